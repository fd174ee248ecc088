"""Fields of the specimens that have a closed form: the disc and the beam, on a pixel grid."""

from __future__ import annotations

import numpy as np

from isochrome.reference import beam_stress, disc_stress
from isochrome.scene import Scene
from isochrome.stress.field import StressComponents, StressDifference
from isochrome.stress.pixels import Floats, PixelGrid


def disc_difference(scene: Scene, pixels: PixelGrid) -> StressDifference:
    """Stress difference of a disc under diametral load, its top at x = 0, z = 0.

    Parameters: `scene`, with a disc; `pixels`. Returns (rows, cols), complex, MPa; NaN outside.
    Source: see `isochrome.reference.disc_stress`.
    """
    return disc_components(scene, pixels).difference


def disc_components(scene: Scene, pixels: PixelGrid) -> StressComponents:
    """Stress components of a disc; parameters, places and source as `disc_difference`."""
    specimen, load = scene.specimen, scene.load
    assert load is not None and specimen.diameter_mm is not None
    assert specimen.thickness_mm is not None
    assert isinstance(load.normal_n, float)  # only a contact's load varies with distance
    stress = disc_stress(
        pixels.x_mm[None, :],
        (pixels.z_mm - 0.5 * specimen.diameter_mm)[:, None],
        load_n=load.normal_n,
        diameter_mm=specimen.diameter_mm,
        thickness_mm=specimen.thickness_mm,
    )
    return StressComponents(stress.sigma_x, stress.sigma_z, stress.tau_xz)


def beam_difference(scene: Scene, pixels: PixelGrid) -> StressDifference:
    """Stress difference of the pure-bending span of a beam, mid-span at x = 0, its top at z = 0.

    Parameters: `scene`, with a beam; `pixels`. Returns (rows, cols), complex, MPa; NaN outside the
    beam and outside the inner span, where bending is not pure.
    Source: see `isochrome.reference.beam_stress`.
    """
    return beam_components(scene, pixels).difference


def beam_components(scene: Scene, pixels: PixelGrid) -> StressComponents:
    """Stress components of a beam, sigma_x alone; parameters, places as `beam_difference`."""
    assert scene.load is not None and scene.load.inner_span_mm is not None
    inside = np.where(np.abs(pixels.x_mm) <= 0.5 * scene.load.inner_span_mm, 1.0, np.nan)
    sigma_x = beam_bending(scene, pixels.z_mm)[:, None] * inside[None, :]
    nothing = np.where(np.isfinite(sigma_x), 0.0, np.nan)
    return StressComponents(sigma_x, nothing, nothing)


def beam_bending(scene: Scene, z_mm: Floats) -> Floats:
    """sigma_x of a beam between its inner rollers, over its height.

    Parameters: `scene`, with a beam; `z_mm`, depth below its top, any shape. Returns that shape,
    MPa; NaN outside. Source: see `isochrome.reference.beam_stress`.
    """
    specimen, load = scene.specimen, scene.load
    assert load is not None and load.inner_span_mm is not None and load.outer_span_mm is not None
    assert specimen.height_mm is not None and specimen.thickness_mm is not None
    assert isinstance(load.normal_n, float)  # only a contact's load varies with distance
    return beam_stress(
        z_mm - 0.5 * specimen.height_mm,
        load_n=load.normal_n,
        inner_span_mm=load.inner_span_mm,
        outer_span_mm=load.outer_span_mm,
        height_mm=specimen.height_mm,
        thickness_mm=specimen.thickness_mm,
    )
