"""From states to what the camera stores of them, one state at a time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import SurfaceState
from isochrome.errors import PhysicsError
from isochrome.optics import expose
from isochrome.scene import Scene
from isochrome.simulate.components import Components, state_components
from isochrome.simulate.model import (
    Picture,
    SceneState,
    make_picture,
    picture_signal,
    refuse_too_fine,
    state_difference,
)
from isochrome.stress import PixelGrid


@dataclass(frozen=True)
class Rendered:
    """A state with its picture and the camera's frames of it (steps, rows, cols[, 3]).

    `components`, of its stress, None where nobody asked.
    """

    state: SceneState
    picture: Picture
    frames: NDArray[np.generic]
    components: Components | None = None


def render(
    scene: Scene, states: Iterable[SceneState], pixels: PixelGrid, *, components: bool = False
) -> Iterator[Rendered]:
    """Render state after state; one is in memory at a time.

    Noise of state i comes from the generator seeded with (camera.seed, i), so that a frame does
    not depend on those before it.
    Parameters: `scene`, with [camera]; `states`, any iterable of them; `pixels`; `components`,
    whether the principal stresses are wanted apart. Yields a Rendered each. Raises PhysicsError
    where a contact is wider than the picture, or fringes are too fine for the pixels.
    """
    assert scene.camera is not None
    steps: list[int | None] = list(range(len(scene.polariscope.step)))
    for index, state in enumerate(states):
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
        yield Rendered(state, picture, np.stack(frames), parts)


def _refuse_too_wide(scene: Scene, surface: SurfaceState, pixels: PixelGrid) -> None:
    width = pixels.cols * pixels.pixel_mm
    if surface.contact_width_mm > width:
        raise PhysicsError(
            f"{scene.name}: the contact is {surface.contact_width_mm:.3g} mm wide, wider than the "
            f"picture ({width:.3g} mm); lower load.normal_n or the wear, or widen the camera"
        )
