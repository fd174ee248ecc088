"""Isochrome: photoelastic image analysis with a simulation back-end."""

__version__ = "0.1.0"
