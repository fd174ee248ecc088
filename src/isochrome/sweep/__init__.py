"""Grids of simulations: a scene with some of its values varied, into one labelled dataset."""

from isochrome.sweep.run import Swept, sweep

__all__ = ["Swept", "sweep"]
