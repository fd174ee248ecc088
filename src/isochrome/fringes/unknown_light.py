"""The unknown light of colour frames: found from their own colours, with what is known beforehand.

Every pixel has three signals and one unknown order: two equations are left over a pixel for the
few numbers of the light: the bands' and the camera's mixing (`band_light`), the camera's tone curve
raw = light^(1/gamma), the background D, each frame's brightness g and the illumination A, a
quadratic surface a channel times a relief r of all channels:

    raw^gamma = g (D_c + r A_c t_c(N)).

What is known, such as a table t of the colours, a gamma, or no-load frames, which are D and D + A,
is no unknown. Orders are looked up with a first guess, guided by their neighbours; all numbers are
corrected by least squares with every pixel's order free (its direction dI/dN is projected out);
orders are looked up again, and so on. A poor guess is allowed for in the misfit that the choice of
orders reckons with. What the bands leave is then given to the table itself (below). The orders' own
scale is the green band's: colours alone cannot give it. Where orders are low all channels go as N²,
and a longer exposure looks like a higher order: g is then as uncertain as the table's own error
makes it, and the order with it. No camera is quite a power and a matrix, and no lamp a quadratic
surface: what is left goes into the table's bend and the illumination's relief, by what the frames
say across the curve of colours; along it a residual is nothing but another order.
Sources: Golub & Pereyra (1973), SIAM J. Numer. Anal. 10, 413, for the projection; Ajovalasit,
Barone & Petrucci (1995), J. Strain Analysis 30, 29, for the signals.
"""

from collections import defaultdict
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from isochrome.errors import InputError
from isochrome.estimation import channel_light
from isochrome.fringes.colour_table import (
    CORRECTED,
    COST_OF_JUMP,
    COST_OF_SLOPE,
    FOUND_ERROR,
    LIKELY,
    NUMBERS,
    SENSOR,
    STEP,
    WIDTH,
    ColourTable,
    band_table,
    choose_orders,
)
from isochrome.fringes.windows import (
    ALIKE,
    DIFFER,
    EXPOSED,
    FAINTEST_LIGHT,
    FEWEST,
    LIGHT_ERROR,
    STRIDE,
    Array,
    Indices,
    Mask,
    beside_jumps,
    block_means,
    nearest_known,
    valid_means,
)

LIGHT_OFF, BACKGROUND_OFF = 0.3, 0.05
"""Expected deviations of log gamma, and of a surface's terms about the frames' own envelope, over
its mean; and of the background (of full scale)."""
UNLIKE = 0.1
"""Expected difference of two channels' surfaces, over their means."""
UNTOLD = 0.1
"""Standard uncertainty of a log brightness from which on a frame does not tell its exposure."""
_DARKER = -1.0
"""Log brightness below which a frame is taken for one of low orders, not of a short exposure."""
_GAMMA = NUMBERS
_FRAMES = NUMBERS + 1
_FIXED = 1e-6


@dataclass(frozen=True)
class ColourShots:
    """Colour frames (frames, rows, cols, 3) as files hold them, 1 = full scale."""

    raw: Array
    noise: Array  # standard deviation
    valid: Mask
    dark: Array | None = None  # the no-load frame (rows, cols, 3)
    bright: Array | None = None  # the same in the bright field
    end_noise: tuple[Array | float, Array | float] = 0.0, 0.0  # theirs, (3,) each


@dataclass(frozen=True, kw_only=True)
class Unknowns:
    """The unknowns of frames, what is `expected` of them, and where to `start`. In order: the
    light's numbers; log gamma; each frame's log brightness; what no no-load frame gives of the
    channels' backgrounds and of the `surface` terms (6, rows, cols). `hold`, the normal equations
    of what is expected but of the brightness; the `table` where it is known."""

    shots: ColourShots
    surface: Array
    table: ColourTable | None
    expected: Array
    hold: Array
    start: Array
    bright_field: bool
    highest_order: float

    @property
    def frames(self) -> slice:
        """Where the frames' brightness stands."""
        return slice(_FRAMES, self.ends_from)

    def hold_of(self, theta: Array | None = None) -> Array:
        """The normal equations of what is expected, by reweighting at `theta`, or of any exposure.
        Most cameras keep theirs, and a few do not: each frame's log brightness b is expected to be
        0 with the weight 1/(s² + b²), of a Cauchy distribution of the width s."""
        off = EXPOSED if theta is None else np.hypot(ALIKE, theta[self.frames])
        hold = self.hold.copy()
        hold[self.frames, self.frames] += np.eye(len(self.shots.raw)) * np.square(off) ** -1.0
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
        terms = theta[start:].reshape(3, len(self.surface))
        return background, np.moveaxis(np.tensordot(terms, self.surface, axes=1), 0, -1)

    def shown(
        self, theta: Array, frame: int, relief: Array | float = 1.0
    ) -> tuple[Array, Array, Array, Array]:
        """One frame's signal (NaN: not usable), noise, variance with no-load frames', contrast."""
        gamma, shots = float(np.exp(theta[_GAMMA])), self.shots
        exposure = np.exp(theta[_FRAMES + frame])
        background, illumination = self.ends(theta)
        background = exposure * background
        contrast = exposure * illumination * np.asarray(relief)[..., None]
        usable = shots.valid[frame] & (contrast > 0.0)
        light = np.where(usable, np.maximum(shots.raw[frame], 0.0), 0.0)
        noise = gamma * np.maximum(light, FAINTEST_LIGHT) ** (gamma - 1.0) * shots.noise[frame]
        contrast = np.where(usable, contrast, 1.0)
        signal = np.where(usable, (light**gamma - background) / contrast, np.nan)
        share = np.clip(np.nan_to_num(signal), 0.0, 1.0)
        # of I - D and B - D
        shares = 1.0 if shots.bright is None else 1.0 - share, share
        both = [exposure * a * b for a, b in zip(shares, shots.end_noise, strict=True)]
        variance = (noise**2 + both[0] ** 2 + both[1] ** 2) / contrast**2
        return signal, noise / contrast, variance, contrast

    def design(
        self, theta: Array, frame: int, at: Array, contrast: Array, ideal: Array, change: Array
    ) -> Array:
        """Derivatives (pixels, 3, unknowns) of the model's light, less the frame's."""
        gamma, shots = float(np.exp(theta[_GAMMA])), self.shots
        design = np.zeros((len(at), 3, len(theta)))
        design[..., :NUMBERS] = contrast[..., None] * change
        exposure = np.exp(theta[_FRAMES + frame])
        share = exposure * (np.ones_like(ideal) if shots.bright is None else 1.0 - ideal)
        design[..., _GAMMA] = -_by_gamma(shots.raw[frame].reshape(-1, 3)[at], gamma)
        for end, part in ((shots.dark, share), (shots.bright, exposure * ideal)):
            if end is not None:
                design[..., _GAMMA] += part * _by_gamma(end.reshape(-1, 3)[at], gamma)
        # of the brightness a background says nothing: a sensor's offset stands in it too
        design[..., _FRAMES + frame] = contrast * ideal
        start = self.ends_from
        if shots.dark is None:
            design[:, np.arange(3), start + np.arange(3)] = share
            start += 3
        if shots.bright is None:
            terms = self.surface.reshape(len(self.surface), -1)[:, at].T
            _, plain = self.ends(theta)
            gain = contrast / plain.reshape(-1, 3)[at]
            for c, here in enumerate(np.split(np.arange(start, design.shape[2]), 3)):
                design[:, c, here] = (gain * ideal)[:, c, None] * terms
        return design


def _by_gamma(raw: Array, gamma: float) -> Array:
    """d raw^gamma / d log gamma."""
    level = np.maximum(raw, FAINTEST_LIGHT)
    return np.asarray(gamma * level**gamma * np.log(level))


def in_blocks(shots: ColourShots, blocks: int) -> ColourShots:
    """Small blocks on a lattice, about so many of all frames, and none that blurs a fringe."""
    size = shots.raw[..., 0].size
    by = 2 if size > 2 * blocks else 1
    every = max(1, round(np.sqrt(size / by**2 / blocks)))
    if by == every == 1:
        return shots

    def means(values: Array, valid: Mask) -> Array:
        return valid_means(values, valid, by)[::every, ::every]

    valid = [block_means(v.astype(float), by)[::every, ::every] > 0.5 for v in shots.valid]
    raw, noise = (
        np.stack([means(*pair) for pair in zip(part, shots.valid, strict=True)])
        for part in (shots.raw, shots.noise)
    )
    ends = shots.dark, shots.bright
    dark, bright = (None if end is None else means(end, np.isfinite(end)) for end in ends)
    end_noise = shots.end_noise[0] / by, shots.end_noise[1] / by
    return ColourShots(raw, noise / by, np.stack(valid), dark, bright, end_noise)


def unknowns(
    shots: ColourShots, light: ColourTable | Array, gamma: float,
    *, fixed: bool, bright_field: bool = False, highest_order: float = 3.0,
) -> Unknowns:  # fmt: skip
    """The unknowns' first guess, from a table or numbers, and what is expected of them."""
    table = light if isinstance(light, ColourTable) else None
    ends = shots.dark is None or shots.bright is None
    shown = np.where(shots.valid, np.maximum(shots.raw, 0.0), np.nan) ** gamma
    if ends and not np.isfinite(shown).any(axis=(0, 1, 2)).all():
        unlit = "channel_saturated_masked_all", "channel_saturated_masked_all_frames"
        raise InputError(unlit[table is None])
    brightness, standard = np.zeros(len(shown)), 0
    if table is None:
        brightness, standard = _brightness(shown, shots, gamma)
    shown = shown / np.exp(brightness)[:, None, None, None]
    if ends:
        low, high = np.nanpercentile(shown, (0.5, 99.5), axis=(0, 1, 2))
        if not (high - low > FAINTEST_LIGHT).all():
            fringeless = "frame_shows_no_fringes_normalise", "frames_show_no_fringes"
            raise InputError(fringeless[table is None])
    frames, numbers = len(shown), SENSOR if isinstance(light, ColourTable) else light
    parts = [numbers, np.array([np.log(gamma)]), np.zeros(frames)]
    off = [LIKELY, np.array([_FIXED if fixed else LIGHT_OFF]), np.full(frames, np.inf)]
    if shots.dark is None:
        parts.append(low)
        off.append(np.full(3, BACKGROUND_OFF))
    surface = channel_light(*shown.shape[1:3])
    if shots.bright is None:
        off[2][standard] = _FIXED  # the frame whose light is the illumination
        ideal = table or band_table(numbers, bright=bright_field, highest_order=3.0)[0]
        shape = np.zeros((3, len(surface)))
        shape[:, 0] = 0.9 * (high - low) / np.ptp(ideal.signal, axis=0)
        parts.append(shape.ravel())
        off.append(np.repeat(LIGHT_OFF * np.abs(shape[:, 0]), len(surface)))
    expected = np.concatenate(parts)
    hold = np.diag(np.concatenate(off) ** -2.0)
    if shots.bright is None:  # the channels' surfaces are alike in form
        over = np.eye(len(hold))[-shape.size :].reshape(*shape.shape, -1)[:, 1:]
        over = over / (UNLIKE * shape[:, :1, None])
        hold += sum(apart.T @ apart for apart in over[:-1] - over[1:])
    start = expected.copy()
    start[_FRAMES : _FRAMES + frames] = brightness
    return Unknowns(
        shots=shots, surface=surface, table=table, expected=expected, hold=hold, start=start,
        bright_field=bright_field, highest_order=highest_order,
    )  # fmt: skip


def _brightness(light: Array, shots: ColourShots, gamma: float) -> tuple[Array, int]:
    """Log of each frame's brightness (frames,) by its brightest places, and the brightest one. Over
    that of the no-load frame where there is one, else over the brightest frame's: frames of a
    fringe or more reach nearly full light all alike. A far darker one shows low orders."""
    top = np.nanpercentile(np.nansum(light, axis=-1), 99.0, axis=(1, 2))
    full = top.max()
    if shots.bright is not None:
        full = np.percentile(np.nansum(shots.bright**gamma, axis=-1), 90.0)
    ratio = np.log(np.maximum(top, 1e-3 * full) / full)
    return np.where(ratio < _DARKER, 0.0, ratio), int(np.argmax(top))


RELIEF_WIDTH = 0.03
"""Window over which the relief is smoothed, over the frame's longer side."""
STRANGE = 0.15
"""What a pixel's colour leaves, of full light, beyond which it is not the table's."""
_LEAST_SLOPE = 0.3
BLOCKS = 150_000
"""Blocks of pixels, of all frames of a light that is not known, that the search works on, about;
and pixels of a frame from which on its branches are chosen for blocks of 2 x 2 of them."""
FRAME_BLOCKS = 2_000
"""The same of one frame in a light whose table is known."""
STARTS = ((SENSOR, 1.0), (CORRECTED, 2.2))
"""Lights and gammas to start from: a bare sensor, and a camera that writes for a display."""
TRIALS = 900.0
"""Independent trials that the pixels are taken to stand for where the table is found with the rest:
neighbours share their errors."""
ROUNDS, UNSMOOTH_FROM = 12, 5
"""Rounds at most, and from which on the illumination's relief and the table's bend are found."""
_LEAST_DOUBT = (LIGHT_ERROR, FOUND_ERROR)
"""How far signals are taken to be off at last, of full light, with a known table and a found one;
at first it is as far as colours are a table's at all, and half as far in each round."""
_REST = 1e-3
_SAMPLES = 16_000
_FITS, _AS_WELL = 4.0, 0.5
"""chi² of a pixel that fits, and by how much less another exposure must leave."""
_LOWEST = 0.15
"""Order below which colours of one hue say nothing of the exposure but through noise."""


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
    moved: float  # the last round's change of the table
    highest: float  # the order that a hundredth of the pixels pass


@dataclass(frozen=True)
class FrameExposure:
    """A frame's exposure over that of its no-load frames."""

    factor: float = 1.0  # 1 where the colours do not speak against it
    uncertainty: float = 0.0  # standard, of its logarithm

    @property
    def told(self) -> bool:
        """Whether the frame's colours tell it."""
        return self.uncertainty < UNTOLD


@dataclass(frozen=True, kw_only=True)
class _State:
    """The frames as some unknowns `theta` show them, by the `table` and the `relief` of these. Of a
    sample of all frames' pixels their numbers in the frame, the equations of `correction`, the rows
    of the table that they are nearest to, and `away`, their signals less the table's. Of all pixels
    `square`, mean square of that, and the chi² `misfit`; `torn`, share of them beside a jump;
    `cost`, -2 ln of the likelihood; `relief_sums` for `added_relief`."""

    theta: Array
    table: ColourTable
    relief: Array
    pixels: Indices
    design: Array
    residual: Array
    along: Array
    weight: Array
    place: Indices
    away: Array
    square: Array
    misfit: Array
    order: Array  # (frames, rows, cols)
    torn: float
    cost: float
    relief_sums: Array

    def correction(self, known: Unknowns, hold: Array) -> tuple[Array, Array]:
        """Change of the unknowns and their covariance, every pixel's order being free."""
        share = len(self.residual) / TRIALS if known.table is None else 1.0
        back = known.expected - self.theta
        flat, residual = (_across(part, self.along) for part in (self.design, self.residual))
        size = np.sum(residual**2, axis=1)
        usual = max(float(np.median(size)), 1e-12) if len(size) else 1.0
        weight = 1.0 / (1.0 + (size / (9.0 * usual)) ** 2)
        normal = np.einsum("p,pcn,pcm->nm", weight, flat, flat, optimize=True) + share * hold
        right = np.einsum("p,pcn,pc->n", weight, flat, residual) + share * hold @ back
        inverse = np.linalg.inv(normal)  # below, the median of chi² with two degrees of freedom
        return inverse @ right, share * max(1.0, usual / np.log(4.0)) * inverse


def find_light(
    shots: ColourShots,
    *, gamma: float | None = None, bright_field: bool = False, highest_order: float = 3.5,
) -> OwnLight:  # fmt: skip
    """Find a light from the colours of frames in it, of any specimens; `gamma` is found where None.
    InputError where no fringes are seen or no colours recognised."""
    small = in_blocks(shots, BLOCKS)
    searches = [
        unknowns(
            small, numbers, gamma or start, fixed=gamma is not None, bright_field=bright_field,
            highest_order=highest_order,
        )
        for numbers, start in STARTS
    ]  # fmt: skip
    ends = [(known, *_search(known)) for known in searches]
    known, best, moved = min(ends, key=lambda end: end[1].cost)
    _, covariance = best.correction(known, known.hold_of())
    fitted, size = float(np.exp(best.theta[_GAMMA])), shots.raw.shape[1:3]
    background, illumination = known.ends(best.theta)
    background, illumination = (  # of the blocks, on the frame's own pixels
        cv2.resize(np.ascontiguousarray(end), size[::-1], interpolation=cv2.INTER_LINEAR)
        for end in (background, illumination * best.relief[..., None])
    )
    return OwnLight(  # each pixel's own order has taken one of its three signals
        table=replace(best.table, spread=np.sqrt(3.0 / 2.0 * np.mean(best.away**2, axis=0))),
        gamma=fitted, gamma_uncertainty=fitted * float(np.sqrt(covariance[_GAMMA, _GAMMA])),
        numbers=best.theta[:NUMBERS], brightness=np.exp(best.theta[known.frames]),
        background=background, illumination=illumination,
        residual=float(np.sqrt(np.mean(np.minimum(best.square, 0.04)))), torn=best.torn,
        strange=float(np.mean(best.square > STRANGE**2)), moved=moved,
        highest=float(np.nanpercentile(best.order, 99.0)),
    )  # fmt: skip


def find_frame_light(
    light: Array, table: ColourTable,
    *, sigma: Array, dark: Array | None, bright: Array | None, valid: Mask,
) -> tuple[Array, Array, Array, Array, FrameExposure]:  # fmt: skip
    """Find what no-load frames do not say of a loaded frame's light: all of it, or its exposure.
    Signal (rows, cols, 3), NaN = not usable, its variance and contrast; the variance (rows, cols),
    fringes², that the light's uncertainty gives to the order. InputError where nothing has
    contrast, or no colour is the table's."""
    of_dark, of_bright = (0.0 if end is None else _noise(end, valid) for end in (dark, bright))
    shots = ColourShots(light[None], sigma[None], valid[None], dark, bright, (of_dark, of_bright))
    known = unknowns(in_blocks(shots, FRAME_BLOCKS), table, 1.0, fixed=True)
    exposure, theta, shape = FrameExposure(), known.start, light.shape[:2]
    if dark is None or bright is None:
        state, _ = _search(known)
        _, covariance = state.correction(known, known.hold)
        theta, variance = state.theta, _order_variance(state, covariance, shape)
    elif np.isfinite(known.shown(theta, 0)[0]).all(axis=-1).sum() < FEWEST:
        exposure, variance = FrameExposure(1.0, EXPOSED), np.full(shape, EXPOSED**2)
    else:
        state, spread = _exposed(known, table)
        covariance = np.zeros((len(theta), len(theta)))
        covariance[_FRAMES, _FRAMES] = spread**2
        theta, variance = state.theta, _order_variance(state, covariance, shape)
        exposure = FrameExposure(float(np.exp(theta[_FRAMES])), spread)
    complete = replace(known, shots=shots, surface=channel_light(*shape))
    signal, _, noise, _ = complete.shown(theta, 0)
    return signal, noise, np.exp(theta[_FRAMES]) * complete.ends(theta)[1], variance, exposure


def _order_variance(state: _State, covariance: Array, shape: tuple[int, ...]) -> Array:
    """What the unknowns' covariance gives to the order of each pixel (rows, cols), fringes²."""
    size = np.sum(state.along**2 + (_LEAST_SLOPE * state.weight) ** 2, axis=1)
    rate = np.einsum("pc,pcn->pn", state.along, state.design) / size[:, None]
    known = np.full(state.order[0].shape, np.nan)
    known.flat[state.pixels] = np.einsum("pn,nm,pm->p", rate, covariance, rate)
    rows, cols = (np.arange(shape[k]) * known.shape[k] // shape[k] for k in (0, 1))
    return np.asarray(nearest_known(known, np.isfinite(known))[np.ix_(rows, cols)])


def _exposed(known: Unknowns, table: ColourTable) -> tuple[_State, float]:
    """A frame at its exposure over that of both its no-load frames, and this one's uncertainty."""
    (alike, _), (best, _) = _search(known, 0.0, 1), _search(known, 0.0)
    misfit = best.misfit
    if misfit.sum() > _FITS * len(misfit):  # no order gives these colours: too far away
        starts = EXPOSED * np.linspace(-3.0, 3.0, 31)
        start = min(starts, key=lambda b: _search(known, b, 1)[0].cost)
        best = min(best, _search(known, start)[0], key=lambda state: state.cost)
    away, spread = float(best.theta[_FRAMES]), _log_spread(best, table)
    as_well = alike.cost - best.cost < _AS_WELL * len(misfit)
    if as_well:  # low orders look like higher ones of a shorter exposure, and these seem to tell it
        spread = max(spread, _log_spread(alike, table))
    if np.nanpercentile(alike.order, 98.0) < _LOWEST:
        return alike, EXPOSED
    same = abs(away) < ALIKE or (as_well and abs(away) < DIFFER * spread)
    return (alike if same else best), spread


def _log_spread(state: _State, table: ColourTable) -> float:
    """Standard uncertainty of a log brightness, with the error that a table's orders share."""
    column = _across(state.design[..., _FRAMES], state.along)
    shared = np.hypot(LIGHT_ERROR, 0.5 * float(table.spread.max()))
    information = float(np.sum(column**2)) + 1e-9
    by_table = shared * float(np.sum(np.abs(column) * state.weight)) / information
    return float((1.0 / (1.0 / information + by_table**2) + EXPOSED**-2) ** -0.5)


def _search(
    known: Unknowns, brightness: float | None = None, rounds: int = ROUNDS
) -> tuple[_State, float]:
    """Look orders up and correct the unknowns, in turn; from a log brightness where ends are known.
    To where that rests, and the table's last change, 1 where it led away from there."""
    theta, least = known.start.copy(), _LEAST_DOUBT[known.table is None]
    doubt = STRANGE
    if brightness is not None:
        doubt, theta[known.frames] = least, brightness
    bend = np.zeros((int(known.highest_order / STEP) + 2, 3))  # added to the bands' table
    relief = np.ones(known.shots.raw.shape[1:3])  # a factor of the illumination
    before: _State | None = None
    for turn in range(rounds):
        state = _state(known, theta, bend, relief, doubt)
        if len(state.place) < FEWEST and brightness is None:
            if before is None or known.table is not None:
                unlike = "frame_colours_not_table", "colours_frames_not_recognised"
                raise InputError(unlike[known.table is None])
            return before, 1.0
        step, _ = state.correction(known, known.hold_of(theta))
        at_rest = known.table is not None and doubt == least and np.abs(step).max() < _REST
        if turn + 1 == rounds or at_rest:
            break
        before, theta = state, theta + np.clip(step, -LIGHT_OFF, LIGHT_OFF)
        doubt = max(0.5 * doubt, least)
        if known.table is None and turn >= UNSMOOTH_FROM:
            bend = bend + added_bend(state, len(bend))
            relief = relief * (1.0 + added_relief(state))
    tables = [each.table.signal for each in (before or state, state)]
    both = min(map(len, tables))
    return state, float(np.abs(tables[0][:both] - tables[1][:both]).max())


def added_bend(state: _State, length: int) -> Array:
    """What pixels add to the bend (length, 3): what they leave at each order, across the curve."""
    table, place = state.table, state.place
    size, width = len(table.signal), WIDTH / STEP
    clipped = np.clip(state.away, -STRANGE, STRANGE).T
    sums = [np.bincount(place, weights=w, minlength=size) for w in (np.ones(len(place)), *clipped)]
    count, *total = gaussian_filter1d(np.array(sums), width, axis=1, mode="constant")
    added = np.zeros((length, 3))
    smooth = gaussian_filter1d(table.slope, 0.5 * width, axis=0)
    added[:size] = _across((np.array(total) / (count + 1.0)).T, smooth, _LEAST_SLOPE)
    return added


def added_relief(state: _State) -> Array:
    """What frames add to the relief, over it: Σ r·a / Σ a·a, rests and signals across the curve."""
    width = RELIEF_WIDTH * max(state.relief.shape)
    smoothed, size = (gaussian_filter(part, width) for part in state.relief_sums)
    return np.asarray(smoothed / (size + 0.01))


def _state(known: Unknowns, theta: Array, bend: Array, relief: Array, doubt: float) -> _State:
    """Look all frames' orders up; `doubt` is how far signals are taken to be off, of full light."""
    table, frames = known.table, len(known.shots.raw)
    if table is None:
        bright, highest = known.bright_field, known.highest_order
        bands, change = band_table(theta[:NUMBERS], bright=bright, highest_order=highest)
        table = replace(bands, signal=np.maximum(bands.signal + bend[: len(bands.signal)], 0.0))
    else:  # no number of the light changes it
        change = np.zeros((*table.signal.shape, NUMBERS))
    looks: dict[str, list[Array]] = defaultdict(list)
    torn, cost, relief_sums = [], [], []
    for frame in range(frames):
        signal, noise, variance, contrast = known.shown(theta, frame, relief)
        variance = variance + doubt**2 + table.spread**2
        choice = choose_orders(signal.astype(np.float32), variance.astype(np.float32), table)
        tears = beside_jumps(choice.order)
        usable = np.isfinite(signal).all(axis=-1)
        inside = ~tears & usable & (choice.misfit < COST_OF_JUMP)
        if table.white is not None:
            inside &= (np.abs(np.nan_to_num(signal) - table.white) > STRANGE).any(axis=-1)
        place = table.place(choice.order[inside])
        ideal, slope = table.signal[place], table.slope[place]
        away = signal[inside] - ideal
        readable = np.isfinite(choice.order)
        off = (signal - table.signal[table.place(np.nan_to_num(choice.order))]) ** 2
        # equations of a sample of the pixels
        selected = np.flatnonzero(inside.ravel())
        picked = np.arange(len(selected))
        wanted = max(500, _SAMPLES // frames)
        if len(selected) > wanted:
            picked = np.random.default_rng(frame).choice(len(selected), wanted, replace=False)
        pixels, weight = selected[picked], 1.0 / np.sqrt(variance[inside][picked])
        full = contrast[inside][picked]
        design = known.design(theta, frame, pixels, full, ideal[picked], change[place[picked]])
        across = _across(ideal, slope, _LEAST_SLOPE)
        sums = np.zeros((2, *inside.shape))
        sums[0][inside] = np.sum(np.clip(away, -STRANGE, STRANGE) * across, axis=1)
        sums[1][inside] = np.sum(across**2, axis=1)
        complete = usable & readable
        misfit = np.minimum(choice.misfit[complete], COST_OF_JUMP)
        # of the two equations a block: else a shorter exposure, with more noise, would fit better
        excess = np.log(variance[complete] / noise[complete] ** 2).mean(axis=-1)
        look = {
            "pixels": pixels, "design": (weight / full)[..., None] * design, "weight": weight,
            "residual": weight * away[picked], "along": weight * slope[picked],
            "place": place[picked], "away": away[picked], "order": choice.order[None],
            "square": np.nanmean(off[readable & ~tears], axis=1), "misfit": misfit,
        }  # fmt: skip
        for name, part in look.items():
            looks[name].append(part)
        torn.append(float(np.mean(tears[readable])) if readable.any() else 1.0)
        changes = (COST_OF_SLOPE * np.abs(np.diff(choice.order, axis=axis)) for axis in (0, 1))
        rough = sum(float(np.nansum(np.minimum(change, COST_OF_JUMP))) for change in changes)
        cost.append(float(misfit.sum()) + 2.0 * float(excess.sum()) + rough)
        relief_sums.append(sums)
    return _State(
        theta=theta, table=table, relief=relief, torn=float(np.mean(torn)), cost=sum(cost),
        relief_sums=np.sum(relief_sums, axis=0),
        **{name: np.concatenate(parts) for name, parts in looks.items()},
    )  # fmt: skip


def _across(part: Array, along: Array, least: float = 1e-9) -> Array:
    """What of parts (pixels, 3, ...) a change of the order does not explain; `along` dI/dN."""
    unit = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), least)
    explained = np.einsum("pc,pc...->p...", unit, part)
    return np.asarray(part - np.einsum("pc,p...->pc...", unit, explained))


def _noise(frame: Array, valid: Mask) -> Array:
    """Noise (channels,) of a no-load frame: fourth differences along every third row, by median."""
    rough = np.abs(np.diff(frame[::STRIDE].astype(np.float32), 4, axis=1))
    inside, estimates = valid[::STRIDE, 2:-2], np.zeros(frame.shape[2])
    for c in range(frame.shape[2]):
        size = rough[..., c][inside[..., c]]
        if size.size:
            # rounding to whole levels makes the median itself a step; the middle half does not
            low, high = np.percentile(size, (25.0, 75.0))
            estimates[c] = (low + high) / (0.3186 + 1.1503) / np.sqrt(70.0)
    return estimates
