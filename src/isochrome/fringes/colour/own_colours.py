r"""The light of colour frames from their own colours: nobody measured it, and no order is known.

Every pixel has three signals and one unknown order: two equations are left over a pixel for the
few numbers of the light (`isochrome.fringes.colour.band_model`), the camera's tone curve raw =
light^(1/gamma), the background D, each frame's brightness g and the illumination A, a quadratic
surface a channel times a relief r of all channels:

    raw^gamma = g (D_c + r A_c t_c(N)).

Orders are looked up with a first guess, guided by their neighbours; all numbers are corrected by
least squares with every pixel's order free; orders are looked up again, and so on. What the bands
leave is then given to the table itself (`colour.remaining_light`). The orders' own scale is
the green band's: colours alone cannot give it.
Sources: Golub & Pereyra (1973), SIAM J. Numer. Anal. 10, 413, for the projection; Ajovalasit,
Barone & Petrucci (1995), J. Strain Analysis 30, 29, for the signals.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import map_coordinates

from isochrome.errors import InputError
from isochrome.fringes.colour.band_model import CORRECTED, NUMBERS, SENSOR, band_table
from isochrome.fringes.colour.band_unknowns import ColourShots, Unknowns, in_blocks, unknowns
from isochrome.fringes.colour.colour_branch import choose_orders
from isochrome.fringes.colour.colour_table import STEP, ColourTable
from isochrome.fringes.colour.colour_value import JUMP
from isochrome.fringes.colour.remaining_light import RemainingLight, added_bend, added_relief
from isochrome.fringes.colour.without_references import correction
from isochrome.fringes.windows import Array, Indices, Mask, beside_jumps

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
    found = []
    for numbers, start in STARTS:
        known = unknowns(
            small, numbers, gamma or start, fixed=gamma is not None, bright_field=bright_field
        )
        found.append(_search(known, highest_order))
    best = min(found, key=lambda light: light.cost)
    size = shots.raw.shape[1:3]
    return replace(
        best,
        background=_enlarged(best.background, size),
        illumination=_enlarged(best.illumination, size),
    )


def _enlarged(blocks: Array, size: tuple[int, ...]) -> Array:
    """Values of blocks (rows, cols, 3) on the frame's own pixels, linear in between."""
    places = [(np.arange(n) + 0.5) * m / n - 0.5 for n, m in zip(size, blocks.shape, strict=False)]
    grid = np.meshgrid(*places, indexing="ij")
    return np.stack(
        [map_coordinates(blocks[..., c], grid, order=1, mode="nearest") for c in range(3)], axis=-1
    )


def _search(known: Unknowns, highest_order: float) -> OwnLight:
    """Look orders up and correct the unknowns, in turn."""
    theta, residual, looks = known.start, 0.1, []
    rest = RemainingLight(
        np.zeros((int(highest_order / STEP) + 2, 3)), np.ones(known.shots.raw.shape[1:3])
    )
    table = previous = ColourTable(np.zeros((1, 3)), np.zeros(3))
    covariance = np.zeros((len(theta), len(theta)))
    for turn, trials in enumerate(TRIALS):
        bands, change = band_table(
            theta[:NUMBERS], bright=known.bright_field, highest_order=highest_order
        )
        previous, table = table, rest.bent(bands)
        doubt = min(max(2.0 * residual, _DOUBT[0]), _DOUBT[1])
        looks = [
            _look(known, theta, f, table, change, rest.relief, doubt)
            for f in range(len(known.shots.raw))
        ]
        design, left, along = (
            np.concatenate(parts) for parts in zip(*(look.equations for look in looks), strict=True)
        )
        if len(left) < 300:
            raise InputError(
                "the colours of the frames were not recognised; are they colour frames of fringes "
                "in white light, without a filter?"
            )
        hold = known.hold_at(theta) * (len(left) / trials)
        step, covariance = correction(design, left, along, hold, known.expected - theta)
        covariance = covariance * (len(left) / trials)
        residual = _root(np.minimum(np.concatenate([look.square for look in looks]), 0.04))
        if turn + 1 < len(TRIALS):
            theta = known.bounded(theta + np.clip(step, -_LARGEST_STEP, _LARGEST_STEP))
            rest = _improved(rest, looks, table, turn)
    both = min(len(table.signal), len(previous.signal))
    moved = float(np.abs(table.signal[:both] - previous.signal[:both]).max())
    return _concluded(known, theta, covariance, rest, looks, table, moved)


def _improved(
    rest: RemainingLight, looks: list[_Look], table: ColourTable, turn: int
) -> RemainingLight:
    """The rest with what this round's looks add to it."""
    if turn >= BEND_FROM:
        place, away = (np.concatenate([getattr(k, n) for k in looks]) for n in ("place", "away"))
        rest = replace(rest, bend=rest.bend + added_bend(place, away, table, len(rest.bend)))
    if turn >= RELIEF_FROM:
        sums = np.sum([look.relief for look in looks], axis=0)
        rest = replace(rest, relief=rest.relief * (1.0 + added_relief(sums)))
    return rest


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
    seen = known.seen(theta, frame, relief)
    variance = (seen.noise / seen.contrast) ** 2 + doubt**2
    signal = np.where(seen.usable, (seen.light - seen.background) / seen.contrast, np.nan)
    choice = choose_orders(signal.astype(np.float32), variance.astype(np.float32), table)
    tears = beside_jumps(choice.order, JUMP)
    inside = ~tears & seen.usable.all(axis=-1) & (choice.misfit < _FARTHEST)
    inside &= table.coloured(signal, _COLOURFUL)
    place = table.place(choice.order[inside])
    ideal, slope = table.signal[place], table.slope[place]
    away = signal[inside] - ideal
    readable = np.isfinite(choice.order)
    off = (signal - table.signal[table.place(np.nan_to_num(choice.order))]) ** 2
    square = np.nanmean(off[readable & ~tears], axis=1)
    kept = np.flatnonzero(inside.ravel())
    picked = np.arange(len(kept))
    wanted = max(500, _SAMPLES // len(known.shots.raw))
    if len(kept) > wanted:
        picked = np.random.default_rng(frame).choice(len(kept), wanted, replace=False)
    weight = 1.0 / np.sqrt(variance[inside][picked])
    contrast = seen.contrast[inside][picked]
    design = known.design(theta, frame, kept[picked], seen, ideal[picked], change[place[picked]])
    return _Look(
        equations=(
            (weight / contrast)[..., None] * design,
            weight * away[picked],
            weight * slope[picked],
        ),
        place=place[picked],
        away=away[picked],
        square=square,
        order=choice.order,
        torn=float(np.mean(tears[readable])) if readable.any() else 1.0,
        relief=_relief_sums(inside, ideal, slope, away),
    )


def _relief_sums(inside: Mask, ideal: Array, slope: Array, away: Array) -> Array:
    """A frame's part of what `added_relief` takes (2, rows, cols), of the pixels `inside`."""
    unit = slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 0.3)
    across = ideal - unit * np.sum(unit * ideal, axis=1, keepdims=True)
    sums = np.zeros((2, *inside.shape))
    sums[0][inside] = np.sum(np.clip(away, -_STRANGE, _STRANGE) * across, axis=1)
    sums[1][inside] = np.sum(across**2, axis=1)
    return sums


def _root(square: Array) -> float:
    return float(np.sqrt(np.mean(square)))


def _concluded(
    known: Unknowns,
    theta: Array,
    covariance: Array,
    rest: RemainingLight,
    looks: list[_Look],
    table: ColourTable,
    moved: float,
) -> OwnLight:
    """What the last round has found."""
    square = np.concatenate([look.square for look in looks])
    away = np.concatenate([look.away for look in looks])
    orders = np.concatenate([look.order[np.isfinite(look.order)] for look in looks])
    background, illumination = known.ends(theta)
    gamma = float(np.exp(theta[NUMBERS]))
    start = NUMBERS + 1
    return OwnLight(
        table=ColourTable(table.signal, np.sqrt(_OF_THREE * np.mean(away**2, axis=0))),
        gamma=gamma,
        gamma_uncertainty=gamma * float(np.sqrt(covariance[NUMBERS, NUMBERS])),
        numbers=theta[:NUMBERS],
        brightness=np.exp(theta[start : start + len(looks)]),
        background=np.asarray(background),
        illumination=illumination * rest.relief[..., None],
        residual=_root(np.minimum(square, 0.04)),
        torn=float(np.mean([look.torn for look in looks])),
        strange=float(np.mean(square > _STRANGE**2)),
        bent=_root(rest.bend**2),
        moved=moved,
        highest=float(np.percentile(orders, 99.0)),
    )
