from .colour.colour_order import ColourReading, read_colour
from .colour.colour_table import (
    STEP,
    ColourTable,
    measured_table,
    read_table,
    spectral_table,
    table_columns,
)
from .colour.own_colours import ColourShots, OwnLight, band_light, band_scale, find_light
from .film.film_light import BrightestLight, FilmLight, smooth_zero
from .film.film_reading import (
    FilmPath,
    KeptState,
    fringe_response,
    joined_pixels,
    joined_reading,
    light_wave,
    pixels_together,
    read_followed,
)
from .film.follower import LARGEST_CHANGE, FilmState, follow_frame, unloaded_state
from .on_branch import BRANCH, LARGEST_UNCERTAINTY, OrderReading, read_order, widened
from .single_frame.background_modulation import (
    BackgroundModulation,
    exact_ends,
    fit_background_modulation,
    gamma_misfit,
)
from .single_frame.free_order import (
    FollowedFringes,
    FreeReading,
    common_reading,
    follow_fringes,
    read_free,
)
from .single_frame.no_load_exposure import NoLoadExposure, find_no_load_exposure
from .single_frame.stated_orders import (
    CLEAR,
    MOST_COST,
    STATED_SPREAD,
    KnownOrders,
    KnownPlaces,
    known_orders,
)
from .skeleton import Skeleton, number_lines, order_contours, skeleton_table, skeletons
from .stepped.step_equations import make_design
from .stepped.stepped_order import ResidualStress, SteppedReading, read_residual, read_steps

__all__ = [
    "BRANCH",
    "CLEAR",
    "LARGEST_CHANGE",
    "LARGEST_UNCERTAINTY",
    "MOST_COST",
    "STATED_SPREAD",
    "STEP",
    "BackgroundModulation",
    "BrightestLight",
    "ColourReading",
    "ColourShots",
    "ColourTable",
    "FilmLight",
    "FilmPath",
    "FilmState",
    "FollowedFringes",
    "FreeReading",
    "KeptState",
    "KnownOrders",
    "KnownPlaces",
    "NoLoadExposure",
    "OrderReading",
    "OwnLight",
    "ResidualStress",
    "Skeleton",
    "SteppedReading",
    "band_light",
    "band_scale",
    "common_reading",
    "exact_ends",
    "find_light",
    "find_no_load_exposure",
    "fit_background_modulation",
    "follow_frame",
    "follow_fringes",
    "fringe_response",
    "gamma_misfit",
    "joined_pixels",
    "joined_reading",
    "known_orders",
    "light_wave",
    "make_design",
    "measured_table",
    "number_lines",
    "order_contours",
    "pixels_together",
    "read_colour",
    "read_followed",
    "read_free",
    "read_order",
    "read_residual",
    "read_steps",
    "read_table",
    "skeleton_table",
    "skeletons",
    "smooth_zero",
    "spectral_table",
    "table_columns",
    "unloaded_state",
    "widened",
]
