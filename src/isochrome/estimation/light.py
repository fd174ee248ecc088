"""The model of a frame's light: illumination and background as sums of smooth images.

I = A s + C with the polariscope's signal s, A = sum_k a_k B_k and C = sum_k c_k C_k. What no-load
frames show stands for itself, times a slow change; what they do not is a polynomial of the place.
All who reckon with uneven light take its images from here, so that another kind of them is a change
of this module alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import InputError

Array = NDArray[Any]

Terms = tuple[tuple[int, int], ...]
"""Products P_i(y) P_j(x) of Legendre's polynomials, each as (i, j)."""

UNEVEN, EVEN = 2, 0
"""Degrees of the illumination and the background of a frame that is fitted with a scene: lamps fall
off to the corners, and what a room adds is the same all over."""

_KEPT_TERMS = 28
"""Products of a stack that is kept for the frames to come: 36 MB at 659 x 494."""

DEGREES = ((2, 1), (4, 2))
"""Degrees of both that a calibration tries, fewest unknowns first, see `smooth_starts`."""

DEGREES_ON_LIGHT = ((1, 1), (2, 1))
"""The same on a no-load frame, which leaves less to be found."""


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
        return (
            f"the light is more uneven than a quadratic: illumination of {light} and background of "
            f"{dark} polynomials were fitted"
        )

    def plain(self) -> LightModel:
        """One amplitude for all the illumination: for a search, or a model that is poor."""
        return replace(self, illumination=self.illumination[:1])

    def of(self, terms: tuple[Terms, Terms]) -> LightModel:
        """The light of a whole frame with other polynomial products."""
        rows, cols = self.illumination.shape[1:]
        return frame_light((rows, cols), self.dark, self.bright, terms=terms)

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
    the dark one plus a constant; without, smooth polynomials stand for what is missing. `terms`,
    the products of illumination and background, are by default the lowest degrees that serve.
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


def smooth_light(
    shape: tuple[int, ...], degrees: tuple[int, int], light: ArrayLike | None = None
) -> LightModel:
    """The light of a calibration's image, with the degrees that its evidence asks for.

    For these see `degrees_of`; `light` (rows, cols) is the no-load bright minus dark frame.
    """
    size = (shape[0], shape[1])
    bases = polynomial_basis(size, degrees[0], times=light), polynomial_basis(size, degrees[1])
    return LightModel(*bases, (total_degree(degrees[0]), total_degree(degrees[1])))


def degrees_of(light: ArrayLike | None) -> tuple[tuple[int, int], ...]:
    """The degrees of illumination and background to try, fewest unknowns first.

    `light` (rows, cols) is the no-load bright minus dark frame, None where there is none.
    """
    return DEGREES if light is None else DEGREES_ON_LIGHT


def total_degree(degree: int) -> Terms:
    """The products P_i(y) P_j(x), as (i, j), with i + j up to a degree, the constant first."""
    return tuple((t - j, j) for t in range(degree + 1) for j in range(t + 1))


def missing_terms(own: tuple[Terms, Terms], degrees: tuple[int, int]) -> tuple[Terms, Terms]:
    """The products of illumination and background up to total degrees that a light has not."""
    light, dark = (
        tuple(term for term in total_degree(degree) if term not in terms)
        for degree, terms in zip(degrees, own, strict=True)
    )
    return light, dark


def with_chosen_terms(
    own: tuple[Terms, Terms], more: tuple[Terms, Terms], chosen: Iterable[int]
) -> tuple[Terms, Terms]:
    """A light's products, of illumination and background, and behind them some of those it has not.

    `chosen`: which of `more` (see `missing_terms`), counted through both, in this order.
    """
    count, order = len(more[0]), tuple(chosen)
    light = tuple(more[0][i] for i in order if i < count)
    dark = tuple(more[1][i - count] for i in order if i >= count)
    return (*own[0], *light), (*own[1], *dark)


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


def polynomial_basis(
    shape: tuple[int, int],
    degree: int,
    *,
    times: ArrayLike | None = None,
    dtype: type[np.floating] = np.float64,
) -> Array:
    """Legendre products P_i(y) P_j(x), i + j <= degree, with x and y in -1..1 over the frame.

    The stack (k, rows, cols), k = (degree + 1)(degree + 2)/2, the constant first; `times`, such as
    the no-load bright less the dark frame, multiplies every member, else it is of `dtype`.
    InputError for a negative degree or an image of another shape.
    """
    if degree < 0:
        raise InputError(f"degree = {degree} is not allowed: a polynomial's is 0 or more; raise it")
    stack = light_products((_unit(shape[0]), _unit(shape[1])), total_degree(degree), dtype)
    if times is None:
        return stack
    image = np.asarray(times, dtype=float)
    if image.shape != tuple(shape):
        raise InputError(
            f"times has the shape {image.shape} and the frame {tuple(shape)}; give one pixel grid"
        )
    result: Array = stack * image
    return result


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
