r"""A contact with what a bench adds, by strips and by rays traced: no code of the package.

Each of `SLICES` of the thickness is a contact of its own,

    d - h(x) = c(p) + (2 / π E*) ∫ p ln(1 / |x - t|) dt + (2 β / E*) ∫ q dt up to x  where p > 0,

c(p) = c p of a soft layer, or -λ ln p of rough surfaces, whose pressure falls by e with each λ of
their gap. Worn, h grows by k p ds (Archard), stepped explicitly. A ray bends by C grad(σ1 + σ2) on
its way and sums the stress up; the picture is that of a plane `focus_mm` before where the middle of
the plate seems to be, which the ray's prolongation meets at X = x + d C (h - d/6n) grad S, x the
mean place of the ray, to first order: d/6n is .42 mm of 4 mm. Where `focus_mm` is 0 nothing bends.
Sources: Johnson (1985), Contact Mechanics, chapters 2 and 13; Born and Wolf, section 3.2.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import fft, ifft, next_fast_len
from scipy.ndimage import map_coordinates

from .outside_camera import _band, _stored, lit
from .outside_contact import Contact
from .outside_tractions import _log, _strip

SLICES = 15
"""Of the thickness of a plate whose load is uneven through it."""

STEPS = 6
"""Of a ray through a plate whose load is even; 1 is the first order alone, X = x + d C h grad S."""

MOMENTS = 4
"""Of an exposure: their mean is a sine's, exactly up to the seventh power of its amplitude."""

MARGIN = 12
"""Samples of the specimen around the picture, that roll and rays bring into it."""

STABLE = 0.45
"""Of 4 dx / (π k E*), beyond which explicit steps double the pressure; of two stages half of it."""

INDEX, OPTIC = 1.57, 1e-4
"""Refractive index of the plate, and C = dn / d(σ1 + σ2) (mm²/N) of PHYSICS.md's table."""


@dataclass(frozen=True, kw_only=True)
class BenchContact(Contact):
    """A contact that is static, sliding or worn, on a bench with any of these facts.

    `modulus_change` of the plate's E against the scene's, relative; `plane_stress`, the bodies' own
    where the scene says strain; `layer_mm_per_mpa` or `roughness_mm`, λ; `tilt`, relative change of
    the load at the faces (beyond 1 the one side lifts off); `focus_mm`, towards the camera, from
    the plane in which light seems to come from the stress that it met, a sixth of the plate's
    apparent thickness before its middle; stress along the edge, `edge_mpa`, falling over `edge_mm`;
    `fringe_change` of f_sigma, relative; `swing`, a sine of the load in the exposure,
    relative; `smooth_mpa` and `bending_mpa_per_mm`, along the surface; `worn_m`, a distance slid.
    Roll and blur are the `defects`'. The picture begins at the surface: `top_mm` is 0.
    """

    modulus_change: float = 0.0
    plane_stress: bool = False
    layer_mm_per_mpa: float = 0.0
    roughness_mm: float = 0.0
    focus_mm: float = 0.0
    edge_mpa: float = 0.0
    edge_mm: float = 0.3
    fringe_change: float = 0.0
    swing: float = 0.0
    smooth_mpa: float = 0.0
    bending_mpa_per_mm: float = 0.0
    worn_m: float = 0.0
    wear_mm2_per_n: float = 2e-9
    samples: int = 5

    @cached_property
    def moduli(self):
        """E* (MPa) and Dundurs' β; plane stress is strain of E(1+2ν)/(1+ν)² and ν/(1+ν)."""
        shear, normal = 0.0, 0.0
        bodies = (1e3 * self.young_gpa * (1.0 + self.modulus_change), self.poisson), (210e3, 0.3)
        for sign, (young, nu) in zip((1.0, -1.0), bodies, strict=True):
            compliance = (1.0 + nu) / young  # 1/(2G), the same in both
            nu = nu / (1.0 + nu) if self.plane_stress else nu
            normal += (1.0 - nu) * compliance
            shear += sign * (1.0 - 2.0 * nu) * compliance
        return 1.0 / normal, 0.5 * shear / normal

    @cached_property
    def loads(self):
        """Each slice's share of the load over the mean's."""
        if not self.tilt:
            return np.ones(1)
        face = (np.arange(SLICES) + 0.5) / SLICES * 2.0 - 1.0
        share = np.maximum(1.0 + self.tilt * face, 0.0)
        return share / share.mean()

    @cached_property
    def strips(self):
        """Places of the strips (mm), and their width, a sample's."""
        stiffness, _ = self.moduli
        most = self.load_n / self.thickness_mm * self.loads.max() * (1.0 + self.swing)
        half = np.sqrt(4.0 * most * self.radius_mm / np.pi / stiffness)
        slid = self.wear_mm2_per_n * 1e3 * self.worn_m
        # a scar and a soft layer have the same parabola; a rough pressure falls as a bell
        soft = np.cbrt(1.5 * self.radius_mm * most * np.array([slid, self.layer_mm_per_mpa]))
        bell = np.sqrt(30.0 * self.radius_mm * self.roughness_mm)
        reach = 1.3 * half + 1.1 * soft.sum() + bell
        step = self.pixel_mm / self.samples
        middle, count = round(-self.left_mm / step), int(np.ceil(reach / step))
        return self.left_mm + step * (middle + np.arange(-count, count) + 0.5), step

    @cached_property
    def compliance(self):
        """Surface displacement (n, n) of the strips' pressures, with their shear's."""
        stiffness, beta = self.moduli
        x, step = self.strips
        apart = x[:, None] - x[None, :]
        matrix = -2.0 / np.pi / stiffness * (_log(apart + 0.5 * step) - _log(apart - 0.5 * step))
        behind = np.clip(apart / step + 0.5, 0.0, 1.0)
        matrix += 2.0 * beta / stiffness * self.friction * step * behind
        return matrix + self.layer_mm_per_mpa * np.eye(len(x))

    def pressed(self, gap, per_mm, start=None):
        """Pressure (n,) of the strips under a load, sought from a `start`."""
        solver = _rough if self.roughness_mm else _pressed
        extra = (self.roughness_mm,) if self.roughness_mm else ()
        return solver(self.compliance, gap, per_mm / self.strips[1], start, *extra)

    def worn_gap(self, per_mm):
        """The gap (n,) after the distance, by Adams and Bashforth's second-order steps."""
        x, step = self.strips
        gap = x**2 / (2.0 * self.radius_mm)
        if not self.worn_m:
            return gap
        rate = np.pi * self.wear_mm2_per_n * self.moduli[0] / 4.0
        count = int(np.ceil(1e3 * self.worn_m * rate / step / STABLE))
        wear = self.wear_mm2_per_n * 1e3 * self.worn_m / count
        pressure = before = self.pressed(gap, per_mm)
        for _ in range(count):
            gap = gap + wear * (1.5 * pressure - 0.5 * before)
            before, pressure = pressure, self.pressed(gap, per_mm, pressure)
        return gap

    @cached_property
    def tractions(self):
        """Pressure (moments, slices, strips) of the exposure's moments."""
        per_mm = self.load_n / self.thickness_mm
        moments = np.ones(1)
        if self.swing:
            turn = np.pi * (np.arange(MOMENTS) + 0.5) / MOMENTS
            moments = 1.0 + self.swing * np.cos(turn)
        pressure = np.zeros((len(moments), len(self.loads), len(self.strips[0])))
        start = None
        for k, share in enumerate(self.loads):
            if not share:
                continue
            gap = self.worn_gap(per_mm * share)
            for j, moment in enumerate(moments):
                start = self.pressed(gap, per_mm * share * moment, start)
                pressure[j, k] = start
        return pressure

    def pressure_mpa(self):
        return float(self.tractions.max())

    def _grid(self):
        """The samples' x (1, cols) and z (rows, 1) on the specimen, margin and all (mm)."""
        rows, cols = (n * self.samples for n in self.shape)
        step = self.pixel_mm / self.samples
        x = self.left_mm + step * (np.arange(-MARGIN, cols + MARGIN) + 0.5)[None, :]
        return x, step * (np.arange(rows + MARGIN) + 0.5)[:, None]

    def fields(self, x, z, pull=False):
        """σ_x - σ_z + 2i τ_xz (MPa), by moment and slice; with `pull` grad(σ1 + σ2) as x + i z."""
        (places, fine), pressure = self.strips, self.tractions
        apart = x[0, 0] - places[-1] + fine * np.arange(x.size + len(places) - 1)[None, :]
        if pull:
            kernel = _pull(apart, z, 0.5 * fine, self.friction)
        else:
            press, drag = _strip(apart, z, 0.5 * fine)
            kernel = press + self.friction * drag
        count = next_fast_len(apart.size)
        kernel = fft(kernel, count, axis=1)
        slopes = -self.edge_mpa * np.exp(-z / self.edge_mm) / self.edge_mm
        besides = self.edge_mpa * np.exp(-z / self.edge_mm) + self.smooth_mpa
        besides = besides + self.bending_mpa_per_mm * (z - 1.0)
        besides = 1j * (slopes + self.bending_mpa_per_mm) if pull else besides
        first = len(places) - 1

        def of(part):
            field = ifft(kernel * fft(part, count)[None, :], axis=1)[:, first : first + x.size]
            return field + besides

        return of, pressure

    def order(self, x, z):
        """Fringe order N on the samples' own grid, through the plate and not bent."""
        stress, pressure = self.fields(x, z)
        scale = self.thickness_mm / self.fringe_value / (1.0 + self.fringe_change)
        return scale * np.abs(stress(pressure.mean(axis=(0, 1))))

    def signal(self):
        """The dark field's mean over the exposure (rows, cols), at the specimen's samples."""
        x, z = self._grid()
        scale = self.thickness_mm / self.fringe_value / (1.0 + self.fringe_change)
        stress, pressure = self.fields(x, z)
        bend = self.fields(x, z, pull=True)[0] if self.focus_mm else None
        total, turn = 0.0, np.zeros(())
        for slices in pressure:
            if bend is None:
                order, seen = stress(slices.mean(axis=0)), None
            else:
                order, seen = self._traced(stress, bend, slices)
            light = np.nan_to_num(_band(scale * np.abs(order), turn, self.defects))
            total = total + (light if seen is None else _gathered(light, seen))
        return total / len(pressure)

    def _traced(self, stress, bend, slices):
        """Mean stress along each ray, and the sample's row and column at which it is seen."""
        step = self.pixel_mm / self.samples
        shape = len(self._grid()[1]), self._grid()[0].size
        at = np.array(np.indices(shape, dtype=float))
        slope = np.zeros_like(at)
        even = len(slices) == 1
        count = STEPS if even else len(slices)
        length = self.thickness_mm / count
        mean, field, pull = 0.0, None, None
        for k in range(count):
            if field is None or not even:
                part = slices[min(k, len(slices) - 1)]
                field, pull = stress(part), bend(part)
            # half a step along, then the turn and the stress there, then the other half
            at = at + 0.5 * length / step * slope
            there = pull if k == 0 else map_coordinates(pull, at, order=1, mode="nearest")
            slope = slope + OPTIC / INDEX * length * np.array([there.imag, there.real])
            here = field if k == 0 else map_coordinates(field, at, order=1, mode="nearest")
            mean = mean + here / count
            at = at + 0.5 * length / step * slope
            mean = np.where(at[0] < -0.5, np.nan, mean)  # through the surface
        out = INDEX * slope  # refracted at the face
        # of a parabola the mean stress lies a third of its end's way off: a sixth of the thickness
        away = self.focus_mm + (1.0 / 6.0 - 0.5) * self.thickness_mm / INDEX
        return mean, at + out * away / step

    def frame(self, seed=0, harm=None):
        """The stored grey levels (rows, cols); `harm`, what is done to the light before."""
        rows, cols = (n * self.samples for n in self.shape)
        signal = self.signal()
        if self.defects.roll_deg:
            phi = np.radians(self.defects.roll_deg)
            v = (np.arange(rows) + 0.5 - 0.5 * rows)[:, None]
            u = (np.arange(cols) + 0.5 - 0.5 * cols)[None, :]
            row = np.sin(phi) * u + np.cos(phi) * v + 0.5 * rows - 0.5
            col = np.cos(phi) * u - np.sin(phi) * v + 0.5 * cols - 0.5 + MARGIN
            seen = map_coordinates(signal, [row, col], order=3, mode="nearest")
            signal = np.where(row > -0.5, seen, 0.0)
        else:
            signal = signal[:rows, MARGIN : MARGIN + cols]
        light = lit(signal, self.defects, self.samples)
        rng = np.random.default_rng(seed)
        return _stored(light if harm is None else harm(light), self.defects, rng)

    def scene(self):
        """The scene of it, which says nothing of the facts."""
        tables = super().scene()
        if self.worn_m:
            tables["friction"]["static_state_first"] = False
            tables["wear"] = {
                "coefficient_mm2_per_n": self.wear_mm2_per_n, "distances_m": [self.worn_m],
            }  # fmt: skip
        return tables


def _pressed(compliance, gap, total, start):
    """Pressure p >= 0 of strips that are pressed together, sum p = total, no gap below 0."""
    inside = gap <= np.sort(gap)[len(gap) // 4] if start is None else start > 0.0
    for _ in range(200):
        at = np.flatnonzero(inside)
        both = np.linalg.solve(
            compliance[np.ix_(at, at)], np.array([-gap[at], np.ones(len(at))]).T
        )  # fmt: skip
        approach = (total - both[:, 0].sum()) / both[:, 1].sum()
        pressure = np.zeros(len(gap))
        pressure[at] = both[:, 0] + approach * both[:, 1]
        apart = compliance[:, at] @ pressure[at] + gap - approach
        new = np.where(inside, pressure > 0.0, apart < -1e-12)
        if (new == inside).all():
            return pressure
        inside = new
    raise ValueError("the contact does not come to rest")


def _rough(compliance, gap, total, start, decay):
    """Pressure of strips whose p falls by e with each `decay` of their gap, sum p = total."""
    if start is None:  # from rougher surfaces, whose problem is more even
        start = np.maximum(_pressed(compliance, gap, total, None), 1e-3 * total / len(gap))
        for rougher in (8.0, 4.0, 2.0):
            start = _rough(compliance, gap, total, start, rougher * decay)
    level = np.log(np.maximum(start, 1e-30))
    for _ in range(200):
        pressure = np.exp(level)
        error = decay * level + gap + compliance @ pressure
        slope = compliance * pressure[None, :]
        slope[np.diag_indices(len(gap))] += decay
        both = np.linalg.solve(slope, np.array([-error, np.ones(len(gap))]).T)
        approach = (total - pressure.sum() - pressure @ both[:, 0]) / (pressure @ both[:, 1])
        change = both[:, 0] + approach * both[:, 1]
        level = level + change / max(1.0, np.abs(change[pressure > 1e-6 * total]).max())
        if np.abs(change * pressure).max() < 1e-7 * pressure.max():
            return np.exp(level)
    raise ValueError("the rough contact does not come to rest")


def _pull(x, z, half, friction):
    """Gradient of σ_x + σ_z, as x + i z, of an even pressure of 1 over a strip with its shear."""
    ahead, behind = 1.0 / (x - half + 1j * z), 1.0 / (x + half + 1j * z)
    # σ_x + σ_z = Re W, W = (2/π) (i + friction) ln((w - half)/(w + half)), its gradient conj(W')
    return np.conj(2.0 / np.pi * (1j + friction) * (ahead - behind))


def _gathered(light, seen):
    """Light (rows, cols) of rays where they are seen, shared by the four samples around each."""
    rows, cols = light.shape
    row, col = np.clip(np.nan_to_num(seen, nan=-9.0), -9.0, max(light.shape) + 9.0)
    top, left = np.floor(row).astype(int), np.floor(col).astype(int)
    low, far = row - top, col - left
    wide = cols + 20
    total = np.zeros((rows + 20) * wide)
    for i, part in ((0, 1.0 - low), (1, low)):
        for j, share in ((0, 1.0 - far), (1, far)):
            at = np.clip(top + i + 9, 0, rows + 19) * wide + np.clip(left + j + 9, 0, wide - 1)
            total += np.bincount(at.ravel(), (light * part * share).ravel(), len(total))
    return total.reshape(rows + 20, wide)[9 : 9 + rows, 9 : 9 + cols]
