"""Contacts whose benches have what is in no list of causes: solid, light path and camera."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, shift

from .outside_camera import _band, _stored, lit
from .outside_contact import Contact
from .outside_tractions import _strip

FACTS = {
    "tilt": lambda rng: {"tilt": rng.uniform(0.2, 0.6)},
    "edge": lambda rng: {"edge_mpa": rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.4)},
    "warm": lambda rng: {"warm": rng.uniform(0.01, 0.03)},
    "second": lambda rng: {
        "second": rng.uniform(0.005, 0.02), "second_mm": rng.choice([-1, 1]) * rng.uniform(1.2, 1.8)
    },
    "window": lambda rng: {
        "window": rng.uniform(0.01, 0.05) * np.exp(2j * rng.uniform(0.0, np.pi))
    },
    "swing": lambda rng: {"swing": rng.uniform(0.01, 0.03)},
    "ghost": lambda rng: {"ghost": rng.uniform(0.02, 0.06), "ghost_px": rng.uniform(5.0, 15.0, 2)},
    "shutter": lambda rng: {
        "shutter_px": rng.uniform(0.1, 0.4), "shutter_rows": rng.uniform(20.0, 60.0)
    },
    "uneven blur": lambda rng: {"blurred_px": rng.uniform(0.7, 1.5)},
    "smear": lambda rng: {"smear": rng.uniform(0.02, 0.1)},
}  # fmt: skip
"""What a bench has, and how strong it is drawn."""


@dataclass(frozen=True, kw_only=True)
class UnlistedContact(Contact):
    """A contact with one fact that no cause describes.

    Solid: `tilt` (see `Contact`); stress along a machined surface, `edge_mpa`, that falls over
    0.3 mm; fringes that are a share `warm` more at the surface, over 0.5 mm; a `second` touch, a
    clamp's, by a share of the load at `second_mm`. Light path: a stressed `window`, fringes and
    direction as a complex number; a load that moves by ± `swing` in the exposure; a `ghost` of the
    picture, a share of its light, `ghost_px` away. Camera: rows that shake by `shutter_px` with a
    period of `shutter_rows`; a blur that grows to `blurred_px` at the right edge; a share `smear`
    of each pixel's light that goes to the next one.
    """

    edge_mpa: float = 0.0
    warm: float = 0.0
    second: float = 0.0
    second_mm: float = 1.5
    window: complex = 0.0
    swing: float = 0.0
    ghost: float = 0.0
    ghost_px: tuple[float, float] = (0.0, 0.0)
    shutter_px: float = 0.0
    shutter_rows: float = 30.0
    blurred_px: float = 0.0
    smear: float = 0.0

    def orders(self, x, z, load_n):
        """Fringe order N at places (mm) under a load."""
        share = (np.arange(9) + 0.5) / 9.0 * 2.0 - 1.0
        loads = load_n * (1.0 + self.tilt * share) if self.tilt else np.array([load_n])
        total = sum(self._difference(x, z, part) for part in loads) / len(loads)
        total = total + self.edge_mpa * np.exp(-z / 0.3)
        if self.second:
            half = 0.02
            press, drag = _strip(x - self.second_mm, np.maximum(z, 1e-9), half)
            pressure = self.second * load_n / self.thickness_mm / (2.0 * half)
            total = total + pressure * (press + self.friction * drag)
        order = self.thickness_mm / self.fringe_value * total
        return np.abs(order * (1.0 + self.warm * np.exp(-z / 0.5)) + self.window)

    def frame(self, seed=0):
        """The stored grey levels (rows, cols)."""
        rows, cols = self.shape
        step = self.pixel_mm / self.samples
        z = (self.top_mm + step * (np.arange(rows * self.samples) + 0.5))[:, None]
        x = self.left_mm + step * (np.arange(cols * self.samples) + 0.5)[None, :]
        row = (z - self.top_mm) / self.pixel_mm
        x = x + self.shutter_px * self.pixel_mm * np.sin(2.0 * np.pi * row / self.shutter_rows)
        moments = 1.0 + self.swing * np.sin(2.0 * np.pi * (np.arange(8) + 0.5) / 8.0)
        loads = self.load_n * (moments if self.swing else np.ones(1))
        turn = np.zeros(())
        seen = (np.where(z > 0.0, self.orders(x, z, load), np.nan) for load in loads)
        signal = sum(np.nan_to_num(_band(order, turn, self.defects)) for order in seen)
        return _stored(
            self._by_camera(lit(signal / len(loads), self.defects, self.samples)), self.defects,
            np.random.default_rng(seed),
        )  # fmt: skip

    def _by_camera(self, light):
        if self.ghost:
            light = light + self.ghost * shift(light, self.ghost_px, order=1, mode="nearest")
        if self.blurred_px:
            widths = np.linspace(0.0, self.blurred_px, 9)
            stack = np.array([gaussian_filter(light, w, mode="nearest") for w in widths])
            rows, cols = np.indices(light.shape)
            light = map_coordinates(stack, [cols / light.shape[1] * 8.0, rows, cols], order=1)
        if self.smear:
            left = np.roll(light, 1, axis=1)
            left[:, 0] = light[:, 0]
            light = (1.0 - self.smear) * light + self.smear * left
        return light
