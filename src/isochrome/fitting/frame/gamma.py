r"""A frame's trusted pixels as the sensor stored them, and least squares on light through its tone.

A camera stores T(m) = m^(1/γ) of the light m, with noise that knows nothing of m. Grey levels that
are turned into light first, m = raw^γ, carry a noise that is neither even nor centred. So the model
is held against the stored levels: about a model m_0,

    (raw - T(m)) / σ  ≈  (d - m) w,    d = m_0 + (raw - T(m_0)) / T'(m_0),    w = T'(m_0) / σ,

which is linear in m again, and exact once m_0 is m. With γ = 1 it is exact at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import FrameData, LinearPart, SeparableProblem, solve_linear
from isochrome.fitting.arrays import Array, Mask

_PASSES = 3
CLEAR_SIGMAS = 3.5
"""Noise standard deviations that a model must stay away from black and white: nearer, the sensor
cuts the noise on one side, and so would a choice of pixels by their own levels."""


ENOUGH = 0.25
"""Share of pixels that must be clear of black and white for the others to be left out."""


@dataclass(frozen=True)
class Pixels:
    """Trusted pixels of a frame (n,), float32: `raw`, fraction of full scale, and `weight` = 1/σ.

    `light` (ka, n) and `dark` (kc, n), the bases of illumination and background; `keep` (rows,
    cols), where the pixels are; `gamma`, the frame's exponent where it is not an unknown.
    """

    raw: Array
    weight: Array
    light: Array
    dark: Array
    keep: Mask
    gamma: float

    @property
    def size(self) -> int:
        """Number of pixels."""
        return self.raw.size

    @cached_property
    def as_stored(self) -> SeparableProblem:
        """The weighted pixels of a linear sensor."""
        return _problem(self, self.raw, self.weight)


@dataclass(frozen=True)
class GammaFit:
    """A linear solution through the tone curve: `part`, of the `problem` about its own model.

    `model` (n,), light; `weight` (n,), of light; `residual` (n,), of the stored levels over noise.
    """

    problem: SeparableProblem
    part: LinearPart
    model: Array
    weight: Array
    residual: Array

    @property
    def cost(self) -> float:
        """Sum of the squared residuals over noise."""
        return float(np.sum(np.square(self.residual), dtype=float))

    @property
    def noise(self) -> float:
        """The residuals' variance over that of the noise, 1 at least."""
        return max(1.0, self.cost / max(1, self.residual.size))


def trusted_pixels(data: FrameData, region: Mask) -> Pixels:
    """The valid pixels of a frame inside a region (rows, cols).

    Raises PhysicsError where there are none.
    """
    keep = data.valid & region
    if not keep.any():
        raise PhysicsError(
            f"{data.name}: no pixel that the camera shows well is part of the scene's specimen; "
            "check camera.left_mm, camera.top_mm and the roi"
        )
    whole = bool(keep.all())

    def chosen(image: Array) -> Array:
        values = image.reshape(-1) if whole else image[keep]
        return np.ascontiguousarray(values, dtype=np.float32)

    return Pixels(
        chosen(data.raw),
        1.0 / chosen(data.raw_sigma),
        np.stack([chosen(image) for image in data.illumination]),
        np.stack([chosen(image) for image in data.background]),
        keep,
        data.gamma,
    )


def clear_of_ends(pixels: Pixels, model: Array, gamma: float) -> Mask:
    """Pixels whose model is far from black and white, whatever their own noise made of them."""
    level = stored(model, gamma)
    room = CLEAR_SIGMAS / pixels.weight
    return np.asarray((level > room) & (level < 1.0 - room))


def some_pixels(pixels: Pixels, chosen: Mask) -> Pixels:
    """Fewer pixels: `chosen` (n,) of them."""
    keep = pixels.keep.copy()
    keep[keep] = chosen
    return replace(
        pixels,
        raw=pixels.raw[chosen],
        weight=pixels.weight[chosen],
        light=np.ascontiguousarray(pixels.light[:, chosen]),
        dark=np.ascontiguousarray(pixels.dark[:, chosen]),
        keep=keep,
    )


def stored(model: Array, gamma: float) -> Array:
    """What the sensor stores of light, T(m) = m^(1/γ)."""
    return model if gamma == 1.0 else np.maximum(model, 0.0) ** np.float32(1.0 / gamma)


def solve_with_gamma(
    pixels: Pixels, signal: Array, gamma: float, *, near: Array | None = None
) -> GammaFit | None:
    """Illumination and background that fit best through the tone curve for a signal (n,).

    Parameters: `pixels`; `signal`, at them; `gamma`; `near` (n,), a model to start from. Returns a
    GammaFit, None where the signal is not finite.
    """
    if not np.isfinite(signal.sum()):
        return None
    if gamma == 1.0:
        part = solve_linear(pixels.as_stored, signal)
        model = pixels.raw - part.residual / pixels.weight
        return GammaFit(pixels.as_stored, part, model, pixels.weight, part.residual)
    model = np.maximum(pixels.raw, 0.0) ** np.float32(gamma) if near is None else near
    # light of one standard deviation above black: there the tone's slope ends
    least = pixels.weight ** np.float32(-gamma)
    for _ in range(_PASSES):
        model = np.maximum(model, least)
        level = stored(model, gamma)
        weight = level / (np.float32(gamma) * model) * pixels.weight
        data = model + (pixels.raw - level) * (pixels.weight / weight)
        problem = _problem(pixels, data, weight)
        part = solve_linear(problem, signal)
        model = data - part.residual / weight
    residual = (pixels.raw - stored(model, gamma)) * pixels.weight
    return GammaFit(problem, part, model, weight, residual)


def gamma_slope(toned: GammaFit, gamma: float) -> Array:
    """Weighted derivative of the model by γ, (n,): -m ln m / γ."""
    model = np.maximum(toned.model, 1e-6)
    return np.asarray(-model * np.log(model) / np.float32(gamma) * toned.weight)


def _problem(pixels: Pixels, data: Array, weight: Array) -> SeparableProblem:
    dark = pixels.dark * weight
    return SeparableProblem(
        data * weight,
        pixels.light * weight,
        dark,
        pixels.keep,
        (dark @ dark.T).astype(float),
        np.empty_like(pixels.light),
    )
