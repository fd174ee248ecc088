"""Closed forms refuse what they cannot be of, by the argument's name."""

from functools import partial

import numpy as np
import pytest

from isochrome import reference
from isochrome.errors import InputError

HERTZ = {"half_width_mm": 1.0, "peak_pressure_mpa": 1.0}
PUNCH = {"half_width_mm": 1.0, "line_load_n_per_mm": 1.0}
WAVE = {"amplitude_mm": 0.01, "wavelength_mm": 2.0, "contact_modulus_mpa": 500.0}
DISC = {"load_n": 300.0, "diameter_mm": 40.0, "thickness_mm": 6.0}
BEAM = {"inner_span_mm": 40.0, "height_mm": 20.0, "thickness_mm": 6.0}
COUPLED = reference.coupled_contact(11.0, 24.61, 2473.2, friction=0.2, beta=0.16)
hertz, punch = partial(reference.hertz_stress, **HERTZ), partial(reference.punch_stress, **PUNCH)
sliding = partial(reference.sliding_hertz_stress, **HERTZ)
hole = partial(reference.hole_stress, tension_mpa=1.0, radius_mm=1.0)
coupled = partial(reference.coupled_contact, friction=0.1, beta=0.1)
disc = partial(reference.disc_stress, 0.0, 0.0, **DISC)
beam = partial(reference.beam_stress, load_n=150.0, outer_span_mm=100.0, **BEAM)
ring = partial(reference.ring_stress, 0.0, 12.0, hole_mm=20.0, **DISC)


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: reference.contact_modulus(0.0, 0.4, 1.0, 0.3), "young_mpa"),
        (lambda: reference.contact_modulus(1.0, 0.6, 1.0, 0.3), "poisson"),
        (lambda: reference.contact_modulus(1.0, -1.0, 1.0, 0.3), "poisson"),
        (lambda: reference.dundurs_beta(1.0, 0.3, 1.0, -1.0), "other_poisson"),
        (lambda: reference.contact_modulus(1.0, 0.4, -1.0, 0.3), "other_young_mpa"),
        (lambda: reference.dundurs_beta(1.0, 0.4, 1.0, float("nan")), "other_poisson"),
        (lambda: reference.hertz_half_width(-1.0, 1.0, 1.0), "line_load_n_per_mm"),
        (lambda: reference.hertz_pressure([0.0, np.nan], **HERTZ), "x_mm"),
        (lambda: hertz(0.0, -0.1), "z_mm"),
        (lambda: hertz([0.0, 1.0], [0.0, 1.0, 2.0]), "broadcast"),
        (lambda: hertz(0.0, 0.1, half_width_mm=0.0), "half_width"),
        (lambda: hole(0.0, 3.0, radius_mm=0.0), "radius_mm"),
        (lambda: hole(0.0, 3.0, tension_mpa=np.inf), "tension_mpa"),
        (lambda: hole(np.nan, 3.0), "x_mm"),
        (lambda: disc(load_n=-1.0), "load_n"),
        (lambda: reference.disc_stress(np.nan, 0.0, **DISC), "x_mm"),
        (lambda: reference.disc_centre_difference(**DISC | {"diameter_mm": 0.0}), "diameter_mm"),
        (lambda: reference.beam_moment(1.0, inner_span_mm=50.0, outer_span_mm=50.0),
         "outer_span_mm"),
        (lambda: beam(np.inf), "eta_mm"),
        (lambda: beam(0.0, height_mm=0.0), "height_mm"),
        (lambda: reference.punch_pressure(0.0, half_width_mm=0.0, line_load_n_per_mm=1.0),
         "half_width_mm"),
        (lambda: punch(0.0, -1.0), "z_mm"),
        (lambda: reference.wedge_half_width(1.0, slope=-0.1, contact_modulus_mpa=1.0), "slope"),
        (lambda: reference.wavy_half_width(0.0, **WAVE), "mean_pressure_mpa"),
        (lambda: reference.wavy_pressure(np.nan, mean_pressure_mpa=1.0, **WAVE), "x_mm"),
        (lambda: reference.wavy_full_contact_pressure(**WAVE | {"amplitude_mm": 0.0}),
         "amplitude_mm"),
        (lambda: sliding(0.0, 1.0, friction=np.nan), "friction"),
        (lambda: sliding(0.0, -1.0, friction=0.1), "z_mm"),
        (lambda: coupled(0.0, 1.0, 1.0), "line_load_n_per_mm"),
        (lambda: coupled(1.0, 1.0, 1.0, beta=0.7), "beta"),
        (lambda: reference.coupled_pressure(np.inf, COUPLED), "x_mm"),
        (lambda: reference.coupled_stress(0.0, -1e-9, COUPLED), "z_mm"),
        (lambda: ring(load_n=0.0), "load_n"),
        (lambda: ring(diameter_mm=-1.0), "diameter_mm"),
        (lambda: ring(hole_mm=0.0), "hole_mm"),
        (lambda: ring(hole_mm=39.5), "hole_mm is 39.5"),
        (lambda: ring(thickness_mm=np.nan), "thickness_mm"),
        (lambda: reference.ring_stress(np.inf, 12.0, hole_mm=20.0, **DISC), "x_mm"),
    ],
)  # fmt: skip
def test_bad_arguments_are_refused_by_name(call, told):
    with pytest.raises(InputError, match=told):
        call()
