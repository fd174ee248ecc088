"""Beams in bending and discs on a bench that is not ours: closed forms at every sample, the defects
of `outside_camera`; no code of the package."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .outside_camera import NONE, Defects, _band, _places, _stored, _things, lit


@dataclass(frozen=True, kw_only=True)
class Bench:
    """A bench: its `defects`, each image's `exposures` (1 where there are fewer), its picture's
    `shape`, and where the specimen lies in it: `angle_deg`, and its middle's place from the
    picture's, `down_px` and `right_px`. `size_px`, a beam's height or a disc's diameter; `axis_px`,
    how far a beam's neutral axis lies below its middle; `zero_order`, what stays without load at a
    beam's edge, or at a disc's centre as a uniform stress along its loads. `residual`, what a disc
    holds besides, (sx - sz) + 2i txz in fringes at (x, z) in radii.
    """

    defects: Defects = NONE
    exposures: tuple[float, ...] = ()
    shape: tuple[int, int] = (220, 280)
    size_px: float = 160.0
    angle_deg: float = 1.0
    down_px: float = 3.0
    right_px: float = -4.0
    axis_px: float = 1.5
    zero_order: float = 0.0
    residual: Callable[..., object] | None = None


def beam_images(orders, bench: Bench, seed: int = 0):
    """Grey levels of a beam across the picture, for each order at its edge."""
    return [_image(_beam_order, order, bench, [seed, i]) for i, order in enumerate(orders)]


def disc_images(orders, bench: Bench, seed: int = 0):
    """Grey levels of a disc pressed along the columns, for each order at its centre."""
    return [_image(_disc_order, order, bench, [seed, i]) for i, order in enumerate(orders)]


def _image(field, order, bench, seed):
    rng, defects = np.random.default_rng(seed), bench.defects
    x, z = _places(*bench.shape, defects)
    values, direction, body = field(order, x - bench.right_px, z - bench.down_px, bench)
    signal = np.where(body, _band(values, direction, defects), 0.0)
    # dust lies where it lies, in all images alike
    pixels = _things(lit(signal, defects), defects, np.random.default_rng(seed[:1]), None)
    exposure = bench.exposures[seed[1]] if seed[1] < len(bench.exposures) else 1.0
    return _stored(exposure * pixels, defects, rng)


def _turned(x, z, bench):
    turn = np.radians(bench.angle_deg)
    return np.cos(turn) * x - np.sin(turn) * z, np.sin(turn) * x + np.cos(turn) * z


def _beam_order(edge, x, z, bench):
    """N = N_edge eta/(h/2), sigma_1 along the beam on one side and across it on the other."""
    half = 0.5 * bench.size_px
    _, eta = _turned(x, z, bench)
    signed = (edge + bench.zero_order) * (eta - bench.axis_px) / half
    direction = np.radians(bench.angle_deg) + np.where(signed < 0, 0.5 * np.pi, 0.0)
    return np.abs(signed), direction, np.abs(eta) < half


def _disc_order(centre, x, z, bench):
    """Two point loads (Frocht 1948, vol. 2): components as the sum of two radial fields and a
    uniform tension.
    """
    radius = 0.5 * bench.size_px
    x, z = (v / radius for v in _turned(x, z, bench))
    total = 0.0
    for side in (-1.0, 1.0):
        below, across = 1.0 - side * z, x
        far = below**2 + across**2 + 1e-9
        # -(2P/(pi d)) cos(theta)/r along the radius from the load: its sx - sz + 2i txz
        radial = -(below / far) * ((across + 1j * -side * below) ** 2 / far)
        total = total + radial
    # at the centre each is 1 along z: N = 2 in these units beside the tension's isotropic part
    field = centre * total / 2.0 + bench.zero_order
    if bench.residual is not None:
        field = field + bench.residual(x, z)
    return np.abs(field), 0.5 * np.angle(field), x**2 + z**2 < 1.0
