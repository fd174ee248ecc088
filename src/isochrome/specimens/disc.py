"""The disc under diametral load, its top at x = 0, z = 0."""

from collections.abc import Callable

import numpy as np

from isochrome.reference import StressComponents, disc_stress
from isochrome.scene import Scene
from isochrome.specimens.interface import Acting, Floats, Mask, SpecimenModel
from isochrome.stress import PixelGrid

EDGE = 0.06
"""Margin at an edge over the radius: an edge is not where it seems dark."""
LOAD = 0.3
"""Distance from the loads over the radius: plates press over a width, not at a point."""


class DiscModel(SpecimenModel):
    """A disc pressed along its vertical diameter; see `isochrome.reference.disc_stress`."""

    def components(self, scene: Scene, surface: Acting, pixels: PixelGrid) -> StressComponents:
        """Stress components in closed form."""
        return diametral_stress(scene, pixels, disc_stress)

    def trusted(self, scene: Scene, pixels: PixelGrid, hidden_mm: float) -> Mask:
        """Without the outermost 6 % and without 0.3 R about the loads, which are no points."""
        return away_from_edges(scene, pixels, EDGE, LOAD)[1]


MODEL = DiscModel()


def diametral_stress(
    scene: Scene, pixels: PixelGrid, formula: Callable[..., StressComponents], **sizes: float
) -> StressComponents:
    """Stress of a round specimen by a `formula` of `isochrome.reference`, with more `sizes`."""
    specimen, load = scene.specimen, scene.load
    assert load is not None and isinstance(load.normal_n, float)  # only a contact's load varies
    assert specimen.diameter_mm is not None and specimen.thickness_mm is not None
    return formula(
        pixels.places[0], pixels.places[1] - 0.5 * specimen.diameter_mm, load_n=load.normal_n,
        diameter_mm=specimen.diameter_mm, thickness_mm=specimen.thickness_mm, **sizes,
    )  # fmt: skip


def away_from_edges(
    scene: Scene, pixels: PixelGrid, edge: float, load: float
) -> tuple[Floats, Mask]:
    """Each pixel's distance from the centre, and whether it is farther than `edge` from the rim and
    `load` from the loads; all over the radius, (rows, cols).
    """
    assert scene.specimen.diameter_mm is not None
    radius = 0.5 * scene.specimen.diameter_mm
    x, z = pixels.places[0] / radius, pixels.places[1] / radius - 1.0
    away, loads = np.hypot(x, z), np.minimum(np.hypot(x, z - 1.0), np.hypot(x, z + 1.0))
    return away, (away < 1.0 - edge) & (loads > load)
