"""Stress below the surface: half-plane fields of surface tractions, discs and beams."""

from isochrome.stress.closed_forms import beam_difference, disc_difference
from isochrome.stress.field import StressComponents, StressDifference, principal_direction
from isochrome.stress.halfplane import (
    FieldGrid,
    make_field_grid,
    stress_components,
    stress_difference,
)
from isochrome.stress.pixels import PixelGrid, pixel_grid

__all__ = [
    "FieldGrid",
    "PixelGrid",
    "StressComponents",
    "StressDifference",
    "beam_difference",
    "disc_difference",
    "make_field_grid",
    "pixel_grid",
    "principal_direction",
    "stress_components",
    "stress_difference",
]
