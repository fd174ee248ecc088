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

WEARING_CONTACT = (
    PAPER_CONTACT
    + """
[friction]
coefficient = 0.25

[wear]
coefficient_mm2_per_n = 2e-9
"""
)
"""The same sliding; `distances_m` is to follow."""

WORN_CONTACT = (
    WEARING_CONTACT
    + """\
distances_m = [0.0, 77.0]

[polariscope]
wavelength_nm = 587.0
"""
)
"""The same sliding: new, and worn, in yellow light."""

SMALL_CAMERA = """
[camera]
width_px = 160
height_px = 120
left_mm = -2.0
top_mm = 0.0
pixel_mm = 0.025
bit_depth = 8
brightness = 0.85
background = 0.05
"""
"""A camera that sees all of that contact in few pixels, without noise."""

BENDING_BEAM = """\
[beam]
thickness_mm = 6.0
height_mm = 20.0
inner_span_mm = 40.0
outer_span_mm = 100.0
"""
"""A beam in four-point bending, for sets of images."""
