"""What a scene states of its measured numbers: priors of a fit, or inputs of its budget."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from isochrome.errors import InputError
from isochrome.estimation import Prior
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.unknowns import BLUR, GAMMA, LEFT, LENS, TOP, WEAR
from isochrome.scene import Scene

PIXEL = "camera.pixel_mm"
_FOLLOWED = (LEFT, TOP, PIXEL, BLUR, GAMMA, *LENS)
"""What fringes follow of the camera and the frames; all measured numbers of other tables."""

_MATTER = (
    PIXEL, "specimen.thickness_mm", "specimen.fringe_value_n_per_mm", "load.normal_n",
    "specimen.diameter_mm", "specimen.hole_mm", "specimen.height_mm", "specimen.width_mm",
    "load.inner_span_mm", "load.outer_span_mm", "indenter.radius_mm", "indenter.half_width_mm",
    "specimen.young_gpa", "indenter.young_gpa", "specimen.poisson", "indenter.poisson",
    "load.tangential_n", "load.bulk_mpa", "friction.coefficient", WEAR, LEFT, TOP,
)  # fmt: skip
"""Measured numbers that the fringes of some scene follow, those that move a load most first."""

_OF_CONTACT = ("specimen.young_gpa", "specimen.poisson")
_OF_BLOCK = ("specimen.height_mm", "specimen.width_mm")


@dataclass(frozen=True)
class StatedInputs:
    """Measured numbers with their uncertainties: `keys` (m,), `values` (m,), `spread` (m,)."""

    keys: tuple[str, ...]
    values: Array
    spread: Array

    def prior(self, keys: tuple[str, ...]) -> Prior:
        """The prior of some unknowns (p,)."""
        at = {key: k for k, key in enumerate(self.keys)}
        values, weight = np.zeros(len(keys)), np.zeros(len(keys))
        for j, key in enumerate(keys):
            if key in at:
                values[j], weight[j] = self.values[at[key]], self.spread[at[key]] ** -2.0
        return Prior(values, weight)

    def some(self, keys: tuple[str, ...], *, free: bool) -> StatedInputs:
        """Those that are unknowns of a fit, among `keys`, or those that it holds."""
        chosen = [k for k, key in enumerate(self.keys) if (key in keys) == free]
        return StatedInputs(
            tuple(self.keys[k] for k in chosen), self.values[chosen], self.spread[chosen]
        )

    @property
    def rows(self) -> tuple[tuple[str, float, float], ...]:
        """Key, value and standard uncertainty of each, as plain numbers."""
        columns = self.keys, self.values.tolist(), self.spread.tolist()
        return tuple(zip(*columns, strict=True))


def stated_inputs(scene: Scene, given: Scene | None = None) -> StatedInputs:
    """The measured numbers of a scene that have an uncertainty and move its fringes.

    Parameters: `scene`; `given`, what one frame's scene was made of, whose wear may be counted by
    another law. A key that the scene has not, or has as a table, is none of them.
    """
    entries = []
    for key, spread in scene.uncertainties.items():
        try:
            value = scene.get(key)
        except InputError:
            continue
        outside = key.split(".")[0] in ("camera", "frames") and key not in _FOLLOWED
        if key == WEAR and given is not None and isinstance(value, int | float):
            stated = given.get(key)
            spread *= value / stated if isinstance(stated, float) and stated else 0.0
        if spread > 0.0 and isinstance(value, int | float) and not outside:
            entries.append((key, float(value), spread))
    return inputs_of_rows(entries)


def stated_pairs(scene: Scene) -> dict[str, tuple[float, float]]:
    """Give what a scene states with an uncertainty and its fringes follow.

    Parameters
    ----------
    scene : Scene
        The scene.

    Returns
    -------
    dict of str to tuple of two floats
        Key to value and standard uncertainty.
    """
    return {key: (value, spread) for key, value, spread in stated_inputs(scene).rows}


def inputs_of_rows(rows: Iterable[tuple[str, float, float]]) -> StatedInputs:
    """Stated inputs from their keys, values and standard uncertainties."""
    columns = tuple(zip(*rows, strict=True))
    keys, values, spread = columns or ((), (), ())
    return StatedInputs(tuple(keys), np.array(values, float), np.array(spread, float))


def taken_as_exact(
    scene: Scene, keys: tuple[str, ...], *, tracked: bool = False
) -> tuple[str, ...]:
    """Name the measured numbers that move a scene's fringes, and that a fit takes as exact.

    Numbers with a stated uncertainty, 0 too, are none of them, but for a track.

    Parameters
    ----------
    scene : Scene
        The scene.
    keys : tuple of str
        The fit's unknowns.
    tracked : bool, default False
        Whether its ± leave out what the scene states of others.

    Returns
    -------
    tuple of str
        Their keys, those that move a load most first.
    """
    exact = []
    counted = () if tracked else scene.uncertainties
    for key in _MATTER:
        if key in keys or key in counted or not _is_used(scene, key):
            continue
        try:
            value = scene.get(key)
        except InputError:
            continue
        if value is not None:
            exact.append(key)
    return tuple(exact)


def _is_used(scene: Scene, key: str) -> bool:
    """Whether a scene's model has a key in it."""
    contact = scene.is_contact
    if key in _OF_CONTACT:
        return contact
    if key in _OF_BLOCK:
        return not contact or scene.specimen.shape is not None
    if key == WEAR and scene.wear is not None and scene.frames.sliding_speed_mm_per_s is None:
        return max(scene.wear.distances_m) > 0.0
    return True
