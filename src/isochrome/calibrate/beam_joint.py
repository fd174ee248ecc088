"""All images of a beam in one fit: under one light, low orders are told from dim ones.

Where less than a fringe is seen, an image's own amplitude and order are hard to tell apart. Images
taken with one lamp and camera share the illumination A and background B,
I_i = b_i A sin^2(pi N_i) + B, and an unloaded one shows the background. Whether the light was the
same (b_i = 1), or changed in brightness, or differs altogether, the images decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibrate.beam_fit import BeamFit, beam_order, beam_scale, beam_signal
from isochrome.calibrate.shot import Shot
from isochrome.calibrate.smooth import degrees_of, light_maps
from isochrome.fit import IntensityFit, fit_intensity

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Together:
    """The images' fits under one light.

    `covariance` (n, n) is that of the slopes, relative to them; `rest` holds the squared order at
    the edge of each unloaded image, with its standard uncertainty.
    """

    fits: tuple[BeamFit, ...]
    covariance: Array
    rest: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class _Stack:
    """The loaded images and then the unloaded ones, one below the other, on the same columns."""

    fits: tuple[BeamFit, ...]
    idle: tuple[Shot, ...]
    height_px: float
    bright: bool
    image: Array
    mask: NDArray[np.bool_]
    sigma: Array

    def table(self, params: Array) -> Array:
        """Slope, row and tilt (n, 3) of the loaded images."""
        return params[: 3 * len(self.fits)].reshape(-1, 3)

    def signal(self, params: Array) -> Array:
        """The whole stack's ideal intensities for slopes, rows, tilts, rest orders, brightness."""
        y, x = self.fits[0].places
        table, count = self.table(params), len(self.fits)
        parts = [beam_signal(beam_order(row, y, x), bright=self.bright) for row in table]
        for square in params[3 * count : 3 * count + len(self.idle)]:
            _, row, tilt = table.mean(axis=0)
            parts.append(_rest_signal(square, (y - row - tilt * x) / (0.5 * self.height_px),
                                      self.bright))  # fmt: skip
        for part, level in zip(parts[1:], params[3 * count + len(self.idle) :], strict=False):
            part *= level
        return np.concatenate(parts)


def fit_together(
    fits: Sequence[BeamFit],
    idle: Sequence[Shot],
    height_px: float,
    *,
    bright: bool = False,
    light: ArrayLike | None = None,
) -> Together | None:
    """Fit all images of one set with shared light, as far as they allow it.

    Parameters: `fits`, each image's own; `idle`, the unloaded images; `height_px`; `bright`;
    `light` (rows, cols), the no-load bright minus dark frame. Returns a Together, or None where
    the images do not share their light: then each image's own fit stands.
    """
    if len({f.shot.image.shape for f in fits} | {s.image.shape for s in idle}) > 1:
        return None
    own = sum(f.best.chi**2 * np.count_nonzero(f.mask) for f in fits)
    unknowns = sum(_light_unknowns(f.best) for f in fits)
    pixels = sum(int(np.count_nonzero(f.mask)) for f in fits)
    for scaled in (False, True) if len(fits) > 1 else (False,):
        stack = _stack(fits, () if scaled else tuple(idle), height_px, bright)
        found = _best(stack, light, scaled)
        if found is None:
            continue
        more = unknowns - _light_unknowns(found) - (len(fits) - 1 if scaled else 0)
        loaded = _weighted(stack, found)[: len(fits) * len(fits[0].mask)]
        worse = pixels * (float(np.nansum(loaded**2)) / own - 1.0)
        if found.converged and found.positive and worse < max(more, 1) * np.log(pixels):
            return _split(stack, found)
    return None


def _stack(
    fits: Sequence[BeamFit], idle: tuple[Shot, ...], height_px: float, bright: bool
) -> _Stack:
    pick = fits[0].pick
    shots = [*(f.shot for f in fits), *idle]
    shared = np.logical_and.reduce([f.mask for f in fits])
    masks = [*(f.mask for f in fits), *(shared & s.mask[:, pick] for s in idle)]
    return _Stack(
        tuple(fits), idle, height_px, bright, np.concatenate([s.image[:, pick] for s in shots]),
        np.concatenate(masks), np.concatenate([s.sigma[:, pick] for s in shots]),
    )  # fmt: skip


def _best(stack: _Stack, light: ArrayLike | None, scaled: bool) -> IntensityFit | None:
    """The fit with the fewest unknowns of light that describe the stack."""
    known = None if light is None else np.asarray(light, dtype=float)[:, stack.fits[0].pick]
    chosen: IntensityFit | None = None
    for degrees in degrees_of(known):
        found = _fit(stack, light_maps(stack.fits[0].mask.shape, degrees, known), scaled)
        if chosen is not None:
            pixels = int(np.count_nonzero(stack.mask))
            gain = pixels * (chosen.chi**2 / max(found.chi, 1e-12) ** 2 - 1.0)
            more = _light_unknowns(found) - _light_unknowns(chosen)
            if not found.positive or gain < more * np.log(pixels):
                break
        chosen = found
    return chosen


def _fit(stack: _Stack, maps: dict[str, Any], scaled: bool) -> IntensityFit:
    count, total = len(stack.fits), len(stack.fits) + len(stack.idle)
    tiled: dict[str, Any] = {k: np.tile(v, (1, total, 1)) for k, v in maps.items()}
    if scaled:
        rows = stack.fits[0].mask.shape[0]
        levels = np.zeros((total - 1, *stack.image.shape))
        for i in range(1, total):
            levels[i - 1, i * rows : (i + 1) * rows] = 1.0
        tiled["background"] = np.concatenate([tiled["background"], levels])
    extra = np.ones(total - 1 if scaled else 0)
    start = [*(f.best.values for f in stack.fits), np.zeros(len(stack.idle)), extra]
    scale = [np.tile(beam_scale(stack.height_px), count), np.full(len(stack.idle), 0.01),
             0.1 * extra]  # fmt: skip
    return fit_intensity(
        stack.image, stack.signal, np.concatenate(start), mask=stack.mask, sigma=stack.sigma,
        scale=np.concatenate(scale), central=False, **tiled,
    )  # fmt: skip


def _light_unknowns(fit: IntensityFit) -> int:
    return len(fit.illumination_coefficients) + len(fit.background_coefficients)


def _rest_signal(square: float, depth: Array, bright: bool) -> Array:
    """Signal of an order sqrt(square) * depth; it goes on smoothly below square = 0, where noise
    may drive it.
    """
    angle = 2.0 * np.pi * np.sqrt(abs(square)) * depth
    wave = np.cos(angle) if square >= 0 else np.cosh(np.minimum(np.abs(angle), 5.0))
    return np.asarray(0.5 + 0.5 * wave if bright else 0.5 - 0.5 * wave)


def _weighted(stack: _Stack, found: IntensityFit) -> Array:
    return np.asarray(found.residual / stack.sigma)


def _split(stack: _Stack, found: IntensityFit) -> Together:
    count, rows = len(stack.fits), stack.fits[0].mask.shape[0]
    weighted, table = _weighted(stack, found), stack.table(found.values)
    spread = stack.table(found.standard_uncertainty[: 3 * count])
    fits = []
    for i, fit in enumerate(stack.fits):
        own = slice(i * rows, (i + 1) * rows)
        left = weighted[own][np.isfinite(weighted[own])]
        unknowns = (found.values.size + found.illumination_coefficients.size) / count
        chi = float(np.sqrt(np.sum(left**2) / (left.size - unknowns)))
        best = replace(
            found, values=table[i], standard_uncertainty=spread[i], chi=chi,
            illumination_map=found.illumination_map[own], signal=found.signal[own],
            background_map=found.background_map[own], residual=found.residual[own],
        )  # fmt: skip
        fits.append(replace(fit, best=best))
    slopes = 3 * np.arange(count)
    relative = found.covariance[np.ix_(slopes, slopes)] / np.outer(table[:, 0], table[:, 0])
    rest = [(float(found.values[i]), float(found.standard_uncertainty[i]))
            for i in range(3 * count, 3 * count + len(stack.idle))]  # fmt: skip
    return Together(tuple(fits), relative, tuple(rest))
