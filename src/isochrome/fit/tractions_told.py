"""What is to be said of tractions found in a frame: where they may be wrong, in plain words."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.tractions_basis import picture_unit
from isochrome.fit.tractions_course import GOOD_CHI
from isochrome.fit.tractions_stage import Stage

Array = NDArray[Any]

_BLOCK = 32
_FEW = 60
"""Bins in a block below which its chi is too uncertain."""
_LOCAL_CHI = 1.5
"""Chi of a block of 60 bins has a standard deviation of 0.09: this one is no noise."""
_NEARLY = 1.1
_SAME_LOAD = 0.005
_UNCERTAIN = 0.01
_LIMITED = 0.1


def what_to_say(stage: Stage, begun: list[Stage], load: tuple[float, float]) -> tuple[str, ...]:
    """Warnings about an inversion.

    Parameters: `stage`, the last; `begun`, the first stages from all beginnings, the one that was
    followed first; `load`, the resultant and its standard uncertainty (N). Returns sentences.
    """
    found = []
    chi, worst = stage.solution.chi, local_chi(stage)
    if chi > GOOD_CHI:
        found.append(
            f"chi = {chi:.2f}: no tractions on a half-plane describe this frame within its noise, "
            "and the result may be wrong; check camera.top_mm (or free it), frames.gamma, the "
            "plates and the region of interest"
        )
    elif worst > _LOCAL_CHI:
        found.append(
            f"chi = {worst:.2f} in one place near the surface: the tractions there may be wrong"
        )
    if not stage.solution.converged:
        found.append("the inversion did not converge fully")
    rivals = [one for one in begun[1:] if one.solution.chi < _NEARLY * begun[0].solution.chi]
    if any(_differ(one, begun[0]) for one in rivals):
        found.append(
            "other resultants explain the deep fringes nearly as well; give the load more closely"
        )
    if load[1] > _UNCERTAIN * load[0]:
        found.append(
            f"the load is determined to {100 * load[1] / load[0]:.1f} % only: more of the field "
            "below the contact must be in view"
        )
    return (*found, *_of_the_surface(stage))


def _of_the_surface(stage: Stage) -> list[str]:
    """What to say where the tractions touch their limits."""
    basis, c, pixels = stage.basis, stage.solution.unknowns, stage.problem.pixels
    pressure, shear = basis.tractions(c)
    found = []
    touching = np.abs(shear) > (1.0 - 1e-9) * basis.limit * pressure
    share = pressure[touching & (pressure > 0.0)].sum() / max(pressure.sum(), 1e-300)
    if share > _LIMITED:
        found.append(
            f"|q| = {basis.limit:g} p, the largest friction allowed for, over "
            f"{100 * share:.0f} % of the load: the shear is held back by that limit"
        )
    reach = 2 * basis.spacing_px
    pressed = basis.nodes_px[pressure > 0.0]
    if len(pressed) and (pressed[0] < reach or pressed[-1] > pixels.cols - reach):
        found.append(
            "the pressure reaches the picture's side: what presses beyond it is not in the load"
        )
    return found


def _differ(one: Stage, other: Stage) -> bool:
    loads = [float(s.basis.tractions(s.solution.unknowns)[0].sum()) for s in (one, other)]
    return abs(loads[0] - loads[1]) > _SAME_LOAD * max(loads)


def local_chi(stage: Stage) -> float:
    """The largest chi of a block of 32 x 32 bins; 0 where no block has enough of them."""
    bins, unit = stage.problem.bins, picture_unit(stage.problem.pixels)
    size = _BLOCK * unit * bins.side
    place = np.stack([bins.side, bins.row // size, bins.col // size])
    block = np.unique(place, axis=1, return_inverse=True)[1].ravel()
    count = np.bincount(block)
    square = np.bincount(block, weights=np.square(stage.solution.residual))
    enough = count >= _FEW
    return float(np.sqrt((square[enough] / count[enough]).max())) if enough.any() else 0.0
