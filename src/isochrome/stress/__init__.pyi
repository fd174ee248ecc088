from .block_fem import Sampled, Sides, corrections
from .field import StressComponents, StressDifference, principal_direction, seen_by
from .half_plane import (
    NO_STRESS,
    FieldGrid,
    PointForce,
    RegularStress,
    cauchy_of_hat,
    components_on_grid,
    field_dtype,
    make_field_grid,
    regular_modes,
    stress_components,
    stress_difference,
    stress_trace,
    uniform_stress,
)
from .half_plane_series import SeriesField, SeriesGrid, make_series_grid, series_difference
from .peak import ShearPeak, largest_shear
from .pixels import Lens, PixelGrid, pixel_grid

__all__ = [
    "NO_STRESS",
    "FieldGrid",
    "Lens",
    "PixelGrid",
    "PointForce",
    "RegularStress",
    "Sampled",
    "SeriesField",
    "SeriesGrid",
    "ShearPeak",
    "Sides",
    "StressComponents",
    "StressDifference",
    "cauchy_of_hat",
    "components_on_grid",
    "corrections",
    "field_dtype",
    "largest_shear",
    "make_field_grid",
    "make_series_grid",
    "pixel_grid",
    "principal_direction",
    "regular_modes",
    "seen_by",
    "series_difference",
    "stress_components",
    "stress_difference",
    "stress_trace",
    "uniform_stress",
]
