"""Damped descents of many starts side by side, on a few hundred pixels, light eliminated linearly.

For each signal f the light's linear part, I = f Σ a_k B_k + Σ c_k C_k, is eliminated as in
`estimation.least_squares`; here the normal equations of a whole batch of signals are two matrix
products, of f² and f with the bases' products. Kaufman's Jacobian (BIT 15, 1975, 49-57) is that of
`estimation.intensity`, one batch of fields for all differences of all starts. A start that leads
nowhere costs as much as a good one, and no more. Those that have arrived are left out of the batch,
and friction holds the others back: that is why the loop is not `isochrome.estimation.minimise_all`,
whose steps and damping it takes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from isochrome.estimation import MOSTLY, FrameData, damped_steps, next_damping
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.search.coarse_fields import BULK, FRICTION, SHEAR, SLIPPING, Field
from isochrome.scene import Scene
from isochrome.stress import PixelGrid, pixel_grid

_LONGEST = np.array([0.3, 0.2, 0.2, 0.5, 1.0, 0.05, 0.025])
"""Longest step in ln P, Q/P, mu, ln k, in fringes of bulk stress, in widths of the picture."""

_STEP = 1e-3
"""Difference step over the natural change: far above the noise of single precision."""

_STUCK = 1e5
_STEEPEST_FRICTION = 2.0
_RIDGE = 1e-9


class Misfit(NamedTuple):
    """Of m signals: `chi` (m,), residual over noise; coefficients `light` (m, ka), `dark` (m, kc).

    chi is inf where the light's mean over the pixels is negative: another contrast than the
    frame's.
    """

    chi: Array
    light: Array
    dark: Array


class SearchPixels:
    """Pixels of one frame: `data` (n,), `light` (ka, n), `dark` (kc, n), all over the noise."""

    def __init__(
        self,
        frame: FrameData,
        scene: Scene,
        make_field: Callable[[PixelGrid, Mask], Field],
        usable: Mask,
        stride: int,
    ) -> None:
        """Every `stride`-th of the `usable` pixels (rows, cols); see `field_maker`."""
        thin, keep = frame.every(stride), usable[::stride, ::stride]
        weight = 1.0 / thin.sigma[keep]
        self.data = thin.light[keep] * weight
        self.light = np.ascontiguousarray(thin.illumination[:, keep] * weight)
        self.dark = np.ascontiguousarray(thin.background[:, keep] * weight)
        self.field = make_field(pixel_grid(scene, frame.shape).every(stride), keep)
        self.optics = scene_optics(scene)
        self._pairs = list(combinations_with_replacement(range(len(self.light)), 2))
        self._square = np.array([self.light[i] * self.light[j] for i, j in self._pairs]).T.copy()
        cross = self.light[:, None] * np.concatenate((self.dark, self.data[None]))
        self._cross = cross.reshape(-1, self.size).T.copy()
        self._dark_gram, self._dark_right = self.dark @ self.dark.T, self.dark @ self.data
        self._energy = float(self.data @ self.data)

    @property
    def size(self) -> int:
        """Number of pixels n."""
        return self.data.size

    def signal_of(self, theta: Array) -> Array:
        """Polariscope signals (m, n), 0..1, of rows θ (m, 7)."""
        return self.optics.signal(self.field.difference(theta))

    def misfit(self, signal: Array) -> Misfit:
        """How well signals (m, n) explain the pixels, with the best light for each."""
        ka, kc, m = len(self.light), len(self.dark), len(signal)
        square = (signal * signal) @ self._square
        cross = (signal @ self._cross).reshape(m, ka, kc + 1)
        gram = np.empty((m, ka + kc, ka + kc))
        for column, (i, j) in enumerate(self._pairs):
            gram[:, i, j] = gram[:, j, i] = square[:, column]
        gram[:, :ka, ka:] = cross[..., :kc]
        gram[:, ka:, :ka] = cross[..., :kc].swapaxes(1, 2)
        gram[:, ka:, ka:] = self._dark_gram
        diagonal = np.arange(ka + kc)
        gram[:, diagonal, diagonal] *= 1.0 + _RIDGE
        gram[:, diagonal, diagonal] += _RIDGE * self._dark_gram[0, 0]
        right = np.empty((m, ka + kc))
        right[:, :ka], right[:, ka:] = cross[..., kc], self._dark_right
        result = np.linalg.solve(gram, right[..., None])[..., 0]
        cost = np.maximum(self._energy - np.einsum("mk,mk->m", result, right), 0.0)
        bright = result[:, :ka] @ self.light.mean(axis=1) > 0.0
        chi = np.sqrt(cost / max(1, self.size - ka - kc))
        return Misfit(np.where(bright, chi, np.inf), result[:, :ka], result[:, ka:])


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


class Descended(NamedTuple):
    """Where starts led: rows `theta` (m, 7), `chi` (m,); `gain` (m,), mean light over noise.

    `sound` (m,), False where more than a few pixels' light came out negative.
    """

    theta: Array
    chi: Array
    gain: Array
    sound: Mask

    def rows(self, chosen: Any) -> Descended:
        """Some of them, by index."""
        return Descended(*(part[chosen] for part in self))

    def joined(self, other: Descended) -> Descended:
        """These and others."""
        return Descended(*map(np.concatenate, zip(self, other, strict=True)))

    @property
    def order(self) -> NDArray[np.intp]:
        """Indices by rising chi, the sound ones first."""
        return np.lexsort((self.chi, ~self.sound))


def descend(pixels: SearchPixels, starts: Array, space: Space, *, steps: int) -> Descended:
    """Take each start down to its minimum, by a few damped steps.

    Parameters: `pixels`; `starts` (m, 7); `space`, what may move; `steps`, how many are tried.
    Returns Descended, in the order of the starts.
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
        some = Misfit(*(part[moving] for part in here))
        normal, slope = _equations(pixels, theta[moving], signal[moving], some, space)
        diagonal = np.einsum("mjj->mj", normal)
        diagonal += 1e-9 * diagonal.max(axis=1, keepdims=True) + 1e-300
        step = damped_steps(normal, slope, damping[moving])
        trial = theta[moving]
        trial[:, space.free] += np.clip(step, -longest, longest)
        trial = space.allowed(trial)
        tried = pixels.signal_of(trial)
        there = pixels.misfit(tried)
        better = there.chi < here.chi[moving]
        damping[moving] = next_damping(damping[moving], better)
        # a step that changes nothing any more has arrived
        settled = better & (there.chi > (1.0 - 1e-5) * here.chi[moving])
        damping[moving[settled]] = _STUCK
        won = moving[better]
        theta[won], signal[won] = trial[better], tried[better]
        for old, new in zip(here, there, strict=True):
            old[won] = new[better]
    amplitude = here.light @ pixels.light
    sound = np.mean(amplitude <= 0.0, axis=1) <= MOSTLY
    return Descended(theta, here.chi, amplitude.mean(axis=1), sound & np.isfinite(here.chi))


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
