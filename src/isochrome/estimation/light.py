"""A captured frame made ready for a fit, and the model of its light.

Its light, noise and mask; what its light is a sum of, and what more unknowns of it would gain.

I = A s + C with the polariscope's signal s, A = sum_k a_k B_k and C = sum_k c_k C_k: what no-load
frames show times a slow change, or polynomials of the place.

Score tests: at a fit the weighted residual r is normal to the fitted unknowns' derivatives A.
Others with derivatives D would lower r·r, to first order, by S = gᵀ M⁻¹ g, g = D⊥ᵀ r, M = D⊥ᵀ D⊥,
D⊥ the part of D that A cannot take up, and would come out at M⁻¹ g. Without them S/σ² is χ² of as
many degrees of freedom as D has columns. Source: Rao (1948), Proc. Camb. Phil. Soc. 44, 50-57.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.frames import Frame, Linear, NoiseModel, estimate_noise, full_scale, to_linear
from isochrome.messages import message
from isochrome.scene import Scene

Array = NDArray[Any]
Mask = NDArray[np.bool_]

Terms = tuple[tuple[int, int], ...]
"""Products P_i(y) P_j(x) of Legendre's polynomials, each as (i, j)."""

UNEVEN, EVEN = 2, 0
"""Degrees of the illumination and the background of a frame that is fitted with a scene: lamps fall
off to the corners, and what a room adds is the same all over."""

_KEPT_TERMS = 28
"""Products of a stack that is kept for the frames to come: 36 MB at 659 x 494."""


@dataclass(frozen=True)
class LightModel:
    """Images (k, rows, cols) that a frame's `illumination` A and `background` C are sums of.

    `terms`, the polynomial products in both; the no-load frames `dark` and `bright` (rows, cols)
    that they stand on, where there are any.
    """

    illumination: Array
    background: Array
    terms: tuple[Terms, Terms]
    dark: Array | None = None
    bright: Array | None = None

    @property
    def bases(self) -> dict[str, Any]:
        """Both by name, as `fit_intensity` takes them."""
        return {"illumination": self.illumination, "background": self.background}

    @property
    def unknowns(self) -> int:
        """Number of coefficients."""
        return len(self.illumination) + len(self.background)

    @property
    def words(self) -> str:
        """What was fitted where a frame asked for more than the first terms, for a message."""
        light, dark = (len(terms) for terms in self.terms)
        return message("light_more_uneven_quadratic_illumination", light=light, dark=dark)

    def plain(self) -> LightModel:
        """One amplitude for all the illumination: for a search, or a model that is poor."""
        return replace(self, illumination=self.illumination[:1])

    def of(self, terms: tuple[Terms, Terms]) -> LightModel:
        """The light of a whole frame with other polynomial products."""
        rows, cols = self.illumination.shape[1:]
        return frame_light((rows, cols), self.dark, self.bright, terms=terms)

    def with_terms(self, more: tuple[Terms, Terms]) -> tuple[Terms, Terms]:
        """Its products, and behind them those of `more` that it has not."""
        light, dark = (
            tuple(dict.fromkeys(own + others)) for own, others in zip(self.terms, more, strict=True)
        )
        return light, dark

    def every(self, stride: int) -> LightModel:
        """The images at every `stride`-th pixel."""
        return replace(
            self,
            illumination=self.illumination[:, ::stride, ::stride],
            background=self.background[:, ::stride, ::stride],
        )


def frame_light(
    shape: tuple[int, int],
    dark: Array | None = None,
    bright: Array | None = None,
    *,
    terms: tuple[Terms, Terms] | None = None,
) -> LightModel:
    """The light of a frame that is fitted with a scene, in single precision.

    With both no-load frames the illumination is their difference times a plane, and the background
    the dark one plus a constant; polynomials, by default of the lowest degrees, stand for what is
    missing.
    """
    if terms is None:
        even = 1 if bright is not None and dark is None else EVEN
        terms = total_degree(UNEVEN if bright is None else 1), total_degree(even)
    light, below = (_basis(shape, chosen) for chosen in terms)
    if bright is not None:
        light = light * (bright if dark is None else bright - dark)
    if dark is not None:
        below = np.concatenate((dark[None], below))
    return LightModel(light, below, terms, dark, bright)


def total_degree(degree: int) -> Terms:
    """The products P_i(y) P_j(x), as (i, j), with i + j up to a degree, the constant first."""
    return tuple((t - j, j) for t in range(degree + 1) for j in range(t + 1))


def missing_terms(present: tuple[Terms, Terms], degrees: tuple[int, int]) -> tuple[Terms, Terms]:
    """The products of illumination and background up to total degrees that a light has not."""
    light, dark = (
        tuple(term for term in total_degree(degree) if term not in terms)
        for degree, terms in zip(degrees, present, strict=True)
    )
    return light, dark


def with_chosen_terms(
    present: tuple[Terms, Terms], more: tuple[Terms, Terms], chosen: Iterable[int]
) -> tuple[Terms, Terms]:
    """A light's products, of illumination and background, and behind them some of those it has not.

    `chosen`: which of `more` (see `missing_terms`), counted through both, in this order.
    """
    count, order = len(more[0]), tuple(chosen)
    light = tuple(more[0][i] for i in order if i < count)
    dark = tuple(more[1][i - count] for i in order if i >= count)
    return (*present[0], *light), (*present[1], *dark)


def _basis(shape: tuple[int, int], terms: Terms) -> Array:
    """Legendre products; rich ones are made anew, since kept ones fill the memory."""
    if len(terms) <= _KEPT_TERMS:
        return light_basis(shape, terms)
    return light_products((_unit(shape[0]), _unit(shape[1])), terms)


@lru_cache(maxsize=8)
def light_basis(shape: tuple[int, int], terms: Terms) -> Array:
    """Legendre products (k, rows, cols) of a frame's light, float32, the same for a size.

    The last ones are kept, and cannot be written to.
    """
    basis = light_products((_unit(shape[0]), _unit(shape[1])), terms)
    basis.flags.writeable = False
    return basis


def light_products(
    places: tuple[Array, Array], terms: Terms, dtype: type[np.floating] = np.float32
) -> Array:
    """Legendre products P_i(y) P_j(x) (k, rows, cols) of rows' y and columns' x, in -1..1."""
    degree = max((max(pair) for pair in terms), default=0)
    rows, cols = (np.polynomial.legendre.legvander(p, degree).T.astype(dtype) for p in places)
    stack = np.empty((len(terms), len(places[0]), len(places[1])), dtype)
    for member, (i, j) in zip(stack, terms, strict=True):
        np.multiply(rows[i][:, None], cols[j][None, :], out=member)
    return stack


def polynomial_basis(shape: tuple[int, int], degree: int) -> Array:
    """Legendre products P_i(y) P_j(x), i + j <= degree, with x and y in -1..1 over the frame.

    The stack (k, rows, cols), k = (degree + 1)(degree + 2)/2, the constant first.
    """
    return light_products((_unit(shape[0]), _unit(shape[1])), total_degree(degree), np.float64)


def channel_light(rows: int, cols: int) -> Array:
    """What a colour channel's light is a sum of, (6, rows, cols): 1, y, x, y², x², xy.

    The even light is first; y and x go from -1 to 1 between the frame's edges.
    """
    y = (2.0 * np.arange(rows) + 1.0)[:, None] / rows - 1.0
    x = (2.0 * np.arange(cols) + 1.0)[None, :] / cols - 1.0
    y, x = np.broadcast_arrays(y, x)
    return np.stack([np.ones(y.shape), y, x, y * y, x * x, x * y])


def _unit(count: int) -> Array:
    return np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1)


ASKED = 2.5
"""What a cause must gain over ln n for each of its unknowns (Schwarz's criterion): of twelve causes
one is found by chance in 200 frames. More would leave what moves the load by many of its standard
uncertainties, where the two are alike."""

FIRST_DEGREES = 6, 4
"""Degrees of illumination and background that every light is asked for."""

RICHEST = 24, 8
"""Degrees of illumination and background up to which light is made richer, product by product."""

FEW_TERMS, MOST_TERMS = 12, 120
"""Products by which light is made richer: beside other causes, since a hundred take up what a roll
does, and once some have explained much."""

TAKEN = 1e-6
"""Part of a column's square that must be left by what is fitted."""


class ScoreProducts:
    """Products of columns with each other and the residual, what is fitted taken off.

    Of parts (local, fitted, columns, residual) of the data, all over the noise: derivatives (q, n)
    by what is fitted to this part alone, such as a frame's light, (p, n) by what is fitted to all,
    (k, n) by what is not, and the residual (n,). p and k are the same in all parts.
    """

    def __init__(self, parts: Iterable[tuple[Array, Array, Array, Array]]) -> None:
        gram, size, count, fitted, shared = np.zeros((1, 1)), np.zeros(1), 0, 0, 0
        for local, rows, columns, residual in parts:
            every = local, rows, columns, residual[None]
            stacked = np.concatenate(every, dtype=np.float32, casting="same_kind")
            products = (stacked @ stacked.T).astype(float)
            shared = len(rows)
            size = size + np.diag(products)[len(local) + shared : -1]
            gram = gram + _taken_off(products, len(local))
            count, fitted = count + stacked.shape[1], fitted + len(local)
        self.size = size
        self.taken_up = _explained(gram, shared)[:, :-1]
        reduced = _taken_off(gram, shared)
        self.count = count
        self.matrix, self.right, square = reduced[:-1, :-1], reduced[:-1, -1], reduced[-1, -1]
        self.noise = max(1.0, float(square) / max(1, count - fitted - shared))

    def one_by_one(self, most: int) -> list[int]:
        """The columns that are asked for, each the one with the most evidence beside those before.

        They are taken as fitted from then on.
        """
        least = np.log(self.count) + ASKED
        chosen: list[int] = []
        while len(chosen) < most:
            size = np.diag(self.matrix)
            free = size > TAKEN * self.size
            gains = np.where(free, self.right**2 / np.where(free, size, 1.0), 0.0) / self.noise
            best = int(gains.argmax())
            if gains[best] < least:
                break
            self.take(best)
            chosen.append(best)
        return chosen

    def take(self, index: int) -> None:
        """Fit one column more."""
        row, value = self.matrix[index].copy(), self.right[index]
        size = row[index]
        self.matrix -= np.outer(row, row) / size
        self.right -= row * (value / size)


def _taken_off(gram: Array, fitted: int) -> Array:
    """Products (k, k) of columns, less what the `fitted` first ones of (fitted + k) explain."""
    cross = gram[:fitted, fitted:]
    return np.asarray(gram[fitted:, fitted:] - cross.T @ _explained(gram, fitted))


def _explained(gram: Array, fitted: int) -> Array:
    """What the `fitted` first columns of (fitted + k) come out at for each of the others."""
    taken, cross = gram[:fitted, :fitted], gram[:fitted, fitted:]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(taken), 1e-300))
    inverse = np.linalg.pinv(taken * np.outer(scale, scale), 1e-10, hermitian=True)
    return np.asarray((inverse * np.outer(scale, scale)) @ cross)


LEVEL_PX, _LEVEL_WINDOW = 1.5, (13, 13)
"""Standard deviation of the Gaussian mean that tells the grey level about a pixel where no model
does, and the window that it extends, pixels."""


@dataclass(frozen=True, kw_only=True)
class Observation:
    """One prepared frame (rows, cols), in fractions of full scale; `name` is that of messages."""

    name: str
    light: Array  # linear, raw^gamma
    sigma: Array
    valid: Mask  # may be used
    raw: Array  # the light as the sensor stored it
    raw_sigma: Array
    gamma: float  # from raw to light


_IMAGES = ("light", "sigma", "valid", "raw", "raw_sigma")
"""What an observation has pixel by pixel."""


@dataclass(frozen=True, kw_only=True)
class FrameData(Observation):
    """A prepared frame to hold a scene against."""

    lamp: LightModel  # what illumination and background are sums of
    noise_ratio: float = 1.0  # over what the finest part shows, which compression takes away

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the picture."""
        return self.light.shape[0], self.light.shape[1]

    @property
    def illumination(self) -> Array:
        """The illumination's images (k, rows, cols)."""
        return self.lamp.illumination

    @property
    def background(self) -> Array:
        """The background's images (k, rows, cols)."""
        return self.lamp.background

    def plain(self) -> FrameData:
        """The frame with one amplitude for all its light: for a search, or a model that is poor."""
        return replace(self, lamp=self.lamp.plain())

    def toned(self, gamma: float) -> FrameData:
        """The frame read with another exponent, and with smooth light whatever was before."""
        level = np.maximum(self.raw, self.raw_sigma)
        return replace(
            self,
            light=np.maximum(self.raw, 0.0) ** np.float32(gamma),
            sigma=(gamma * level ** (gamma - 1.0) * self.raw_sigma).astype(np.float32),
            lamp=frame_light(
                self.shape, terms=self.lamp.terms if self.lamp.bright is None else None
            ),
            gamma=gamma,
        )

    def with_noise(self, ratio: float) -> FrameData:
        """The frame with so many times its noise."""
        share = np.float32(ratio)
        return replace(
            self,
            sigma=share * self.sigma,
            raw_sigma=share * self.raw_sigma,
            noise_ratio=ratio * self.noise_ratio,
        )

    def lying(self, move: Callable[[Array], Array]) -> FrameData:
        """The frame, its mask and its no-load light turned or mirrored by `move`, of images."""
        parts: dict[str, Any] = {name: move(getattr(self, name)) for name in _IMAGES}
        ends = (self.lamp.dark, self.lamp.bright)
        dark, bright = (None if end is None else move(end) for end in ends)
        rows, cols = parts["light"].shape
        return replace(self, lamp=frame_light((rows, cols), dark, bright), **parts)

    def in_blocks(self, side: int) -> FrameData:
        """Means over blocks of `side` by `side` pixels, an odd number, about every `side`-th one.

        Valid are those whose pixels all are.
        """
        import cv2

        def mean(image: Array) -> Array:
            blurred = cv2.blur(image.astype(np.float32), (side, side))
            return np.asarray(blurred[::side, ::side])

        thin: dict[str, Any] = {name: mean(getattr(self, name)) for name in ("light", "raw")}
        for name in ("sigma", "raw_sigma"):
            thin[name] = np.sqrt(mean(getattr(self, name) ** 2)) / np.float32(side)
        # at the picture's ends blocks are not whole
        valid = self.valid.astype(np.float32)
        share = cv2.blur(valid, (side, side), borderType=cv2.BORDER_CONSTANT)[::side, ::side]
        thin["valid"] = share > 1.0 - 0.5 / side**2
        return replace(self, lamp=self.lamp.every(side), **thin)

    def every(self, stride: int) -> FrameData:
        """The frame at every `stride`-th pixel."""
        thin = {name: getattr(self, name)[::stride, ::stride] for name in _IMAGES}
        return replace(self, lamp=self.lamp.every(stride), **thin)


def observe(
    image: Array,
    *,
    name: str,
    bit_depth: int | None,
    gamma: float,
    mask: Mask | None = None,
    noise: NoiseModel | None = None,
) -> Observation:
    """Turn a frame's raw grey levels into light with its noise; InputError on a blank frame.

    The noise is told from the frame itself where it is not known. A pixel's own is that of the grey
    level about it, a Gaussian mean in which the pixel counts for a fourteenth, not a ninth as in
    one over 3 x 3: a weight that follows the pixel's own noise pulls every fit to the dark side.
    """
    import cv2

    linear = to_linear(image, bit_depth=bit_depth, gamma=gamma, name=name, mask=mask)
    blank = ~np.isfinite(image)
    grey = image.astype(np.float32)
    grey[blank] = 0.0
    if noise is None:
        noise = estimate_noise(image, linear.valid, bit_depth=bit_depth)
    level = cv2.GaussianBlur(grey, _LEVEL_WINDOW, LEVEL_PX, borderType=cv2.BORDER_REFLECT)
    full = np.float32(full_scale(bit_depth))
    raw_sigma = noise.sigma(level) / full
    sigma = raw_sigma
    if gamma != 1.0:
        sigma = noise.linear_sigma(level, bit_depth=bit_depth, gamma=gamma).astype(np.float32)
    # a mask is no edge of the light: a rim is looked for in all that the camera saw
    light = linear.image
    light[blank] = 0.0
    return Observation(
        name=name, light=light, sigma=sigma, valid=linear.valid, raw=grey / full,
        raw_sigma=raw_sigma, gamma=gamma,
    )  # fmt: skip


def prepare_frame(
    frame: Frame,
    scene: Scene,
    *,
    bit_depth: int | None,
    no_load: tuple[Linear | None, Linear | None] = (None, None),
    gamma_found: bool = False,
    noise: NoiseModel | None = None,
) -> FrameData:
    """Observe a frame, with the light that its scene is to be held against, as in `frame_light`.

    `gamma_found`: an unknown gamma is going to be found, and is 1 until then; else InputError, as
    on a blank frame. `noise`: by default the frame itself tells it.
    """
    gamma = scene.frames.first_gamma if gamma_found else scene.frames.stated_gamma
    observed = observe(
        frame.image, name=frame.name, bit_depth=bit_depth, gamma=gamma, mask=frame.mask, noise=noise
    )
    ends = [part for part in no_load if part is not None]
    valid = np.logical_and.reduce([observed.valid, *(part.valid for part in ends)])
    rows, cols = observed.light.shape
    lamp = frame_light((rows, cols), *(None if part is None else part.image for part in no_load))
    return FrameData(**(vars(observed) | {"valid": valid}), lamp=lamp)
