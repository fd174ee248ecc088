r"""The model of a whole set: each image's own fringes under one light, through one camera.

    I_i = e_i (A s_i + B),    s_i = 1/2 -+ 1/2 V_i cos 2π N_i(x, z),

with the illumination A and the background B of all images (sums of smooth images, eliminated
linearly), image i's exposure e_i and its order N_i, a specimen's closed form at the places (x, z)
that the pixels look at through the lens (`isochrome.stress`). Contrast falls with the order in a
band of wavelengths, and with its slope by blur: V = exp(-a N² - b |grad N|²).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.shot import Shot
from isochrome.calibration.whole_set.set_image import SetImage, looked_at
from isochrome.estimation import (
    MOSTLY,
    Damping,
    Terms,
    block_correlation,
    light_products,
    line_correlation,
    minimise,
    scaled_inverse,
    total_degree,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LENS = ("camera.distortion", "camera.keystone_x", "camera.keystone_z")
BAND, BLUR, GAMMA = "polariscope.bandwidth_nm", "camera.blur_px", "frames.gamma"
SHARED = (*LENS, BAND, BLUR, GAMMA)
"""What all images may share besides the light, by the keys that a scene has for them."""

PIXEL = np.pi**2 / 6.0
"""What a pixel's own area takes of the contrast, as `b` of a blur."""

_BESIDE = ((1, 0), (-1, 0), (0, 1), (0, -1))

_STEPS = dict(zip(SHARED, (1e-5, 1e-5, 1e-5, 1e-6, 1e-3, 1e-5), strict=True))
"""Steps of their derivatives."""

_CORRELATED = 1.2
"""Variance of sums of residuals, over that of independent ones, that these may have by chance."""

_MOST_STEPS = 40
_ENOUGH = 1e-3
"""Fall of chi-square, in units of the noise that is left, below which a step is the last."""


@dataclass(frozen=True)
class Kind:
    """A specimen: its `order` (n,), with a sign or none, for an image's unknowns (p,) at rows and
    columns (n,), px; `steps` (p,) of their derivatives, and the `largest` moves of them at once.
    """

    order: Callable[[Array, Array, Array], Array]
    steps: Array
    largest: Array


@dataclass(frozen=True, kw_only=True)
class SetModel:
    """Images `shots` (m,) of one size on common pixels, at `rows` (R,) and `cols` (C,), each where
    its `masks` (m, R, C) say; the light's polynomial `terms`; the `free` keys of SHARED, and what
    the others are `held` at; `levels` (m, R, C), the light without noise where a fit tells it.
    """

    kind: Kind
    shots: Sequence[Shot]
    rows: NDArray[np.intp]
    cols: NDArray[np.intp]
    masks: Mask
    terms: tuple[Terms, Terms] = (total_degree(2), total_degree(1))
    free: tuple[str, ...] = ()
    held: dict[str, float] = field(default_factory=dict)
    levels: Array | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the whole picture."""
        return self.shots[0].light.shape[0], self.shots[0].light.shape[1]

    @cached_property
    def images(self) -> tuple[SetImage, ...]:
        """The images' pixels."""
        pick = np.ix_(self.rows, self.cols)
        return tuple(
            SetImage.of(shot, pick, mask, None if self.levels is None else self.levels[i])
            for i, (shot, mask) in enumerate(zip(self.shots, self.masks, strict=True))
        )

    @cached_property
    def bases(self) -> tuple[tuple[Array, Array], ...]:
        """The light's images over each image's noise, (ka, n) and (kc, n).

        The last of the background's are what each image after the first has beside the others.
        """
        result, more = [], np.eye(len(self.shots))[:, 1:]
        for (light, dark), own, image in zip(
            self.weighted(self.terms), more, self.images, strict=True
        ):
            offsets = own[:, None] / image.sigma
            result.append((light, np.concatenate((dark, offsets))))
        return tuple(result)

    def weighted(self, terms: tuple[Terms, Terms]) -> tuple[tuple[Array, Array], ...]:
        """Some light's images over each image's noise."""
        places = [np.linspace(-1.0, 1.0, n) for n in self.shape]
        axes = places[0][self.rows], places[1][self.cols]
        light, dark = (light_products(axes, chosen, np.float64) for chosen in terms)
        lamp = self.shots[0].lamp(*np.ix_(self.rows, self.cols))
        light = light if lamp is None else light * lamp
        result: list[tuple[Array, Array]] = [
            (light[:, i.mask] / i.sigma, dark[:, i.mask] / i.sigma) for i in self.images
        ]
        return tuple(result)

    def split(self, values: Array) -> tuple[Array, Array, dict[str, float]]:
        """Unknowns: the images' own (m, p), their exposures (m,), and what they share."""
        count, own = len(self.shots), len(self.kind.steps)
        table = values[: count * own].reshape(count, own)
        exposure = np.exp(np.concatenate([[0.0], values[count * own :][: count - 1]]))
        shared = dict.fromkeys(SHARED, 0.0) | {GAMMA: 1.0} | self.held
        return table, exposure, shared | dict(zip(self.free, values[self.first :], strict=True))

    @property
    def first(self) -> int:
        """Where the shared unknowns begin."""
        return len(self.shots) * (len(self.kind.steps) + 1) - 1

    def places(self, index: int, shared: dict[str, float]) -> tuple[Array, Array]:
        """Rows and columns (n,), px, of the places that an image's pixels look at."""
        image = self.images[index]
        if not any(shared[key] for key in LENS):
            return image.rows, image.cols
        return looked_at(image, self.shape, {key: shared[key] for key in LENS})

    def signal(self, index: int, own: Array, shared: dict[str, float]) -> Array:
        """The polariscope's 0..1 at an image's pixels (n,)."""
        rows, cols = self.places(index, shared)
        at = self.kind.order
        order = at(own, rows, cols)
        beside = [at(own, rows + d, cols + c) - order for d, c in _BESIDE]
        steep = 0.25 * ((beside[0] - beside[1]) ** 2 + (beside[2] - beside[3]) ** 2)
        # a blur adds half its variance times the curvature to the order
        spread = PIXEL + shared[BLUR]
        blurred = order + spread / (4.0 * np.pi**2) * sum(beside)
        # a band's mean phase is that of its mean wave number, less the third cumulant's part
        share, phase = shared[BAND] / (2.0 * np.pi**2), 2.0 * np.pi * blurred
        wave = np.cos(phase * (1.0 + share - (share * phase) ** 2))
        wave *= np.exp(-shared[BAND] * order**2 - spread * steep)
        return np.asarray(0.5 + 0.5 * wave if self.shots[index].bright else 0.5 - 0.5 * wave)

    def at(self, values: Array) -> SetPoint | None:
        """The model at some unknowns, None where it is not finite."""
        table, exposure, shared = self.split(values)
        signals = tuple(self.signal(i, own, shared) for i, own in enumerate(table))
        if not all(np.isfinite(s).all() for s in signals):
            return None
        return SetPoint(self, values, signals, exposure, shared[GAMMA])

    def fit(self, start: Array) -> SetFit:
        """Least squares from a start."""
        largest = np.full(len(start), np.inf)
        count, own = len(self.shots), len(self.kind.steps)
        largest[: count * own] = np.tile(self.kind.largest, count)
        largest[self.first :] = [0.2 if key in (GAMMA, BLUR) else 0.02 for key in self.free]

        def cut(_: Array, step: Array) -> Array:
            return np.asarray(step / max(1.0, float(np.max(np.abs(step) / largest))))

        first = self.at(start)
        assert first is not None
        result = minimise(
            self.at, start, first, damping=Damping(1e-3), iterations=_MOST_STEPS, cut=cut,
            enough=lambda at: _ENOUGH * max(1.0, at.cost / at.pixels),
            better=lambda new, old: new.cost < old.cost and (new.positive or not old.positive),
        )  # fmt: skip
        return SetFit(self, result.values, result.point, result.converged)

    def freed(
        self, values: Array, free: tuple[str, ...], held: dict[str, float] | None = None
    ) -> tuple[SetModel, Array]:
        """The model with other keys free, and where its unknowns start."""
        shared = self.split(values)[2]
        model = replace(self, free=free, held=self.held if held is None else held)
        return model, np.concatenate([values[: self.first], [shared[key] for key in free]])


@dataclass(frozen=True)
class SetPoint:
    """The model at some unknowns: its signals (m,) of (n,), exposures (m,) and tone."""

    model: SetModel
    values: Array
    signals: tuple[Array, ...]
    exposure: Array
    gamma: float

    def columns(self, index: int, bases: tuple[Array, Array] | None = None) -> Array:
        """Weighted columns of an image by the light's coefficients (k, n)."""
        light, dark = bases or self.model.bases[index]
        weight = self.exposure[index] * self.model.images[index].scale(self.gamma)
        return np.concatenate((light * (weight * self.signals[index]), dark * weight))

    @cached_property
    def linear(self) -> tuple[Array, Array, tuple[Array, ...]]:
        """Coefficients of the light, their inverse normal equations, the weighted residuals."""
        size = sum(map(len, self.model.bases[0]))
        gram, right, data = np.zeros((size, size)), np.zeros(size), []
        for i, image in enumerate(self.model.images):
            columns = self.columns(i)
            value = image.toned(self.gamma)
            gram, right = gram + columns @ columns.T, right + columns @ value
            data.append(value)
        inverse = scaled_inverse(gram)
        coefficients = inverse @ right
        residual = tuple(value - coefficients @ self.columns(i) for i, value in enumerate(data))
        return coefficients, inverse, residual

    @cached_property
    def cost(self) -> float:
        """Chi-square over all images."""
        return float(sum(r @ r for r in self.linear[2]))

    @property
    def pixels(self) -> int:
        """Pixels of all images."""
        return sum(i.light.size for i in self.model.images)

    def amplitude(self, index: int) -> Array:
        """The illumination over the noise (n,)."""
        light = self.model.bases[index][0]
        return np.asarray(self.linear[0][: len(light)] @ light)

    @cached_property
    def positive(self) -> bool:
        """Whether the illumination is positive over (nearly) all pixels."""
        negative = sum(np.count_nonzero(self.amplitude(i) <= 0) for i in range(len(self.signals)))
        return bool(negative <= MOSTLY * self.pixels)

    def _gain(self, index: int) -> Array:
        """How an image's pixels change with its signal (n,)."""
        scale = self.exposure[index] * self.model.images[index].scale(self.gamma)
        return np.asarray(self.amplitude(index) * scale)

    def shared_rows(self, index: int, keys: tuple[str, ...]) -> Array:
        """Weighted derivatives of one image by shared keys (k, n)."""
        table, _, shared = self.model.split(self.values)
        gain = self.amplitude(index) * (
            self.exposure[index] * self.model.images[index].scale(self.gamma)
        )
        rows = np.empty((len(keys), gain.size))
        for row, key in zip(rows, keys, strict=True):
            if key == GAMMA:
                row[:] = self._tone_row(index)
                continue
            moved = shared | {key: shared[key] + _STEPS[key]}
            change = self.model.signal(index, table[index], moved) - self.signals[index]
            row[:] = change * gain / _STEPS[key]
        return rows

    def _tone_row(self, index: int) -> Array:
        """How an image's residual changes with the exponent, the other way round."""
        image = self.model.images[index]
        step = _STEPS[GAMMA]
        later = replace(self, gamma=self.gamma + step)
        model = (self.linear[0] @ (later.columns(index) - self.columns(index))) / step
        data = (image.toned(self.gamma + step) - image.toned(self.gamma)) / step
        return np.asarray(model - data)

    def rows(self, index: int) -> Array:
        """Weighted derivatives of one image by its own unknowns, exposure and shared ones."""
        model = self.model
        own = model.split(self.values)[0][index]
        shared = model.split(self.values)[2]
        gain = self.amplitude(index) * (
            self.exposure[index] * self.model.images[index].scale(self.gamma)
        )
        rows = np.empty((len(own), gain.size))
        for j, step in enumerate(model.kind.steps):
            moved = own.copy()
            moved[j] += step
            change = model.signal(index, moved, shared) - self.signals[index]
            rows[j] = change * gain / step
        parts = [rows, self.shared_rows(index, model.free)]
        if index:
            parts.insert(1, (self.linear[0] @ self.columns(index))[None])
        return np.concatenate(parts)

    def columns_of(self, index: int) -> NDArray[np.intp]:
        """Which unknowns the `rows` of an image are by."""
        model, own = self.model, len(self.model.kind.steps)
        exposures = len(model.shots) * own
        start = np.arange(index * own, (index + 1) * own)
        end = np.arange(model.first, len(self.values))
        return np.concatenate([start, [exposures + index - 1][: min(index, 1)], end]).astype(int)

    @cached_property
    def equations(self) -> tuple[Array, Array]:
        """Normal equations with the light eliminated, and their right side."""
        size, (_, inverse, residual) = len(self.values), self.linear
        normal, gradient = np.zeros((size, size)), np.zeros(size)
        cross = np.zeros((size, len(inverse)))
        for i, left in enumerate(residual):
            rows, place = self.rows(i), self.columns_of(i)
            normal[np.ix_(place, place)] += rows @ rows.T
            gradient[place] += rows @ left
            cross[place] += rows @ self.columns(i).T
        return normal - cross @ inverse @ cross.T, gradient

    @property
    def normal(self) -> Array:
        """The normal equations' matrix."""
        return self.equations[0]

    @property
    def gradient(self) -> Array:
        """Their right side."""
        return self.equations[1]


@dataclass(frozen=True)
class SetFit:
    """A fitted set: its `model`, unknowns, the `point` there, whether it `converged`, and the part
    of the pixels that was `left_out`.
    """

    model: SetModel
    values: Array
    point: SetPoint
    converged: bool
    left_out: float = 0.0

    @property
    def unknowns(self) -> int:
        """All unknowns, the light's as well."""
        return self.values.size + len(self.point.linear[0])

    @property
    def chi(self) -> float:
        """Residual over noise."""
        return float(np.sqrt(self.point.cost / (self.point.pixels - self.unknowns)))

    @cached_property
    def correlation(self) -> float:
        """Variance of sums of residuals over that of independent ones, 1 at least.

        Sums over blocks of 4 x 4 pixels, or over rows where that is more: rows have their own noise
        in many cameras, and a beam's fringes lie along them.
        """
        ratios = []
        for image, left in zip(self.model.images, self.point.linear[2], strict=True):
            rows = line_correlation(image.mask, left, 1)
            ratios.append((rows, block_correlation(image.mask, left)))
        ratio = float(np.mean(ratios, axis=0).max())
        return ratio if ratio > _CORRELATED else 1.0

    @cached_property
    def covariance(self) -> Array:
        """Of the unknowns by the noise, its correlation and a chi above 1 included."""
        wider = max(1.0, self.chi) ** 2 * self.correlation
        return np.asarray(scaled_inverse(self.point.normal, 1e-14) * wider)

    def levelled(self) -> SetFit:
        """The same fit, with its own model as the light without noise of each image."""
        levels = np.ones(self.model.masks.shape)
        for level, image, left in zip(levels, self.model.images, self.point.linear[2], strict=True):
            level[image.mask] = image.light - image.sigma * left
        model = replace(self.model, levels=levels)
        point = model.at(self.values)
        assert point is not None
        return replace(self, model=model, point=point)

    @property
    def own(self) -> Array:
        """The images' own unknowns (m, p)."""
        return self.model.split(self.values)[0]

    @property
    def shared(self) -> dict[str, tuple[float, float]]:
        """The free shared keys: value and standard uncertainty."""
        spread = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))[self.model.first :]
        return {
            key: (float(v), float(u))
            for key, v, u in zip(
                self.model.free, self.values[self.model.first :], spread, strict=True
            )
        }
