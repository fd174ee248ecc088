r"""A real cylinder that slides on a half-plane: strips of even traction, no code of the package.

The gap of a rough, wavy, worn or dusty cylinder on a half-plane with a soft layer of compliance c,

    d - h(x) = c p + (2 / π E*) ∫ p ln(1 / |x - t|) dt + (2 β / E*) ∫ q dt up to x  where p > 0,

by strips as wide as a sample of the picture, solved for p >= 0 of a given load. Below the surface
each strip's field is a closed form (Johnson, Contact Mechanics, 1985, sections 2.5.1, 2.5.2) and
their sum a convolution along the surface, row by row. β is Dundurs', its sign that of the closed
form in `outside_contact`, which a test compares.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import fftconvolve

from .outside_contact import Contact

_REACH = 2.0
"""The strips reach so many half-widths to each side."""


@dataclass(frozen=True, kw_only=True)
class RealContact(Contact):
    """A contact with what a real one has.

    `modulus_change`, of E* against the scene's, relative; `layer_mm_per_mpa`; a wave of `wave_mm`
    height and `wavelength_mm`; a flat worn `flat_mm` deep; a grain, `grain_mm` high and
    `grain_width_mm` wide, `grain_at` half-widths from the middle; `uneven`, by how much the shear
    over the pressure grows over a half-width, relative; `coupled`, False where friction does not
    shift the pressure; `smooth_mpa` and `bending_mpa_per_mm`, stress along the surface besides.
    Strips are as wide as one of the `samples`, and are seen as such above their own width only.
    """

    modulus_change: float = 0.0
    layer_mm_per_mpa: float = 0.0
    wave_mm: float = 0.0
    wavelength_mm: float = 0.2
    flat_mm: float = 0.0
    grain_mm: float = 0.0
    grain_width_mm: float = 0.03
    grain_at: float = 0.0
    uneven: float = 0.0
    coupled: bool = True
    samples: int = 5
    smooth_mpa: float = 0.0
    bending_mpa_per_mm: float = 0.0

    @cached_property
    def tractions(self):
        """Places of the strips (mm), and their pressure and shear (MPa)."""
        half, eta, k = self._sizes(self.load_n)
        stiffness = 2.0 * self.radius_mm * k / np.cos(np.pi * eta)  # E*
        beta = -np.tan(np.pi * eta) / self.friction if self.friction else 0.0
        stiffness *= 1.0 + self.modulus_change
        step = self.pixel_mm / self.samples
        middle = round((-self.left_mm) / step)
        count = int(np.ceil(_REACH * half / step))
        x = self.left_mm + step * (np.arange(middle - count, middle + count) + 0.5)
        apart = x[:, None] - x[None, :]
        normal = -2.0 / np.pi / stiffness * (_log(apart + 0.5 * step) - _log(apart - 0.5 * step))
        normal += self.layer_mm_per_mpa * np.eye(len(x))
        if self.coupled:
            behind = np.clip(apart / step + 0.5, 0.0, 1.0)
            normal += 2.0 * beta / stiffness * self.friction * step * behind
        pressure = _pressed(normal, self._gap(x, half), self.load_n / self.thickness_mm / step)
        share = 1.0 + self.uneven * x / half
        shear = self.friction * pressure * share
        return (
            x,
            pressure,
            shear * (self.friction * pressure.sum() / shear.sum() if shear.any() else 1.0),
        )

    def _gap(self, x, half):
        """The cylinder's distance from its lowest point, undeformed (mm)."""
        gap = x**2 / (2.0 * self.radius_mm)
        gap = np.maximum(gap, self.flat_mm)
        gap = gap + self.wave_mm * np.cos(2.0 * np.pi * (x / self.wavelength_mm + 0.15))
        away = (x - self.grain_at * half) / (0.5 * self.grain_width_mm)
        return gap - self.grain_mm * np.maximum(1.0 - away**2, 0.0)

    def pressure_mpa(self):
        return float(self.tractions[1].max())

    def order(self, x, z):
        """Fringe order N on the samples' own grid: rows of z, and all of x."""
        places, pressure, shear = self.tractions
        step = self.pixel_mm / self.samples
        apart = x[0, 0] - places[-1] + step * np.arange(x.size + len(places) - 1)
        press, drag = _strip(apart[None, :], np.maximum(z, 1e-9), 0.5 * step)
        found = sum(
            fftconvolve(kernel, part[None, :], mode="valid", axes=1)
            for kernel, part in ((press, pressure), (drag, shear))
        )
        found = found + self.smooth_mpa + self.bending_mpa_per_mm * (z - 1.0)
        return self.thickness_mm / self.fringe_value * np.abs(found)


def _pressed(compliance, gap, total):
    """Pressure (n,) of strips that are pressed together: p >= 0, sum p = total, no gap below 0."""
    inside = gap <= np.sort(gap)[len(gap) // 4]
    for _ in range(200):
        at = np.flatnonzero(inside)
        system = np.block([
            [compliance[np.ix_(at, at)], -np.ones((len(at), 1))], [np.ones((1, len(at))), 0.0]
        ])  # fmt: skip
        *part, approach = np.linalg.solve(system, [*-gap[at], total])
        pressure = np.zeros(len(gap))
        pressure[at] = part
        left = compliance @ pressure + gap - approach
        new = np.where(inside, pressure > 0.0, left < -1e-12)
        if (new == inside).all():
            return pressure
        inside = new
    raise ValueError("the contact does not come to rest")


def _log(x):
    return x * np.log(np.maximum(np.abs(x), 1e-300))


def _strip(x, z, half):
    """σ_x - σ_z + 2i τ_xz of an even pressure of 1 over a strip, and of an even shear."""
    ahead, behind = np.arctan2(z, x - half), np.arctan2(z, x + half)
    turns = np.exp(2j * ahead) - np.exp(2j * behind)
    far = np.log(((x - half) ** 2 + z**2) / ((x + half) ** 2 + z**2))
    drag = far - turns.real - 1j * (2.0 * (ahead - behind) + turns.imag)
    return 1j / np.pi * turns, drag / np.pi
