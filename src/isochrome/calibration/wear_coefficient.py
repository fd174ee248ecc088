"""`calibrate_wear`: from traces and volumes to the wear coefficient, and what they contradict."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from isochrome.calibration.result import CONTRADICTED
from isochrome.calibration.wear_result import (
    WearCalibration,
    WearLawFit,
    WornDistance,
    archard_of,
    fit_laws,
)
from isochrome.calibration.wear_set import (
    TraceScar,
    TraceScatter,
    WearSet,
    WornVolume,
    levelled_of,
    trace_scars,
    worn_volumes,
)
from isochrome.contact import contact_states
from isochrome.errors import InputError, IsochromeError, PhysicsError
from isochrome.estimation import BudgetRow, budget_items
from isochrome.fitting import CLEAR
from isochrome.messages import message
from isochrome.scars import student_factor_of
from isochrome.scene import check_reach, load_scene, scene_names

Array = NDArray[Any]
Volumes = Sequence[WornVolume]


_ALIKE = 0.02
"""Difference of a load or a width from the scene's that is none."""

_OWN_WIDTH = 0.03
"""Relative standard uncertainty of a simulated scar's width: where its depth runs out is seen
otherwise in a trace than in the model."""


def _of_traces(scars: Sequence[TraceScar], scatter: TraceScatter) -> Iterator[str]:
    for trace in levelled_of(scars):
        yield from trace.messages
    unclear = [scar for scar in scars if scar.levelled is None]
    if unclear:
        names = ", ".join(scar.test.file for scar in unclear)
        places = ", ".join(f"{d:g} m" for d in dict.fromkeys(s.test.distance_m for s in unclear))
        yield message("no_scar_stands_out", names=names, places=places)
    if scatter.is_unlikely:
        ratio = np.sqrt(scatter.chi_square / scatter.freedom)
        yield message("traces_distance_differ_times", ratio=ratio)


def _of_order(volumes: Volumes, spread: Array) -> Iterator[str]:
    """Less worn, or narrower, where more was slid under as much load."""
    for i, j in pairwise(np.argsort([volume.work_n_mm for volume in volumes], kind="stable")):
        one, other = volumes[i], volumes[j]
        if other.work_n_mm <= one.work_n_mm or other.normal_n < one.normal_n:
            continue
        less = one.volume_mm3 - other.volume_mm3
        if less > CONTRADICTED * float(np.hypot(spread[i], spread[j])):
            yield message(
                "mm_worn_after_less",
                volume_mm3=other.volume_mm3,
                place=other.place,
                volume_mm3_2=one.volume_mm3,
                place_2=one.place,
            )
        before, after = _width(one), _width(other)
        if before is None or after is None:
            continue
        (wide, u_wide), (narrow, u_narrow) = before, after
        if wide - narrow > CONTRADICTED * float(np.hypot(u_wide, u_narrow)):
            yield message(
                "scar_after_mm_wide", place=other.place, narrow=narrow, wide=wide, place_2=one.place
            )


def _width(volume: WornVolume) -> tuple[float, float] | None:
    """Mean width of a volume's scars and its uncertainty, mm."""
    traces = levelled_of(volume.scars)
    if not traces:
        return None
    spreads = np.array([np.hypot(*trace.edge_uncertainty_mm) for trace in traces])
    width = float(np.mean([trace.width_mm for trace in traces]))
    return width, float(np.sqrt(np.mean(spreads**2) / len(spreads)))


def _of_laws(volumes: Volumes, laws: Sequence[WearLawFit], law: str) -> Iterator[str]:
    archard = archard_of(laws)
    if law != "archard":
        best, more, evidence = laws[0], "", -archard.log_evidence
        if best.first_over_last is not None and best.running_in_distance_m is not None:
            more = message(
                "which_begins_last_coefficient",
                first_over_last=best.first_over_last,
                running_in_distance_m=best.running_in_distance_m,
            )
        yield message(
            "volumes_prefer_ln_clear", law=best.law, more=more, log_evidence=evidence, sure=CLEAR
        )
    if archard.is_unlikely:
        worst = max(
            volumes,
            key=lambda v: abs(
                v.volume_mm3 - archard.coefficient_mm2_per_n * v.work_n_mm
            ) / (v.own_uncertainty_mm3 if np.isfinite(v.own_uncertainty_mm3) else 1.0),
        )  # fmt: skip
        ratio = worst.volume_mm3 / (archard.coefficient_mm2_per_n * worst.work_n_mm)
        chi = np.sqrt(archard.chi_square / archard.freedom)
        yield message("distances_do_not_agree", chi=chi, place=worst.place, ratio=ratio)


def _of_inputs(settings: WearSet, volumes: Volumes) -> Iterator[str]:
    known = settings.uncertainty
    stated = {"load": known.load_percent, "distance": known.distance_percent}
    if any(volume.scars for volume in volumes):
        stated["width"] = known.width_mm
        stated["the profilometer's heights"] = known.height_percent
        stated["its lateral scale"] = known.lateral_percent
    missing = [name for name, value in stated.items() if value is None]
    if missing:
        yield message("no_uncertainty_given_what_scars", missing=", ".join(missing))
    if len(volumes) == 1 and not np.isfinite(volumes[0].own_uncertainty_mm3):
        yield message("one_volume_without_uncertainty")


def _of_scene(settings: WearSet, volumes: Volumes, laws: Sequence[WearLawFit]) -> Iterator[str]:
    """Scars against those of a scene's contact, worn with the coefficient that was found."""
    if settings.scar is None or settings.scar.scene is None:
        return
    name = settings.scar.scene
    scene = load_scene(name if name in scene_names() else settings.path(name))
    if scene.indenter is None or scene.load is None or scene.wear is None:
        raise InputError("scar_scene_has_no", name=settings.name, name_2=name)
    thickness = scene.specimen.thickness_mm
    if thickness is not None and abs(settings.scar.width_mm / thickness - 1.0) > _ALIKE:
        yield message(
            "scar_width_mm_scene_specimen", width_mm=settings.scar.width_mm, thickness=thickness
        )
    for volume in sorted(volumes, key=lambda v: v.distance_m):
        measured = _width(volume)
        if measured is None:
            continue
        place, load = volume.place, scene.load_at(volume.distance_m)
        if abs(volume.normal_n / load - 1.0) > _ALIKE:
            yield message(
                "normal_n_scene_load_normal_n", normal_n=volume.normal_n, place=place, load=load
            )
        worn_scene = scene.with_values({
            "load.normal_n": volume.normal_n,
            "wear.coefficient_mm2_per_n": archard_of(laws).coefficient_mm2_per_n,
            "wear.law": "archard",
            "wear.distances_m": (volume.distance_m,),
        })  # fmt: skip
        try:
            state = list(contact_states(worn_scene))[-1]
        except IsochromeError as error:
            yield message("scene_own_scar_cannot", place=place, error=error)
            continue
        worn = state.grid.x_mm[state.wear_depth_mm > 0.0]
        (scar, spread), width, load = measured, float(worn[-1] - worn[0]), volume.normal_n
        if abs(scar - width) > CONTRADICTED * float(np.hypot(spread, _OWN_WIDTH * width)):
            yield message("scar_mm_wide_mm", place=place, measured=scar, width=width, normal_n=load)


_PLAUSIBLE = 1e-15, 1e-1
"""Coefficients (mm²/N) from diamond to chalk, with room on both sides."""


def calibrate_wear(settings: str | Path | WearSet) -> WearCalibration:
    """Calibrate the wear coefficient from measured scars.

    k = V/(P s), equation 11 of the paper, at each distance and for all of them by their weights; V
    of traces is the mean worn area times the scar's width. What other laws give, and which of them
    the volumes speak for, stands beside.

    Parameters
    ----------
    settings : str, Path or WearSet
        The calibration set, a TOML file: [scar], [[trace]] or [[volume]], [uncertainty].

    Returns
    -------
    WearCalibration
        The coefficient with its uncertainty, budget, laws, distances and warnings.

    Raises
    ------
    InputError
        Where the set or a trace is wrong; it names the file, the key or line, and the fix.
    PhysicsError
        Where no trace shows a scar, or nothing was worn.

    Notes
    -----
    Source: Archard (1953), J. Appl. Phys. 24, 981; JCGM 100:2008 (GUM), 5.1 and G.4, for the
    uncertainty and its degrees of freedom.

    Examples
    --------
    >>> import isochrome
    >>> from isochrome.calibration import WearSet
    >>> volume = {"distance_m": 155.0, "normal_n": 44.0, "value_mm3": 0.01364}
    >>> found = isochrome.calibrate_wear(WearSet(volume=[volume]))
    >>> round(found.coefficient_mm2_per_n / 1e-9, 6)
    2.0
    """
    given = WearSet.read(settings)
    if given is not settings:
        check_reach(given.model_dump(exclude_unset=True), given.name)
    scars = trace_scars(given)
    volumes, scatter = worn_volumes(given, scars)
    if not volumes:
        why = next(scar.why_not for scar in scars if scar.why_not)
        raise PhysicsError("no_distance_has_traces", name=given.name, scars=why)
    spread = _own_spread(volumes)
    laws = fit_laws(volumes, spread)
    archard = archard_of(laws)
    k = archard.coefficient_mm2_per_n
    least, most = _PLAUSIBLE
    if not least <= k <= most:
        raise InputError(
            "scars_give_mm_where", name=given.name, k=k, plausible=least, plausible_2=most
        )
    scattered = _has_scatter_only(volumes)
    # of the square scatter over its degrees of freedom, in what the shoulders promise
    square = archard.chi_square * scatter.factor + scatter.chi_square
    count = 0 if scattered else archard.freedom + scatter.freedom
    rows = _own_rows(volumes, spread, archard) + common_inputs(given, volumes, spread, k)
    budget, total = budget_items(rows), _joined(np.array([u * c for _, _, u, c in rows]))
    freedom = _freedom(volumes, scatter, archard, spread, total)
    reach = _reach(freedom, total, scattered=scattered)
    law = "archard" if archard.log_evidence > -CLEAR else laws[0].law
    return WearCalibration(
        coefficient_mm2_per_n=k,
        standard_uncertainty=total,
        degrees_of_freedom=freedom,
        interval_95=(k - reach, k + reach),
        chi=float(np.sqrt(square / count)) if count > 0 else None,
        law=law,
        laws=laws,
        by_distance=_by_distance(given, volumes, spread),
        traces=scars,
        budget=budget,
        warnings=(
            *_of_traces(scars, scatter),
            *_of_order(volumes, spread),
            *_of_laws(volumes, laws, law),
            *_of_inputs(given, volumes),
            *_of_scene(given, volumes, laws),
        ),
    )


def _own_spread(volumes: Volumes) -> Array:
    """Standard uncertainties of the volumes' own errors (n,), mm³.

    Of volumes without one, all alike: their scatter about V = k P s, since a volume's error is
    roughness and levelling, which the distance does not change; at least that of rounding.
    """
    spread = np.array([volume.own_uncertainty_mm3 for volume in volumes])
    if np.isfinite(spread).all():
        return np.asarray(np.maximum(spread, 1e-12 * max(v.volume_mm3 for v in volumes)))
    values = np.array([volume.volume_mm3 for volume in volumes])
    work = np.array([volume.work_n_mm for volume in volumes])
    residual = values - work * (work @ values) / (work @ work)
    size = float(np.sqrt(residual @ residual / max(len(values) - 1, 1)))
    return np.full(len(values), max(size, 1e-12 * float(values.max())))


def _has_scatter_only(volumes: Volumes) -> bool:
    return not all(np.isfinite(volume.own_uncertainty_mm3) for volume in volumes)


def _weights(volumes: Volumes, spread: Array) -> Array:
    """dk/dV of Archard's law (n,), 1/(N mm)."""
    work = np.array([volume.work_n_mm for volume in volumes])
    return np.asarray(work / spread**2 / np.sum((work / spread) ** 2))


def _own_rows(volumes: Volumes, spread: Array, archard: WearLawFit) -> list[BudgetRow]:
    """What the volumes' own errors add to k."""
    weights = _weights(volumes, spread)
    traced = np.array([bool(volume.scars) for volume in volumes])
    parts = {
        "roughness": np.array([volume.roughness_mm3 for volume in volumes]),
        "levelling": np.array([volume.levelling_mm3 for volume in volumes]),
    }
    promised = np.sqrt(sum(part**2 for part in parts.values()))
    # less scatter than was promised makes both parts less, more of it is a part of its own
    share = np.minimum(1.0, np.divide(spread, promised, out=np.ones_like(spread), where=traced))
    rows: list[BudgetRow] = []
    if traced.any():
        rows += [(n, None, _joined(weights * part * share), 1.0) for n, part in parts.items()]
        more = np.sqrt(np.maximum(spread**2 - promised**2, 0.0)) * traced
        rows.append(("scatter of the traces", None, _joined(weights * more), 1.0))
    if not traced.all():
        name = "scatter of the volumes" if _has_scatter_only(volumes) else "volumes"
        rows.append((name, None, _joined(weights * spread * ~traced), 1.0))
    if archard.is_unlikely and not _has_scatter_only(volumes):
        wider = archard.own_uncertainty * np.sqrt(archard.chi_square / archard.freedom - 1.0)
        rows.append(("scatter of the distances", None, float(wider), 1.0))
    return rows


def _joined(parts: Array) -> float:
    return float(np.sqrt(np.sum(parts**2)))


def common_inputs(settings: WearSet, volumes: Volumes, spread: Array, k: float) -> list[BudgetRow]:
    """What the inputs common to all add to k.

    k goes as 1/P and 1/s, and its part by traces as the width and the profilometer's two scales.
    """
    known = settings.uncertainty
    by_traces = np.array([bool(volume.scars) for volume in volumes])
    part = _weights(volumes, spread) * np.array([v.volume_mm3 for v in volumes])
    traced = float(part[by_traces].sum())
    load, slid = volumes[0].normal_n, volumes[0].distance_m
    rows: list[BudgetRow] = []
    if known.load_percent:
        rows.append(("normal_n", load, load * known.load_percent / 100.0, -k / load))
    if known.distance_percent:
        rows.append(("distance_m", slid, slid * known.distance_percent / 100.0, -k / slid))
    if settings.scar is not None and by_traces.any():
        width = settings.scar.width_mm
        if known.width_mm:
            rows.append(("scar.width_mm", width, known.width_mm, traced / width))
        if known.height_percent:
            rows.append(("profilometer's height scale", 1.0, known.height_percent / 100.0, traced))
        if known.lateral_percent:
            share = known.lateral_percent / 100.0
            rows.append(("profilometer's lateral scale", 1.0, share, traced))
    return rows


def _freedom(
    volumes: Volumes, scatter: TraceScatter, archard: WearLawFit, spread: Array, total: float
) -> float:
    """Effective degrees of freedom by Welch and Satterthwaite (JCGM 100:2008, G.4)."""
    if not total > 0.0:
        return np.inf
    if _has_scatter_only(volumes):
        part, freedom = archard.own_uncertainty, float(max(archard.freedom, 1))
    else:
        weights = _weights(volumes, spread)
        traced = np.array([bool(volume.scars) for volume in volumes])
        part, freedom = _joined((weights * spread)[traced]), scatter.degrees_of_freedom
    return freedom * (total / part) ** 4 if part > 0.0 and np.isfinite(freedom) else np.inf


def _reach(freedom: float, total: float, *, scattered: bool) -> float:
    """Half the interval that holds the coefficient with 95 %, by Student's t.

    `total` is the standard deviation of that distribution, its scale times (ν/(ν - 2))^(1/2); of
    volumes that are known by their scatter alone it is the scale itself (JCGM 100:2008, 4.2.3).
    """
    if not np.isfinite(freedom):
        return 1.959964 * total
    scale = total if scattered else total / np.sqrt(student_factor_of(freedom))
    return float(stdtrit(freedom, 0.975) * scale)


def _by_distance(settings: WearSet, volumes: Volumes, spread: Array) -> tuple[WornDistance, ...]:
    """Each distance's coefficient, with what all share in its uncertainty."""
    rows = []
    for volume, noise in zip(volumes, spread, strict=True):
        k = volume.volume_mm3 / volume.work_n_mm
        shared = common_inputs(settings, [volume], np.array([noise]), k)
        of_scale = [u * c for name, _, u, c in shared if name not in ("normal_n", "distance_m")]
        u_volume = float(np.hypot(noise, volume.work_n_mm * _joined(np.array(of_scale))))
        parts = np.array([noise / volume.work_n_mm, *(u * c for _, _, u, c in shared)])
        rows.append(WornDistance(volume, u_volume, k, _joined(parts)))
    return tuple(sorted(rows, key=lambda row: row.volume.distance_m))
