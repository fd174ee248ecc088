from .block_fem import Sampled, Sides, corrections
from .field import StressComponents, StressDifference, principal_direction
from .half_plane.direct import stress_components
from .half_plane.hats import cauchy_of_hat
from .half_plane.pixel_sums import (
    FieldGrid,
    components_on_grid,
    field_dtype,
    make_field_grid,
    stress_difference,
    stress_trace,
)
from .half_plane.point_force import PointForce
from .half_plane.regular import NO_STRESS, RegularStress, regular_modes, uniform_stress
from .half_plane.series import SeriesField, SeriesGrid, make_series_grid, series_difference
from .lens import Lens
from .peak import ShearPeak, largest_shear
from .pixels import PixelGrid, pixel_grid
from .seen import seen_by

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
