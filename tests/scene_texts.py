"""Pieces of scene files that several tests start from."""

PAPER_PAIR = """\
[specimen]
young_gpa = 2.1
poisson = 0.4
thickness_mm = 4.0
fringe_value_n_per_mm = 14.6

[indenter]
radius_mm = 24.61
young_gpa = 210.0
poisson = 0.3
"""
"""The paper's epoxy block under its steel cylinder."""

PAPER_CONTACT = PAPER_PAIR + "\n[load]\nnormal_n = 44.0\n"
"""The same under the paper's load."""
