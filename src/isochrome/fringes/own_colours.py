"""The light of colour frames from their own colours: nobody measured it, and no order is known.

Every pixel has three signals and one unknown order: two equations are left over a pixel for the
few numbers of the light (below), the camera's tone curve raw =
light^(1/gamma), the background D, each frame's brightness g and the illumination A, a quadratic
surface a channel times a relief r of all channels:

    raw^gamma = g (D_c + r A_c t_c(N)).

Orders are looked up with a first guess, guided by their neighbours; all numbers are corrected by
least squares with every pixel's order free; orders are looked up again, and so on. What the bands
leave is then given to the table itself (below). The orders' own scale is
the green band's: colours alone cannot give it.
Sources: Golub & Pereyra (1973), SIAM J. Numer. Anal. 10, 413, for the projection; Ajovalasit,
Barone & Petrucci (1995), J. Strain Analysis 30, 29, for the signals.

A colour camera's signals against fringe order in a few numbers, for light that nobody measured.

Each channel's light is taken as a band that is Gaussian over the wavelength, and the channels as
mixed by the camera (crosstalk, and the camera's own colour correction, which is negative):

    s_k(N) = ∫ g(e) (1 - cos(2 pi N r_k/(1 + b_k e))) de / 2,   t_c(N) = Σ_k M_ck s_k(N) >= 0

with g the normal distribution, r_k = l0/l_k the ratio of the reference to the band's centre, b_k
its relative width, and the rows of M of sum 1. N counts at the green band's centre: r_green = 1.
Source of the integral over the band: Ajovalasit, Barone & Petrucci (1995), J. Strain Analysis
30, 29.

The unknowns of frames in an unknown light, what is expected of them, and their derivatives.

In order: the light's numbers; log gamma; the log brightness of each frame; then, as far as no
no-load frame gives them, the backgrounds of the channels and the surfaces of their illumination.

What a light of three bands leaves of colour frames: the table's bend, the illumination's relief.

A camera's tone curve and colours are not quite a power and a matrix, and no lamp is a quadratic
surface. Both rests are what the frames say across the curve of colours: along it, a rest is
nothing but another order, and the orders' scale stays the bands'.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d, map_coordinates

from isochrome.errors import InputError
from isochrome.estimation import channel_light
from isochrome.fringes.colour_order import JUMP
from isochrome.fringes.colour_table import STEP, ColourTable, choose_orders, end_of_contrast
from isochrome.fringes.frame_exposure import UNLIKE, correction, spread_out
from isochrome.fringes.windows import Array, Indices, Mask, beside_jumps, block_means, valid_means

GREEN = 1

_PLACES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(48)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
_OFF_DIAGONAL = np.nonzero(~np.eye(3, dtype=bool))

NUMBERS = 11
"""Numbers that describe the light: 2 ratios, 3 widths, 6 terms of the mixing."""

_OWN_CENTRES_NM, _OWN_WIDTH = (600.0, 540.0, 460.0), 0.06
_CORRECTED_CENTRES_NM = (579.5, 540.0, 444.7)
_CORRECTED_WIDTH = (0.063, 0.068, 0.048)
_CORRECTED_MIXING = (-1.51, 0.10, -0.47, -0.15, -0.05, -0.09)
"""Fitted to the sRGB signals of equal-energy light: the CIE 1931 observer in the analytic form of
Wyman, Sloan & Shirley (2013), J. Computer Graphics Techniques 2, 1, and the matrix of IEC
61966-2-1; 0.005 of full light up to N = 4."""


def _numbers(centres: tuple[float, ...], width: Any, mixing: Any) -> Array:
    ratio = np.log(centres[GREEN] / np.array(centres))[[0, 2]]
    return np.concatenate([ratio, np.log(np.broadcast_to(width, 3)), np.broadcast_to(mixing, 6)])


SENSOR = _numbers(_OWN_CENTRES_NM, _OWN_WIDTH, 0.0)
"""Numbers of a bare sensor in equal-energy white light, whose channels do not mix."""

CORRECTED = _numbers(_CORRECTED_CENTRES_NM, _CORRECTED_WIDTH, _CORRECTED_MIXING)
"""Numbers of a camera that corrects its colours for a display (sRGB)."""

LIKELY = np.concatenate([np.full(2, 0.05), np.full(3, 0.4), np.full(6, 0.2)])
"""Expected deviations of a light's numbers from one of these."""

_STEP_OF_NUMBERS = 1e-4
_SCALE_ERROR = 0.02


@dataclass(frozen=True)
class BandLight:
    """The bands of red, green and blue and their mixing.

    `ratio` (3,), reference wavelength over the band's centre; `width` (3,), standard deviation over
    the centre; `mixing` (3, 3), rows of sum 1: what each channel takes from each band.
    """

    ratio: Array
    width: Array
    mixing: Array

    def bands(self, order: Array, *, bright: bool = False) -> Array:
        """Light s (n, 3) of the bands at orders N (n,); `bright`, in the bright field."""
        centres = zip(self.ratio, self.width, strict=True)
        turns = (ratio / np.maximum(1.0 + width * _PLACES, 0.3) for ratio, width in centres)
        waves = [np.cos(2.0 * np.pi * np.outer(order, each)) @ _WEIGHTS for each in turns]
        return np.asarray(0.5 + (0.5 if bright else -0.5) * np.stack(waves, axis=1))


def band_light(numbers: Array) -> BandLight:
    """The light of its numbers (11,): log r of red and blue, log b of red, green and blue, and M.

    M, the mixing, is its six terms off the diagonal, row by row.
    """
    red, blue = np.exp(numbers[:2])
    mixing = np.zeros((3, 3))
    mixing[_OFF_DIAGONAL] = numbers[5:11]
    mixing += np.diag(1.0 - mixing.sum(axis=1))
    return BandLight(np.array([red, 1.0, blue]), np.exp(numbers[2:5]), mixing)


def band_table(numbers: Array, *, bright: bool, highest_order: float) -> tuple[ColourTable, Array]:
    """The table of a light, up to where its last contrast fades, and how it changes.

    Its derivative is by the numbers of `band_light` (orders, 3, 11). What a camera cannot show,
    less than no light, is 0.
    """
    order = STEP * np.arange(int(np.ceil(highest_order / STEP)) + 1)
    light = band_light(numbers)
    bands = light.bands(order, bright=bright)
    plain = bands @ light.mixing.T
    last = end_of_contrast(plain)
    table = np.maximum(plain, 0.0)[:last]
    change = np.zeros((last, 3, NUMBERS))
    for i in range(5):
        step = np.zeros(NUMBERS)
        step[i] = _STEP_OF_NUMBERS
        ahead, behind = (
            band_light(numbers + s).bands(order[:last], bright=bright) for s in (step, -step)
        )
        change[..., i] = (ahead - behind) @ light.mixing.T / (2.0 * _STEP_OF_NUMBERS)
    rows, cols = _OFF_DIAGONAL
    change[:, rows, 5 + np.arange(6)] = bands[:last, cols] - bands[:last, rows]
    change *= (plain[:last] > 0.0)[..., None]
    return ColourTable(table, np.zeros(3)), change


def band_scale(order: Array, signal: Array, *, bright: bool = False) -> float:
    """How much light signals (n, 3) at known orders have over those of a light of three bands.

    Of signals that are known up to one factor: light of any bands is half full on the mean over
    many orders, so that bands and factor are found together.
    """
    from scipy.optimize import least_squares

    def misfit(unknowns: Array, start: Array) -> Array:
        light = band_light(unknowns[:NUMBERS])
        model = light.bands(order, bright=bright) @ light.mixing.T
        away = (signal - np.exp(unknowns[NUMBERS]) * model) / _SCALE_ERROR
        return np.concatenate([away.ravel(), (unknowns[:NUMBERS] - start) / LIKELY])

    top = float(np.log(np.percentile(signal, 98.0)))
    ends = [
        least_squares(misfit, np.append(start, top), args=(start,), max_nfev=40)
        for start in (SENSOR, CORRECTED)
    ]
    return float(np.exp(min(ends, key=lambda end: float(end.cost)).x[NUMBERS]))


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
        return background, spread_out(theta[start:].reshape(3, len(self.surface)), self.surface)

    def seen(self, theta: Array, frame: int, relief: Array) -> tuple[Array, Array, Array, Array]:
        """One frame by the unknowns as they are.

        Its signal, NaN where it is not usable, the noise of that, the background and the contrast
        that the light would have at full signal, (rows, cols, 3) each.
        """
        gamma = float(np.exp(theta[_GAMMA]))
        background, illumination = self.ends(theta)
        exposure = np.exp(theta[_FRAMES + frame])
        background = exposure * background
        contrast = exposure * illumination * relief[..., None]
        raw, valid = self.shots.raw[frame], self.shots.valid[frame]
        usable = valid & (contrast > 0.0)
        light = np.where(usable, np.maximum(raw, 0.0), 0.0)
        noise = gamma * np.maximum(light, _DIMMEST) ** (gamma - 1.0) * self.shots.noise[frame]
        contrast = np.where(usable, contrast, 1.0)
        signal = np.where(usable, (light**gamma - background) / contrast, np.nan)
        return signal, noise / contrast, background, contrast

    def design(
        self, theta: Array, frame: int, at: Array, ends: list[Array], ideal: Array, change: Array
    ) -> Array:
        """Derivatives (pixels, 3, unknowns) of the model's light, less those of the frame's.

        `at` some pixels, of `ideal` signals (pixels, 3), and their `change` by the light's numbers
        (pixels, 3, 11), with the `ends`, the frame's background and contrast there (pixels, 3).
        """
        gamma, shots = float(np.exp(theta[_GAMMA])), self.shots
        background, contrast = ends
        design = np.zeros((len(at), 3, len(theta)))
        design[..., :NUMBERS] = contrast[..., None] * change
        exposure = np.exp(theta[_FRAMES + frame])
        share = exposure * (np.ones_like(ideal) if shots.bright is None else 1.0 - ideal)
        design[..., _GAMMA] = -_by_gamma(shots.raw[frame].reshape(-1, 3)[at], gamma)
        for end, part in ((shots.dark, share), (shots.bright, exposure * ideal)):
            if end is not None:
                design[..., _GAMMA] += part * _by_gamma(end.reshape(-1, 3)[at], gamma)
        design[..., _FRAMES + frame] = background + contrast * ideal
        start = self.ends_from
        if shots.dark is None:
            design[:, np.arange(3), start + np.arange(3)] = share
            start += 3
        if shots.bright is None:
            terms = self.surface.reshape(len(self.surface), -1)[:, at].T
            _, plain = self.ends(theta)
            gain = contrast / plain.reshape(-1, 3)[at]
            count = len(self.surface)
            for c in range(3):
                here = slice(start + c * count, start + (c + 1) * count)
                design[:, c, here] = (gain * ideal)[:, c, None] * terms
        return design


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
    """The unknowns' first guess, and what is expected of them; `fixed` where the gamma is
    given.
    """
    light = np.where(shots.valid, np.maximum(shots.raw, 0.0), np.nan) ** gamma
    if not np.isfinite(light).any(axis=(0, 1, 2)).all():
        raise InputError("channel_saturated_masked_all_frames")
    low, high = np.nanpercentile(light, (0.5, 99.5), axis=(0, 1, 2))
    if not (high - low > _LEAST_CONTRAST).all():
        raise InputError("frames_show_no_fringes")
    frames = len(light)
    brightness, standard = _brightness(light, shots, gamma)
    light = light / np.exp(brightness)[:, None, None, None]
    parts = [numbers, np.array([np.log(gamma)]), np.zeros(frames)]
    off = [LIKELY, np.array([_FIXED if fixed else GAMMA_OFF]), np.full(frames, np.inf)]
    if shots.dark is None:
        parts.append(low)
        off.append(np.full(3, BACKGROUND_OFF))
    surface = channel_light(*light.shape[1:3])
    if shots.bright is None:
        off[2][standard] = _FIXED  # the frame whose light is the illumination
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
    bands = np.empty((3, len(surface)))
    lit: Mask = np.asarray(np.isfinite(light).any(axis=0))
    top = np.where(np.isfinite(light), light, -1.0).max(axis=0)
    for c in range(3):
        design, value = surface[:, lit[..., c]].T, top[..., c][lit[..., c]]
        weight = np.ones(len(value))
        for _ in range(30):
            scaled = design * weight[:, None]
            bands[c] = np.linalg.solve(design.T @ scaled, scaled.T @ value)
            off = value - design @ bands[c]
            weight = np.where(off > 0.0, 0.9, 0.1) / np.maximum(np.abs(off), 0.02 * value.max())
    return bands


def _hold_alike(hold: Array, shape: Array) -> None:
    """Expect the channels' surfaces, whose coefficients (3, terms) end `hold`, to be alike
    in form.
    """
    size, terms = shape[:, 0], shape.shape[1]
    unit = np.eye(len(hold))[-shape.size :]
    for c in range(2):
        for here in range(c * terms + 1, (c + 1) * terms):
            row = unit[here] / (UNLIKE * size[c]) - unit[here + terms] / (UNLIKE * size[c + 1])
            hold += np.outer(row, row)


BEND_WIDTH = 0.04
"""Fringes over which the bend is smoothed, standard deviation."""

RELIEF_WIDTH = 0.03
"""The same of the relief, over the frame's longer side."""

_GAIN = 0.7
_LARGEST = 0.15
_LEAST_SLOPE = 0.3


def added_bend(place: Indices, away: Array, table: ColourTable, length: int) -> Array:
    """What pixels (n,), rows of the table, add to the bend (length, 3): their mean rest at each
    order, across the curve. `away` (n, 3), signals less the table's.
    """
    size, width = len(table.signal), BEND_WIDTH / STEP
    clipped = np.clip(away, -_LARGEST, _LARGEST).T
    sums = [np.bincount(place, weights=w, minlength=size) for w in (np.ones(len(place)), *clipped)]
    count, *total = gaussian_filter1d(np.array(sums), width, axis=1, mode="constant")
    mean = (np.array(total) / (count + 1.0)).T
    unit = gaussian_filter1d(table.slope, 0.5 * width, axis=0)
    unit /= np.maximum(np.linalg.norm(unit, axis=1, keepdims=True), _LEAST_SLOPE)
    added = np.zeros((length, 3))
    added[:size] = _GAIN * (mean - unit * np.sum(unit * mean, axis=1, keepdims=True))
    return added


def added_relief(sums: Array) -> Array:
    """What frames add to the relief, over it, (rows, cols), by the pixels' `sums` (2, rows, cols).

    Σ r·a / Σ a·a over a window and all frames, r the rests and a the signals, both across the curve
    of colours.
    """
    width = RELIEF_WIDTH * max(sums.shape[1:])
    smoothed, size = (gaussian_filter(part, width) for part in sums)
    return np.asarray(_GAIN * smoothed / (size + 0.01))


BLOCKS = 300_000
"""Blocks of pixels, of all frames, that the search works on at most."""

STARTS = ((SENSOR, 1.0), (CORRECTED, 2.2))
"""Lights and gammas to start from: a bare sensor, and a camera that writes for a display."""

TRIALS = (1, 10, 30, 100, 300, *(900,) * 7, *(900,) * 7)
"""Independent trials that a round's pixels are taken to stand for: neighbours share their errors,
and early orders may be wrong in patches."""

RELIEF_FROM, BEND_FROM = 3, 12
"""Rounds from which on the illumination's relief, and the table's bend, are found too."""

_DOUBT = (0.03, 0.15)
_SAMPLES = 16_000
_FARTHEST = 25.0
_COLOURFUL = 0.15
_LARGEST_STEP = 0.3
_TEAR = 0.2
_BENT = 0.3
_STRANGE = 0.15
_OF_THREE = 3.0 / 2.0  # each pixel's own order has taken one of its three signals


@dataclass(frozen=True, kw_only=True)
class OwnLight:
    """What was found of a light from the colours of frames in it, on their own pixels."""

    table: ColourTable  # its spread is what the colours leave of each channel
    gamma: float
    gamma_uncertainty: float  # standard
    numbers: Array  # (11,), see `band_light`
    brightness: Array  # (frames,)
    background: Array  # (rows, cols, 3)
    illumination: Array  # (rows, cols, 3)
    residual: float  # root mean square that the colours leave, of full light
    torn: float  # share of pixels beside a jump of the order
    strange: float  # share of pixels off the table by over 0.15
    bent: float  # root mean square of the table's bend
    moved: float  # the last round's change of the table
    highest: float  # the order that a hundredth of the pixels pass

    @property
    def cost(self) -> float:
        """By which two ends of the search are compared, of full light."""
        return float(np.hypot(self.residual, _TEAR * np.sqrt(self.torn)) + _BENT * self.bent)


@dataclass(frozen=True, kw_only=True)
class _Look:
    """What one frame says: `equations` of some pixels, see `correction`, and what its orders leave.

    `place`, rows of the table that these pixels are nearest to, and `away`, their signals less the
    table's; `square`, mean square of that in each pixel; `order`; `torn`, share of pixels beside a
    jump; `relief`, sums for `added_relief`.
    """

    equations: tuple[Array, Array, Array]
    place: Indices
    away: Array
    square: Array
    order: Array
    torn: float
    relief: Array


def find_light(
    shots: ColourShots,
    *,
    gamma: float | None = None,
    bright_field: bool = False,
    highest_order: float = 3.5,
) -> OwnLight:
    """Find a light from the colours of frames in it, of any specimens; `gamma` is found where None.

    Colours are looked for up to `highest_order`. InputError where no fringes are seen or no colours
    recognised.
    """
    small = in_blocks(shots, BLOCKS)
    looks = []
    for numbers, start in STARTS:
        known = unknowns(
            small, numbers, gamma or start, fixed=gamma is not None, bright_field=bright_field
        )
        looks.append(_search(known, highest_order))
    best = min(looks, key=lambda light: light.cost)
    size = shots.raw.shape[1:3]
    background, illumination = (_enlarged(v, size) for v in (best.background, best.illumination))
    return replace(best, background=background, illumination=illumination)


def _enlarged(blocks: Array, size: tuple[int, ...]) -> Array:
    """Values of blocks (rows, cols, 3) on the frame's own pixels, linear in between."""
    places = [(np.arange(n) + 0.5) * m / n - 0.5 for n, m in zip(size, blocks.shape, strict=False)]
    grid = np.meshgrid(*places, indexing="ij")
    return np.stack(
        [map_coordinates(blocks[..., c], grid, order=1, mode="nearest") for c in range(3)], axis=-1
    )


def _search(known: Unknowns, highest_order: float) -> OwnLight:
    """Look orders up and correct the unknowns, in turn."""
    theta, residual, start = known.start, 0.1, known.ends_from
    backgrounds = slice(start, start + 3 * (known.shots.dark is None))
    bend = np.zeros((int(highest_order / STEP) + 2, 3))  # added to the bands' table
    relief = np.ones(known.shots.raw.shape[1:3])  # a factor of the illumination
    table = ColourTable(np.zeros((1, 3)), np.zeros(3))
    for turn, trials in enumerate(TRIALS):
        bands, change = band_table(
            theta[:NUMBERS], bright=known.bright_field, highest_order=highest_order
        )
        signal = np.maximum(bands.signal + bend[: len(bands.signal)], 0.0)
        previous, table = table, ColourTable(signal, bands.spread)
        doubt = min(max(2.0 * residual, _DOUBT[0]), _DOUBT[1])
        looks = [
            _look(known, theta, f, table, change, relief, doubt)
            for f in range(len(known.shots.raw))
        ]
        design, left, along = (
            np.concatenate(parts) for parts in zip(*(look.equations for look in looks), strict=True)
        )
        if len(left) < 300:
            raise InputError("colours_frames_not_recognised")
        hold = known.hold_at(theta) * (len(left) / trials)
        step, covariance = correction(design, left, along, hold, known.expected - theta)
        covariance = covariance * (len(left) / trials)
        place, away, square = (
            np.concatenate([getattr(look, name) for look in looks])
            for name in ("place", "away", "square")
        )
        residual = _root(np.minimum(square, 0.04))
        if turn + 1 < len(TRIALS):
            theta = theta + np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
            theta[backgrounds] = np.maximum(theta[backgrounds], 0.0)  # not below no light
            if turn >= BEND_FROM:
                bend = bend + added_bend(place, away, table, len(bend))
            if turn >= RELIEF_FROM:
                relief = relief * (1.0 + added_relief(np.sum([k.relief for k in looks], axis=0)))
    both = min(len(table.signal), len(previous.signal))
    moved = float(np.abs(table.signal[:both] - previous.signal[:both]).max())
    orders = np.concatenate([look.order[np.isfinite(look.order)] for look in looks])
    background, illumination = known.ends(theta)
    gamma = float(np.exp(theta[_GAMMA]))
    return OwnLight(
        table=ColourTable(table.signal, np.sqrt(_OF_THREE * np.mean(away**2, axis=0))), gamma=gamma,
        gamma_uncertainty=gamma * float(np.sqrt(covariance[_GAMMA, _GAMMA])),
        numbers=theta[:NUMBERS], brightness=np.exp(theta[_FRAMES : _FRAMES + len(looks)]),
        background=np.asarray(background), illumination=illumination * relief[..., None],
        residual=residual, torn=float(np.mean([look.torn for look in looks])),
        strange=float(np.mean(square > _STRANGE**2)), bent=_root(bend**2), moved=moved,
        highest=float(np.percentile(orders, 99.0)),
    )  # fmt: skip


def _look(
    known: Unknowns,
    theta: Array,
    frame: int,
    table: ColourTable,
    change: Array,
    relief: Array,
    doubt: float,
) -> _Look:
    """Look one frame's orders up, and make equations of a sample of its pixels."""
    signal, noise, *ends = known.seen(theta, frame, relief)
    variance = noise**2 + doubt**2
    choice = choose_orders(signal.astype(np.float32), variance.astype(np.float32), table)
    tears = beside_jumps(choice.order, JUMP)
    inside = ~tears & np.isfinite(signal).all(axis=-1) & (choice.misfit < _FARTHEST)
    inside &= table.coloured(signal, _COLOURFUL)
    place = table.place(choice.order[inside])
    ideal, slope = table.signal[place], table.slope[place]
    away = signal[inside] - ideal
    readable = np.isfinite(choice.order)
    off = (signal - table.signal[table.place(np.nan_to_num(choice.order))]) ** 2
    square = np.nanmean(off[readable & ~tears], axis=1)
    selected = np.flatnonzero(inside.ravel())
    picked = np.arange(len(selected))
    wanted = max(500, _SAMPLES // len(known.shots.raw))
    if len(selected) > wanted:
        picked = np.random.default_rng(frame).choice(len(selected), wanted, replace=False)
    weight = 1.0 / np.sqrt(variance[inside][picked])
    ends = [part[inside][picked] for part in ends]
    pixels = selected[picked]
    design = known.design(theta, frame, pixels, ends, ideal[picked], change[place[picked]])
    equations = (weight / ends[1])[..., None] * design, weight * away[picked]
    unit = slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 0.3)
    across = ideal - unit * np.sum(unit * ideal, axis=1, keepdims=True)
    relief_sums = np.zeros((2, *inside.shape))
    relief_sums[0][inside] = np.sum(np.clip(away, -_STRANGE, _STRANGE) * across, axis=1)
    relief_sums[1][inside] = np.sum(across**2, axis=1)
    return _Look(
        equations=(*equations, weight * slope[picked]), place=place[picked], away=away[picked],
        square=square, order=choice.order, relief=relief_sums,
        torn=float(np.mean(tears[readable])) if readable.any() else 1.0,
    )  # fmt: skip


def _root(square: Array) -> float:
    return float(np.sqrt(np.mean(square)))
