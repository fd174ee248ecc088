from .api import SweepGrid, Swept, make_grid, sweep

__all__ = ["SweepGrid", "Swept", "make_grid", "sweep"]
