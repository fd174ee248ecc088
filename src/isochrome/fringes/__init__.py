"""Fringe order from images, and the lines that fringes draw."""
