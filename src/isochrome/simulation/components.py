"""The principal stresses apart, and the largest shear with its place: only when asked for.

Fringes show the difference of the principal stresses alone; the model has both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.scene import Scene
from isochrome.simulation.model import Picture, SceneState
from isochrome.specimens import specimen_model
from isochrome.stress import PixelGrid, ShearPeak, principal_direction

LAYERS = ("sigma_1", "sigma_2", "sigma_1_direction", "sigma_x", "sigma_z", "tau_xz")
"""Names of the maps that `simulate` leaves: MPa, the direction in degrees."""


@dataclass(frozen=True)
class Components:
    """All that the model knows of one state's stress.

    `maps`, each of LAYERS by its name (rows, cols), float32, NaN outside the material; `peak`, the
    largest shear in the material in view, its surface included (under point
    loads, which make it infinite, that at the pixels' centres).
    """

    maps: dict[str, NDArray[np.float32]]
    peak: ShearPeak


def state_components(
    scene: Scene, state: SceneState, picture: Picture, pixels: PixelGrid
) -> Components:
    """Stress components, principal stresses and the largest shear of one state.

    Parameters: `scene`, `state`; its `picture`, for the material; `pixels`. Returns Components.
    Equations: sigma_1,2 = (sigma_x + sigma_z)/2 ± |(sigma_x - sigma_z) + 2i tau_xz|/2; direction of
    sigma_1 counter-clockwise from the image's +x, -90 to 90. Source: Timoshenko & Goodier (1970),
    section 9.
    """
    model = specimen_model(scene)
    stress = model.components(scene, state.surface, pixels)
    first, second = stress.principal
    direction = np.degrees(principal_direction(stress.difference))
    arrays = (first, second, direction, stress.sigma_x, stress.sigma_z, stress.tau_xz)
    maps = {
        name: np.where(picture.material, array, np.nan).astype(np.float32)
        for name, array in zip(LAYERS, arrays, strict=True)
    }
    difference = maps["sigma_1"] - maps["sigma_2"]
    return Components(maps, model.peak(scene, state.surface, difference, pixels))
