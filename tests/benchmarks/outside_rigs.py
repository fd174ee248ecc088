"""Beams on a four-point rig that is not ours, with what a rig adds: no code of the package.

Lengths in half heights c, stress in fringe orders, eta downwards. Bending is N = E m(x) eta, with
the shear E m' (1 - eta²) of a changing moment; rollers near the view are the whole beam's field
under its four forces as a Fourier series (Timoshenko and Goodier, Theory of Elasticity, art. 24).
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import map_coordinates

from .outside_camera import NONE, Defects, _band, _places, _stored, _things, lit

WAVES, PATCH = 260, 0.06
"""Of the series, and the standard deviation of a roller's pressure."""

FINE = 2
"""Places of the series' grid in a pixel."""


@dataclass(frozen=True, kw_only=True)
class Rig:
    """A rig: its four-point spans, `inner` and `outer`, the inner rollers' `offset` along the
    beam and the share of the load by which the two differ, `uneven`; whether the `rollers`' own
    stress is there; an `axial` stress over the bending stress at the edge; stress `edge` along the
    upper and the lower edge (fringes), falling by e in `depth`; relative `creep` of the orders an
    image; a `stray` order's worth of load that the cell does not see; the camera's `defects`,
    `shape`, the beam's height, its angle and its middle's place (px).
    """

    inner: float = 4.0
    outer: float = 10.0
    offset: float = 0.0
    uneven: float = 0.0
    rollers: bool = False
    axial: float = 0.0
    edge: tuple[float, float] = (0.0, 0.0)
    depth: float = 0.03
    creep: float = 0.0
    stray: float = 0.0
    angle_deg: float = 0.7
    down_px: float = 2.0
    shape: tuple[int, int] = (110, 130)
    size_px: float = 80.0
    defects: Defects = field(default=NONE)

    @property
    def forces(self):
        """Places and sizes of the four forces, upper ones first, of a load of 1, down."""
        places = np.array(
            [-self.inner / 2, self.inner / 2, -self.outer / 2, self.outer / 2]
        ) + self.offset * np.array([1.0, 1.0, 0.0, 0.0])
        shares = np.array([0.5 * (1 + self.uneven), 0.5 * (1 - self.uneven)])
        right = (shares @ places[:2] + self.outer / 2) / self.outer
        return places, np.array([*shares, right - 1.0, -right])

    def moment(self, x):
        """Moment over that of two spans that are as stated, by places on the beam."""
        places, down = self.forces
        arms = np.maximum(np.asarray(x)[..., None] - places, 0.0)
        return -(arms @ down) * 4.0 / (self.outer - self.inner)

    def stress(self, x, eta):
        """sx - sz + 2i txz (fringes) of one at the edge by bending, at places (n,) and (m, 1)."""
        if self.rollers:
            local = _series(*self.forces, x, eta, 2.0 * self.outer)
            return local * (2.0 / 3.0) * 4.0 / (self.outer - self.inner)
        step = 1e-4
        slope = (self.moment(x + step) - self.moment(x - step)) / (2.0 * step)
        return self.moment(x) * eta + 1j * slope * (1.0 - eta**2)

    def machined(self, eta):
        """The edges' stress (fringes), its force and its moment none."""
        fine = np.linspace(-1.0, 1.0, 20001)
        total = 0.0
        for size, side in zip(self.edge, (-1.0, 1.0), strict=True):
            bare = np.exp(-(1.0 - side * fine) / self.depth)
            mean, turn = np.trapezoid(bare, fine) / 2.0, np.trapezoid(bare * fine, fine) * 1.5
            total = total + size * (np.exp(-(1.0 - side * eta) / self.depth) - mean - turn * eta)
        return total

    def images(self, orders, seed=0):
        """Grey levels of a dark field for each order at the edge, in the order they were taken."""
        half = 0.5 * self.size_px
        reach = 1.3 * np.array(self.shape[::-1]) / 2.0 + 8.0
        across, down = (np.arange(-n, n, 1.0 / FINE) / half for n in reach)
        unit = self.stress(across, np.clip(down, -1.0, 1.0)[:, None])
        frames = []
        for i, order in enumerate(orders):
            rng = np.random.default_rng([seed, i])
            x, z = _places(*self.shape, self.defects)
            z = z - self.down_px
            turn = np.radians(self.angle_deg)
            x, z = np.cos(turn) * x - np.sin(turn) * z, np.sin(turn) * x + np.cos(turn) * z
            at = [(z + reach[1]) * FINE, (x + reach[0]) * FINE]
            seen = map_coordinates(unit, at, order=3, mode="nearest")
            eta = z / half
            bent = order + self.stray
            field = bent * (seen + self.axial) * (1.0 + self.creep) ** i
            field = np.where(np.abs(eta) < 1.0, field + self.machined(np.clip(eta, -1, 1)), 0.0)
            signal = np.where(
                np.abs(eta) < 1.0,
                _band(np.abs(field), 0.5 * np.angle(field) + turn, self.defects), 0.0,
            )  # fmt: skip
            pixels = _things(lit(signal, self.defects), self.defects, rng, None)
            frames.append(_stored(pixels, self.defects, rng))
        return frames


def _series(places, down, x, eta, length):
    """sx - sz + 2i txz of a beam of half height 1 by forces, the first two on its upper edge.

    For each wave a the stress function (A cosh + B sinh + C eta sinh + D eta cosh)(a eta) times
    exp(i a x) leaves no shear on the edges and the forces' pressure; a moment that is the same all
    along goes into what a period has too much.
    """
    total = np.zeros((eta.size, x.size), complex)
    sx, sz, shear = (np.zeros((eta.size, x.size)) for _ in range(3))
    bent = 0.0
    fine = np.linspace(-1.0, 1.0, 401)
    for n in range(1, WAVES + 1):
        a = 2.0 * np.pi * n / length
        parts = down * np.exp(-1j * a * places - 0.5 * (a * PATCH) ** 2) * 2.0 / length
        upper, lower = parts[:2].sum(), parts[2:].sum()

        def forms(y, a=a):
            # scaled by exp(a), all of them; value, first and second derivative
            p, m = np.exp(a * (y - 1.0)), np.exp(-a * (y + 1.0))
            ch, sh = (p + m) / 2, (p - m) / 2
            return np.array(
                [
                    [ch, a * sh, a * a * ch],
                    [sh, a * ch, a * a * sh],
                    [y * sh, sh + a * y * ch, 2 * a * ch + a * a * y * sh],
                    [y * ch, ch + a * y * sh, 2 * a * sh + a * a * y * ch],
                ]
            )

        top, bottom = forms(-1.0), forms(1.0)
        # sz = -a² f is minus the pressure above; below, forces are down on the lower edge: pulled
        matrix = np.array([-a * a * top[:, 0], -a * a * bottom[:, 0], top[:, 1], bottom[:, 1]])
        result = np.linalg.solve(matrix, np.array([-upper, lower, 0.0, 0.0]))
        value, first, second = np.tensordot(result, forms(eta[:, 0]), (0, 0))
        wave = np.exp(1j * a * x)
        sx += np.real(second[:, None] * wave)
        sz += np.real(-a * a * value[:, None] * wave)
        shear += np.real(-1j * a * first[:, None] * wave)
        # its moment far outside, where there is none: int sx eta
        of_all = np.tensordot(result, forms(fine), (0, 0))[2]
        far = np.exp(1j * a * 0.5 * length)
        bent += np.trapezoid(np.real(of_all * far) * fine, fine)
    sx -= bent * 1.5 * eta
    sz -= down[:2].sum() / length  # the wave of length nought, pressed from both edges
    total.real, total.imag = sx - sz, 2.0 * shear
    return total
