"""The field by the tractions' waves, wherever the pixels stand, against exact sums over hats."""

import numpy as np
import pytest

from isochrome.stress import make_series_grid, series_difference

PIXEL, SPACING, NODES = 0.006, 0.002, 301
LEFT = -0.3
NODES_MM = LEFT + SPACING * np.arange(NODES)


def tractions(*, shear=True, seed=3):
    """A contact's pressure with steep edges, and shear that is no multiple of it."""
    rng = np.random.default_rng(seed)
    x = NODES_MM / 0.25
    bumps = 1.0 + 0.3 * np.sin(9.0 * x + rng.normal())
    pressure = 18.0 * np.sqrt(np.clip(1.0 - x**2, 0.0, None)) * bumps
    return pressure, pressure * (0.2 + 0.3 * np.cos(4.0 * x)) if shear else None


def compared(rows, cols, *, pitch, x, z, exact_field, shear=True, slopes=False):
    pressure, q = tractions(shear=shear)
    width, depth = cols * pitch, z + rows * pitch
    grid = make_series_grid(
        rows, cols, pitch, nodes=NODES, spacing_mm=SPACING,
        reach_mm=float(np.hypot(max(abs(x), abs(x + width)) + 0.3, depth)),
    )  # fmt: skip
    made = series_difference(
        grid, x_mm=x, z_mm=z, left_mm=LEFT, pressure_mpa=pressure, shear_mpa=q, slopes=slopes
    )
    rng = np.random.default_rng(0)
    row, col = rng.integers(0, rows, 40), rng.integers(0, cols, 40)
    row[:8], col[:8] = [0, 0, 0, 1, 2, 3, rows - 1, rows - 1], [0, cols // 2, -1, 9, 9, 9, 0, -1]
    x_mm, z_mm = x + pitch * (col % cols), z + pitch * row
    below = z_mm > 0.5 * SPACING
    truth, _ = exact_field(
        x_mm[below], z_mm[below], NODES_MM, pressure, np.zeros(NODES) if q is None else q
    )
    return made, row[below], col[below], truth


@pytest.mark.parametrize("shear", [True, False])
@pytest.mark.parametrize(
    ("rows", "cols", "pitch", "x", "z"),
    [
        (250, 330, PIXEL, -1.0, 0.5 * PIXEL),  # the surface at the top, the first row half a pixel
        (250, 330, PIXEL, -1.0137, 2.3 * PIXEL),  # no pixel below a node
        (83, 110, 3 * PIXEL, -0.9, 0.4 * PIXEL),  # every third pixel
        (250, 330, 1.00713 * PIXEL, -0.4, 0.9 * PIXEL),  # a pitch that no spacing divides
        (250, 330, PIXEL, -1.9, -0.31),  # the surface inside the picture, the contact at its side
    ],
)
def test_the_field_is_the_exact_sum_wherever_the_pixels_stand(
    rows, cols, pitch, x, z, shear, exact_field
):
    made, row, col, truth = compared(
        rows, cols, pitch=pitch, x=x, z=z, exact_field=exact_field, shear=shear
    )
    field = made.difference
    # single precision over transforms of about a thousand numbers
    assert np.abs(field[row, col] - truth).max() < 1e-6 * 18.0
    assert np.all(field[z + pitch * np.arange(rows) <= 0.0] == 0.0)


def test_the_slopes_are_those_of_the_field(exact_field):
    step = 1e-3
    made, *_ = compared(
        120, 160, pitch=2 * PIXEL, x=-0.9, z=0.02, exact_field=exact_field, slopes=True
    )
    for key, slope in (("x", made.along), ("z", made.down)):
        ahead, behind = (
            compared(120, 160, pitch=2 * PIXEL, exact_field=exact_field,
                     **({"x": -0.9, "z": 0.02} | {key: start + sign * step}))[0].difference
            for start, sign in ((({"x": -0.9, "z": 0.02})[key], s) for s in (1.0, -1.0))
        )  # fmt: skip
        difference = (ahead - behind) / (2.0 * step)
        # without the slopes of the repetitions, and steps of half a spacing
        assert np.abs(slope - difference)[2:].max() < 0.02 * np.abs(difference).max()


def test_a_pixel_beyond_the_reach_is_an_error_and_no_echo():
    pressure, _ = tractions()
    grid = make_series_grid(50, 60, PIXEL, nodes=NODES, spacing_mm=SPACING, reach_mm=0.9)
    with pytest.raises(ValueError, match="beyond the reach"):
        series_difference(grid, x_mm=1.0, z_mm=0.01, left_mm=LEFT, pressure_mpa=pressure)
