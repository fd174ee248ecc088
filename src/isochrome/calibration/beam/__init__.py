"""The fringe value from four-point bending."""
