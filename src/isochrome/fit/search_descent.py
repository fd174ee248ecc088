"""Levenberg-Marquardt descents of many starts side by side, light eliminated linearly.

Kaufman's Jacobian (BIT 15, 1975, 49-57) as in `isochrome.fit.intensity`, one batch of fields for
all differences of all starts. A start that leads nowhere costs as much as a good one, and no more.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.linear import MOSTLY
from isochrome.fit.search_field import BULK, FRICTION, SHEAR, SLIPPING
from isochrome.fit.search_pixels import Misfit, SearchPixels

Array = NDArray[Any]

_LONGEST = np.array([0.3, 0.2, 0.2, 0.5, 1.0, 0.05, 0.025])
"""Longest step in ln P, Q/P, mu, ln k, in fringes of bulk stress, in widths of the picture."""

_STEP = 1e-3
"""Difference step over the natural change: far above the noise of single precision."""

_STUCK = 1e5
_STEEPEST_FRICTION = 2.0


@dataclass(frozen=True)
class Space:
    """What may move in a row θ: indices `free` (p,); `held`, whether shear is below friction's.

    `size` (7,), a natural change of each: 1, one fringe of bulk stress, the picture's width.
    """

    free: NDArray[np.intp]
    size: Array
    held: bool

    def allowed(self, theta: Array) -> Array:
        """Rows θ (m, 7) brought back to where friction holds them."""
        theta[:, FRICTION] = np.clip(theta[:, FRICTION], -_STEEPEST_FRICTION, _STEEPEST_FRICTION)
        if self.held:
            friction = np.abs(theta[:, FRICTION])
            if FRICTION in self.free:
                friction = np.maximum(friction, np.abs(theta[:, SHEAR]) / SLIPPING)
                theta[:, FRICTION] = friction
            theta[:, SHEAR] = np.clip(theta[:, SHEAR], -SLIPPING * friction, SLIPPING * friction)
        return theta


@dataclass(frozen=True)
class Descended:
    """Where starts led: rows `theta` (m, 7), `chi` (m,); `gain` (m,), mean light over noise.

    `sound` (m,), False where more than a few pixels' light came out negative.
    """

    theta: Array
    chi: Array
    gain: Array
    sound: NDArray[np.bool_]

    def rows(self, chosen: Any) -> Descended:
        """Some of them, by index."""
        return Descended(
            self.theta[chosen], self.chi[chosen], self.gain[chosen], self.sound[chosen]
        )

    def joined(self, other: Descended) -> Descended:
        """These and others."""
        return Descended(
            np.concatenate((self.theta, other.theta)),
            np.concatenate((self.chi, other.chi)),
            np.concatenate((self.gain, other.gain)),
            np.concatenate((self.sound, other.sound)),
        )

    @property
    def order(self) -> NDArray[np.intp]:
        """Indices by rising chi, the sound ones first."""
        return np.lexsort((self.chi, ~self.sound))


def descend(pixels: SearchPixels, starts: Array, space: Space, *, steps: int) -> Descended:
    """Take each start down to its minimum, by a few damped Gauss-Newton steps.

    Parameters: `pixels`; `starts` (m, 7); `space`, what may move; `steps`, how many are tried.
    Returns Descended, in the order of the starts. Sources: Marquardt (1963), J. SIAM 11, 431; see
    above.
    """
    theta = space.allowed(starts.copy())
    signal = pixels.signal_of(theta)
    here = pixels.misfit(signal)
    damping = np.full(len(theta), 1e-2)
    longest = (_LONGEST * space.size)[space.free]
    for _ in range(steps if space.free.size else 0):
        moving = np.flatnonzero((damping < _STUCK) & np.isfinite(here.chi))
        if not moving.size:
            break
        normal, slope = _equations(pixels, theta[moving], signal[moving], _of(here, moving), space)
        diagonal = np.einsum("mjj->mj", normal)
        diagonal += damping[moving, None] * diagonal + 1e-9 * diagonal.max(axis=1, keepdims=True)
        diagonal += 1e-300
        step = np.linalg.solve(normal, slope[..., None])[..., 0]
        trial = theta[moving]
        trial[:, space.free] += np.clip(step, -longest, longest)
        trial = space.allowed(trial)
        tried = pixels.signal_of(trial)
        there = pixels.misfit(tried)
        better = there.chi < here.chi[moving]
        damping[moving] *= np.where(better, 0.2, 6.0)
        # a step that changes nothing any more has arrived
        settled = better & (there.chi > (1.0 - 1e-5) * here.chi[moving])
        damping[moving[settled]] = _STUCK
        won = moving[better]
        theta[won], signal[won] = trial[better], tried[better]
        for old, new in zip(
            (here.chi, here.light, here.dark), (there.chi, there.light, there.dark), strict=True
        ):
            old[won] = new[better]
    amplitude = here.light @ pixels.light
    sound = np.mean(amplitude <= 0.0, axis=1) <= MOSTLY
    return Descended(theta, here.chi, amplitude.mean(axis=1), sound & np.isfinite(here.chi))


def _of(misfit: Misfit, rows: Array) -> Misfit:
    return Misfit(misfit.chi[rows], misfit.light[rows], misfit.dark[rows])


def _equations(
    pixels: SearchPixels, theta: Array, signal: Array, here: Misfit, space: Space
) -> tuple[Array, Array]:
    """Normal equations (m, p, p) and gradient (m, p) of rows θ, light eliminated."""
    amplitude = here.light @ pixels.light
    moved = np.repeat(theta[:, None], space.free.size, axis=1)
    count = np.arange(space.free.size)
    change = _STEP * space.size[space.free]
    # inwards, where friction holds the shear
    inwards = np.where(space.free == FRICTION, -1.0, 1.0) if space.held else np.ones(count.size)
    change = np.where(theta[:, space.free] * inwards > 0.0, -change, change)
    moved[:, count, space.free] += change
    above = pixels.signal_of(moved.reshape(-1, theta.shape[1])).reshape(*moved.shape[:2], -1)
    rows = (above - signal[:, None]) * (amplitude[:, None] / change[..., None])
    residual = pixels.data - amplitude * signal - here.dark @ pixels.dark
    light = signal[:, None] * pixels.light
    dark = np.broadcast_to(pixels.dark, (len(theta), *pixels.dark.shape))
    linear = np.concatenate((light, dark), axis=1)
    gram = linear @ linear.swapaxes(1, 2)
    diagonal = np.einsum("mkk->mk", gram)
    diagonal += 1e-9 * diagonal.max(axis=1, keepdims=True)
    cross = linear @ rows.swapaxes(1, 2)
    normal = rows @ rows.swapaxes(1, 2) - cross.swapaxes(1, 2) @ np.linalg.solve(gram, cross)
    return normal, np.einsum("mpn,mn->mp", rows, residual)


def bulk_hops(theta: Array, space: Space) -> Array:
    """Starts (m, 7) a half and a whole fringe of bulk stress away from rows θ.

    There lie a fringe pattern's nearest rivals: far from the contact bulk stress adds a constant.
    """
    if BULK not in space.free:
        return theta[:0]
    hops = np.array([-1.0, -0.5, 0.5, 1.0]) * space.size[BULK]
    starts = np.repeat(theta, len(hops), axis=0)
    starts[:, BULK] += np.tile(hops, len(theta))
    return starts
