"""What scars say against each other, against the load, and against the order of the distances."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from isochrome.calibration.wear.coefficient import SURE, WearLawFit
from isochrome.calibration.wear.settings import WearSet
from isochrome.calibration.wear.worn_volumes import (
    UNLIKELY,
    TraceScar,
    TraceScatter,
    WornVolume,
)
from isochrome.contact import contact_states
from isochrome.errors import InputError, IsochromeError
from isochrome.scene import load_scene, scene_names

Array = NDArray[Any]

_CLEARLY = 3.0
"""Standard uncertainties that are a contradiction."""

_ALIKE = 0.02
"""Difference of a load or a width from the scene's that is none."""

_OWN_WIDTH = 0.03
"""Relative standard uncertainty of a simulated scar's width: where its depth runs out is seen
otherwise in a trace than in the model."""


def contradictions(
    settings: WearSet,
    scars: Sequence[TraceScar],
    volumes: Sequence[WornVolume],
    spread: Array,
    scatter: TraceScatter,
    laws: Sequence[WearLawFit],
    law: str,
) -> tuple[str, ...]:
    """All warnings of a wear calibration, in sentences."""
    return (
        *_of_traces(scars, scatter),
        *_of_order(volumes, spread),
        *_of_laws(volumes, laws, law),
        *_of_inputs(settings, volumes),
        *_of_scene(settings, volumes, laws),
    )


def _of_traces(scars: Sequence[TraceScar], scatter: TraceScatter) -> Iterator[str]:
    for scar in scars:
        if scar.levelled is not None:
            yield from scar.levelled.messages
    unclear = [scar for scar in scars if scar.levelled is None]
    if unclear:
        names = ", ".join(scar.test.file for scar in unclear)
        places = ", ".join(f"{d:g} m" for d in dict.fromkeys(s.test.distance_m for s in unclear))
        yield (
            f"no scar stands out of the roughness in {names}: {places} is left out, with all its "
            "traces; measure longer traces or more of them there"
        )
    if scatter.is_unlikely:
        ratio = np.sqrt(scatter.chi_square / scatter.freedom)
        yield (
            f"the traces of a distance differ {ratio:.1f} times as much as their roughness "
            "explains: the scar is not alike over its width, or a trace belongs to another one; "
            "their scatter is in the uncertainty"
        )


def _of_order(volumes: Sequence[WornVolume], spread: Array) -> Iterator[str]:
    """Less worn, or narrower, where more was slid under as much load."""
    order = np.argsort([volume.work_n_mm for volume in volumes], kind="stable")
    for i, j in pairwise(order):
        one, other = volumes[i], volumes[j]
        if other.work_n_mm <= one.work_n_mm or other.normal_n < one.normal_n:
            continue
        less = one.volume_mm3 - other.volume_mm3
        if less > _CLEARLY * float(np.hypot(spread[i], spread[j])):
            yield (
                f"{other.volume_mm3:.3g} mm³ are worn after {other.place}, less than the "
                f"{one.volume_mm3:.3g} mm³ after {one.place}: check which scar is which"
            )
        before, after = _width(one), _width(other)
        if before is None or after is None:
            continue
        (wide, u_wide), (narrow, u_narrow) = before, after
        if wide - narrow > _CLEARLY * float(np.hypot(u_wide, u_narrow)):
            yield (
                f"the scar after {other.place} is {narrow:.3g} mm wide, narrower than the "
                f"{wide:.3g} mm after {one.place}: check which scar is which, and the loads"
            )


def _width(volume: WornVolume) -> tuple[float, float] | None:
    """Mean width of a volume's scars and its uncertainty, mm."""
    found = [scar.levelled for scar in volume.scars if scar.levelled is not None]
    if not found:
        return None
    own = np.array([np.hypot(*scar.edge_uncertainty_mm) for scar in found])
    return float(np.mean([s.width_mm for s in found])), float(np.sqrt(np.mean(own**2) / len(own)))


def _of_laws(volumes: Sequence[WornVolume], laws: Sequence[WearLawFit], law: str) -> Iterator[str]:
    archard = next(fit for fit in laws if fit.law == "archard")
    if law != "archard":
        best = laws[0]
        more = ""
        if best.first_over_last is not None and best.running_in_distance_m is not None:
            more = (
                f", which begins with {best.first_over_last:.2g} of its last coefficient and runs "
                f"in over {best.running_in_distance_m:.3g} m"
            )
        yield (
            f"the volumes prefer {best.law}{more}, by {-archard.log_evidence:.3g} in ln Z "
            f"({SURE:g} is clear): k = V/(P s) changes with the distance, and one value for all "
            "is a mean"
        )
    if archard.freedom > 0 and chdtrc(archard.freedom, archard.chi_square) < UNLIKELY:
        worst = max(
            volumes,
            key=lambda v: abs(
                v.volume_mm3 - archard.coefficient_mm2_per_n * v.work_n_mm
            ) / (v.own_uncertainty_mm3 if np.isfinite(v.own_uncertainty_mm3) else 1.0),
        )  # fmt: skip
        ratio = worst.volume_mm3 / (archard.coefficient_mm2_per_n * worst.work_n_mm)
        chi = np.sqrt(archard.chi_square / archard.freedom)
        yield (
            f"the distances do not agree on one coefficient: chi = {chi:.1f} where 1 is right, and "
            f"{worst.place} has {ratio:.2f} of the volume that all together give; their scatter is "
            "in the uncertainty"
        )


def _of_inputs(settings: WearSet, volumes: Sequence[WornVolume]) -> Iterator[str]:
    known = settings.uncertainty
    missing = [
        name
        for name, value in (("load", known.load_percent), ("distance", known.distance_percent))
        if value is None
    ]
    if any(volume.scars for volume in volumes):
        missing += [
            name
            for name, value in (
                ("width", known.width_mm),
                ("the profilometer's heights", known.height_percent),
                ("its lateral scale", known.lateral_percent),
            )
            if value is None
        ]
    if missing:
        yield (
            f"no uncertainty is given for {', '.join(missing)}: what the scars show is included, "
            "these are not; add them under [uncertainty]"
        )
    if len(volumes) == 1 and not np.isfinite(volumes[0].own_uncertainty_mm3):
        yield (
            "one volume without an uncertainty: how well it was measured is not in that of k; "
            "write value_mm3 = { value = ..., standard_uncertainty = ... }"
        )


def _of_scene(
    settings: WearSet, volumes: Sequence[WornVolume], laws: Sequence[WearLawFit]
) -> Iterator[str]:
    """Scars against those of a scene's contact, worn with the coefficient that was found."""
    if settings.scar is None or settings.scar.scene is None:
        return
    name = settings.scar.scene
    scene = load_scene(name if name in scene_names() else settings.path(name))
    if scene.indenter is None or scene.load is None or scene.wear is None:
        raise InputError(
            f"{settings.name}: scar.scene = '{name}' has no [indenter], [load] and [wear] to "
            "simulate scars with; name a scene that wears, or remove the key"
        )
    thickness = scene.specimen.thickness_mm
    if thickness is not None and abs(settings.scar.width_mm / thickness - 1.0) > _ALIKE:
        yield (
            f"scar.width_mm = {settings.scar.width_mm:g} and the scene's specimen.thickness_mm = "
            f"{thickness:g}, which is the width that wears; correct one of them"
        )
    archard = next(fit for fit in laws if fit.law == "archard")
    for volume in sorted(volumes, key=lambda v: v.distance_m):
        found = _width(volume)
        if found is None:
            continue
        load = scene.load_at(volume.distance_m)
        if abs(volume.normal_n / load - 1.0) > _ALIKE:
            yield (
                f"normal_n = {volume.normal_n:g} at {volume.place} and the scene's load.normal_n "
                f"= {load:g}; correct one of them"
            )
        wear = {
            "coefficient_mm2_per_n": archard.coefficient_mm2_per_n,
            "law": "archard",
            "distances_m": (volume.distance_m,),
        }
        own = scene.with_values(
            {"load.normal_n": volume.normal_n, **{f"wear.{k}": v for k, v in wear.items()}}
        )
        try:
            state = list(contact_states(own))[-1]
        except IsochromeError as error:
            yield f"the scene's own scar at {volume.place} cannot be computed: {error}"
            continue
        worn = state.grid.x_mm[state.wear_depth_mm > 0.0]
        width = float(worn[-1] - worn[0])
        if abs(found[0] - width) > _CLEARLY * float(np.hypot(found[1], _OWN_WIDTH * width)):
            yield (
                f"the scar at {volume.place} is {found[0]:.3g} mm wide, and {width:.3g} mm in the "
                f"scene with this coefficient and {volume.normal_n:g} N: the load, the radius, or "
                "the scar is another"
            )
