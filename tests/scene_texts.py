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


def disc_text(load_n, *, fringe_value, thickness_mm=6.0, diameter_mm=20.0):
    """A disc under two loads; a number may be a text that is to be filled in."""
    size = f"diameter_mm = {diameter_mm}"
    return _specimen_text("disc", size, thickness_mm, fringe_value, load_n)


def beam_text(load_n, *, fringe_value, thickness_mm=6.0, spans_mm=(40.0, 100.0)):
    """A beam in four-point bending, 20 mm high."""
    inner, outer = spans_mm
    return (
        _specimen_text("beam", "height_mm = 20.0", thickness_mm, fringe_value, load_n)
        + f"inner_span_mm = {inner}\nouter_span_mm = {outer}\n"
    )


def _specimen_text(shape, size, thickness_mm, fringe_value, load_n):
    return (
        f'[specimen]\nshape = "{shape}"\n{size}\nthickness_mm = {thickness_mm}\n'
        f"fringe_value_n_per_mm = {fringe_value}\n[load]\nnormal_n = {load_n}\n"
    )


def camera_text(cols, rows, pixel_mm, **more):
    """A camera's pixels, and what else is told of it."""
    keys = {"width_px": cols, "height_px": rows, "pixel_mm": pixel_mm, **more}
    return "[camera]\n" + "".join(f"{key} = {value}\n" for key, value in keys.items())
