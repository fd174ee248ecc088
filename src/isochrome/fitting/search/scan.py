"""A ladder of solved contacts, each held against few pixels at many values at once.

On the pixels of a picture the stress difference of a contact is nearly a straight line in its
friction, or in its tangential force over the load; a bulk stress adds a constant, and another place
of the contact is another window of a wider picture. So a scan solves no more contacts than it tries
loads. What a signal leaves of the pixels' light is told for all of them by one
elimination of illumination and background (`estimation.linear_costs`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.single_state import is_held, with_numerics, with_part
from isochrome.scene import Scene
from isochrome.simulation import SceneState, scene_states, state_difference
from isochrome.stress import PixelGrid

LOAD_STEP, SHEAR_STEP = 0.19, 0.2
"""Steps of ln P and of the friction, or Q/P, within which a start leads to the next minimum."""

HIDDEN = 1.0 / 13.0
"""Share of the picture's height below the surface where the contact decides what is seen."""
_FRICTION = 0.2
"""What a contact slides with whose own friction says nothing of the shear."""


@dataclass(frozen=True)
class Rung:
    """A solved contact at a `load` (N).

    Its stress difference (rows, cols), MPa: `even`, and `odd`, by one of friction or Q/P.
    """

    load: float
    even: Array
    odd: Array

    def fields(self, shears: Array) -> Array:
        """The differences (m, rows, cols) at some shears (m,)."""
        return np.asarray(self.even + shears[:, None, None].astype(np.float32) * self.odd)


def ladder(widest: float, step: float) -> Array:
    """Factors from 1/widest to widest, about a step of their logarithm apart."""
    end = np.log(widest)
    return np.exp(np.linspace(-end, end, 1 + int(np.ceil(2.0 * end / step))))


def shears_to(limit: float) -> Array:
    """Frictions or Q/P about zero, to `limit` either way, at the middles of equal steps."""
    count = 2 * max(1, int(np.ceil(limit / SHEAR_STEP)))
    return limit * (2.0 * np.arange(count) + 1.0 - count) / count


def rungs(scene: Scene, pixels: PixelGrid, loads: Sequence[float]) -> Iterator[Rung]:
    """The rungs of a one-state scene on some pixels; PhysicsError where none can be solved, with
    the last one's reason.
    """
    solved, reason = False, PhysicsError("contact_cannot_solved_any", name=scene.name)
    shear = _shear(scene)
    for load in loads:
        try:
            one = _loaded(scene, float(load), shear)
            even, odd = _parts(one, scene_states(one)[-1], pixels)
        except InputError:  # a block is not known so far out
            continue
        except PhysicsError as error:
            reason = error
            continue
        solved = True
        yield Rung(float(load), even, odd / np.float32(shear or 1.0))
    if not solved:
        raise reason


def _shear(scene: Scene) -> float:
    """A friction, or Q/P, to solve contacts with."""
    friction = scene.friction_at(0.0) if scene.friction else 0.0
    if is_held(scene):
        return 0.5 * abs(friction)
    return (friction or _FRICTION) if scene.friction else 0.0


def _loaded(scene: Scene, load: float, shear: float) -> Scene:
    """The scene under another load, its contact coarse."""
    one = with_part(scene, "load", normal_n=load)
    if is_held(scene):
        one = with_part(one, "load", tangential_n=shear * load)
    elif scene.friction:
        one = with_part(one, "friction", coefficient=shear)
    return with_numerics(one, nodes_per_pixel=1, tolerance=1e-2)


def _parts(scene: Scene, state: SceneState, pixels: PixelGrid) -> tuple[Array, Array]:
    """The stress difference's part that stays as the shear turns round, and the one that does."""
    here = np.nan_to_num(state_difference(scene, state, pixels))
    if state.surface is None or not state.surface.shear_mpa.any():
        return here, np.zeros_like(here)
    turned = replace(state, surface=replace(state.surface, shear_mpa=-state.surface.shear_mpa))
    back = np.nan_to_num(state_difference(scene, turned, pixels))
    return 0.5 * (here + back), 0.5 * (here - back)
