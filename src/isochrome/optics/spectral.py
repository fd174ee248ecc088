"""The polariscope's signal for light of several wavelengths, in every channel of the camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from isochrome.optics.polariscope import Chain, polariscope_signal
from isochrome.optics.wavelengths import Light

Array = NDArray[np.floating]

_STEP = 1.0 / 128.0
"""Of the table over N: cubic pieces hold cos 2 pi k N to (2 pi k/128)⁴/384, 7e-8 at k = 1.5."""

_DARKEST = 1e-300
"""Keeps the logarithm of a visibility finite; its product with that visibility is then nothing."""

_BLOCK = 64
"""Orders of the table at a time."""

_VISIBLE = 1e-3
"""Contrast below which a pixel's waves are left out of what a table must reach."""


def highest_visible(order: Array, visibility: Array | float = 1.0) -> float:
    """The highest order N of a picture that leaves a thousandth of its contrast or more, or 0.

    Beside a point load N has no bound, and no fringes either.
    """
    return float(np.max(order, where=np.asarray(visibility) > _VISIBLE, initial=0.0))


def spectral_signal(
    order: Array,
    light: Light,
    chains: Sequence[Chain],
    *,
    reference_nm: float,
    direction: Array | None = None,
    visibility: Array | float = 1.0,
) -> Array:
    """The light behind the analyser (rows, cols, channels), 1 for the channel's full light.

    I_c = Σ_s w_cs I(k_s N, θ, V^(k_s²)), k_s = reference/wavelength, as the order goes, and nearly
    the visibility, sinc(k g), as its power k². Lines are summed; a spectrum's sum is a table over
    N, interpolated by cubics, with V^(k²) linear in k² about the channel's mean. N and V are those
    at the reference; θ (rad) is needed where a chain, one a wavelength, is not ideal.
    """
    ratio = reference_nm / light.wavelength_nm
    if light.continuous:
        order = np.minimum(order, highest_visible(order, visibility))
        signals = _table_signals(order, light, ratio, chains, direction, visibility)
        return np.stack(list(signals), axis=-1)
    total = np.zeros((*order.shape, len(light.weights)))
    for k, chain, weights in zip(ratio, chains, light.weights.T, strict=True):
        one = polariscope_signal(
            k * order, chain, direction=direction, visibility=visibility ** (k * k)
        )
        total += one[..., None] * weights
    return total


def _table_signals(
    order: Array,
    light: Light,
    ratio: Array,
    chains: Sequence[Chain],
    direction: Array | None,
    visibility: Array | float,
) -> Iterator[Array]:
    """The channels' signals one by one, each from a table of the waves in N that it holds."""
    ideal = all(chain.ideal for chain in chains)
    if direction is None and not ideal:
        raise ValueError("a chain that is not ideal needs the direction of sigma_1")
    angles = [np.ones(())] if direction is None or ideal else _angles(direction)
    still, cosine, sine = (terms[:, : len(angles)] for terms in _harmonics(chains))
    contrast = np.asarray(visibility, dtype=float)
    for weights in light.weights:
        mean = float(weights @ ratio**2)
        both = np.stack([weights, weights * (ratio**2 - mean)], axis=1)
        amplitudes = (np.einsum("sv,sa->sva", both, terms) for terms in (cosine, sine))
        waves = _wave_table(float(order.max()), ratio, *amplitudes)(order)
        steady, change = np.moveaxis(waves, -2, 0)
        wave = _over(angles, steady) + np.log(np.maximum(contrast, _DARKEST)) * _over(
            angles, change
        )
        yield _over(angles, weights @ still) + contrast**mean * wave


def _angles(direction: Array) -> list[Array]:
    """1, cos 4θ, sin 4θ, cos 2θ, sin 2θ."""
    turned = np.exp(2j * np.asarray(direction, dtype=float))
    twice = turned * turned
    return [np.ones(()), twice.real, twice.imag, turned.real, turned.imag]


def _over(angles: Sequence[Array], amplitudes: Array) -> Array:
    """Sum of the angles' functions times their amplitudes (..., angles)."""
    total = sum(angle * amplitudes[..., i] for i, angle in enumerate(angles))
    return np.asarray(total)


def _harmonics(chains: Sequence[Chain]) -> tuple[Array, Array, Array]:
    """The signal's amplitudes over 1, cos 4θ, sin 4θ, cos 2θ, sin 2θ: still, of cos δ, of sin δ.

    From I = (|α|² + |w|²)/2 + (|α|² - |w|²)/2 cos δ - Im(α w*) sin δ with w = β cos 2θ + γ sin 2θ.
    Returns three arrays (s, 5).
    """
    a, b, c = (np.array([getattr(x, n) for x in chains]) for n in ("alpha", "beta", "gamma"))
    straight, none = 0.5 * np.abs(a) ** 2, np.zeros(len(chains))
    mean, difference = (0.25 * (np.abs(b) ** 2 + sign * np.abs(c) ** 2) for sign in (1.0, -1.0))
    both = 0.5 * np.real(b * np.conj(c))
    still = [straight + mean, difference, both, none, none]
    cosine = [straight - mean, -difference, -both, none, none]
    sine = [none, none, none, -np.imag(a * np.conj(b)), -np.imag(a * np.conj(c))]
    return np.stack(still, axis=1), np.stack(cosine, axis=1), np.stack(sine, axis=1)


def _wave_table(
    highest: float, ratio: Array, cosine: Array, sine: Array
) -> Callable[[Array], Array]:
    """Σ_s (cosine_s cos 2 pi k_s N + sine_s sin 2 pi k_s N) as cubics in N with exact slopes.

    Within a block of orders the waves are those of the first block, turned: one product of
    matrices a block. Parameters: `highest` N; `ratio` k (s,); `cosine`, `sine` (s, ...).
    """
    from scipy.interpolate import CubicHermiteSpline

    blocks = int(highest / (_STEP * _BLOCK)) + 1
    order = _STEP * np.arange(blocks * _BLOCK + 1)
    speed = 2.0 * np.pi * ratio
    wave = (cosine - 1j * sine).reshape(len(ratio), -1)
    both = np.hstack([wave, 1j * speed[:, None] * wave])  # the value, and the slope
    first = np.exp(1j * np.outer(order[: _BLOCK + 1], speed))
    table = np.empty((len(order), both.shape[1]))
    for start in range(0, blocks * _BLOCK, _BLOCK):
        turned = np.exp(1j * speed * order[start])[:, None] * both
        table[start : start + _BLOCK + 1] = (first @ turned).real
    value, slope = np.moveaxis(table.reshape(len(order), 2, *cosine.shape[1:]), 1, 0)
    result: Callable[[Array], Array] = CubicHermiteSpline(order, value, slope)
    return result
