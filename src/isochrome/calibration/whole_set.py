r"""A whole set of images: each one's own fringes under one light, through one camera.

    I_i = e_i (A s_i + B + c_i),    s_i = 1/2 -+ 1/2 V_i cos 2π N_i(x, z),

with the illumination A and the background B of all images (sums of smooth images, eliminated
linearly), image i's exposure e_i and stray light c_i, and its order N_i, a specimen's closed form
at the places (x, z) that the pixels look at through the lens (`isochrome.stress`). Contrast falls
with the order in a band of wavelengths, and with its slope by blur: V = exp(-a N² - b |grad N|²).

What a set shows besides its specimen is weighed by its evidence, see `isochrome.estimation`. About
a fit the columns of all that may be there are taken once: lens, tone, blur and band, uneven light,
light of each image's own, what the kind of specimen has besides, and a smooth order that no cause
explains. The likeliest set of them is fitted, and asked again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.shot import EXPLAINED, Shot
from isochrome.estimation import (
    ALIKE_CHI,
    FIRST_DEGREES,
    LEVEL_PX,
    LIGHT_FALLS,
    MOSTLY,
    RIVAL_CHI,
    STEP,
    Bounds,
    Damping,
    LightModel,
    Nuisance,
    PixelLight,
    ScoreProducts,
    Unevenness,
    Weighed,
    block_correlation,
    cosine_spread,
    cosines,
    frame_light,
    line_correlation,
    line_noise,
    local_noise,
    minimise,
    scaled_inverse,
    total_degree,
    weighed,
)
from isochrome.fitting import CAUSES, LIGHT, ORDER, RARE, SIZES, WIDTHS
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
SHARED_SIZES = {k: USUAL_SIZES[k] ** 2 if k in EVEN else USUAL_SIZES[k] for k in SHARED}
"""Those of what enters a set's model. `STEP` of these is that of their derivatives."""

_BAND_SHARE = np.pi**2 / (4.0 * np.log(2.0) * GREEN_NM**2)
"""The model's `a` of a Gaussian band, over its squared full width at half height."""

_MOST_STEPS = 40
_ENOUGH = 1e-3
"""Fall of chi-square, in units of the noise that is left, below which a step is the last."""

_ROUNDS = 8
"""Times that a set is asked, and its outliers looked for, at the most."""

_RICHEST = 24, 12
"""Degrees of an uneven light: a glare adds background in a twelfth of the picture."""

_OUTLIER = 6.0
"""Residual in noises beyond which a pixel is no accident, and is left out with its neighbours."""

_COSINES = 5
"""Cosines along each side of the picture that an unknown part of the orders is made of."""


@dataclass(frozen=True)
class SetImage:
    """An image's fitted pixels (n,): places, light, noise, its `lamp`, and the `level` of light
    without noise. The curve of a tone is taken along its tangent there: noise on it is no light.
    """

    rows: Array
    cols: Array
    light: Array
    sigma: Array
    level: Array
    lamp: PixelLight

    def toned(self, gamma: float) -> Array:
        """Light over noise with another exponent g, (L^g + g L^(g-1) (I - L))/(g L^(g-1) σ)."""
        return np.asarray((self.light + (1.0 / gamma - 1.0) * self.level) / self.sigma)

    def weight(self, gamma: float) -> Array:
        """What light of another exponent is multiplied by (n,): 1/σ of it."""
        return np.asarray((self.level / self.level.max()) ** (1.0 - gamma) / (gamma * self.sigma))


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A specimen. Its `order` (n,) for an image's unknowns (p,) and amplitudes (k,) by name, of
    what all images have `besides`, of such sizes on usual benches (none: not told), at rows and
    columns (n,), px; `by_besides` (k, n), its derivatives by those of a name; the `largest` moves
    (p,) at once. Of an unloaded image `idle` gives the unknowns (p,) from the first one's and its
    own (r,), none below nought. Of the name `alone` the first may be there without the others."""

    besides: dict[str, Array]
    order: Callable[[Array, dict[str, Array], Array, Array], Array]
    by_besides: Callable[[str, Array, dict[str, Array], Array, Array], Array]
    largest: Array
    idle: Callable[[Array, Array], Array]
    idle_largest: Array
    alone: str = ""


@dataclass(frozen=True, kw_only=True)
class SetModel:
    """Images `shots` (m,) of one size, the loaded ones first, on common pixels, at `rows` (R,) and
    `cols` (C,), each where its `masks` (m, R, C) say. How `uneven` their light is, and whether it
    is `apart`, each image's own, or one light that is `exposed` for each; what is `free`, of SHARED
    and what the kind has besides, and what the other keys are `held` at; `levels` (m, R, C), the
    light without noise where a fit tells it.
    """

    kind: Kind
    shots: Sequence[Shot]
    rows: NDArray[np.intp]
    cols: NDArray[np.intp]
    masks: Mask
    uneven: Unevenness | None = None
    apart: bool = False
    exposed: bool = False
    free: tuple[str, ...] = ()
    held: dict[str, float] = field(default_factory=dict)
    levels: Array | None = None

    @cached_property
    def loaded(self) -> int:
        """Number of images with a load."""
        return sum(shot.load_n > 0.0 for shot in self.shots)

    @property
    def lights(self) -> int:
        """Number of lights: image i has number i modulo this."""
        return len(self.shots) if self.apart else 1

    @property
    def fitted(self) -> frozenset[str]:
        """What is free beside what a set states, by name."""
        return frozenset(self.free) | ({LIGHT} if self.uneven else set())

    @cached_property
    def lamp(self) -> LightModel:
        """A light on the common pixels, of the no-load frames' form where there are."""
        first = self.shots[0]
        light = frame_light(
            first.light.shape, bright=first.no_load_light, terms=PLAIN, uneven=self.uneven
        )
        return light.on(self.rows, self.cols)

    @cached_property
    def images(self) -> tuple[SetImage, ...]:
        """The images' pixels; by default a mean of the pixels near is the light without noise."""
        from scipy.ndimage import gaussian_filter

        pick, images = np.ix_(self.rows, self.cols), []
        for i, (shot, mask) in enumerate(zip(self.shots, self.masks, strict=True)):
            near = (
                gaussian_filter(np.nan_to_num(shot.light), LEVEL_PX)[pick]
                if self.levels is None
                else self.levels[i]
            )
            rows, cols, light, sigma, level = (
                np.broadcast_to(values, mask.shape)[mask].astype(float)
                for values in (*pick, shot.light[pick], shot.sigma[pick], near)
            )
            lamp = PixelLight(self.lamp, mask)
            images.append(SetImage(rows, cols, light, sigma, np.maximum(level, sigma), lamp))
        return tuple(images)

    @cached_property
    def places(self) -> dict[int | str, NDArray[np.intp]]:
        """Which unknowns are each image's own, by its number, and each of the shared, by name."""
        names = (*((EXPOSURES,) if self.exposed else ()), *self.free)
        counts: dict[int | str, int] = {i: len(self.largest(i)) for i in range(len(self.shots))}
        counts |= {name: len(self.middle(name)) for name in names}
        ends = pairwise(np.cumsum([0, *counts.values()]).tolist())
        return {key: np.arange(*pair) for key, pair in zip(counts, ends, strict=True)}

    @property
    def names(self) -> list[str]:
        """What all images share of the unknowns, by name."""
        return [name for name in self.places if isinstance(name, str)]

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return sum(map(len, self.places.values()))

    def sizes(self, name: str) -> Array:
        """The usual standard deviations (k,) of a key, of what the kind has besides, of exposures:
        these are alike within a factor of e, and stray light has any size; the first has neither.
        """
        if name in SHARED:
            return np.array([SHARED_SIZES[name]])
        several = len(self.shots) - 1
        return np.repeat([1.0, np.inf], several) if name == EXPOSURES else self.kind.besides[name]

    def roots(self, name: str) -> tuple[Array, ...]:
        """The ways of their prior: the first alone, of what may be, and all."""
        every = np.diag(self.sizes(name))
        return (every[:, :1], every) if name == self.kind.alone else (every,)

    def middle(self, name: str) -> Array:
        """What something (k,) is where it is not free."""
        if name in SHARED:
            return np.array([self.held.get(name, float(name == GAMMA))])
        return np.zeros(len(self.sizes(name)))

    def besides(self, values: Array) -> dict[str, Array]:
        """What the kind has besides that is not nought (k,), by name."""
        return {name: values[self.places[name]] for name in self.free if name in self.kind.besides}

    def value(self, values: Array, name: str) -> Array:
        """What it is (k,) at some unknowns."""
        return values[self.places[name]] if name in self.places else self.middle(name)

    @cached_property
    def prior(self) -> Array:
        """Weights (p,), 1/u², about nought, of exposures and of what the kind has besides."""
        result = np.zeros(self.size)
        for name in set(self.names) - set(SHARED):
            result[self.places[name]] = self.sizes(name) ** -2.0
        return result

    def looked_at(self, index: int, shared: dict[str, float]) -> tuple[Array, Array]:
        """Rows and columns (n,), px, of the places that an image's pixels look at."""
        image = self.images[index]
        if not any(shared[key] for key in LENS):
            return image.rows, image.cols
        height, width = self.shots[0].light.shape
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

    def orders(self, index: int, values: Array, shared: dict[str, float]) -> tuple[Array, ...]:
        """An image's order (n,), and its differences to the pixels below, above, right and left."""
        unknowns, besides = self.unknowns_of(index, values), self.besides(values)
        rows, cols = self.looked_at(index, shared)
        here = self.kind.order(unknowns, besides, rows, cols)
        beside = (
            self.kind.order(unknowns, besides, rows + down, cols + right) - here
            for down, right in ((1, 0), (-1, 0), (0, 1), (0, -1))
        )
        return (here, *beside)

    def signal(self, orders: Sequence[Array], shared: dict[str, float]) -> Array:
        """The polariscope's 0..1 (n,) of `orders`, through a blur and in a band of wavelengths."""
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
        return np.asarray(0.5 + 0.5 * wave if self.shots[0].bright else 0.5 - 0.5 * wave)

    def at(self, values: Array) -> SetPoint | None:
        """The model at some unknowns, None where it is not finite."""
        shared = {key: float(self.value(values, key)[0]) for key in SHARED}
        orders = tuple(self.orders(i, values, shared) for i in range(len(self.shots)))
        signals = tuple(self.signal(each, shared) for each in orders)
        if not all(np.isfinite(s).all() for s in signals):
            return None
        return SetPoint(self, values, shared, orders, signals)

    def fit(self, start: Array) -> SetFit:
        """Least squares from a start."""
        largest, low = np.full(self.size, np.inf), np.full(self.size, -np.inf)
        for i in range(len(self.shots)):
            largest[self.places[i]] = self.largest(i)
        largest[self.prior > 0.0] = self.prior[self.prior > 0.0] ** -0.5
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
        return SetFit(model=self, point=result.point, converged=result.converged)

    def carried(self, values: Array, wider: SetModel) -> Array:
        """Where another model's unknowns start that has more of them, or fewer."""
        of_images = [values[self.places[i]] for i in range(len(self.shots))]
        return np.concatenate([*of_images, *(self.value(values, name) for name in wider.names)])


@dataclass(frozen=True)
class SetPoint:
    """The model at some unknowns: `orders` (m,) with differences to the pixels beside, signals."""

    model: SetModel
    values: Array
    shared: dict[str, float]
    orders: tuple[tuple[Array, ...], ...]
    signals: tuple[Array, ...]

    @cached_property
    def exposures(self) -> Array:
        """The images' exposures, and their stray light (2, m); the first one's are 1 and 0."""
        of_others = self.model.value(self.values, EXPOSURES).reshape(2, -1)
        logs, stray = np.pad(of_others, ((0, 0), (1, 0)))
        return np.array([np.exp(logs), stray])

    def weight(self, index: int) -> Array:
        """What an image's light is multiplied by (n,): its exposure, over the noise."""
        image = self.model.images[index]
        return np.asarray(self.exposures[0, index] * image.weight(self.shared[GAMMA]))

    def light_columns(self, index: int, lamp: LightModel) -> NDArray[Any]:
        """Weighted columns (l k, n) of an image by all coefficients of lights of some form."""
        light, dark = lamp.columns(self.model.images[index].lamp.keep)
        columns = np.zeros((self.model.lights, lamp.unknowns, light.shape[1]), np.float32)
        own = np.concatenate((light * self.signals[index], dark)) * self.weight(index)
        columns[index % self.model.lights] = own
        return columns.reshape(-1, light.shape[1])

    @cached_property
    def solved(self) -> tuple[Array, Array]:
        """Coefficients of the lights (l, k), and their inverse normal equations (l, k, k)."""
        lights, weights = self.model.lights, self.model.lamp.weights
        normal, right = np.tile(np.diag(weights), (lights, 1, 1)), np.zeros((lights, len(weights)))
        for i, image in enumerate(self.model.images):
            weight = self.weight(i)
            data = image.toned(self.shared[GAMMA]) - self.exposures[1, i] * weight
            of_image, with_data = image.lamp.equations(weight * self.signals[i], weight, data)
            normal[i % lights] += of_image
            right[i % lights] += with_data
        inverse = np.array([scaled_inverse(matrix) for matrix in normal])
        return np.einsum("lij,lj->li", inverse, right), inverse

    @cached_property
    def light(self) -> tuple[tuple[Array, Array], ...]:
        """Illumination and background (n,) of each image, before its exposure."""
        light = []
        for i, image in enumerate(self.model.images):
            bright, dark = image.lamp.of(self.solved[0][i % self.model.lights], np.float64)
            light.append((bright, dark + self.exposures[1, i]))
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
        return tuple(image.toned(self.shared[GAMMA]) - self.modelled(i) for i, image in images)

    @cached_property
    def cost(self) -> float:
        """Chi-square over all images, and of what has a usual size over this."""
        known = float(self.model.prior @ self.values**2)
        known += float(np.sum(self.model.lamp.weights * self.solved[0] ** 2))
        return float(sum(r @ r for r in self.residuals)) + known

    @property
    def pixels(self) -> int:
        """Pixels of all images."""
        return int(np.count_nonzero(self.model.masks))

    @property
    def told(self) -> int:
        """How many of the lights' coefficients the images tell."""
        known = np.einsum("k,lkk->", self.model.lamp.weights, self.solved[1])
        return round(self.solved[0].size - float(known))

    @cached_property
    def occam(self) -> float:
        """What the unknowns take of twice the evidence: ln n each that may have any size, and
        ln det(1 + V M) those of the light with a prior's covariance V.
        """
        weights = self.model.lamp.weights
        known = np.flatnonzero(weights)
        spread = np.sqrt(weights[known])
        taken = self.solved[1][:, known[:, None], known] * np.outer(spread, spread)
        free = self.values.size + self.model.lights * (len(weights) - len(known))
        return float(free * np.log(self.pixels) - np.linalg.slogdet(taken)[1].sum())

    @cached_property
    def positive(self) -> bool:
        """Whether the illumination is positive over (nearly) all pixels."""
        negative = sum(np.count_nonzero(illumination <= 0.0) for illumination, _ in self.light)
        return bool(negative <= MOSTLY * self.pixels)

    def gain(self, index: int) -> Array:
        """How an image's pixels change with its signal (n,)."""
        return self.weight(index) * self.light[index][0]

    def by_order(self, index: int) -> tuple[Array, Array]:
        """An image's order (n,), and its weighted derivative by what is added to it all over."""
        order, *beside = self.orders[index]
        change = self.model.signal((order + STEP, *beside), self.shared) - self.signals[index]
        return order, change * self.gain(index) / STEP

    def rows_of(self, index: int, name: str) -> Array:
        """Weighted derivatives of one image by something that all share (k, n)."""
        model, gain = self.model, self.gain(index)
        if name == EXPOSURES:
            rows = np.zeros((2, len(model.shots), gain.size))
            rows[:, index] = self.modelled(index), self.weight(index)
            return rows[:, 1:].reshape(-1, gain.size)
        if name in model.kind.besides:
            unknowns, besides = model.unknowns_of(index, self.values), model.besides(self.values)
            at = model.looked_at(index, self.shared)
            by = model.kind.by_besides(name, unknowns, besides, *at)
            return np.asarray(by * self.by_order(index)[1])
        step = STEP * SHARED_SIZES[name]
        moved = self.shared | {name: self.shared[name] + step}
        if name == GAMMA:  # how the residual changes with the exponent, the other way round
            image, here, there = model.images[index], self.shared[GAMMA], moved[GAMMA]
            ratio = image.weight(there) / image.weight(here) - 1.0
            change = ratio * self.modelled(index) - image.toned(there) + image.toned(here)
            return np.asarray(change / step)[None]
        signal = model.signal(model.orders(index, self.values, moved), moved)
        return np.asarray((signal - self.signals[index]) * gain / step)[None]

    def rows(self, index: int) -> tuple[Array, NDArray[np.intp]]:
        """Weighted derivatives (k, n) of one image by the unknowns it depends on, and which."""
        model, gain, derivatives = self.model, self.gain(index), []
        # an unloaded one lies where the first one does
        own: list[int | str] = [index] if index < model.loaded else [0, index]
        place = np.concatenate([model.places[i] for i in own])
        steps = STEP * np.concatenate([model.largest(int(i)) for i in own])
        for at, step in zip(place, steps, strict=True):
            moved = self.values.copy()
            moved[at] += step
            signal = model.signal(model.orders(index, moved, self.shared), self.shared)
            derivatives.append((signal - self.signals[index]) * gain / step)
        parts = [np.array(derivatives), *(self.rows_of(index, name) for name in model.names)]
        places = [place, *(model.places[name] for name in model.names)]
        return np.concatenate(parts), np.concatenate(places)

    @cached_property
    def equations(self) -> tuple[Array, Array]:
        """Normal equations with the light eliminated, and their right side."""
        model, (coefficients, inverse) = self.model, self.solved
        normal, gradient = np.diag(model.prior), -model.prior * self.values
        cross = np.zeros((model.size, *coefficients.shape))
        for i, residual in enumerate(self.residuals):
            (rows, place), weight = self.rows(i), self.weight(i)
            normal[np.ix_(place, place)] += rows @ rows.T
            gradient[place] += rows @ residual
            products = model.images[i].lamp.products(rows, weight * self.signals[i], weight)
            cross[place, i % model.lights] += products
        for of_light, each in zip(np.moveaxis(cross, 1, 0), inverse, strict=True):
            normal -= of_light @ each @ of_light.T
        return normal, gradient

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
    """A fitted set: `left_out`, the part of pixels that was; `asked`, what else may be there."""

    model: SetModel
    point: SetPoint
    converged: bool
    left_out: float = 0.0
    asked: Weighed | None = None

    @property
    def values(self) -> Array:
        """The unknowns (p,)."""
        return self.point.values

    @property
    def chi(self) -> float:
        """Residual over noise."""
        point = self.point
        return float(np.sqrt(point.cost / (point.pixels - point.values.size - point.told)))

    @cached_property
    def covariance(self) -> Array:
        """Of the unknowns (p, p), by the noise and by what else the images leave open."""
        return self.of_noise + (self.asked.undecided if self.asked else 0.0)

    @cached_property
    def of_noise(self) -> Array:
        """That by what is left, with what neighbours share of it: in blocks of 4 x 4 pixels, or in
        rows, which have their own noise in many cameras, and along which a beam's fringes lie.
        """
        ratios = [
            (line_correlation(mask, residual, 1), block_correlation(mask, residual))
            for mask, residual in zip(self.model.masks, self.point.residuals, strict=True)
        ]
        noise = max(1.0, self.chi) ** 2 * float(np.mean(ratios, axis=0).max())
        return np.asarray(scaled_inverse(self.point.normal, 1e-14) * noise)

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
        model, levels = self.model, np.ones(self.model.masks.shape)
        images = zip(levels, model.masks, model.images, self.point.residuals, strict=True)
        for level, mask, image, residual in images:
            level[mask] = image.light - image.sigma * residual
        point = replace(model, levels=levels).at(self.values)
        assert point is not None
        return replace(self, model=point.model, point=point)

    @property
    def own(self) -> Array:
        """The loaded images' own unknowns (m, p)."""
        return np.array([self.values[self.model.places[i]] for i in range(self.model.loaded)])

    @property
    def shared(self) -> dict[str, tuple[float, float]]:
        """The free shared keys: value and standard uncertainty, given that they are there."""
        spread = np.sqrt(np.maximum(np.diag(self.of_noise), 0.0))
        places = {key: self.model.places[key][0] for key in self.model.free if key in SHARED}
        return {key: (float(self.values[i]), float(spread[i])) for key, i in places.items()}


def fit_set(model: SetModel, unknowns: Array) -> SetFit:
    """Fit a set with all that it shows, from loaded images' `unknowns` and what else is free."""
    start = np.pad(unknowns.ravel(), (0, model.size - unknowns.size))
    if len(model.shots) > 1:
        point = replace(model, apart=True).at(start)
        assert point is not None
        model = replace(model, exposed=True)
        start = point.model.carried(start, model)
        bright = np.abs(point.brightness[: model.loaded])
        start[model.places[EXPOSURES][: model.loaded - 1]] = np.log(bright[1:] / bright[0])
    fit = model.fit(start)
    if not fit.explained:
        return fit
    pixels = model.masks.sum()
    fit = _exposed(_without_outliers(fit))
    asked, nothing = ask_set(fit), frozenset({ORDER})
    for _ in range(_ROUNDS):
        wanted = frozenset(h.name for h in asked.sets.best) - nothing
        if wanted == fit.model.fitted:
            rival, asked = _exchanged(fit, asked, nothing)
            if rival is fit:
                break
            nothing |= fit.model.fitted - rival.model.fitted
            fit = rival
        else:
            fit = _exposed(_without_outliers(_with(fit, wanted, asked)))
            # what comes out at its bound, or as no better light, is not there, whatever slopes say
            nothing |= {key for key in EVEN if fit.shared.get(key, (1.0, 0.0))[0] == 0.0}
            nothing |= wanted - fit.model.fitted
        asked = ask_set(fit)
    return replace(fit, left_out=float(1.0 - fit.model.masks.sum() / pixels), asked=asked)


def _exchanged(fit: SetFit, asked: Weighed, nothing: frozenset[str]) -> tuple[SetFit, Weighed]:
    """The fit, or that of the likeliest set with something else in the place of what it has, where
    this leaves less, and the sets by what both leave: what slopes do not tell apart, as a moment
    and a keystone, curvature may.
    """
    sets = asked.sets
    for index, weight in enumerate(sets.weights):
        names = frozenset(h.name for h in sets.named(index)) - nothing
        gone, come = fit.model.fitted - names, names - fit.model.fitted
        if weight > RARE * sets.weights[0] and gone and come and LIGHT not in gone | come:
            rival = _with(fit, names, asked)
            fall = fit.point.cost - rival.point.cost
            if fall > 0.0:
                return rival, asked
            odds = np.log(weight / sets.weights[0]) + 0.5 * fall / max(1.0, fit.chi) ** 2
            logs = {sets.members[0]: 0.0, sets.members[index]: float(odds)}
            return fit, replace(asked, judged=sets.judged(logs))
    return fit, asked


def _exposed(fit: SetFit) -> SetFit:
    """The fit with one light, an exposure and stray light of each image besides, or each one's own
    light, as they ask. Only under one exposure does an image of less than a fringe tell its order.
    """
    ways = ((False, False), (False, True), (True, False)) if len(fit.model.shots) > 1 else ()
    for apart, exposed in ways:
        if (apart, exposed) == (fit.model.apart, fit.model.exposed):
            continue
        other = replace(fit.model, apart=apart, exposed=exposed)
        start = fit.model.carried(fit.values, other)
        for index in range(other.loaded, len(other.shots)):
            start[other.places[index]] = 0.0  # which its exposure could not be told from
        # in most sets images of their own light are worth no fit
        if not other.apart or _is_better(other.at(start), fit.point):
            rival = other.fit(start)
            fit = rival if _is_better(rival.point, fit.point) else fit
    return fit


def _is_better(point: SetPoint | None, best: SetPoint) -> bool:
    """Whether another light of the same pixels is worth its unknowns."""
    if point is None or not point.positive:
        return False
    fall = point.pixels * (best.cost - point.cost) / min(best.cost, point.cost)
    return fall > point.occam - best.occam


def _with(fit: SetFit, names: frozenset[str], asked: Weighed) -> SetFit:
    """The fit with other things free, under a light as uneven as that of the likeliest set."""
    model, uneven = fit.model, None
    if LIGHT in names:
        ways = [h for h in asked.evidence.hypotheses if h.name == LIGHT]
        (way,) = (k for k, h in enumerate(ways) if any(h is best for best in asked.sets.best))
        uneven = _lights(fit)[way]._replace(degrees=_RICHEST)
    free = tuple(name for name in (*SHARED, *model.kind.besides) if name in names)
    wider = replace(model, free=free, uneven=uneven)
    result = wider.fit(model.carried(fit.values, wider)).levelled()
    if GAMMA in free:  # a tone is linear about the light only
        result = result.model.fit(result.values).levelled()
    return result


def unevenly_lit(fit: SetFit) -> SetFit:
    """The fit under light as uneven as on usual benches; as it is where that turns negative."""
    uneven = replace(fit.model, uneven=_lights(fit)[1]).fit(fit.values)
    return uneven if uneven.point.positive else fit


def best_first(fits: Iterable[SetFit]) -> list[SetFit]:
    """Fits whose light is positive, by rising misfit, up to where a finer model may turn them."""
    good = sorted((fit for fit in fits if fit.point.positive), key=lambda fit: fit.chi)
    return [fit for fit in good if fit.chi < RIVAL_CHI * good[0].chi]


def alike_fits(fits: Sequence[SetFit]) -> tuple[list[SetFit], list[SetFit]]:
    """Fits of one image under uneven light, and those that explain it as well in either light."""
    uneven = best_first(map(unevenly_lit, fits))
    return uneven, [m for each in (fits, uneven) for m in each if m.chi < ALIKE_CHI * each[0].chi]


def _lights(fit: SetFit) -> tuple[Unevenness, ...]:
    """The ways in which a set's light may be uneven: as one of them it is fitted."""
    now = fit.model.uneven or Unevenness(float(fit.point.brightness.mean()), 0.0, FIRST_DEGREES)
    return tuple(now._replace(fall=fall) for fall in LIGHT_FALLS)


def _without_outliers(fit: SetFit) -> SetFit:
    """The fit without pixels whose residual no noise explains, and those beside them."""
    from scipy.ndimage import binary_dilation

    for _ in range(_ROUNDS):
        away = np.zeros(fit.model.masks.shape, dtype=bool)
        for i, residual in enumerate(fit.point.residuals):
            away[i, fit.model.masks[i]] = np.abs(residual) > _OUTLIER * max(1.0, fit.chi)
            away[i] = binary_dilation(away[i], iterations=2) & fit.model.masks[i]
        if not 0 < np.count_nonzero(away) <= MOSTLY * fit.point.pixels:
            break
        fit = replace(fit.model, masks=fit.model.masks & ~away).fit(fit.values)
    return fit


def ask_set(fit: SetFit) -> Weighed:
    """Weigh all that a set of images may show about a fit."""
    model, point, nuisances = fit.model, fit.point, list[Nuisance]()
    for name in (*SHARED, *model.kind.besides):
        sizes, places = model.sizes(name), model.places.get(name, np.arange(0))
        if not len(sizes) or (name == GAMMA and model.shots[0].no_load_light is not None):
            continue  # of a tone the no-load frames would need it too
        nuisances.append(
            Nuisance(
                name=name, columns=partial(point.rows_of, name=name),
                now=model.value(fit.values, name) - model.middle(name),
                roots=model.roots(name),
                positive=name in EVEN and name not in model.held, unknowns=tuple(places.tolist()),
                weights=model.prior[places],
            )
        )  # fmt: skip
    lit = [replace(model, uneven=way).lamp for way in _lights(fit)]
    more, known = lit[0].weights > 0.0, model.lamp.weights > 0.0
    of_each = np.tile(more, model.lights)
    now = point.solved[0][:, known].ravel() if model.uneven else np.zeros(of_each.sum())

    def by_waves(index: int) -> Array:
        """By a share of each place's own order, as products of cosines."""
        order, slope = point.by_order(index)
        mask = model.masks[index]
        return np.asarray(cosines(mask.shape, _COSINES)[1:, mask] * (slope * order))

    nuisances += [
        Nuisance(
            name=LIGHT, columns=lambda index: point.light_columns(index, lit[0])[of_each], now=now,
            roots=tuple(np.diag(np.tile(lamp.weights[more] ** -0.5, model.lights)) for lamp in lit),
            weights=np.tile(model.lamp.weights[known], model.lights),
        ),
        # Gaussian processes on their cosines; the even one left out is the fringe value itself
        Nuisance(
            name=ORDER, columns=by_waves, now=np.zeros(_COSINES**2 - 1), sizes=SIZES[:-1],
            roots=tuple(np.diag(cosine_spread(_COSINES, width)[1:]) for width in WIDTHS),
        ),
    ]  # fmt: skip
    unknowns = np.setdiff1d(np.arange(model.size), [u for n in nuisances for u in n.unknowns])
    plain = replace(model, uneven=None).lamp

    def parts() -> Iterator[tuple[Array, Array, NDArray[Any], Array]]:
        for i, residual in enumerate(point.residuals):
            rows, place = point.rows(i)
            every = np.zeros((model.size, residual.size))
            every[place] = rows
            fitted = np.concatenate((every[unknowns], point.light_columns(i, plain)))
            others = np.concatenate(
                [n.columns(i) for n in nuisances], dtype=np.float32, casting="same_kind"
            )
            yield every[:0], fitted, others, residual

    # the noise alone, whatever the model misses: that is smooth
    noise = [
        local_noise(mask, residual, image.light / image.sigma) ** 2 * line_noise(mask, residual, 1)
        for mask, residual, image in zip(model.masks, point.residuals, model.images, strict=True)
    ]
    return weighed(
        nuisances, ScoreProducts(parts()), noise=max(1.0, float(np.mean(noise))),
        fitted=model.fitted, chance=RARE, unknowns=unknowns, size=model.size,
    )  # fmt: skip
