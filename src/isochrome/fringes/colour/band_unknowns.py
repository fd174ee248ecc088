"""The unknowns of frames in an unknown light, what is expected of them, and their derivatives.

In order: the light's numbers; log gamma; the log brightness of each frame; then, as far as no
no-load frame gives them, the backgrounds of the channels and the surfaces of their illumination.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isochrome.errors import InputError
from isochrome.estimation import channel_light
from isochrome.fringes.colour.band_model import LIKELY, NUMBERS, band_table
from isochrome.fringes.colour.without_references import UNLIKE, spread_out
from isochrome.fringes.windows import Array, Mask, block_means, valid_means

BRIGHTNESS_OFF, GAMMA_OFF, BACKGROUND_OFF, UNEVEN = 0.02, 0.3, 0.005, 0.1
"""Expected deviations: of the frames' brightness, of log gamma, of the background (of full scale)
and of a surface's terms about the frames' own envelope, over its mean. Of the brightness, of
frames exposed alike; it may be any other (`Unknowns.hold_at`)."""

_DARKER = -1.0
"""Log brightness below which a frame is taken for one of low orders, not of a short exposure."""

_GAMMA = NUMBERS
_FRAMES = NUMBERS + 1
_FIXED = 1e-6
_DARKEST = 1e-3
_DIMMEST = 0.02
_LEAST_CONTRAST = 0.01


@dataclass(frozen=True)
class ColourShots:
    """Colour frames (frames, rows, cols, 3) as files hold them, 1 = full scale."""

    raw: Array
    noise: Array  # standard deviation
    valid: Mask
    dark: Array | None = None  # the no-load frame (rows, cols, 3)
    bright: Array | None = None  # the same in the bright field


@dataclass(frozen=True)
class Seen:
    """One frame by the unknowns as they are: `light`, its `noise`, `background`, `contrast` and
    where it is `usable`, (rows, cols, 3) each.
    """

    light: Array
    noise: Array
    background: Array
    contrast: Array
    usable: Mask


@dataclass(frozen=True)
class Unknowns:
    """`shots`; the `surface` terms (6, rows, cols); what is `expected` of the unknowns, the
    normal equations `hold` of that but for the frames' brightness, and where to `start`.
    """

    shots: ColourShots
    surface: Array
    expected: Array
    hold: Array
    start: Array
    bright_field: bool

    def hold_at(self, theta: Array) -> Array:
        """The normal equations of what is expected, by reweighting at `theta`.

        Most cameras keep their exposure, and a few do not: each frame's log brightness b is
        expected to be 0 with the weight 1/(s² + b²), of a Cauchy distribution of the width s.
        """
        frames = np.arange(_FRAMES, _FRAMES + len(self.shots.raw))
        hold = self.hold.copy()
        hold[frames, frames] += 1.0 / (BRIGHTNESS_OFF**2 + theta[frames] ** 2)
        return hold

    @property
    def ends_from(self) -> int:
        """Where the backgrounds, or else the surfaces, begin."""
        return _FRAMES + len(self.shots.raw)

    def ends(self, theta: Array) -> tuple[Array, Array]:
        """Background and illumination (rows, cols, 3) as light."""
        gamma, start = float(np.exp(theta[_GAMMA])), self.ends_from
        dark, bright = self.shots.dark, self.shots.bright
        if dark is None:
            background = np.broadcast_to(theta[start : start + 3], self.shots.raw.shape[1:])
            start += 3
        else:
            background = dark**gamma
        if bright is not None:
            return background, bright**gamma - background
        shape = theta[start:].reshape(3, len(self.surface))
        return background, spread_out(shape, self.surface)

    def seen(self, theta: Array, frame: int, relief: Array) -> Seen:
        """One frame's light, with the contrast that it would have at full signal."""
        gamma = float(np.exp(theta[_GAMMA]))
        background, illumination = self.ends(theta)
        exposure = np.exp(theta[_FRAMES + frame])
        background = exposure * background
        contrast = exposure * illumination * relief[..., None]
        raw, valid = self.shots.raw[frame], self.shots.valid[frame]
        usable = valid & (contrast > 0.0)
        light = np.where(usable, np.maximum(raw, 0.0), 0.0)
        noise = gamma * np.maximum(light, _DIMMEST) ** (gamma - 1.0) * self.shots.noise[frame]
        return Seen(light**gamma, noise, background, np.where(usable, contrast, 1.0), usable)

    def design(
        self, theta: Array, frame: int, pixels: Array, seen: Seen, ideal: Array, change: Array
    ) -> Array:
        """Derivatives (pixels, 3, unknowns) of the model's light, less those of the frame's.

        Parameters: `pixels`, places in the frame; `seen`; `ideal` signals (pixels, 3), and their
        `change` by the light's numbers (pixels, 3, 11).
        """
        gamma, shots = float(np.exp(theta[_GAMMA])), self.shots
        contrast = seen.contrast.reshape(-1, 3)[pixels]
        design = np.zeros((len(pixels), 3, len(theta)))
        design[..., :NUMBERS] = contrast[..., None] * change
        exposure = np.exp(theta[_FRAMES + frame])
        share = exposure * (np.ones_like(ideal) if shots.bright is None else 1.0 - ideal)
        design[..., _GAMMA] = -_by_gamma(shots.raw[frame].reshape(-1, 3)[pixels], gamma)
        for end, part in ((shots.dark, share), (shots.bright, exposure * ideal)):
            if end is not None:
                design[..., _GAMMA] += part * _by_gamma(end.reshape(-1, 3)[pixels], gamma)
        low = seen.background.reshape(-1, 3)[pixels]
        design[..., _FRAMES + frame] = low + contrast * ideal
        start = self.ends_from
        if shots.dark is None:
            design[:, np.arange(3), start + np.arange(3)] = share
            start += 3
        if shots.bright is None:
            terms = self.surface.reshape(len(self.surface), -1)[:, pixels].T
            _, plain = self.ends(theta)
            gain = contrast / plain.reshape(-1, 3)[pixels]
            count = len(self.surface)
            for c in range(3):
                here = slice(start + c * count, start + (c + 1) * count)
                design[:, c, here] = (gain * ideal)[:, c, None] * terms
        return design

    def bounded(self, theta: Array) -> Array:
        """The unknowns, no background of them below no light."""
        if self.shots.dark is None:
            here = slice(self.ends_from, self.ends_from + 3)
            theta[here] = np.maximum(theta[here], 0.0)
        return theta


def _by_gamma(raw: Array, gamma: float) -> Array:
    """d raw^gamma / d log gamma."""
    level = np.maximum(raw, _DARKEST)
    return np.asarray(gamma * level**gamma * np.log(level))


def in_blocks(shots: ColourShots, blocks: int) -> ColourShots:
    """Means over so many pixels that `blocks` of them remain at most, of all frames."""
    factor = int(np.ceil(np.sqrt(shots.raw[..., 0].size / blocks)))
    if factor == 1:
        return shots

    valid = np.stack([block_means(v.astype(float), factor) > 0.5 for v in shots.valid])
    raw, noise = (
        np.stack([valid_means(*pair, factor) for pair in zip(part, shots.valid, strict=True)])
        for part in (shots.raw, shots.noise)
    )
    dark, bright = (
        None if end is None else valid_means(end, np.isfinite(end), factor)
        for end in (shots.dark, shots.bright)
    )
    return ColourShots(raw, noise / factor, valid, dark, bright)


def unknowns(
    shots: ColourShots, numbers: Array, gamma: float, *, fixed: bool, bright_field: bool
) -> Unknowns:
    """The unknowns' first guess, and what is expected of them.

    Parameters: `shots`; `numbers` of the light and `gamma` to start from, `fixed` where the gamma
    is given; `bright_field`. Returns Unknowns. Raises InputError where nothing has contrast.
    """
    light = np.where(shots.valid, np.maximum(shots.raw, 0.0), np.nan) ** gamma
    if not np.isfinite(light).any(axis=(0, 1, 2)).all():
        raise InputError(
            "a channel is saturated or masked in all frames; lower the exposure, or correct the "
            "mask"
        )
    low, high = np.nanpercentile(light, (0.5, 99.5), axis=(0, 1, 2))
    if not (high - low > _LEAST_CONTRAST).all():
        raise InputError(
            "the frames show no fringes to find the light by; load the specimen until its orders "
            "pass 1 at least"
        )
    frames = len(light)
    brightness, standard = _brightness(light, shots, gamma)
    light = light / np.exp(brightness)[:, None, None, None]
    parts = [numbers, np.array([np.log(gamma)]), np.zeros(frames)]
    off = [LIKELY, np.array([_FIXED if fixed else GAMMA_OFF]), np.full(frames, np.inf)]
    if shots.bright is None:
        off[-1][standard] = _FIXED  # whose light is the illumination
    if shots.dark is None:
        parts.append(low)
        off.append(np.full(3, BACKGROUND_OFF))
    surface = channel_light(*light.shape[1:3])
    if shots.bright is None:
        ideal = band_table(numbers, bright=bright_field, highest_order=3.0)[0].signal
        shape = _envelope(light, surface) / ideal.max(axis=0)[:, None]
        parts.append(shape.ravel())
        off.append(np.repeat(UNEVEN * np.abs(shape[:, 0]), len(surface)))
    expected = np.concatenate(parts)
    hold = np.diag(np.concatenate(off) ** -2.0)
    if shots.bright is None:
        _hold_alike(hold, shape)
    start = expected.copy()
    start[_FRAMES : _FRAMES + frames] = brightness
    return Unknowns(shots, surface, expected, hold, start, bright_field)


def _brightness(light: Array, shots: ColourShots, gamma: float) -> tuple[Array, int]:
    """Log of each frame's brightness (frames,) by its brightest places, and the brightest one.

    Over that of the no-load frame where there is one, else over the brightest frame's: frames of
    a fringe or more reach nearly full light all alike. One that is darker than exposures differ
    shows low orders.
    """
    top = np.nanpercentile(np.nansum(light, axis=-1), 99.0, axis=(1, 2))
    full = top.max()
    if shots.bright is not None:
        full = np.percentile(np.nansum(shots.bright**gamma, axis=-1), 90.0)
    ratio = np.log(np.maximum(top, 1e-3 * full) / full)
    return np.where(ratio < _DARKER, 0.0, ratio), int(np.argmax(top))


def _envelope(light: Array, surface: Array) -> Array:
    """Coefficients (3, terms) of surfaces above nine tenths of the brightest of all frames.

    By weights repeated until the sum of unequally weighed distances is least.
    Source: Koenker & Bassett (1978), Econometrica 46, 33.
    """
    found = np.empty((3, len(surface)))
    seen: Mask = np.asarray(np.isfinite(light).any(axis=0))
    top = np.where(np.isfinite(light), light, -1.0).max(axis=0)
    for c in range(3):
        design, value = surface[:, seen[..., c]].T, top[..., c][seen[..., c]]
        weight = np.ones(len(value))
        for _ in range(30):
            scaled = design * weight[:, None]
            found[c] = np.linalg.solve(design.T @ scaled, scaled.T @ value)
            off = value - design @ found[c]
            weight = np.where(off > 0.0, 0.9, 0.1) / np.maximum(np.abs(off), 0.02 * value.max())
    return found


def _hold_alike(hold: Array, shape: Array) -> None:
    """Expect the channels' surfaces to be alike in form; added to `hold`, whose last they are.

    Parameters: `hold`; `shape`, the surfaces' coefficients (3, terms).
    """
    size, terms = shape[:, 0], shape.shape[1]
    unit = np.eye(len(hold))[-shape.size :]
    for c in range(2):
        for here in range(c * terms + 1, (c + 1) * terms):
            row = unit[here] / (UNLIKE * size[c]) - unit[here + terms] / (UNLIKE * size[c + 1])
            hold += np.outer(row, row)
