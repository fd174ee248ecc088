"""One frame's pixels as the sensor stored them, and a scene's unknowns about one set of values.

With the weighted derivatives J less what illumination and background explain of them, J⊥, a
residual r moves the unknowns by (J⊥ᵀ J⊥)⁻¹ J⊥ᵀ r; near enough J may stay, if r is exact. Source:
Kaufman (1975), BIT 15, 49-57.

A camera stores T(m) = m^(1/γ) of the light m, with noise that knows nothing of m, so that the model
is held against the stored levels, about a model m_0:

    (raw - T(m)) / σ  ≈  (d - m) w,    d = m_0 + (raw - T(m_0)) / T'(m_0),    w = T'(m_0) / σ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import (
    STEP,
    Damping,
    FrameData,
    LinearPart,
    PixelLight,
    Pixels,
    Prior,
    cosine_sum,
    damped_step,
    is_determined,
    no_prior,
    promised_gain,
    scaled_inverse,
    solve_linear,
    standard_uncertainty,
    white_covariance,
)
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.renderer import FringeOptics, SceneRenderer, Solve
from isochrome.fitting.frame.unknowns import BLUR, GAMMA, SWING, limits, moved_scene, scales
from isochrome.scene import Scene

_PASSES = 3
CLEAR_SIGMAS = 3.5
"""Noise standard deviations that a model must stay away from black and white: nearer, the sensor
cuts the noise on one side, and so would a choice of pixels by their own levels."""


_ENOUGH = 0.25
"""Share of pixels that must be clear of black and white for the others to be left out."""


def trusted_pixels(data: FrameData, region: Mask) -> Pixels:
    """The valid pixels of a frame inside a region (rows, cols); PhysicsError where none are."""
    keep = data.valid & region
    if not keep.any():
        raise PhysicsError("no_pixel_camera_shows", name=data.name)
    raw, sigma = (np.asarray(image[keep], np.float32) for image in (data.raw, data.raw_sigma))
    return Pixels(raw, 1.0 / sigma, PixelLight(data.lamp, keep), data.gamma)


def clear_of_ends(pixels: Pixels, model: Array, gamma: float) -> Mask:
    """Pixels whose model is far from black and white, whatever their noise; all where few are."""
    level = stored(model, gamma)
    room = CLEAR_SIGMAS / pixels.weight
    clear = np.asarray((level > room) & (level < 1.0 - room))
    return clear if np.count_nonzero(clear) > _ENOUGH * clear.size else np.ones_like(clear)


def stored(model: Array, gamma: float) -> Array:
    """What the sensor stores of light, T(m) = m^(1/γ)."""
    return model if gamma == 1.0 else np.maximum(model, 0.0) ** np.float32(1.0 / gamma)


def solve_with_gamma(
    pixels: Pixels, signal: Array, gamma: float, *, near: Array | None = None
) -> LinearPart | None:
    """Illumination and background that fit a signal (n,) best through the tone curve, from a model
    `near` (n,); the residual is that of the stored levels. None for a signal that is not finite.
    """
    if not np.isfinite(signal.sum()):
        return None
    if gamma == 1.0:
        return solve_linear(pixels, signal)
    model = np.maximum(pixels.raw, 0.0) ** np.float32(gamma) if near is None else near
    # light of one standard deviation above black, or of white: there the tone's slope ends
    least = np.maximum(pixels.weight, np.float32(1.0)) ** np.float32(-gamma)
    for _ in range(_PASSES):
        model = np.maximum(model, least)
        level = stored(model, gamma)
        weight = level / (np.float32(gamma) * model) * pixels.weight
        data = model + (pixels.raw - level) * (pixels.weight / weight)
        part = solve_linear(replace(pixels, raw=data, weight=weight), signal)
        model = part.model
    return replace(part, residual=(pixels.raw - stored(model, gamma)) * pixels.weight)


def gamma_slope(gamma_fit: LinearPart, gamma: float) -> Array:
    """Weighted derivative of the model by γ, (n,): -m ln m / γ."""
    model = np.maximum(gamma_fit.model, 1e-6)
    return np.asarray(-model * np.log(model) / np.float32(gamma) * gamma_fit.problem.weight)


def trust_of_slopes(gamma_fit: LinearPart, stride: int = 1) -> Array:
    """Root of the weight (n,) that pixels have by the error of their slopes, besides the noise.
    Where fringes are off by a phase d the signal is by sin(phase) d / 2, and by cos(phase) d^2 / 4
    besides, which slopes do not know: with the mean square m of the first about a pixel, the root
    mean square of that is sqrt(2) m. Near the contact, where fringes are off by most, it leaves
    little; as a fit comes nearer, all. `stride`, of the pixels.
    """
    from scipy.ndimage import uniform_filter

    keep, gain = gamma_fit.problem.keep, gamma_fit.amplitude
    image, there = np.zeros((2, *keep.shape), np.float32)
    image[keep] = np.square(gamma_fit.residual / np.maximum(gain, 1e-6))
    there[keep] = 1.0
    size = max(3, _ABOUT_PX // stride)
    mean = uniform_filter(image, size)[keep] / np.maximum(uniform_filter(there, size)[keep], 1e-6)
    return np.asarray(1.0 / np.hypot(1.0, sqrt(2.0) * mean * gain), np.float32)


def inward(value: float, step: float, most: float) -> float:
    """The step of an unknown to the side on which it does not pass its most."""
    return step if value + step <= most else -step


_ABOUT_PX = 15
"""Side of the square about a pixel that tells how far off its fringes are: some fringes."""
_SMOOTH_PX, _DIMMEST = 5.0, 0.05
"""What is smoothed off an illumination whose slope is wanted; the least of it, over its most."""

NEAR = 0.02
"""Last step in standard uncertainties."""

_CUTOFF = 1e-12
"""Eigenvalue over the largest below which derivatives in single precision tell nothing."""

_FROZEN = 0.3
"""Share of the last step below which the next must lie for the derivatives to be kept."""


class FrameModel:
    """One frame's pixels, and the scene that is rendered on them as its unknowns move."""

    def __init__(
        self,
        data: FrameData,
        scene: Scene,
        keys: tuple[str, ...],
        region: Array,
        *,
        stride: int = 1,
        hidden_px: float = 0.0,
        prior: Prior | None = None,
        in_blocks: bool = False,
        solve: Solve | None = None,
    ) -> None:
        """`data`, whole; `scene`, one state, numbers at `keys`; `region` (rows, cols), strided.
        `hidden_px`, depth above which the region shows nothing; `prior` of the unknowns;
        `in_blocks`, whether to fit the means over blocks as wide as the stride, and not one pixel
        of each; `solve` gives a scene's state, by default on its own.
        """
        self.scene, self.keys = scene, keys
        self.prior = prior or no_prior(len(keys))
        self._precise = self.prior.any
        self.renderer = SceneRenderer(
            scene, data.shape, stride=stride, hidden_px=hidden_px,
            side=stride if in_blocks else 1, solve=solve,
        )  # fmt: skip
        thin = data.in_blocks(stride) if in_blocks else data.every(stride) if stride > 1 else data
        self.pixels: Pixels = trusted_pixels(thin, region)
        if data.waves is not None:
            self.renderer.waves = cosine_sum(thin.shape, data.waves)
        self.limits = limits(scene, keys, data.shape)
        self._light_slopes: tuple[Array, Array] | None = None

    def keep_clear(self, values: Array) -> LinearPart | None:
        """Leave out pixels whose model is near black or white; the others' solution."""
        gamma_fit = self.at(values)
        if gamma_fit is None:
            return None
        clear = clear_of_ends(self.pixels, gamma_fit.model, self.gamma(values))
        if clear.all():
            return gamma_fit
        self.pixels = self.pixels.some(clear)
        return self.solved(gamma_fit.signal[clear], values, gamma_fit.model[clear])

    def follow_light(self, data: FrameData, gamma_fit: LinearPart) -> None:
        """Blur the light with its fall-off A, G * (A s) = A (G * s) + b² ∇A·∇(G * s) for a Gaussian
        G of standard deviation b; ∇A/A from the solution `gamma_fit` of the frame `data`.
        """
        from scipy.ndimage import gaussian_filter

        light = data.lamp.illumination(gamma_fit.coefficients[: self.pixels.light.split])
        light = np.maximum(gaussian_filter(light, _SMOOTH_PX), _DIMMEST * float(light.max()))
        down, across = np.gradient(np.log(light))
        self._light_slopes = down, across

    def gamma(self, values: Array) -> float:
        """The exponent of the tone curve at some values."""
        return float(values[self.keys.index(GAMMA)]) if GAMMA in self.keys else self.pixels.gamma

    def moved(self, keys: tuple[str, ...], values: Array) -> Scene:
        """The scene with some values (p,) at its keys."""
        return moved_scene(self.scene, keys, values)

    def signal(
        self, values: Array, *, visibility: Array | None = None, keys: tuple[str, ...] | None = None
    ) -> Array | None:
        """The signal at the pixels (n,), None: no scene; `visibility` (rows, cols), where known."""
        try:
            scene = self.moved(self.keys if keys is None else keys, values)
            image = self.renderer.signal(scene, visibility=visibility)
        except (InputError, PhysicsError):
            return None
        assert scene.camera is not None
        if self._light_slopes is not None and scene.camera.blur_px > 0.0:
            down, across = np.gradient(image)
            down *= self._light_slopes[0]
            across *= self._light_slopes[1]
            image = image + np.float32(scene.camera.blur_px**2) * (down + across)
        return np.asarray(image[self.pixels.keep], dtype=np.float32)

    def at(self, values: Array, *, near: Array | None = None) -> LinearPart | None:
        """The linear solution at some values (p,); `near` (n,), a model that is not far off."""
        signal = self.signal(values)
        return None if signal is None else self.solved(signal, values, near)

    def solved(self, signal: Array, values: Array, near: Array | None = None) -> LinearPart | None:
        """The linear solution for a signal (n,)."""
        return solve_with_gamma(self.pixels, signal, self.gamma(values), near=near)

    def step(self, local: LocalModel, values: Array, pull: Array, damping: float) -> Array:
        """The damped step (p,) from some values that `pull`, the right side, asks for."""
        free = self.limits.free(values, pull) & local.determined
        step = damped_step(local.normal, pull, damping, free, cutoff=_CUTOFF)
        return self.limits.cut(values, step)

    def linearise(self, values: Array, gamma_fit: LinearPart) -> LocalModel:
        """Derivatives at some values; PhysicsError where the scene cannot be solved beside them."""
        rows = self._slopes(self.keys, values, range(len(self.keys)), gamma_fit)
        return local_model(self.keys, values, gamma_fit, rows, self.prior)

    def input_rows(self, values: Array, gamma_fit: LinearPart, inputs: tuple[str, ...]) -> Array:
        """Derivatives (m, n) by held inputs, less what light explains; or PhysicsError."""
        stated = [float(self.scene.get(key)) for key in inputs]
        keys, count = (*self.keys, *inputs), len(self.keys)
        rows = self._slopes(keys, np.r_[values, stated], range(count, len(keys)), gamma_fit)
        gamma_fit.project(rows)
        return rows

    def _slopes(
        self, keys: tuple[str, ...], values: Array, chosen: range, gamma_fit: LinearPart
    ) -> Array:
        """Weighted derivatives by the chosen ones of some keys, (chosen, n). What only priors tell
        apart needs both sides: a fringe's curvature is a per cent of a one-sided difference.
        """
        rows = np.empty((len(chosen), self.pixels.size), np.float32)
        # what the pixels' area takes changes little: it is not rendered for every derivative
        _, shown = self.renderer.order_field(self.moved(keys, values[: len(keys)]))
        picked = tuple(keys[j] for j in chosen)
        steps, high = STEP * scales(self.scene, picked), limits(self.scene, picked).high
        for row, j, key, step, most in zip(rows, chosen, picked, steps, high, strict=True):
            if key == GAMMA:
                row[:] = gamma_slope(gamma_fit, self.gamma(values))
                continue
            first = inward(values[j], step, most)
            visibility = None if key in (BLUR, SWING) or self._precise else shown
            signals: dict[float, Array] = {}
            for sign in (1.0, -1.0):
                if signals and not self._precise:
                    break
                moved = np.array(values, dtype=float)
                moved[j] += sign * first
                signal = self.signal(moved, visibility=visibility, keys=keys)
                if signal is not None:
                    signals[sign] = signal
            if not signals:
                raise PhysicsError("scene_cannot_solved_beside", key=key, value=values[j])
            ahead, behind = (signals.get(sign, gamma_fit.signal) for sign in (1.0, -1.0))
            np.subtract(ahead, behind, out=row)
            row *= gamma_fit.amplitude / np.float32(first * len(signals))
        return rows


def turned_row(
    optics: FringeOptics,
    field: Array,
    shown: Array,
    turn: Array | np.complex64,
    step: np.float32,
    gamma_fit: LinearPart,
) -> Array:
    """The weighted derivative (n,) by what turns a field (n,) of visibility `shown` by `turn` (n,),
    over a step of it: fringes are soon others, what turns them changes little.
    """
    ahead = optics.signal(field + step * turn, visibility=shown)
    return np.asarray((ahead - gamma_fit.signal) * (gamma_fit.amplitude / step))


@dataclass(frozen=True)
class LocalModel:
    """A frame's model about `values` (p,) of `keys`: the linear solution `gamma_fit`, the weighted
    derivatives less what it explains, `rows` (p, n), `squares` (p,), their sums before that, and
    the `prior`.
    """

    keys: tuple[str, ...]
    values: Array
    gamma_fit: LinearPart
    rows: Array
    squares: Array
    prior: Prior

    @cached_property
    def information(self) -> Array:
        """Fisher information of the frame's pixels, the linear unknowns eliminated, (p, p)."""
        # what a prior alone tells apart differs by less than single precision resolves
        rows = self.rows.astype(float) if self.prior.any else self.rows
        return np.asarray((rows @ rows.T).astype(float))

    @cached_property
    def normal(self) -> Array:
        """The same with what is known beforehand, (p, p)."""
        return np.asarray(self.information + self.prior.normal)

    @cached_property
    def inverse(self) -> Array:
        """Covariance that this information allows at best, (p, p)."""
        return scaled_inverse(self.normal, 1e-12)

    @property
    def determined(self) -> Mask:
        """Which unknowns are stated, or leave an effect that the light cannot take up."""
        return is_determined(self.information, self.squares) | (self.prior.weight > 0.0)

    @property
    def bound(self) -> Array:
        """Cramér-Rao bound of each unknown (p,), inf where it is not determined."""
        return standard_uncertainty(self.inverse, self.determined)

    def covariance(self, gamma_fit: LinearPart, noise: Array | None = None) -> Array:
        """Covariance of the values by noise (p, p), by default what `gamma_fit` has left (n,)."""
        residual = gamma_fit.residual if noise is None else noise
        keep = gamma_fit.problem.keep
        return white_covariance(self.inverse, self.rows, residual, keep, linear=gamma_fit.count)

    def sensitivity(self, stated: tuple[str, ...], held: Array) -> Array:
        """Change of the values over that of what is known beforehand, (p, stated + held): of keys
        with a prior, and of `held` derivatives (m, n), see `isochrome.estimation.priors`.
        """
        stated_columns = [self.keys.index(key) for key in stated]
        cross = (self.rows @ held.T).astype(float)
        prior = self.inverse[:, stated_columns] * self.prior.weight[stated_columns]
        return np.asarray(np.hstack((prior, -self.inverse @ cross)))

    def size(self, step: Array) -> float:
        """A step (p,) in standard uncertainties, those of the noise alone."""
        return sqrt(max(0.0, float(step @ self.normal @ step)))


def local_model(
    keys: tuple[str, ...],
    values: Array,
    gamma_fit: LinearPart,
    rows: Array,
    prior: Prior | None = None,
) -> LocalModel:
    """The model about `values` (p,), from the weighted derivatives `rows` (p, n), which change."""
    squares = np.array([np.sum(np.square(row), dtype=float) for row in rows])
    gamma_fit.project(rows)
    prior = prior or no_prior(len(keys))
    return LocalModel(keys, np.array(values, float), gamma_fit, rows, squares, prior)


@dataclass(frozen=True)
class RefinedFit:
    """Where the steps ended: `values` (p,), the `local` model of the last derivatives, and the
    solution `gamma_fit` at the last values but a step below 0.02 standard uncertainties.
    """

    values: Array
    local: LocalModel
    gamma_fit: LinearPart
    converged: bool = True

    @property
    def freedom(self) -> int:
        """Pixels less unknowns, those of the light among them."""
        return max(1, self.gamma_fit.residual.size - (len(self.local.keys) + self.gamma_fit.count))

    @property
    def cost(self) -> float:
        """Sum of squares, the prior's with it."""
        return self.gamma_fit.cost + self.local.prior.cost(self.values)

    @property
    def chi(self) -> float:
        """Residual over noise."""
        return sqrt(self.gamma_fit.cost / self.freedom)

    @property
    def positive(self) -> bool:
        """Whether the light is light."""
        return self.gamma_fit.positive


def refine_fit(
    model: FrameModel,
    start: Array,
    *,
    gamma_fit: LinearPart | None = None,
    tolerance: float = NEAR,
    iterations: int = 25,
) -> RefinedFit | None:
    """Damped steps with derivatives that are kept as long as they serve; `iterations`, exact
    residuals at most; `tolerance`, the last step in standard uncertainties. None where the start
    makes no scene that can be solved, PhysicsError where only the start does.
    """
    values = np.clip(np.asarray(start, float), model.limits.low, model.limits.high)
    gamma_fit = gamma_fit or model.at(values)
    if gamma_fit is None:
        return None
    local = model.linearise(values, gamma_fit)
    damping, last = Damping(0.0, least=1e-2), np.inf
    for _ in range(iterations):
        pull = (local.rows @ gamma_fit.residual).astype(float) + model.prior.gradient(values)
        step = model.step(local, values, pull, damping.value)
        # of all solutions only those that slopes are made of have counted what the data tell
        size = local.size(step) / sqrt(gamma_fit.noise_of(local.gamma_fit.count))
        if size < tolerance:
            return RefinedFit(values + step, local, gamma_fit)
        if size > _FROZEN * last and not np.array_equal(local.values, values):
            local, last = model.linearise(values, gamma_fit), np.inf
            continue
        trial = model.at(values + step, near=gamma_fit.model)
        known = model.prior.cost(values), model.prior.cost(values + step)
        if trial is None or not _better(trial, gamma_fit, known):
            damping, last = damping.heavier(), np.inf
            if not np.array_equal(local.values, values):
                local = model.linearise(values, gamma_fit)
            continue
        gain = promised_gain(local.normal, pull, step)
        damping = damping.lighter(gamma_fit.cost + known[0] - trial.cost - known[1], gain)
        values, gamma_fit, last = values + step, trial, size
    return RefinedFit(values, local, gamma_fit, converged=False)


def _better(trial: LinearPart, gamma_fit: LinearPart, known: tuple[float, float]) -> bool:
    """Whether a step lowers the cost with the priors' (`known`), and keeps the light positive."""
    if gamma_fit.positive and not trial.positive:
        return False
    # the costs of two points that differ by less than the noise of their sum are alike
    return trial.cost + known[1] <= (gamma_fit.cost + known[0]) * (1.0 + 1e-6)
