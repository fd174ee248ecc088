"""The ring under diametral load, its top at x = 0, z = 0."""

from isochrome.reference import ring_stress
from isochrome.scene import Scene
from isochrome.specimens.disc import EDGE, LOAD, away_from_edges, diametral_stress
from isochrome.specimens.interface import Acting, Mask, SpecimenModel
from isochrome.stress import PixelGrid, StressComponents

_WALL = 0.2, 0.6
"""Neither margin is more than this share of the wall: of a thin ring something must be left."""


class RingModel(SpecimenModel):
    """A ring pressed along its vertical diameter; see `isochrome.reference.ring_stress`."""

    def components(self, scene: Scene, surface: Acting, pixels: PixelGrid) -> StressComponents:
        """Stress components by the disc's closed form and a series for the hole."""
        assert scene.specimen.hole_mm is not None
        return diametral_stress(scene, pixels, ring_stress, hole_mm=scene.specimen.hole_mm)

    def trusted(self, scene: Scene, pixels: PixelGrid, hidden_mm: float) -> Mask:
        """Without margins at both edges, and without the loads, which are no points."""
        specimen = scene.specimen
        assert specimen.diameter_mm is not None and specimen.hole_mm is not None
        hole = specimen.hole_mm / specimen.diameter_mm
        edge, load = (min(s, w * (1.0 - hole)) for s, w in zip((EDGE, LOAD), _WALL, strict=True))
        away, trusted = away_from_edges(scene, pixels, edge, load)
        return trusted & (away > hole + edge)


MODEL = RingModel()
