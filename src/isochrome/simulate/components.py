"""The principal stresses apart, and the largest shear with its place: only when asked for.

Fringes show the difference of the principal stresses alone; the model has both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.scene import Scene
from isochrome.simulate.model import Picture, SceneState, regular_stress, surface_field_grid
from isochrome.stress import (
    PixelGrid,
    ShearPeak,
    StressComponents,
    beam_bending,
    beam_components,
    components_on_grid,
    disc_components,
    largest_shear,
    principal_direction,
)

LAYERS = ("sigma_1", "sigma_2", "sigma_1_direction", "sigma_x", "sigma_z", "tau_xz")
"""Names of the maps that `simulate` leaves: MPa, the direction in degrees."""


@dataclass(frozen=True)
class Components:
    """All that the model knows of one state's stress.

    `maps`, each of LAYERS by its name (rows, cols), float32, NaN outside the material; `peak`, the
    largest shear in the material in view, its surface included (in a disc, which its loads make
    infinite, that at the pixels' centres).
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
    stress = _stress(scene, state, pixels)
    first, second = stress.principal
    direction = np.degrees(principal_direction(stress.difference))
    arrays = (first, second, direction, stress.sigma_x, stress.sigma_z, stress.tau_xz)
    maps = {
        name: np.where(picture.material, array, np.nan).astype(np.float32)
        for name, array in zip(LAYERS, arrays, strict=True)
    }
    return Components(maps, _peak(scene, state, maps, pixels))


def _stress(scene: Scene, state: SceneState, pixels: PixelGrid) -> StressComponents:
    if scene.model == "disc":
        return disc_components(scene, pixels)
    if scene.model == "beam":
        return beam_components(scene, pixels)
    surface = state.surface
    assert surface is not None
    return components_on_grid(
        surface_field_grid(pixels, surface.grid, scene.numerics.tolerance),
        surface.pressure_mpa,
        surface.shear_mpa if surface.shear_mpa.any() else None,
        regular=regular_stress(scene, surface, pixels),
    )


def _peak(
    scene: Scene, state: SceneState, maps: dict[str, NDArray[np.float32]], pixels: PixelGrid
) -> ShearPeak:
    """The largest (sigma_1 - sigma_2)/2 in the material in view, and its place."""
    if scene.model == "disc":
        shear = 0.5 * np.nan_to_num(maps["sigma_1"] - maps["sigma_2"], nan=-1.0)
        row, col = np.unravel_index(int(shear.argmax()), shear.shape)
        return ShearPeak(float(shear[row, col]), float(pixels.x_mm[col]), float(pixels.z_mm[row]))
    if scene.model == "beam":
        return _beam_peak(scene, pixels)
    surface = state.surface
    assert surface is not None
    return largest_shear(
        surface.grid.x_mm,
        surface.pressure_mpa,
        surface.shear_mpa,
        within=pixels,
        regular=regular_stress(scene, surface, pixels),
    )


def _beam_peak(scene: Scene, pixels: PixelGrid) -> ShearPeak:
    """Bending is linear over the height: the largest shear is at an end of what is in view."""
    height = scene.specimen.height_mm
    assert height is not None
    bottom = pixels.top_mm + pixels.rows * pixels.pixel_mm
    ends = np.array([max(pixels.top_mm, 0.0), min(bottom, height)])
    shear = 0.5 * np.abs(beam_bending(scene, ends))
    end = int(np.nan_to_num(shear, nan=-1.0).argmax())
    middle = pixels.left_mm + 0.5 * pixels.cols * pixels.pixel_mm
    return ShearPeak(float(shear[end]), middle, float(ends[end]))
