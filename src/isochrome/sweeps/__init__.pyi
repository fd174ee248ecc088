from .api import Swept, sweep

__all__ = ["Swept", "sweep"]
