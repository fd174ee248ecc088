"""Measured scars as observations of a fit, beside the frames: the worn area at a distance.

A contact that is in equilibrium wears W(s) = ∫ P' dK whatever its shape, so a scar's area tells of
load, friction and wear coefficient without a contact being solved:

    cost += Σ ((A - W(s))/u)²

with A a trace's worn area and u its standard uncertainty, of roughness and levelling. How well the
traces' spectra are known widens u by Student's factor, of all traces' degrees of freedom together.
Source: Archard (1953), J. Appl. Phys. 24, 981.
"""

import numpy as np

from isochrome.errors import InputError
from isochrome.fitting.arrays import Array
from isochrome.fitting.joint.frame_sequence import MeasuredArea, Sequence, local_values
from isochrome.fitting.joint.normal_equations import NormalEquations, local_slopes
from isochrome.messages import message
from isochrome.output import with_uncertainty
from isochrome.scars import LevelledTrace, levelled, read_trace, student_factor_of
from isochrome.scene import Scene

_WEARING = ("specimen", "load", "friction", "wear")
"""Parts of a scene that the worn area goes with."""
_CONTRADICTS = 3.0
"""Standard uncertainties beyond which a scar contradicts the fit."""


def refuse_scars(sequence: Sequence) -> None:
    """Raise InputError where a sequence's frames do not show the wear that a scar measures."""
    if not sequence.run:
        raise InputError("scar_measured_one_run", name=sequence.scene.name)


def measured_areas(scene: Scene) -> tuple[MeasuredArea, ...]:
    """Read the worn areas of a scene's [[scar]].

    Raises InputError for a trace that cannot be read or levelled, PhysicsError where one shows no
    scar.
    """
    traces = [levelled(read_trace(scene.path(scar.file))) for scar in scene.scar]
    return tuple(
        MeasuredArea(scar.file, scar.distance_m, trace.worn_area_mm2, spread, trace.messages)
        for scar, trace, spread in zip(scene.scar, traces, _spreads(traces), strict=True)
    )


def _spreads(traces: list[LevelledTrace]) -> list[float]:
    """The standard uncertainties of traces' worn areas beside each other, mm².

    Student's factor is that of their weighted mean, with 1 / Σ share² / ν degrees of freedom: of
    each alone it would count the noise's scale over again. Source: Welch (1947), Biometrika 34, 28;
    Satterthwaite (1946), Biometrics Bull. 2, 110.
    """
    if not traces:
        return []
    variance = np.array([t.worn_area_uncertainty_mm2**2 / t.student_factor for t in traces])
    share = (1.0 / variance) / np.sum(1.0 / variance)
    freedom = 1.0 / np.sum(share**2 / np.array([t.degrees_of_freedom for t in traces]))
    return list(np.sqrt(variance * student_factor_of(float(freedom))).tolist())


def scar_rows(sequence: Sequence, values: Array) -> tuple[Array, Array]:
    """Derivatives dW/dv (p, m) of a sequence's worn areas, and A - W (m,), both over u."""
    areas = sequence.areas
    distances = tuple(area.distance_m for area in areas)
    spread = np.array([area.standard_uncertainty_mm2 for area in areas])
    local = local_values(sequence.whole(values), distances)
    residual = (np.array([area.area_mm2 for area in areas]) - local[:, 2]) / spread
    wearing = {u.key for u in sequence.unknowns if u.key.split(".")[0] in _WEARING}
    return local_slopes(sequence, values, distances, local, wearing)[..., 2] / spread, residual


def scar_equations(sequence: Sequence, values: Array) -> NormalEquations:
    """The normal equations of a sequence's measured areas at some values (p,) of its unknowns."""
    rows, residual = scar_rows(sequence, values)
    normal = rows @ rows.T
    return NormalEquations(
        normal=normal,
        middle=normal,
        gradient=rows @ residual,
        squares=np.diag(normal).copy(),
        cost=float(residual @ residual),
        freedom=residual.size,
        positive=(),
        chi=(),
    )


def scar_messages(areas: tuple[MeasuredArea, ...], scene: Scene) -> tuple[str, ...]:
    """What to say of measured areas beside those of a fitted scene."""
    if not areas:
        return ()
    worn = local_values(scene, tuple(area.distance_m for area in areas))[:, 2]
    messages = [text for area in areas for text in area.messages]
    for area, model in zip(areas, worn.tolist(), strict=True):
        away = abs(area.area_mm2 - model) / area.standard_uncertainty_mm2
        if away > _CONTRADICTS:
            measured = with_uncertainty(area.area_mm2, area.standard_uncertainty_mm2)
            messages.append(
                message(
                    "worn_area_mm_fitted", name=area.name, measured=measured, model=model, away=away
                )
            )
    return tuple(messages)
