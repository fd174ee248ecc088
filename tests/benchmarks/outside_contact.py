r"""A cylinder that slides on a half-plane, by closed forms written out: no code of the package.

The pressure p = k (1 + ξ/a)^α (1 - ξ/a)^(1-α) a and the shear q = mu p have the transform
F(w) = (1/π) ∫ p/(w - t) dt = (k / cos πη) (w + 2 η a - (w + a)^α (w - a)^(1-α)), α = 1/2 + η,
w = ξ + i z, and the field σ_x - σ_z + 2i τ_xz = 2 z conj(F') - 2 mu (conj F - i z conj(F')), from
the radial field of a force on the surface. tan πη = -β mu of Dundurs' β, k/cos πη = E*/(2R).
Sources: Johnson (1985), Contact Mechanics, sections 2.2, 2.3, 7.2; Muskhelishvili (1953).
"""

from dataclasses import dataclass, field

import numpy as np

from .outside_camera import NONE, SAMPLES, Defects, _band, _stored, lit

SLICES = 24
"""Of the thickness, each with a load of its own."""


@dataclass(frozen=True, kw_only=True)
class Contact:
    """A steel cylinder on a plate, and the picture of it.

    `tilt`, how much more load the plate's one face carries, and the other less, relative; the
    picture's `shape`, `pixel_mm` and upper left corner, from the cylinder's axis and the surface;
    `samples`, a pixel's side.
    """

    load_n: float = 47.3
    friction: float = 0.0
    tilt: float = 0.0
    radius_mm: float = 24.61
    young_gpa: float = 2.1
    poisson: float = 0.4
    thickness_mm: float = 4.0
    fringe_value: float = 14.6
    shape: tuple[int, int] = (124, 165)
    pixel_mm: float = 4.0 / 165
    left_mm: float = -2.0
    top_mm: float = 0.0
    defects: Defects = field(default_factory=lambda: NONE)
    samples: int = SAMPLES

    def order(self, x, z):
        """Fringe order N at places (mm); the mean stress of all slices of the thickness counts."""
        share = (np.arange(SLICES) + 0.5) / SLICES * 2.0 - 1.0
        loads = [1.0] if not self.tilt else 1.0 + self.tilt * share
        total = sum(self._difference(x, z, self.load_n * part) for part in loads) / len(loads)
        return self.thickness_mm / self.fringe_value * np.abs(total)

    def pressure_mpa(self):
        """The largest pressure of a contact whose load is even."""
        a, eta, k = self._sizes(self.load_n)
        # p = k (a + ξ)^α (a - ξ)^(1-α) is largest at ξ = 2 η a
        return k * a * (1.0 + 2.0 * eta) ** (0.5 + eta) * (1.0 - 2.0 * eta) ** (0.5 - eta)

    def _sizes(self, load_n):
        """Half-width (mm), the exponent's η and k of a load."""
        moduli = (1e3 * self.young_gpa, self.poisson), (210e3, 0.3)
        plate, steel = ((1.0 + nu) / e for e, nu in moduli)  # 1/(2G)
        (_, nu), (_, mu) = moduli
        compliance = 2.0 * ((1.0 - nu) * plate + (1.0 - mu) * steel)  # 2/E*
        beta = ((1.0 - 2.0 * nu) * plate - (1.0 - 2.0 * mu) * steel) / compliance
        eta = -np.arctan(beta * self.friction) / np.pi
        per_mm = load_n / self.thickness_mm
        a = np.sqrt(2.0 * per_mm * self.radius_mm * compliance / np.pi / (1.0 - 4.0 * eta**2))
        return a, eta, np.cos(np.pi * eta) / (self.radius_mm * compliance)

    def _difference(self, x, z, load_n):
        a, eta, k = self._sizes(load_n)
        alpha = 0.5 + eta
        w = x - 2.0 * eta * a + 1j * np.maximum(z, 1e-9)
        root = (w + a) ** alpha * (w - a) ** (1.0 - alpha)
        scale = k / np.cos(np.pi * eta)
        found = np.conj(scale * (w + 2.0 * eta * a - root))
        slope = np.conj(scale * (1.0 - root * (alpha / (w + a) + (1.0 - alpha) / (w - a))))
        return 2.0 * z * slope - 2.0 * self.friction * (found - 1j * z * slope)

    def seen(self, samples=None):
        """Orders at the samples of the picture's pixels; NaN above the surface."""
        rows, cols = self.shape
        samples = samples or self.samples
        step = self.pixel_mm / samples
        x = self.left_mm + step * (np.arange(cols * samples) + 0.5)
        z = (self.top_mm + step * (np.arange(rows * samples) + 0.5))[:, None]
        return np.where(z > 0.0, self.order(x[None, :], z), np.nan)

    def frame(self, seed=0, harm=None):
        """The stored grey levels (rows, cols); `harm`, what is done to the light before."""
        signal = np.nan_to_num(_band(self.seen(), np.zeros(()), self.defects))
        light = lit(signal, self.defects, self.samples)
        rng = np.random.default_rng(seed)
        return _stored(light if harm is None else harm(light), self.defects, rng)

    def scene(self):
        """The scene of it, whose load is even, as plain tables."""
        rows, cols = self.shape
        tables = {
            "specimen": {
                "young_gpa": self.young_gpa, "poisson": self.poisson,
                "thickness_mm": self.thickness_mm, "fringe_value_n_per_mm": self.fringe_value,
            },
            "indenter": {"radius_mm": self.radius_mm, "young_gpa": 210.0, "poisson": 0.3},
            "load": {"normal_n": self.load_n},
            "polariscope": {"wavelength_nm": 587.0},
            "camera": {
                "width_px": cols, "height_px": rows, "pixel_mm": self.pixel_mm,
                "left_mm": self.left_mm, "top_mm": self.top_mm, "bit_depth": 8,
            },
        }  # fmt: skip
        return tables | ({"friction": {"coefficient": self.friction}} if self.friction else {})
