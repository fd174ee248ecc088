"""Films of specimens, by closed forms in numpy: no code of the package."""

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

KEYED = (
    ("disc", 6.0, "rim"), ("beam", 6.0, "line"), ("ring", 5.0, "least"), ("two ways", 6.0, "least"),
)  # fmt: skip
"""Specimen, its highest order, and which known order of 0 it has in all frames: both ends of the
free rim, the neutral axis, or where the order is least."""
WHOLE, SMALL = (494, 659), (124, 165)

FILMS = (
    ("disc", 4.0, 0.1, "unload"), ("disc", 8.0, 0.2, "pauses"), ("disc", 12.0, 0.2, "up"),
    ("beam", 4.0, 0.2, "pauses"), ("beam", 8.0, 0.2, "cycle"), ("beam", 12.0, 0.2, "unload"),
    ("hole", 6.0, 0.2, "cycle"), ("hole", 9.0, 0.2, "pauses"), ("hole", 12.0, 0.15, "unload"),
    ("force", 5.0, 0.2, "unload"), ("force", 8.0, 0.2, "cycle"),
    ("force and tension", 10.0, 0.2, "pauses"),
)  # fmt: skip
"""Specimen, its highest order, the order's largest change from frame to frame, and its course."""

COURSES = {
    "up": ((1, 1.0),),
    "pauses": ((1, 0.35), (0, 12), (1, 0.7), (0, 10), (1, 1.0)),
    "unload": ((1, 0.8), (0, 5), (-1, 0.3), (0, 6), (1, 1.0)),
    "cycle": ((1, 0.9), (-1, 0.15), (1, 0.6), (-1, 0.2), (1, 1.0)),
}
"""Ways up or down to a share of the highest order, and pauses of some frames."""


def _places(shape):
    row, col = np.indices(shape, dtype=float)
    return col - 0.5 * (shape[1] - 1), 0.5 * (shape[0] - 1) - row


def _disc(shape):
    x, y = _places(shape)
    s = (x + 1j * y) / (0.46 * shape[0])
    inside = np.abs(s) < 0.98
    s = np.where(inside, s, 0.0)
    field = 1.6 * (1.0 - np.abs(s) ** 2) / np.conj(s**2 + 1.0) ** 2 / 1.6**2
    return np.where(inside, field, np.nan)


def _beam(shape):
    _, y = _places(shape)
    half = 0.45 * shape[0]
    return np.where(np.abs(y) < half, y / half + 0j, np.nan)


def _hole(shape, across=0.0):
    """Tension along x, and some of it along y, which turns the field by 90 degrees."""
    x, y = _places(shape)
    radius, z = 0.12 * shape[0], x + 1j * y
    inside = np.abs(z) > radius
    r = np.where(inside, np.abs(z), radius)
    angle, q = np.angle(z), (radius / r) ** 2
    both, either = 0.5 * (1.0 + across), 0.5 * (1.0 - across)
    radial = both * (1 - q) + either * (1 - 4 * q + 3 * q * q) * np.cos(2 * angle)
    hoop = both * (1 + q) - either * (1 + 3 * q * q) * np.cos(2 * angle)
    shear = -either * (1 + 2 * q - 3 * q * q) * np.sin(2 * angle)
    field = ((radial - hoop) + 2j * shear) * np.exp(2j * angle) / 3.0
    return np.where(inside, field, np.nan)


def _force(shape):
    x, _ = _places(shape)
    y = -(np.indices(shape)[0] + 0.12 * shape[0])
    z = x + 1j * y
    field = -(z * 1j).real * z / (np.abs(z) ** 2 * np.conj(z))
    return field / np.percentile(np.abs(field), 99.0)


def _ring(shape):
    from finite_ring import finite_ring_difference

    x, y = _places(shape)
    sizes = {"load_n": 1.0, "thickness_mm": 1.0, "diameter_mm": 2.0, "hole_mm": 0.7}
    radius = 0.46 * shape[0]
    inside = (np.hypot(x, y) < 0.98 * radius) & (np.hypot(x, y) > 0.36 * radius)
    field = finite_ring_difference(
        np.where(inside, x, 0.5 * radius) / radius, -np.where(inside, y, 0.0) / radius, **sizes
    )
    return np.where(inside, field / np.percentile(np.abs(field[inside]), 98.0), np.nan)


FIELDS = {
    "disc": _disc, "beam": _beam, "hole": _hole, "force": _force, "ring": _ring,
    "two ways": partial(_hole, across=0.5),
}  # fmt: skip


@dataclass(frozen=True)
class LoadedFilm:
    """A film by its `number` among FILMS, of frames of a `shape`, with a noise in grey levels."""

    number: int
    shape: tuple[int, int] = SMALL
    noise: float = 3.0

    @cached_property
    def course(self):
        """The highest order that the specimen has, or nearly so, in each frame."""
        _, top, rate, kind = FILMS[self.number]
        rng = np.random.default_rng([self.number, 21])
        orders = [0.0]
        for way, until in COURSES[kind]:
            if way == 0:
                orders += [orders[-1]] * int(until)
                continue
            while True:
                share = 1.0 if kind == "up" else 0.6 + 0.4 * rng.random()
                after = orders[-1] + way * rate * share
                if way * after >= way * until * top:
                    break
                orders.append(after)
        return np.array(orders)

    @property
    def count(self):
        return len(self.course)

    @cached_property
    def _field(self):
        return FIELDS[FILMS[self.number][0].split()[0]](self.shape)

    @cached_property
    def material(self):
        """True on the specimen."""
        return np.isfinite(self._field)

    def order(self, frame):
        """Fringe order, NaN outside of the specimen."""
        field = self.course[frame] * self._field
        if "tension" in FILMS[self.number][0]:
            field = field + 0.6 * np.sin(2 * np.pi * frame / 150.0)
        return np.abs(field)

    @cached_property
    def light(self):
        """Background and illumination, of full scale."""
        x, y = _places(self.shape)
        away = (x**2 + y**2) / (x**2 + y**2).max()
        bright = 0.8 * (1.0 - 0.3 * away) * (1.0 + 0.06 * x / self.shape[1])
        return 0.05 + 0.02 * y / self.shape[0], bright

    def image(self, frame):
        """Grey levels of 8 bits."""
        order = np.nan_to_num(self.order(frame))
        along, across = np.gradient(order)
        wave = np.cos(2 * np.pi * order) * np.sinc(along) * np.sinc(across)
        signal = np.where(self.material, 0.5 - 0.5 * wave, 0.0)
        background, illumination = self.light
        noise = self.noise * np.random.default_rng([frame, 99]).standard_normal(self.shape)
        levels = np.rint(255.0 * (background + illumination * signal) + noise)
        return np.clip(levels, 0, 255).astype(np.uint8)

    def frames(self, numbers=None):
        """Grey levels (frame, row, col) of some frames, or all."""
        return np.stack(
            [self.image(k) for k in (range(self.count) if numbers is None else numbers)]
        )

    def __str__(self):
        name, top, rate, course = FILMS[self.number]
        return f"{self.number:2d} {name:17s} to {top:4.1f} at {rate:.2f}, {course:6s}"

    def scene(self, **frames):
        """The tables of a scene that knows nothing of the specimen but where it is."""
        mask = {} if self.material.all() else {"mask": (255 * self.material).astype(np.uint8)}
        return {
            "specimen": {"shape": "other", "thickness_mm": 4.0},
            "camera": {"bit_depth": 8, "pixel_mm": 0.02},
            "frames": mask | (frames or {"starts_unloaded": True}),
        }


@dataclass(frozen=True)
class KnownFilm(LoadedFilm):
    """A film by its `number` among KEYED, whose load swings: it begins and ends in the middle."""

    count: int = 60

    @cached_property
    def course(self):
        """The highest order that the specimen has, or nearly so, in each frame."""
        top, k = KEYED[self.number][1], np.arange(self.count)
        return top * (0.85 + 0.15 * np.sin(2.0 * np.pi * k * 0.15 / (0.15 * 2.0 * np.pi * top)))

    @cached_property
    def _field(self):
        return FIELDS[KEYED[self.number][0]](self.shape)

    def order(self, frame):
        """Fringe order, NaN outside of the specimen."""
        return np.abs(self.course[frame] * self._field)

    def known(self):
        """The key of [frames] that tells its orders."""
        rows, cols = self.shape
        kind, middle = KEYED[self.number][2], {"row_px": rows // 2, "order": 0.0}
        if kind == "line":
            across = [int(0.3 * cols), int(0.6 * cols)]
            return {"known_line": [middle | {"row_px": [rows // 2] * 2, "col_px": across}]}
        if kind == "rim":
            away = int(0.975 * 0.46 * rows)
            return {
                "known_order": [middle | {"col_px": cols // 2 + side * away} for side in (-1, 1)]
            }
        row, col = np.unravel_index(np.nanargmin(np.abs(self._field)), self.shape)
        return {"known_order": [{"row_px": int(row), "col_px": int(col), "order": 0.0}]}

    def __str__(self):
        return f"{self.number:2d} {KEYED[self.number][0]:5s} to {self.course.max():4.1f}"


def judged(film, found, numbers=None):
    """Of each frame the share of the specimen that is known, of that what is on a wrong branch, and
    the RMS of the error of the rest; of the `numbers` of the film's frames."""
    orders = found.dataset.fringe_order.values
    rows = []
    for order, number in zip(
        orders, range(film.count) if numbers is None else numbers, strict=True
    ):
        known = np.isfinite(order)
        error = (order - film.order(number))[known & film.material]
        wrong = np.abs(error) > 0.25
        rms = float(np.sqrt(np.mean(error[~wrong] ** 2))) if (~wrong).any() else 0.0
        kept = np.count_nonzero(known & film.material) / np.count_nonzero(film.material)
        rows.append((kept, float(wrong.mean()) if error.size else 0.0, rms))
    return np.array(rows)
