"""Films that are drawn by a seed: specimen, orders, course, lamp, noise and field."""

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from unloaded_films import LoadedFilm

from isochrome.benchmarks import load_benchmarks

OUTSIDE = load_benchmarks("outside_fields")
SPECIMENS = tuple(k for k in (*OUTSIDE.KINDS, *OUTSIDE.BODIES, "free corner") if k != "bowl")
MIDDLE = (247, 330)
ZERO = ("three loads", "free corner", "half plane", "wedge", "crack", "hole")
"""Specimens that may have a place without stress."""
NOUGHT, DRAWS, AWAY = 0.004, 200, 9
"""Of the highest order, that of a place said to have none; shapes that are tried for one; pixels
that it has about it."""
SAMPLES, STEEPEST, MOSTLY = 3, 0.4, 99.0
"""Samples a pixel's side; fringes a pixel, and the order's and its change's largest, for so many
per cent of the specimen: beside loads and tips both are larger."""


@dataclass(frozen=True)
class DrawnFilm(LoadedFilm):
    """A film by its `number` under a `seed`; `shape` and `noise` as of a LoadedFilm, but that
    a noise of None is drawn."""

    shape: tuple[int, int] = MIDDLE
    noise: float | None = None
    seed: int = 1

    def _rng(self, use):
        return np.random.default_rng([self.seed, self.number, use])

    @cached_property
    def kind(self):
        """The specimen."""
        rng = np.random.default_rng([self.seed, 7])
        turns = [rng.permutation(len(SPECIMENS)) for _ in range(self.number // len(SPECIMENS) + 1)]
        return SPECIMENS[int(turns[-1][self.number % len(SPECIMENS)])]

    @cached_property
    def rate(self):
        """The order's largest change from frame to frame."""
        return float(self._rng(1).uniform(0.06, 0.2))

    @cached_property
    def _samples(self):
        """The field at the samples, 1 where it is large, its body, and the highest order."""
        draw = (OUTSIDE.KINDS | OUTSIDE.BODIES).get(self.kind, OUTSIDE.free_corner)
        field, body = draw(OUTSIDE.places(self.shape, SAMPLES), self._rng(2))
        field = field / np.percentile(np.abs(field[body]), MOSTLY)
        slope = SAMPLES * np.hypot(*np.gradient(np.abs(field)))[body]
        top = min(self._rng(3).uniform(4.0, 12.0), STEEPEST / np.percentile(slope, MOSTLY))
        return field.astype(np.complex64), body, float(top)

    @cached_property
    def top(self):
        """The highest order of most of the specimen."""
        return self._samples[2]

    @cached_property
    def course(self):
        """The highest order in each frame: up, pauses and down as drawn."""
        rng, orders, way, target = self._rng(4), [0.0], 1.0, 0.0
        for _ in range(int(rng.integers(1, 6))):
            target = target + (1.0 - target) * rng.uniform(0.4, 0.9) if way > 0 else (
                target * rng.uniform(0.0, 0.8))  # fmt: skip
            self._move(orders, target * self.top, rng)
            pause = rng.random() < 0.5
            orders += [orders[-1]] * (int(rng.integers(2, 15)) if pause else 0)
            way = way if pause and rng.random() < 0.5 else -way
        self._move(orders, self.top, rng)
        return np.array(orders)

    def _move(self, orders, target, rng):
        """Go on to an order, steadily or by fits and starts."""
        steady, least = rng.random() < 0.4, rng.uniform(0.2, 0.9)
        while orders[-1] != target:
            step = self.rate * (1.0 if steady else rng.uniform(least, 1.0))
            left = target - orders[-1]
            orders.append(target if abs(left) <= step else orders[-1] + step * np.sign(left))

    @cached_property
    def second(self):
        """Of a stress that comes and goes by itself: its size, its direction, frames of a turn."""
        rng = self._rng(5)
        return (
            rng.uniform(0.2, 0.6) * (rng.random() < 0.3),
            np.exp(1j * rng.uniform(0.0, 2.0 * np.pi)),
            rng.uniform(90.0, 200.0),
        )

    @cached_property
    def material(self):
        """True on the specimen."""
        return self._pixels(self._samples[1].astype(np.float32)) > 0.99

    def _pixels(self, values):
        rows, cols = self.shape
        return values.reshape(rows, SAMPLES, cols, SAMPLES).mean(axis=(1, 3))

    def _order(self, frame):
        field, body, _ = self._samples
        size, turn, period = self.second
        field = np.float32(self.course[frame]) * field
        if size:
            field = field + np.complex64(size * turn * np.sin(2.0 * np.pi * frame / period))
        return np.where(body, np.abs(field), np.float32(0.0))

    def order(self, frame):
        """Fringe order in the middle of each pixel."""
        return self._order(frame)[SAMPLES // 2 :: SAMPLES, SAMPLES // 2 :: SAMPLES]

    @cached_property
    def bright(self):
        """Whether the field is bright."""
        return bool(self._rng(6).random() < 0.2)

    @cached_property
    def grey(self):
        """The noise in grey levels."""
        return float(self._rng(8).uniform(1.0, 4.0)) if self.noise is None else self.noise

    @cached_property
    def light(self):
        """Background and illumination, of full scale."""
        rng = self._rng(9)
        y, x = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in self.shape), indexing="ij")
        away = (x - rng.uniform(-0.4, 0.4)) ** 2 + (y - rng.uniform(-0.4, 0.4)) ** 2
        lamp = 1.0 - rng.uniform(0.05, 0.2) * away + rng.uniform(-0.1, 0.1) * x
        if rng.random() < 0.3:
            lamp = lamp + rng.uniform(0.03, 0.12) * np.exp(-(((x - 0.3) / 0.6) ** 2) - y**2 / 0.4)
        lamp = rng.uniform(0.5, 0.82) * lamp / lamp.max()
        return rng.uniform(0.02, 0.1) * (1.0 + 0.3 * rng.uniform(-1.0, 1.0) * y), lamp

    def image(self, frame):
        """Grey levels of 8 bits."""
        wave = self._pixels(np.cos(np.float32(2.0 * np.pi) * self._order(frame)))
        signal = np.where(self.material, (0.5 - 0.5 * wave), 0.0)
        background, illumination = self.light
        signal = 1.0 - signal if self.bright else signal
        noise = self.grey * self._rng(100 + frame).standard_normal(self.shape)
        levels = np.rint(255.0 * (background + illumination * signal) + noise)
        return np.clip(levels, 0, 255).astype(np.uint8)

    def scene(self, **frames):
        """The tables of a scene that knows nothing of the specimen but where it is."""
        tables = super().scene(**frames)
        return tables | ({"polariscope": {"field": "bright"}} if self.bright else {})

    def __str__(self):
        """What was drawn."""
        size, *_ = self.second
        return (
            f"{self.number:2d} {self.kind:12s} to {self.top:4.1f} at {self.rate:.2f}"
            f"{f' and {size:.1f}' if size else ''}, {'bright' if self.bright else 'dark'} field,"
            f" noise {self.grey:.1f}"
        )


@dataclass(frozen=True)
class DrawnKnownFilm(DrawnFilm):
    """A film that begins in the middle of a load that swings, and has a place without stress."""

    count: int = 60
    draw: int = 0

    def _rng(self, use):
        return np.random.default_rng([self.seed, self.number, use, self.draw])

    @property
    def kind(self):
        """The specimen."""
        return ZERO[self.number % len(ZERO)]

    @cached_property
    def second(self):
        """No stress that comes and goes by itself: it would leave no place without any."""
        return 0.0, 1.0, 1.0

    @cached_property
    def course(self):
        """The highest order in each frame: from one load that is drawn to the next, with pauses."""
        rng = self._rng(4)
        orders = [rng.uniform(0.4, 1.0) * self.top]
        while len(orders) < self.count:
            self._move(orders, rng.uniform(0.4, 1.0) * self.top, rng)
            orders += [orders[-1]] * int(rng.integers(0, 5))
        return np.array(orders[: self.count])

    def least(self):
        """The least order away from the rim, over the highest, and its row and column."""
        field, *_ = self._samples
        middle = slice(SAMPLES // 2, None, SAMPLES)
        inside = cv2.erode(self.material.astype(np.uint8), np.ones((AWAY, AWAY)))
        order = np.where(inside > 0, np.abs(field)[middle, middle], np.inf)
        row, col = np.unravel_index(order.argmin(), order.shape)
        return float(order[row, col]), int(row), int(col)

    def known(self):
        """The key of [frames] that tells its orders."""
        _, row, col = self.least()
        return {"known_order": [{"row_px": row, "col_px": col, "order": 0.0}]}


def drawn_known_film(number, shape, *, seed, count=60):
    """A DrawnKnownFilm by its `number` under a `seed`: the first that has a place without stress.
    It is looked for in frames of one size, so that a film is the same in another."""
    for draw in range(DRAWS):
        film = DrawnKnownFilm(number, MIDDLE, seed=seed, count=count, draw=draw)
        if film.least()[0] < NOUGHT:
            return replace(film, shape=shape)
    raise AssertionError(f"no {film.kind} has a place without stress")
