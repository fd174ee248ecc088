"""The contact: surface operators, the pressure solver, and wear over sliding distance."""

from isochrome.contact.course import Course, Stop, constant_course, wear_course, wear_rate
from isochrome.contact.pressure import ContactState, solve_pressure
from isochrome.contact.profile import Grid, contact_grid, elastic_constants, line_load
from isochrome.contact.regrid import scar_on_nodes
from isochrome.contact.scar import Scar, scar_history
from isochrome.contact.state import SurfaceState
from isochrome.contact.states import contact_states, iter_contact_states
from isochrome.contact.surface import Surface, displacement, make_surface
from isochrome.contact.wear import WornStart, WornState, wear_history
from isochrome.contact.worn import Site, elastic_state, make_site, worn_states

__all__ = [
    "ContactState",
    "Course",
    "Grid",
    "Scar",
    "Site",
    "Stop",
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
    "scar_history",
    "scar_on_nodes",
    "solve_pressure",
    "wear_course",
    "wear_history",
    "wear_rate",
    "worn_states",
]
