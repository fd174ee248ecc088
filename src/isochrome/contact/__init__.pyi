from .pressure import ContactState, Surface, displacement, log_of_hat, make_surface, solve_pressure
from .scar import Scar, make_mesh, scar_history, unresolved
from .sliding_history import OutputState, SlidingHistory, mean_wear_rate, wear_course, wear_rate
from .state import ContactGrid, SurfaceState, contact_grid, elastic_constants, line_load
from .wear import (
    ContactSetup,
    GrowingScar,
    WornState,
    contact_states,
    elastic_state,
    iter_contact_states,
    make_site,
    scar_on_nodes,
    wear_history,
    worn_states,
)

__all__ = [
    "ContactGrid",
    "ContactSetup",
    "ContactState",
    "GrowingScar",
    "OutputState",
    "Scar",
    "SlidingHistory",
    "Surface",
    "SurfaceState",
    "WornState",
    "contact_grid",
    "contact_states",
    "displacement",
    "elastic_constants",
    "elastic_state",
    "iter_contact_states",
    "line_load",
    "log_of_hat",
    "make_mesh",
    "make_site",
    "make_surface",
    "mean_wear_rate",
    "scar_history",
    "scar_on_nodes",
    "solve_pressure",
    "unresolved",
    "wear_course",
    "wear_history",
    "wear_rate",
    "worn_states",
]
