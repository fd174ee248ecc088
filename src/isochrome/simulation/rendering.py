"""From states to what the camera stores of them, one state at a time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import SurfaceState
from isochrome.errors import PhysicsError
from isochrome.optics import expose, fringe_order
from isochrome.scene import Scene
from isochrome.simulation.components import Components, state_components
from isochrome.simulation.model import (
    Picture,
    SceneState,
    make_picture,
    picture_signal,
    refuse_too_fine,
    state_difference,
)
from isochrome.specimens import specimen_model
from isochrome.stress import PixelGrid


@dataclass(frozen=True)
class Rendered:
    """A state with its picture and the camera's frames of it."""

    state: SceneState
    picture: Picture
    frames: NDArray[np.generic]  # grey levels, (steps, rows, cols[, 3])
    components: Components | None = None  # of its stress; None: nobody asked
    # largest change of the order in view by the sides of a block; None: a half-plane
    block_order: float | None = None


def render(
    scene: Scene,
    states: Iterable[SceneState],
    pixels: PixelGrid,
    *,
    components: bool = False,
    first: int = 0,
) -> Iterator[Rendered]:
    """Render state after state; one is in memory at a time.

    Noise of state i, counted from `first`, is seeded with (camera.seed, i), so that a frame does
    not depend on those before it. PhysicsError where a contact is wider than the picture, or
    fringes are too fine for the pixels.
    """
    assert scene.camera is not None
    steps: list[int | None] = list(range(len(scene.polariscope.step)))
    for index, state in enumerate(states, first):
        if state.surface is not None:
            _refuse_too_wide(scene, state.surface, pixels)
        picture = make_picture(scene, state_difference(scene, state, pixels), pixels)
        refuse_too_fine(scene, picture)
        rng = np.random.default_rng([scene.camera.seed, index])
        frames = [
            expose(picture_signal(scene, picture, step), scene.camera, rng=rng)
            for step in steps or [None]
        ]
        parts = state_components(scene, state, picture, pixels) if components else None
        yield Rendered(state, picture, np.stack(frames), parts, _block_order(scene, state, pixels))


def _block_order(scene: Scene, state: SceneState, pixels: PixelGrid) -> float | None:
    """How far a half-plane would be off, in fringes: the most that a block's sides add in view."""
    if state.surface is None:
        return None
    added = specimen_model(scene).side_stress(scene, state.surface, pixels)
    if added is None:
        return None
    few = pixels.every(max(1, min(pixels.rows, pixels.cols) // 32))  # smooth: no pixel differs
    x, z = few.places
    order = fringe_order(
        added.difference(x, np.maximum(z, 0.0)),
        thickness_mm=scene.specimen.thickness_mm or 0.0,
        fringe_value_n_per_mm=scene.specimen.fringe_value_n_per_mm or 0.0,
    )
    return float(order.max())


def _refuse_too_wide(scene: Scene, surface: SurfaceState, pixels: PixelGrid) -> None:
    width = pixels.cols * pixels.pixel_mm
    if surface.contact_width_mm > width:
        raise PhysicsError(
            f"{scene.name}: the contact is {surface.contact_width_mm:.3g} mm wide, wider than the "
            f"picture ({width:.3g} mm); lower load.normal_n or the wear, or widen the camera"
        )
