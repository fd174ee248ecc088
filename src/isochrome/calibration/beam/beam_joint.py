"""All images of a beam in one fit: under one light, low orders are told from dim ones.

Where less than a fringe is seen, an image's own amplitude and order are hard to tell apart; images
taken with one lamp and camera share the light, and an unloaded one shows the background. Whether
the light was the same, or changed in brightness, or differs altogether, the images decide.

I_i = b_i A sin^2(pi N_i) + B: the illumination A and background B are shared; the brightness b_i
is 1, or free with a constant of its own where the light changed. An unloaded image has the order
that stays, sqrt(q) at the edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.beam.beam_fit import BeamFit, beam_order, beam_signal
from isochrome.calibration.order_line import ResidualOrder
from isochrome.calibration.shot import Shot
from isochrome.estimation import (
    IntensityFit,
    degrees_of,
    evidence_gain,
    fit_intensity,
    light_unknowns,
    smooth_light,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class BeamJointFit:
    """The images' fits under one light.

    `covariance` (n, n) is that of the slopes, relative to them; `rest` is what each unloaded image
    shows at the edge; `scaled`, whether the brightness changed.
    """

    fits: tuple[BeamFit, ...]
    covariance: Array
    rest: tuple[ResidualOrder, ...]
    scaled: bool


def fit_beam_images(fits: Sequence[BeamFit], idle: Sequence[Shot]) -> BeamJointFit | None:
    """Fit all images of one set with shared light, as far as they allow it.

    Shared light is taken unless the evidence asks for each image's own, see `evidence_gain`.
    Parameters: `fits`, each image's own; `idle`, the unloaded images. Returns a BeamJointFit, or
    None where the images do not share their light: then each image's own fit stands.
    """
    if len({f.shot.light.shape for f in fits} | {s.light.shape for s in idle}) > 1:
        return None
    pixels = sum(int(np.count_nonzero(f.mask)) for f in fits)
    own = sum(f.best.chi**2 * np.count_nonzero(f.mask) for f in fits)
    unknowns = sum(light_unknowns(f.best) for f in fits)
    for scaled in (False, True) if len(fits) > 1 else (False,):
        stack = Stack(fits, () if scaled else idle, scaled)
        result = _best(stack)
        saved = unknowns - light_unknowns(result) - (len(fits) - 1 if scaled else 0)
        loaded = (result.residual / stack.sigma)[: len(fits) * stack.rows]
        shared = float(np.nansum(loaded**2)) / pixels
        gain = evidence_gain((shared, 0), (own / pixels, max(saved, 1)), pixels=pixels)
        if result.converged and result.positive and gain < 0.0:
            return _split(stack, result)
    return None


def _best(stack: Stack) -> IntensityFit:
    """The fit with the fewest unknowns of light that describe the stack."""
    few, *rest = degrees_of(stack.fits[0].shot.no_load_light)
    chosen = fit_stack(stack, few)
    pixels = int(np.count_nonzero(stack.mask))
    for many in rest:
        result = fit_stack(stack, many)
        old, new = ((f.chi**2, light_unknowns(f)) for f in (chosen, result))
        if not result.positive or evidence_gain(old, new, pixels=pixels) < 0.0:
            break
        chosen = result
    return chosen


def _split(stack: Stack, found: IntensityFit) -> BeamJointFit:
    count, table = len(stack.fits), stack.table(found.values)
    spread = stack.table(found.standard_uncertainty)
    unknowns = (found.values.size + light_unknowns(found)) / count
    fits = []
    for i, fit in enumerate(stack.fits):
        own = slice(i * stack.rows, (i + 1) * stack.rows)
        left = (found.residual / stack.sigma)[own][fit.mask]
        best = replace(
            found, values=table[i], standard_uncertainty=spread[i],
            chi=float(np.sqrt(np.sum(left**2) / (left.size - unknowns))),
            illumination_map=found.illumination_map[own], signal=found.signal[own],
            background_map=found.background_map[own], residual=found.residual[own],
        )  # fmt: skip
        fits.append(replace(fit, best=best))
    slopes, idle = 3 * np.arange(count), slice(3 * count, 3 * count + len(stack.idle))
    relative = found.covariance[np.ix_(slopes, slopes)] / np.outer(table[:, 0], table[:, 0])
    squares = found.values[idle], found.standard_uncertainty[idle]
    rest = tuple(
        ResidualOrder(shot.name, float(q), float(u))
        for shot, q, u in zip(stack.idle, *squares, strict=True)
    )
    return BeamJointFit(tuple(fits), relative, rest, stack.scaled)


@dataclass(frozen=True)
class Stack:
    """The loaded images, then the unloaded ones, one below the other, on the same columns.

    Parameters: `fits`, of the loaded images, of one size; `idle`, the unloaded ones;
    `scaled`, whether each has its brightness. All maps are (images * rows, cols).
    """

    fits: Sequence[BeamFit]
    idle: Sequence[Shot] = ()
    scaled: bool = False

    @property
    def rows(self) -> int:
        """Rows of one image."""
        return len(self.fits[0].shot.light)

    @property
    def pick(self) -> tuple[Any, ...]:
        """The fitted columns of an image, as an index."""
        return np.s_[:, self.fits[0].pick]

    @property
    def shots(self) -> list[Shot]:
        """All images."""
        return [*(f.shot for f in self.fits), *self.idle]

    @cached_property
    def image(self) -> Array:
        """The light."""
        return np.concatenate([s.light[self.pick] for s in self.shots])

    @cached_property
    def sigma(self) -> Array:
        """Its noise."""
        return np.concatenate([s.sigma[self.pick] for s in self.shots])

    @cached_property
    def mask(self) -> Mask:
        """The pixels that are fitted, of an unloaded image those of all loaded ones."""
        shared = np.logical_and.reduce([f.mask for f in self.fits])
        idle = [shared & s.valid[self.pick] for s in self.idle]
        return np.concatenate([*(f.mask for f in self.fits), *idle])

    def table(self, params: Array) -> Array:
        """Slope, row and tilt (n, 3) of the loaded images, out of all parameters."""
        return params[: 3 * len(self.fits)].reshape(-1, 3)

    def signal(self, params: Array) -> Array:
        """Ideal intensities of the stack: (slope, row, tilt) an image, squared orders, levels."""
        y, x = self.fits[0].places
        table, count, bright = self.table(params), len(self.fits), self.fits[0].shot.bright
        parts = [beam_signal(beam_order(row, y, x), bright) for row in table]
        for square in params[3 * count : 3 * count + len(self.idle)]:
            _, row, tilt = table.mean(axis=0)
            depth = (y - row - tilt * x) / (0.5 * self.fits[0].view.height_px)
            parts.append(_rest_signal(square, depth, bright))
        for part, level in zip(parts[1:], params[3 * count + len(self.idle) :], strict=False):
            part *= level
        return np.concatenate(parts)

    def start(self) -> Array:
        """The parameters as the images' own fits have them."""
        levels = np.ones(len(self.fits) - 1 if self.scaled else 0)
        return np.concatenate(
            [*(f.best.values for f in self.fits), np.zeros(len(self.idle)), levels]
        )

    def scale(self) -> Array:
        """Natural changes of the parameters."""
        levels = np.full(len(self.fits) - 1 if self.scaled else 0, 0.1)
        own = np.tile(self.fits[0].view.scale, len(self.fits))
        return np.concatenate([own, np.full(len(self.idle), 0.01), levels])


def fit_stack(
    stack: Stack, degrees: tuple[int, int], *, mask: Mask | None = None, start: Array | None = None
) -> IntensityFit:
    """Least squares on a stack.

    Parameters: `degrees` of illumination and background; `mask`, where not the stack's own;
    `start`, where not its own. Returns the IntensityFit over the whole stack.
    """
    total, (height, width) = len(stack.shots), stack.image.shape
    lamp = stack.shots[0].lamp(*stack.pick)
    maps = smooth_light((stack.rows, width), degrees, lamp).bases
    tiled: dict[str, Any] = {k: np.tile(v, (1, total, 1)) for k, v in maps.items()}
    if stack.scaled:
        levels = np.zeros((total - 1, height, width))
        for i in range(1, total):
            levels[i - 1, i * stack.rows : (i + 1) * stack.rows] = 1.0
        tiled["background"] = np.concatenate([tiled["background"], levels])
    return fit_intensity(
        stack.image, stack.signal, stack.start() if start is None else start,
        mask=stack.mask if mask is None else mask, sigma=stack.sigma,
        scale=stack.scale(), central=False, **tiled,
    )  # fmt: skip


def _rest_signal(square: float, depth: Array, bright: bool) -> Array:
    """Signal of an order sqrt(square) * depth; it goes on smoothly below square = 0, where noise
    may drive it.
    """
    angle = 2.0 * np.pi * np.sqrt(abs(square)) * depth
    wave = np.cos(angle) if square >= 0 else np.cosh(np.minimum(np.abs(angle), 5.0))
    return np.asarray(0.5 + 0.5 * wave if bright else 0.5 - 0.5 * wave)
