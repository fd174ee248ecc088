"""The disc under diametral load, its top at x = 0, z = 0."""

from collections.abc import Callable

import numpy as np

from isochrome.reference import StressComponents, disc_stress
from isochrome.scene import Scene
from isochrome.specimens.interface import Acting, Floats, Mask, SpecimenModel, centred, form_sizes
from isochrome.stress import PixelGrid

EDGE = 0.06
"""Margin at an edge over the radius: an edge is not where it seems dark."""
LOAD = 0.3
"""Distance from the loads over the radius: plates press over a width, not at a point."""


class DiscModel(SpecimenModel):
    """A disc pressed along its vertical diameter, by its `formula` of `isochrome.reference`."""

    formula: Callable[..., StressComponents] = staticmethod(disc_stress)

    def components(self, scene: Scene, surface: Acting, pixels: PixelGrid) -> StressComponents:
        """Stress components in closed form."""
        return self.formula(*centred(scene, pixels), **form_sizes(scene))

    def trusted(self, scene: Scene, pixels: PixelGrid, hidden_mm: float) -> Mask:
        """Without the outermost 6 % and without 0.3 R about the loads, which are no points."""
        return away_from_edges(scene, pixels, EDGE, LOAD)[1]


MODEL = DiscModel()


def away_from_edges(
    scene: Scene, pixels: PixelGrid, edge: float, load: float
) -> tuple[Floats, Mask]:
    """Distance from the centre over the radius; whether `edge` and `load` from rim and loads."""
    radius = 0.5 * (scene.rim_diameter_mm or 0.0)
    x, z = pixels.places[0] / radius, pixels.places[1] / radius - 1.0
    away, loads = np.hypot(x, z), np.minimum(np.hypot(x, z - 1.0), np.hypot(x, z + 1.0))
    return away, (away < 1.0 - edge) & (loads > load)
