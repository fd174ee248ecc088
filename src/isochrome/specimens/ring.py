"""The ring under diametral load, its top at x = 0, z = 0."""

from isochrome.reference import ring_stress
from isochrome.scene import Scene
from isochrome.specimens.disc import EDGE, LOAD, DiscModel, away_from_edges
from isochrome.specimens.interface import Mask, form_sizes
from isochrome.stress import PixelGrid

_WALL = 0.2, 0.6
"""Neither margin is more than this share of the wall: of a thin ring something must be left."""


class RingModel(DiscModel):
    """A ring pressed along its vertical diameter."""

    formula = staticmethod(ring_stress)

    def trusted(self, scene: Scene, pixels: PixelGrid, hidden_mm: float) -> Mask:
        """Without margins at both edges, and without the loads, which are no points."""
        sizes = form_sizes(scene)
        hole = sizes["hole_mm"] / sizes["diameter_mm"]
        edge, load = (min(s, w * (1.0 - hole)) for s, w in zip((EDGE, LOAD), _WALL, strict=True))
        away, trusted = away_from_edges(scene, pixels, edge, load)
        return trusted & (away > hole + edge)


MODEL = RingModel()
