from .api import Swept, make_grid, sweep

__all__ = ["Swept", "make_grid", "sweep"]
