r"""The order nought of free corners, carried to where the fringes are followed.

Between two free sides of an outward corner no stress is left: N rises from it as r^p. For stress
functions r^(p+2) the sides are free where sin(2 lambda a) = -lambda sin(2 a), lambda = p + 1, of
the interior angle 2 a, so that p = 1.74 at 90 degrees, 1.27 at 110, and 1 at 126.
Source: Williams (1952), J. Appl. Mech. 19, 526.

The nearest patch that is followed lies some pixels away. On the way to it N starts at nought and
changes by less than a quarter as long as the light c = cos 2 pi N stays dark, c > 0: so the corner
says the patch's whole number where all of the way is seen to be dark. Within the few pixels that a
blurred or masked edge hides, N is less than their distance times its slope beyond them, as p > 1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from isochrome.fringes.single_frame.patch_labels import Labels
from isochrome.fringes.single_frame.patches import HALF, Patches
from isochrome.fringes.single_frame.stated_orders import KnownPlaces
from isochrome.fringes.windows import Array, Mask
from isochrome.scene import FreeCorner

_REACH_PX = 30.0
"""How far from a corner a patch is looked for."""
_HIDDEN_PX = float(HALF)
"""What an edge may hide of the way."""
_HIDDEN_RISE = 0.5
"""Fringes by which the order may at most have risen there: less than the next dark."""
_DARK = 0.3
"""The light c above which the order is within 0.2 of a whole number."""
_POOLED_PX = 1.5
_BESIDE_DEG, _FEWEST = 20.0, 3
"""Angle beyond the corner's sides, and patches there, that are no specimen's."""


def corner_orders(
    corners: Sequence[FreeCorner], patches: Patches, labels: Labels, wave: Array, valid: Mask
) -> tuple[list[KnownPlaces], list[str]]:
    """Known orders of patches beside free corners, and what to say where there is none.

    Parameters: `corners`; `patches` and their `labels`; `wave`, the light c (rows, cols); `valid`,
    True = trusted (rows, cols).
    """
    known, said = [], []
    trusted = gaussian_filter(valid.astype(float), _POOLED_PX)
    pooled = gaussian_filter(np.where(valid, wave, 0.0), _POOLED_PX) / np.maximum(trusted, 1e-9)
    light = np.where(valid, pooled, np.nan)
    for corner in corners:
        found = _carried(corner, patches, labels, light)
        name = f"frames.free_boundary, corner at row {corner.row:g}, column {corner.col:g}"
        if isinstance(found, str):
            said.append(f"{name}: {found}; it is not used")
            continue
        order = abs(patches.terms[found][0] - round(patches.terms[found][0]))
        place = float(patches.rows[found[0]]), float(patches.cols[found[1]])
        known.append(KnownPlaces((place,), round(float(order), 2), name, says_zero_line=False))
    return known, said


def _carried(
    corner: FreeCorner, patches: Patches, labels: Labels, light: Array
) -> tuple[int, int] | str:
    """The followed patch to which the light carries a corner's order, or why there is none."""
    down, right = patches.rows[:, None] - corner.row, patches.cols[None, :] - corner.col
    away = np.maximum(np.hypot(down, right), 1e-9)
    cosine = np.clip((down * corner.inward[0] + right * corner.inward[1]) / away, -1.0, 1.0)
    beside = np.degrees(np.arccos(cosine)) - 0.5 * corner.angle_deg
    near = (labels.part >= 0) & (away < _REACH_PX)
    if np.count_nonzero(near & (beside > _BESIDE_DEG)) >= _FEWEST:
        return "fringes are followed outside of it; mask what is not the specimen"
    inside = near & (beside < 0.0)
    if not inside.any():
        return f"no fringe could be followed within {_REACH_PX:g} px of it"
    i, j = np.unravel_index(np.where(inside, away, np.inf).argmin(), away.shape)
    steps = np.arange(0.0, float(away[i, j]) + 0.5, 0.5) / float(away[i, j])
    way = [corner.row + steps * down[i, 0], corner.col + steps * right[0, j]]
    seen = map_coordinates(light, way, order=0, mode="constant", cval=np.nan)
    first = int(np.isfinite(seen).argmax())
    hidden = 0.5 * first
    steepest = float(np.hypot(*patches.terms[inside][:, 1:3].T).max())
    if not np.isfinite(seen[first:]).all() or hidden > _HIDDEN_PX:
        return "pixels between it and the next fringes are not trusted"
    if hidden * steepest > _HIDDEN_RISE:
        return "fringes beside it are too dense for what its edge hides"
    if seen[first:].min() < _DARK:
        return (
            "the light beside it is not that of order 0, which a corner between free sides has; "
            "check that it is free, and its place"
        )
    return int(i), int(j)
