r"""The model of a whole set: each image's own fringes under one light, through one camera.

    I_i = e_i (A s_i + B) + c_i,    s_i = 1/2 -+ 1/2 V_i cos 2π N_i(x, z),

with the illumination A and the background B of all images (sums of smooth images, eliminated
linearly), image i's exposure e_i and stray light c_i, and its order N_i, a specimen's closed form
at the places (x, z) that the pixels look at through the lens (`isochrome.stress`). Contrast falls
with the order in a band of wavelengths, and with its slope by blur: V = exp(-a N² - b |grad N|²).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.shot import EXPLAINED, Shot
from isochrome.estimation import (
    LEVEL_PX,
    MOSTLY,
    STEP,
    Bounds,
    Damping,
    LightModel,
    PixelLight,
    Unevenness,
    Weighed,
    block_correlation,
    frame_light,
    line_correlation,
    line_noise,
    local_noise,
    minimise,
    scaled_inverse,
    total_degree,
)
from isochrome.fitting import CAUSES
from isochrome.stress import Lens

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
PLAIN = total_degree(2), total_degree(1)
"""Products of the illumination and the background of a set as stated."""

LENS = ("camera.distortion", "camera.keystone_x", "camera.keystone_z")
BAND, BLUR, GAMMA = "polariscope.bandwidth_nm", "camera.blur_px", "frames.gamma"
SHARED = (*LENS, BAND, BLUR, GAMMA)
"""What all images may share besides the light, by the keys that a scene has for them."""
EVEN = (BAND, BLUR)
"""Those that enter by their square, which is the unknown."""
EXPOSURES = "an exposure and stray light of each image"

GREEN_NM = 550.0
"""The wavelength that a band's width is counted at: its share of the wavelength is what shows."""

USUAL_SIZES = {k: size for cause in CAUSES for k, size in zip(cause.keys, cause.sizes, strict=True)}
"""Standard deviations on usual benches, see `fitting.causes`; of a pixel the share of it."""
SIZES = {key: USUAL_SIZES[key] ** 2 if key in EVEN else USUAL_SIZES[key] for key in SHARED}
"""Those of what enters a set's model. `STEP` of these is that of their derivatives."""

_BAND_SHARE = np.pi**2 / (4.0 * np.log(2.0) * GREEN_NM**2)
"""The model's `a` of a Gaussian band, over its squared full width at half height."""

_MOST_STEPS = 40
_ENOUGH = 1e-3
"""Fall of chi-square, in units of the noise that is left, below which a step is the last."""


@dataclass(frozen=True)
class SetImage:
    """An image's fitted pixels (n,): places, light, noise, and the `level` of light without noise.

    The curve of a tone is taken along its tangent at the level: noise on a curve is no light.
    """

    mask: Mask
    rows: Array
    cols: Array
    light: Array
    sigma: Array
    level: Array

    def toned(self, gamma: float) -> Array:
        """Light over noise with another exponent g, (L^g + g L^(g-1) (I - L))/(g L^(g-1) σ)."""
        if gamma == 1.0:
            return self.light / self.sigma
        return np.asarray((self.light + (1.0 / gamma - 1.0) * self.level) / self.sigma)

    def scale(self, gamma: float) -> Array | float:
        """What light over noise of one exponent is multiplied by for another's (n,)."""
        if gamma == 1.0:
            return 1.0
        return np.asarray((self.level / self.level.max()) ** (1.0 - gamma) / gamma)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A specimen. Its `order` (n,), with a sign or none, for an image's unknowns (p,) and the
    amplitudes (k,) of what all images have `besides`, at rows and columns (n,), px.

    `by_besides` (k, n), its derivatives by these; their `sizes` (k,) on usual benches; the
    `largest` moves of an image's unknowns (p,) at once. Of an unloaded image `idle` gives the
    unknowns (p,) from the first loaded one's and its own (r,), none below nought, whose largest
    moves are `idle_largest` (r,).
    """

    besides: str
    order: Callable[[Array, Array, Array, Array], Array]
    by_besides: Callable[[Array, Array, Array, Array], Array]
    sizes: Array
    largest: Array
    idle: Callable[[Array, Array], Array]
    idle_largest: Array


@dataclass(frozen=True, kw_only=True)
class SetModel:
    """Images `shots` (m,) of one size, the loaded ones first, on common pixels, at `rows` (R,) and
    `cols` (C,), each where its `masks` (m, R, C) say.

    How `uneven` their light is, and whether it is `apart`, each image's own; what is `free`, of
    SHARED, EXPOSURES and what the kind has besides, and what the other keys are `held` at; `levels`
    (m, R, C), the light without noise where a fit tells it.
    """

    kind: Kind
    shots: Sequence[Shot]
    rows: NDArray[np.intp]
    cols: NDArray[np.intp]
    masks: Mask
    uneven: Unevenness | None = None
    apart: bool = False
    free: tuple[str, ...] = ()
    held: dict[str, float] = field(default_factory=dict)
    levels: Array | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the whole picture."""
        return self.shots[0].light.shape[0], self.shots[0].light.shape[1]

    @cached_property
    def loaded(self) -> int:
        """Number of images with a load."""
        return sum(shot.load_n > 0.0 for shot in self.shots)

    @cached_property
    def images(self) -> tuple[SetImage, ...]:
        """The images' pixels; by default a mean of the pixels near is the light without noise."""
        from scipy.ndimage import gaussian_filter

        pick, images = np.ix_(self.rows, self.cols), []
        for i, (shot, mask) in enumerate(zip(self.shots, self.masks, strict=True)):
            rows, cols = (np.broadcast_to(p, mask.shape)[mask].astype(float) for p in pick)
            light, sigma = (m[pick][mask].astype(float) for m in (shot.light, shot.sigma))
            near = (
                gaussian_filter(shot.light, LEVEL_PX)[pick]
                if self.levels is None
                else self.levels[i]
            )
            level = np.maximum(near[mask].astype(float), sigma)
            images.append(SetImage(mask, rows, cols, light, sigma, level))
        return tuple(images)

    @cached_property
    def lamp(self) -> LightModel:
        """An image's light on the common pixels, of the no-load frames' form where there are."""
        lamp = self.shots[0].no_load_light
        light = frame_light(self.shape, bright=lamp, terms=PLAIN, uneven=self.uneven)
        return light.on(self.rows, self.cols)

    @cached_property
    def lights(self) -> tuple[PixelLight, ...]:
        """The light at each image's pixels."""
        return tuple(PixelLight(self.lamp, image.mask) for image in self.images)

    def coefficients_of(self, index: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Which of all the light's coefficients an image depends on, and which of its own light's
        each is: its stray light is more of the background's constant.
        """
        own = np.arange(self.lamp.unknowns, dtype=np.intp)
        if not index or not self.exposures:
            return own + (index * own.size if self.apart else 0), own
        return np.append(own, own.size + index - 1), np.append(own, len(self.lamp.terms[0]))

    @property
    def coefficients(self) -> int:
        """Number of the light's coefficients."""
        return self.lamp.unknowns * (len(self.shots) if self.apart else 1) + self.exposures

    @cached_property
    def light_weights(self) -> Array:
        """The weights of all the light's coefficients about nought."""
        weights = np.zeros(self.coefficients)
        for i in range(len(self.shots)):
            at, own = self.coefficients_of(i)
            weights[at] = self.lamp.weights[own]
        return weights

    @property
    def exposures(self) -> int:
        """Number of free exposures: the first image's is 1."""
        return len(self.shots) - 1 if EXPOSURES in self.free else 0

    @cached_property
    def places(self) -> dict[int | str, NDArray[np.intp]]:
        """Which unknowns are each image's own, by its number, and each of the free, by name."""
        counts: dict[int | str, int] = {i: len(self.largest(i)) for i in range(len(self.shots))}
        counts |= {name: len(self.middle(name)) for name in self.free}
        ends = pairwise(np.cumsum([0, *counts.values()]).tolist())
        return {key: np.arange(*pair) for key, pair in zip(counts, ends, strict=True)}

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return sum(map(len, self.places.values()))

    def sizes(self, name: str) -> Array:
        """The usual standard deviations (k,) of a key, of exposures, of what the kind has besides.

        Exposures are alike within a factor of e: those of dark images are told by nothing else.
        """
        if name in SHARED:
            return np.array([SIZES[name]])
        return np.ones(len(self.shots) - 1) if name == EXPOSURES else self.kind.sizes

    def middle(self, name: str) -> Array:
        """What something (k,) is where it is not free."""
        if name in SHARED:
            return np.array([self.held.get(name, float(name == GAMMA))])
        return np.zeros(len(self.sizes(name)))

    def value(self, values: Array, name: str) -> Array:
        """What it is (k,) at some unknowns."""
        return values[self.places[name]] if name in self.free else self.middle(name)

    def shared(self, values: Array) -> dict[str, float]:
        """What all keys of SHARED are at some unknowns."""
        return {key: float(self.value(values, key)[0]) for key in SHARED}

    @cached_property
    def prior(self) -> Array:
        """Weights (p,), 1/u², of the unknowns about nought: what is left undecided of exposures and
        of what the kind has besides keeps the size that benches have.
        """
        result = np.zeros(self.size)
        for name in self.free:
            if name not in SHARED:
                result[self.places[name]] = self.sizes(name) ** -2.0
        return result

    def looked_at(self, index: int, shared: dict[str, float]) -> tuple[Array, Array]:
        """Rows and columns (n,), px, of the places that an image's pixels look at."""
        image = self.images[index]
        if not any(shared[key] for key in LENS):
            return image.rows, image.cols
        height, width = self.shape
        down, right = 0.5 * (height - 1), 0.5 * (width - 1)
        through = Lens(
            right_mm=right, down_mm=down, half_width_mm=0.5 * width, half_height_mm=0.5 * height,
            **{key.partition(".")[2]: shared[key] for key in LENS},
        )  # fmt: skip
        x, z = through.looked_at(image.cols - right, image.rows - down)
        return np.asarray(z + down, dtype=np.float64), np.asarray(x + right, dtype=np.float64)

    def largest(self, index: int) -> Array:
        """Largest moves at once of an image's own unknowns; `STEP` of it is a derivative's."""
        return self.kind.largest if index < self.loaded else self.kind.idle_largest

    def unknowns_of(self, index: int, values: Array) -> Array:
        """An image's unknowns as a loaded one's (p,)."""
        unknowns = values[self.places[index]]
        return unknowns if index < self.loaded else self.kind.idle(values[self.places[0]], unknowns)

    def _orders(self, index: int, values: Array, shared: dict[str, float]) -> tuple[Array, ...]:
        """An image's order (n,), and its differences to the pixels below, above, right and left."""
        unknowns, besides = self.unknowns_of(index, values), self.value(values, self.kind.besides)
        rows, cols = self.looked_at(index, shared)
        here = self.kind.order(unknowns, besides, rows, cols)
        beside = (
            self.kind.order(unknowns, besides, rows + down, cols + right) - here
            for down, right in ((1, 0), (-1, 0), (0, 1), (0, -1))
        )
        return (here, *beside)

    def signal(self, index: int, values: Array, moved: dict[str, float] | None = None) -> Array:
        """The polariscope's 0..1 at an image's pixels (n,), with some shared keys elsewhere."""
        shared = self.shared(values) | (moved or {})
        orders = self._orders(index, values, shared)
        return seen(orders, shared, self.shots[index].bright)

    def at(self, values: Array) -> SetPoint | None:
        """The model at some unknowns, None where it is not finite."""
        shared = self.shared(values)
        orders = tuple(self._orders(i, values, shared) for i in range(len(self.shots)))
        signals = tuple(
            seen(own, shared, shot.bright) for own, shot in zip(orders, self.shots, strict=True)
        )
        if not all(np.isfinite(s).all() for s in signals):
            return None
        return SetPoint(self, values, orders, signals, shared[GAMMA])

    def fit(self, start: Array) -> SetFit:
        """Least squares from a start."""
        largest = np.full(self.size, np.inf)
        for i in range(len(self.shots)):
            largest[self.places[i]] = self.largest(i)
        largest[self.prior > 0.0] = self.prior[self.prior > 0.0] ** -0.5
        low = np.full(self.size, -np.inf)
        for key in (*range(self.loaded, len(self.shots)), *(k for k in self.free if k in EVEN)):
            low[self.places[key]] = 0.0
        bounds = Bounds(low, np.full(self.size, np.inf))

        def cut(values: Array, step: Array) -> Array:
            return bounds.cut(values, step / max(1.0, float(np.max(np.abs(step) / largest))))

        first = self.at(start)
        assert first is not None
        result = minimise(
            self.at, start, first, damping=Damping(1e-3), iterations=_MOST_STEPS, bounds=bounds,
            cut=cut, enough=lambda at: _ENOUGH * max(1.0, at.cost / at.pixels),
            better=lambda new, old: new.cost < old.cost and (new.positive or not old.positive),
        )  # fmt: skip
        values, point = result.values, result.point
        return SetFit(model=self, values=values, point=point, converged=result.converged)

    def carried(self, values: Array, wider: SetModel) -> Array:
        """Where another model's unknowns start that has more of them, or fewer."""
        of_images = [values[self.places[i]] for i in range(len(self.shots))]
        return np.concatenate([*of_images, *(self.value(values, name) for name in wider.free)])


def seen(orders: Sequence[Array], shared: dict[str, float], bright: bool) -> Array:
    """The polariscope's 0..1 (n,) of an order and its differences to the pixels below, above, right
    and left, through a blur and in a band of wavelengths.
    """
    order, *beside = orders
    steep = 0.25 * ((beside[0] - beside[1]) ** 2 + (beside[2] - beside[3]) ** 2)
    # a blur adds half its variance times the curvature to the order
    spread = 2.0 * np.pi**2 * (1.0 / 12.0 + shared[BLUR])  # a pixel's own area is one
    blurred = order + spread / (4.0 * np.pi**2) * sum(beside)
    # a band's mean phase is that of its mean wave number, less the third cumulant's part
    band = _BAND_SHARE * shared[BAND]
    share, phase = band / (2.0 * np.pi**2), 2.0 * np.pi * blurred
    wave = np.cos(phase * (1.0 + share - (share * phase) ** 2))
    wave *= np.exp(-band * order**2 - spread * steep)
    return np.asarray(0.5 + 0.5 * wave if bright else 0.5 - 0.5 * wave)


@dataclass(frozen=True)
class SetPoint:
    """The model at some unknowns: its `orders` (m,), each (n,) with its differences to the pixels
    beside, its signals (m,) of (n,), and tone.
    """

    model: SetModel
    values: Array
    orders: tuple[tuple[Array, ...], ...]
    signals: tuple[Array, ...]
    gamma: float

    @cached_property
    def exposure(self) -> Array:
        """The images' exposures (m,), the first one's 1."""
        return np.concatenate(([1.0], np.exp(self.model.value(self.values, EXPOSURES))))

    def weight(self, index: int) -> Array:
        """What an image's light is multiplied by (n,): its exposure, over the noise."""
        image = self.model.images[index]
        return np.asarray(self.exposure[index] * image.scale(self.gamma) / image.sigma)

    def columns(self, index: int, model: SetModel) -> NDArray[Any]:
        """Weighted columns (k, n) of an image by all coefficients of the light of some model."""
        light, dark = model.lamp.columns(self.model.images[index].mask)
        columns = np.zeros((model.coefficients, len(self.signals[index])), np.float32)
        at, own = model.coefficients_of(index)
        weight = self.weight(index)
        columns[at] = np.concatenate((light * self.signals[index], dark))[own] * weight
        return columns

    @cached_property
    def solved(self) -> tuple[Array, Array]:
        """Coefficients of the light, and their inverse normal equations."""
        model, size = self.model, self.model.coefficients
        normal, right = np.diag(model.light_weights), np.zeros(size)
        inverse = np.zeros((size, size))
        for i, image in enumerate(model.images):
            (at, own), weight = model.coefficients_of(i), self.weight(i)
            data, lit = image.toned(self.gamma), weight * self.signals[i]
            of_image, with_data = model.lights[i].equations(lit, weight, data)
            normal[np.ix_(at, at)] += of_image[np.ix_(own, own)]
            right[at] += with_data[own]
            if model.apart:
                inverse[np.ix_(at, at)] = scaled_inverse(normal[np.ix_(at, at)])
        inverse = inverse if model.apart else scaled_inverse(normal)
        return inverse @ right, inverse

    @cached_property
    def light(self) -> tuple[tuple[Array, Array], ...]:
        """Illumination and background (n,) of each image, before its exposure."""
        light = []
        for i, pixels in enumerate(self.model.lights):
            at, own = self.model.coefficients_of(i)
            light.append(pixels.of(np.bincount(own, self.solved[0][at]), np.float64))
        return tuple(light)

    @property
    def brightness(self) -> Array:
        """Mean illumination (m,) of each image, before its exposure."""
        return np.array([float(np.mean(illumination)) for illumination, _ in self.light])

    def modelled(self, index: int) -> Array:
        """An image's light over its noise, by the model (n,)."""
        illumination, background = self.light[index]
        return self.weight(index) * (illumination * self.signals[index] + background)

    @cached_property
    def residuals(self) -> tuple[Array, ...]:
        """The images' weighted residuals, each (n,)."""
        images = enumerate(self.model.images)
        return tuple(image.toned(self.gamma) - self.modelled(i) for i, image in images)

    def by_order(self, index: int) -> tuple[Array, Array]:
        """An image's order (n,), and its weighted derivative by what is added to it all over."""
        order, *beside = self.orders[index]
        shared, bright = self.model.shared(self.values), self.model.shots[index].bright
        change = seen((order + STEP, *beside), shared, bright) - self.signals[index]
        return order, change * self.gain(index) / STEP

    @cached_property
    def cost(self) -> float:
        """Chi-square over all images, and of what has a usual size over this."""
        known = self.model.prior @ self.values**2 + self.model.light_weights @ self.solved[0] ** 2
        return float(sum(r @ r for r in self.residuals) + known)

    @property
    def pixels(self) -> int:
        """Pixels of all images."""
        return sum(i.light.size for i in self.model.images)

    @property
    def unknowns(self) -> int:
        """All unknowns, and as many of the light's as the images tell."""
        known = self.model.light_weights @ np.diag(self.solved[1])
        return self.values.size + round(float(self.model.coefficients - known))

    @cached_property
    def occam(self) -> float:
        """What the unknowns take of twice the evidence: ln n each that may have any size, and
        ln det(1 + V M) those of the light with a prior's covariance V.
        """
        weights = self.model.light_weights
        known = np.flatnonzero(weights)
        spread = np.sqrt(weights[known])
        taken = self.solved[1][np.ix_(known, known)] * np.outer(spread, spread)
        free = self.values.size + len(weights) - len(known)
        return float(free * np.log(self.pixels) - np.linalg.slogdet(taken)[1])

    @cached_property
    def positive(self) -> bool:
        """Whether the illumination is positive over (nearly) all pixels."""
        negative = sum(np.count_nonzero(illumination <= 0.0) for illumination, _ in self.light)
        return bool(negative <= MOSTLY * self.pixels)

    def gain(self, index: int) -> Array:
        """How an image's pixels change with its signal (n,)."""
        return self.weight(index) * self.light[index][0]

    def rows_of(self, index: int, name: str) -> Array:
        """Weighted derivatives of one image by something that may be free (k, n)."""
        model, gain = self.model, self.gain(index)
        if name == EXPOSURES:
            rows = np.zeros((len(model.shots) - 1, gain.size))
            if index:
                rows[index - 1] = self.modelled(index)
            return rows
        shared = model.shared(self.values)
        if name == model.kind.besides:
            unknowns = model.unknowns_of(index, self.values)
            besides = model.value(self.values, name)
            by = model.kind.by_besides(unknowns, besides, *model.looked_at(index, shared))
            return np.asarray(by * self.by_order(index)[1])
        step = STEP * SIZES[name]
        if name == GAMMA:  # how the residual changes with the exponent, the other way round
            later, image = replace(self, gamma=self.gamma + step), model.images[index]
            ratio = later.weight(index) / self.weight(index) - 1.0
            change = ratio * self.modelled(index) - image.toned(later.gamma)
            change += image.toned(self.gamma)
            return np.asarray(change / step)[None]
        signal = model.signal(index, self.values, {name: shared[name] + step})
        return np.asarray((signal - self.signals[index]) * gain / step)[None]

    def rows(self, index: int) -> tuple[Array, NDArray[np.intp]]:
        """Weighted derivatives (k, n) of one image by the unknowns that it depends on, and which
        these are.
        """
        model, gain = self.model, self.gain(index)
        place, steps = model.places[index], STEP * model.largest(index)
        if index >= model.loaded:  # it lies where the first one does
            place = np.concatenate((model.places[0], place))
            steps = np.concatenate((STEP * model.kind.largest, steps))
        derivatives = np.empty((len(place), gain.size))
        for row, at, step in zip(derivatives, place, steps, strict=True):
            moved = self.values.copy()
            moved[at] += step
            row[:] = (model.signal(index, moved) - self.signals[index]) * gain / step
        parts = [derivatives, *(self.rows_of(index, name) for name in model.free)]
        places = [place, *(model.places[name] for name in model.free)]
        return np.concatenate(parts), np.concatenate(places)

    @cached_property
    def equations(self) -> tuple[Array, Array]:
        """Normal equations with the light eliminated, and their right side."""
        model, inverse = self.model, self.solved[1]
        normal, gradient = np.zeros((model.size, model.size)), np.zeros(model.size)
        cross = np.zeros((model.size, len(inverse)))
        for i, residual in enumerate(self.residuals):
            rows, place = self.rows(i)
            normal[np.ix_(place, place)] += rows @ rows.T
            gradient[place] += rows @ residual
            (at, own), weight = model.coefficients_of(i), self.weight(i)
            products = model.lights[i].products(rows, weight * self.signals[i], weight)
            cross[np.ix_(place, at)] += products[:, own]
        normal += np.diag(model.prior)
        gradient -= model.prior * self.values
        return normal - cross @ inverse @ cross.T, gradient

    @property
    def normal(self) -> Array:
        """The normal equations' matrix."""
        return self.equations[0]

    @property
    def gradient(self) -> Array:
        """Their right side."""
        return self.equations[1]


@dataclass(frozen=True, kw_only=True)
class SetFit:
    """A fitted set: its `model`, unknowns, the `point` there, whether it `converged`, the part of
    the pixels that was `left_out`; `asked`, what else may be there.
    """

    model: SetModel
    values: Array
    point: SetPoint
    converged: bool
    left_out: float = 0.0
    asked: Weighed | None = None

    @property
    def chi(self) -> float:
        """Residual over noise."""
        return float(np.sqrt(self.point.cost / (self.point.pixels - self.point.unknowns)))

    @cached_property
    def correlation(self) -> float:
        """Variance of sums of residuals over that of independent ones, 1 at least.

        Sums over blocks of 4 x 4 pixels, or over rows where that is more: rows have their own noise
        in many cameras, and a beam's fringes lie along them.
        """
        ratios = []
        for image, residual in zip(self.model.images, self.point.residuals, strict=True):
            rows = line_correlation(image.mask, residual, 1)
            ratios.append((rows, block_correlation(image.mask, residual)))
        return float(np.mean(ratios, axis=0).max())

    @property
    def noise(self) -> float:
        """Variance of what is left, in units of the noise's, with what neighbours share."""
        return max(1.0, self.chi) ** 2 * self.correlation

    @property
    def local_noise(self) -> float:
        """The same of the noise alone, whatever the model misses: that is smooth."""
        ratios = [
            local_noise(image.mask, residual, image.light / image.sigma) ** 2
            * line_noise(image.mask, residual, 1)
            for image, residual in zip(self.model.images, self.point.residuals, strict=True)
        ]
        return max(1.0, float(np.mean(ratios)))

    @cached_property
    def covariance(self) -> Array:
        """Of the unknowns (p, p), by the noise and by what else the images leave open."""
        return self._of_noise + (self.asked.undecided if self.asked else 0.0)

    @cached_property
    def _of_noise(self) -> Array:
        return np.asarray(scaled_inverse(self.point.normal, 1e-14) * self.noise)

    @property
    def explained_share(self) -> float:
        """Share of a loaded image's variation that the model explains, the least of them."""
        pairs = zip(self.model.images[: self.model.loaded], self.point.residuals, strict=False)
        return 1.0 - max(float(np.var(r) / np.var(i.light / i.sigma)) for i, r in pairs)

    @property
    def explained(self) -> bool:
        """Whether the model explains most of each loaded image's variation."""
        return self.point.positive and self.explained_share > EXPLAINED

    def levelled(self) -> SetFit:
        """The same fit, with its own model as the light without noise of each image."""
        levels = np.ones(self.model.masks.shape)
        residuals = self.point.residuals
        for level, image, residual in zip(levels, self.model.images, residuals, strict=True):
            level[image.mask] = image.light - image.sigma * residual
        model = replace(self.model, levels=levels)
        point = model.at(self.values)
        assert point is not None
        return replace(self, model=model, point=point)

    @property
    def own(self) -> Array:
        """The loaded images' own unknowns (m, p)."""
        return np.array([self.values[self.model.places[i]] for i in range(self.model.loaded)])

    @property
    def shared(self) -> dict[str, tuple[float, float]]:
        """The free shared keys: value and standard uncertainty, given that they are there."""
        spread = np.sqrt(np.maximum(np.diag(self._of_noise), 0.0))
        places = {key: self.model.places[key][0] for key in self.model.free if key in SHARED}
        return {key: (float(self.values[i]), float(spread[i])) for key, i in places.items()}
