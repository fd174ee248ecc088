from .pressure import ContactState, solve_pressure
from .profile import ContactGrid, contact_grid, elastic_constants, line_load
from .sliding_history import (
    OutputState,
    SlidingHistory,
    constant_course,
    mean_wear_rate,
    wear_course,
    wear_rate,
)
from .state import SurfaceState
from .states import contact_states, iter_contact_states
from .surface import Surface, displacement, make_surface
from .wear.fixed_grid import WornStart, WornState, wear_history
from .wear.scar import Scar, scar_history
from .wear.worn_states import ContactSetup, elastic_state, make_site, scar_on_nodes, worn_states

__all__ = [
    "ContactGrid",
    "ContactSetup",
    "ContactState",
    "OutputState",
    "Scar",
    "SlidingHistory",
    "Surface",
    "SurfaceState",
    "WornStart",
    "WornState",
    "constant_course",
    "contact_grid",
    "contact_states",
    "displacement",
    "elastic_constants",
    "elastic_state",
    "iter_contact_states",
    "line_load",
    "make_site",
    "make_surface",
    "mean_wear_rate",
    "scar_history",
    "scar_on_nodes",
    "solve_pressure",
    "wear_course",
    "wear_history",
    "wear_rate",
    "worn_states",
]
