"""Least squares: linear unknowns eliminated, and damped steps of one or of many problems.

I = f A + C with A = sum_k a_k B_k, C = sum_k c_k C_k: for a given signal f the coefficients (a, c)
follow from the weighted normal equations. With the residual r and its derivatives J, N = Jᵀ J and
g = Jᵀ r, a damped step s solves (N + λ diag N) s = g, which promises to lower r·r by
s·(2 g - N s); λ follows what came of that promise.
Sources: Levenberg (1944), Q. Appl. Math. 2, 164; Marquardt (1963), J. SIAM 11, 431; Nielsen (1999),
Damping Parameter in Marquardt's Method, IMM-REP-1999-05, DTU, for the damping.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement
from math import sqrt
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from isochrome.errors import InputError
from isochrome.estimation.covariance import Array, Mask
from isochrome.estimation.light import LightModel, PixelLight

MOSTLY = 0.05
"""Share of pixels whose illumination may be negative before the contrast counts as wrong."""


_CUTOFF = {4: 1e-6, 8: 1e-12}
"""Eigenvalues below which directions are dropped, 1 in the mean, by the precision in bytes."""


@dataclass(frozen=True)
class Pixels:
    """Pixels of a frame (n,): `raw`, fraction of full scale, and `weight` = 1/sigma. `light`, what
    they are held against; `gamma`, the frame's exponent where it is not an unknown.
    """

    raw: Array
    weight: Array
    light: PixelLight
    gamma: float = 1.0

    @property
    def size(self) -> int:
        """Number of pixels."""
        return self.raw.size

    @property
    def keep(self) -> Mask:
        """Where the pixels are (rows, cols)."""
        return self.light.keep

    @property
    def data(self) -> Array:
        """Their levels (n,) over the noise."""
        return np.asarray(self.raw * self.weight)

    @property
    def columns(self) -> tuple[Array, Array]:
        """What illumination (ka, n) and background (kc, n) are sums of, weighted: of few pixels."""
        light, dark = self.light.model.columns(self.keep)
        return light * self.weight, dark * self.weight

    def some(self, chosen: Mask) -> Pixels:
        """Fewer of them: `chosen` (n,)."""
        keep = self.keep.copy()
        keep[keep] = chosen
        light = PixelLight(self.light.model, keep)
        return Pixels(self.raw[chosen], self.weight[chosen], light, self.gamma)


@dataclass(frozen=True, kw_only=True)
class LinearPart:
    """The light of pixels that fits best for one signal, and the residual it leaves."""

    problem: Pixels
    coefficients: Array  # (k,), the illumination's, then the background's
    signal: Array  # (n,), solved for
    normal: Array  # (k, k), the weighted columns' Gram matrix
    amplitude: Array  # (n,), the weighted illumination
    model: Array  # (n,), the light
    residual: Array  # (n,), over noise

    @cached_property
    def cost(self) -> float:
        """Sum of the squared residuals over noise."""
        return float(np.sum(np.square(self.residual), dtype=float))

    @property
    def noise(self) -> float:
        """The residuals' variance over that of the noise, 1 at least."""
        return self.noise_of(self.count)

    def noise_of(self, count: int) -> float:
        """The same where the light's coefficients are known to be so many."""
        return max(1.0, self.cost / max(1, self.residual.size - count))

    @cached_property
    def positive(self) -> bool:
        """Whether the illumination is positive over (nearly) the whole frame."""
        return bool(np.count_nonzero(self.amplitude <= 0.0) <= MOSTLY * self.amplitude.size)

    @property
    def weights(self) -> Array:
        """1/u^2 (k,) of what is known of the coefficients."""
        return self.problem.light.model.weights

    @cached_property
    def inverse(self) -> Array:
        """Of the normal equations, the weights in them (k, k): only slopes ask for it."""
        cutoff = _CUTOFF[self.problem.weight.dtype.itemsize]
        return scaled_inverse(self.normal + np.diag(self.weights), cutoff)

    @property
    def count(self) -> int:
        """Number of coefficients that the data tell: of one that is known before, the less."""
        return round(float(len(self.weights) - self.weights @ np.diag(self.inverse)))

    @property
    def chi(self) -> float:
        """How far the coefficients are from what is known of them, over what is expected: of as
        many as the data tell, beside those that may have any size.
        """
        return sqrt(self.known / max(1, self.count - int(np.count_nonzero(self.weights == 0.0))))

    @property
    def known(self) -> float:
        """What the coefficients add to the squares by what is known of them."""
        return float(self.weights @ self.coefficients**2)

    def project(self, rows: Array) -> None:
        """Take off what illumination and background explain of derivatives J (p, n), in place: with
        a prior's V they leave P = (1 + L V L')^-1 of data, whose squares P J are derivatives of.
        """
        weight = self.problem.weight
        self.problem.light.take_off(rows, weight * self.signal, weight, self.inverse)


STEP = 1e-4
"""Difference step in units of a parameter's scale; fits responses in single precision as well."""


@dataclass(frozen=True)
class Minimum:
    """One minimum that a start led to; chi is inf where the light is negative."""

    values: Array
    chi: float


def prepare(image: ArrayLike, *, mask: Mask | None, sigma: ArrayLike, light: LightModel) -> Pixels:
    """Unmasked, finite pixels; InputError where none is, or a sigma is not positive."""
    frame = np.asarray(image, dtype=float)
    keep = np.isfinite(frame) if mask is None else np.asarray(mask, dtype=bool) & np.isfinite(frame)
    noise = np.broadcast_to(np.asarray(sigma, dtype=float), frame.shape)[keep]
    if not keep.any() or not np.all(noise > 0):
        raise InputError("no_valid_pixel_sigma")
    return Pixels(frame[keep], 1.0 / noise, PixelLight(light, keep))


def solve_linear(pixels: Pixels, signal: Array) -> LinearPart:
    """Illumination and background that fit best for a signal (n,), the ideal polariscope's 0..1."""
    light, weight, data = pixels.light, pixels.weight, pixels.data
    normal, right = light.equations(weight * signal, weight, data)
    known = normal + np.diag(light.model.weights)
    coefficients = scaled_solution(known, right, _CUTOFF[weight.dtype.itemsize])
    illumination, background = light.of(coefficients)
    model = illumination * signal + background
    return LinearPart(
        problem=pixels,
        coefficients=coefficients,
        signal=signal,
        normal=normal,
        amplitude=weight * illumination,
        model=model,
        residual=data - weight * model,
    )


def linear_costs(light: Array, dark: Array, data: Array, signals: Array) -> tuple[Array, Array]:
    """What the best light of each of m signals (m, n) leaves of k pictures, and its mean, (m, k).
    Of weighted pixels: bases `light` (ka, n) and `dark` (kc, n), pictures `data` (k, n). The cost
    is dᵀd - bᵀ G⁻¹ b, with G and b = (a columns, c columns)ᵀ d the normal equations of each signal.
    """
    ka, kc, single = len(light), len(dark), signals.dtype
    pairs = list(combinations_with_replacement(range(ka), 2))
    products = np.array([light[i] * light[j] for i, j in pairs], single).T
    others = np.concatenate((dark, data))
    cross = (light[:, None] * others).reshape(-1, light.shape[1]).astype(single).T
    square, crossed = (signals * signals) @ products, signals @ cross
    crossed = crossed.reshape(len(signals), ka, len(others))
    gram = np.empty((len(signals), ka + kc, ka + kc))
    for column, (i, j) in enumerate(pairs):
        gram[:, i, j] = gram[:, j, i] = square[:, column]
    gram[:, :ka, ka:] = crossed[..., :kc]
    gram[:, ka:, :ka] = crossed[..., :kc].swapaxes(1, 2)
    gram[:, ka:, ka:] = dark @ dark.T
    diagonal = np.arange(ka + kc)
    gram[:, diagonal, diagonal] *= 1.0 + _CUTOFF[single.itemsize]
    right = np.empty((len(signals), ka + kc, len(data)))
    right[:, :ka], right[:, ka:] = crossed[..., kc:], dark @ data.T
    found = solve_all(gram, right)
    explained = np.einsum("mkd,mkd->md", found, right)
    return np.sum(data**2, axis=1) - explained, light.mean(axis=1) @ found[:, :ka]


def scaled_inverse(matrix: Array, cutoff: float = 1e-12) -> Array:
    """Pseudo-inverse (k, k) by a unit diagonal, without eigenvalues below the cutoff."""
    from scipy.linalg.lapack import dpotri

    scale, scaled, factor = _factored(matrix, cutoff)
    if factor is None:
        return _by_eigenvalues(scale, scaled, cutoff)
    lower = np.tril(dpotri(factor, lower=True)[0])
    return np.asarray((lower + np.tril(lower, -1).T) * np.outer(scale, scale))


def scaled_solution(matrix: Array, right: Array, cutoff: float = 1e-12) -> Array:
    """What `scaled_inverse` makes of a right side (k,), where it can without the inverse."""
    from scipy.linalg.lapack import dpotrs

    scale, scaled, factor = _factored(matrix, cutoff)
    if factor is None:
        return np.asarray(_by_eigenvalues(scale, scaled, cutoff) @ right)
    return np.asarray(scale * dpotrs(factor, scale * right, lower=True)[0])


def _factored(matrix: Array, cutoff: float) -> tuple[Array, Array, Array | None]:
    """Scale (k,) to a unit diagonal, the matrix then, its Cholesky factor: None if small."""
    from scipy.linalg.lapack import dpotrf

    diagonal = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scale = 1.0 / np.where(diagonal > 0, diagonal, 1.0)
    scaled = np.asarray(matrix * np.outer(scale, scale), float)
    factor, failed = dpotrf(scaled, lower=True)
    small = failed or np.diag(factor).min(initial=1.0) ** 2 < cutoff
    return scale, scaled, None if small else np.asarray(factor)


def _by_eigenvalues(scale: Array, scaled: Array, cutoff: float) -> Array:
    """The pseudo-inverse by the eigenvalues that are not below the cutoff."""
    values, vectors = np.linalg.eigh(scaled)
    good = values > cutoff
    half = (scale[:, None] * vectors[:, good]) / np.sqrt(values[good])
    return np.asarray(half @ half.T)


CUTOFF = 1e-14
"""Eigenvalue, 1 in the mean, below which a direction of the normal equations is not moved in."""

_EASIEST = 1e-2
"""Part of the damping that is left after a step which does all that it promised."""


class Point(Protocol):
    """Where an iteration stands."""

    @property
    def cost(self) -> float:
        """The sum of squares r·r."""

    @property
    def normal(self) -> Array:
        """The normal equations' matrix N (p, p)."""

    @property
    def gradient(self) -> Array:
        """Their right side g (p,)."""


P = TypeVar("P", bound=Point)


@dataclass(frozen=True)
class Damping:
    """The damping λ of one problem, what it is multiplied by next, and what it rises from."""

    value: float
    growth: float = 2.0
    least: float = 0.0

    def lighter(self, gained: float, promised: float) -> Damping:
        """The damping after a step that was taken, λ max(1/100, 1 - (2 gained/promised - 1)³)."""
        # a step that was cut at a bound may promise nothing at all
        ratio = gained / promised if promised > 0.0 else 0.0
        easier = max(_EASIEST, 1.0 - (2.0 * ratio - 1.0) ** 3)
        return replace(self, value=self.value * easier, growth=2.0)

    def heavier(self) -> Damping:
        """The damping after a step that was not taken: times 2, 4, 8, ..."""
        heavy = max(self.value, self.least) * self.growth
        return replace(self, value=heavy, growth=self.growth * 2.0)


@dataclass(frozen=True)
class Bounds:
    """The least and the largest value of each unknown, (p,)."""

    low: Array
    high: Array

    def free(self, values: Array, gradient: Array) -> Mask:
        """Unknowns (p,) that are not at a bound which the gradient pushes them against."""
        held = ((values <= self.low) & (gradient < 0)) | ((values >= self.high) & (gradient > 0))
        return np.asarray(~held)

    def cut(self, values: Array, step: Array) -> Array:
        """A step (p,) that ends at the bounds."""
        return np.asarray(np.clip(values + step, self.low, self.high) - values)


@dataclass(frozen=True)
class Descent(Generic[P]):
    """Where the steps ended: `values` (p,), the `point` there, the next `step`, `converged`."""

    values: Array
    point: P
    step: Array
    converged: bool


def damped(normal: Array, damping: float) -> Array:
    """The matrix N + λ diag N of Marquardt."""
    return np.asarray(normal + damping * np.diag(np.diag(normal)))


def damped_step(
    normal: Array, gradient: Array, damping: float, free: Mask, *, cutoff: float = CUTOFF
) -> Array:
    """The step of the free unknowns, 0 for the others; `cutoff` as of `scaled_inverse`."""
    step = np.zeros(len(gradient))
    moved = np.flatnonzero(free)
    if moved.size:
        matrix = damped(normal[np.ix_(moved, moved)], damping)
        step[moved] = scaled_inverse(matrix, cutoff) @ gradient[moved]
    return step


def promised_gain(normal: Array, gradient: Array, step: Array) -> float:
    """How much a step s lowers r·r where the model is linear, s·(2 g - N s)."""
    return float(step @ (2.0 * gradient - normal @ step))


def minimise(
    at: Callable[[Array], P | None],
    values: Array,
    point: P,
    *,
    enough: Callable[[P], float],
    damping: Damping,
    iterations: int,
    better: Callable[[P, P], bool] | None = None,
    bounds: Bounds | None = None,
    cut: Callable[[Array, Array], Array] | None = None,
) -> Descent[P]:
    """Take steps from a point to the least sum of squares near it. `at`: from values (p,) to the
    point there, or None; `enough`: the promised gain below which a point is the end; `better`: of a
    new and the old point, by default less cost; `cut`: the part of a step from values that is
    taken, by default up to the bounds.
    """
    anywhere = np.full(values.size, np.inf)
    bounds = bounds or Bounds(-anywhere, anywhere)
    cut, better = cut or bounds.cut, better or (lambda trial, point: trial.cost < point.cost)
    step = np.zeros(values.size)
    for _ in range(iterations):
        normal, gradient = point.normal, point.gradient
        free = bounds.free(values, gradient)
        step = cut(values, damped_step(normal, gradient, damping.value, free))
        gain = promised_gain(normal, gradient, step)
        if gain < enough(point):
            return Descent(values, point, step, True)
        trial = at(values + step)
        if trial is not None and better(trial, point):
            damping = damping.lighter(point.cost - trial.cost, gain)
            values, point = values + step, trial
        else:
            damping = damping.heavier()
    return Descent(values, point, step, False)


State = tuple[Array, ...]

EASED, STIFFENED = 0.2, 8.0
"""What a damping is multiplied by after a step that was taken, and after one that was not."""


def solve_all(matrices: Array, right: Array) -> Array:
    """Solve m systems A x = b, (m, p, p) and (m, p, q); NaN for a singular one alone."""
    try:
        return np.asarray(np.linalg.solve(matrices, right))
    except np.linalg.LinAlgError:  # of one of them, and nothing is said of which
        regular = np.linalg.slogdet(matrices)[0] != 0.0
        solution = np.full(right.shape, np.nan)
        solution[regular] = np.linalg.solve(matrices[regular], right[regular])
        return solution


def minimise_all(
    at: Callable[[Array], State],
    equations: Callable[[Array, State], tuple[Array, Array]],
    values: Array,
    damping: Array,
    *,
    steps: int,
    limits: tuple[float, float] = (0.0, np.inf),
) -> tuple[Array, State, Array]:
    """Take damped steps of m problems at once, each where it lowers the problem's cost. `at`: from
    values (m, p) to arrays (m, ...), the costs (m,) first; `equations`: from values and these to N
    (m, p, p), which is damped in place, and g (m, p); `limits`: least and largest damping λ.
    Returns where the steps ended: values, what `at` says there, λ (m,).
    """
    now, diagonal = at(values), np.arange(values.shape[-1])
    for _ in range(steps):
        normal, gradient = equations(values, now)
        normal[:, diagonal, diagonal] *= 1.0 + damping[:, None]
        trial = values + solve_all(normal, gradient[..., None])[..., 0].astype(values.dtype)
        new = at(trial)
        better = new[0] < now[0]
        values, *others = (
            np.where(better.reshape(-1, *[1] * (one.ndim - 1)), one, other)
            for one, other in zip((trial, *new), (values, *now), strict=True)
        )
        now = tuple(others)
        damping = np.clip(np.where(better, EASED * damping, STIFFENED * damping), *limits)
    return values, now, damping
