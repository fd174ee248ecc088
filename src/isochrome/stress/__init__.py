"""Stress below the surface: half-planes and blocks under surface tractions, discs and beams."""

from isochrome.stress.block import block_stress
from isochrome.stress.closed_forms import (
    beam_bending,
    beam_components,
    beam_difference,
    disc_components,
    disc_difference,
)
from isochrome.stress.direct import stress_components
from isochrome.stress.field import StressComponents, StressDifference, principal_direction
from isochrome.stress.halfplane import (
    FieldGrid,
    components_on_grid,
    field_dtype,
    make_field_grid,
    stress_difference,
    stress_trace,
)
from isochrome.stress.peak import ShearPeak, largest_shear
from isochrome.stress.pixels import PixelGrid, pixel_grid
from isochrome.stress.regular import NO_STRESS, RegularStress, regular_modes, uniform_stress

__all__ = [
    "NO_STRESS",
    "FieldGrid",
    "PixelGrid",
    "RegularStress",
    "ShearPeak",
    "StressComponents",
    "StressDifference",
    "beam_bending",
    "beam_components",
    "beam_difference",
    "block_stress",
    "components_on_grid",
    "disc_components",
    "disc_difference",
    "field_dtype",
    "largest_shear",
    "make_field_grid",
    "pixel_grid",
    "principal_direction",
    "regular_modes",
    "stress_components",
    "stress_difference",
    "stress_trace",
    "uniform_stress",
]
