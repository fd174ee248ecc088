r"""Fringe order from a colour frame: three-fringe (RGB) photoelasticity.

In light of several wavelengths each order has a colour of its own, as far as the fringes have
contrast; black in the dark field is N = 0 alone. Each pixel's three signals are compared with a
calibration table; the branch is chosen with the neighbours (`colour.colour_branch`),
never by the nearest colour alone. The value then comes from the pixel's neighbourhood by weighted
least squares over the channels (`isochrome.fringes.colour.colour_value`).
Sources: Ajovalasit, Barone & Petrucci (1995), J. Strain Analysis 30, 29; Quiroga, García-Botella
& Gómez-Pedrero (2002), Applied Optics 41, 3461, for the guidance by neighbours.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from isochrome.errors import InputError
from isochrome.fringes.colour.colour_branch import choose_orders
from isochrome.fringes.colour.colour_table import ColourTable
from isochrome.fringes.colour.colour_value import (
    JUMP,
    ColourSignal,
    ColourValue,
    colour_signal,
    refine_colour,
)
from isochrome.fringes.colour.frame_exposure import FrameExposure
from isochrome.fringes.on_branch import OrderReading, probability
from isochrome.fringes.windows import Array, Mask, beside_jumps, masked

BINNED_FROM = 150_000
"""Pixels of a frame from which on branches are chosen for blocks of 2 x 2 of them."""

LOST = 0.03
"""Share of pixels whose colours are not the table's from which on nothing is read: frames that the
table describes leave 0.6 % at most, a wrong spectrum, response or gamma 5 % on."""

LOST_SPREAD = 0.05
"""The same for a table with a scatter of its own: what the frames it was found from differ in."""

STEEPEST = 0.25
"""Fringes a pixel beyond which a pixel's mixture of colours is no longer of the second order."""

_LARGEST_UNCERTAINTY = 0.03
_LARGEST_DOUBT = 0.02
_LARGEST_RESIDUAL = 0.05
_LARGEST_MISFIT = 2.0
_SMALLEST_ISLAND = 0.002
_LEAST_CONTRAST = (0.04, 0.1)  # of fringes in white, with no-load frames and without
_BELOW_WHITE = 0.25
_FOUND_ENDS = 0.001  # fringes: what a quadratic surface leaves of an illumination
_BLOCK_ERROR = 0.004  # of the table at a block's mean order
_UNLIT_ORDER = 0.045
_UNLIT_PX = 6
_SPREAD = 0.01


@dataclass(frozen=True, kw_only=True)
class ColourReading(OrderReading):
    """An OrderReading of a colour frame, with what it was read from.

    Without a no-load bright frame all pixels count as lit in `kept`.
    """

    signal: Array  # without background and illumination, 1 = full light; NaN = not trusted
    chi: float  # residual over noise where it can be read, 1 where table and frame agree
    misfit: Array  # the same about each pixel
    blind: bool  # illumination or background is from the frame itself
    noise: float  # of the signal, the median
    strange: float  # share of the pixels whose colours are not the table's
    lost: bool  # these are too many: no order is known
    exposure: FrameExposure  # over that of the no-load frames, by the colours


def read_colour(
    light: Array,
    table: ColourTable,
    *,
    sigma: Array | float,
    dark: Array | None = None,
    bright: Array | None = None,
    valid: Mask | None = None,
    specimen: Mask | None = None,
) -> ColourReading:
    """Read the absolute order of a linear colour frame (rows, cols, channels) by its table.

    Not known: fewer than two channels trusted; a branch in doubt by over 2 %; over 0.03 fringe of
    noise; light and table apart by over twice the noise and 0.05 of the table; fringes finer than 4
    pixels, or fading to white; beside a jump; without `bright` and `specimen` wide black places,
    maybe no specimen. Missing no-load frames are found from it. InputError: shapes, no contrast.
    """
    _check(light, table, valid, specimen)
    trusted = np.isfinite(light) if valid is None else valid & np.isfinite(light)
    if specimen is not None:
        trusted = trusted & specimen[..., None]
    shown = colour_signal(light, table, sigma=sigma, dark=dark, bright=bright, valid=trusted)
    factor = 2 if trusted[..., 0].size >= BINNED_FROM else 1
    choice = choose_orders(*_blocks(shown, factor), table)
    return _reading(shown, refine_colour(shown, choice, factor, table), table, specimen)


def _check(light: Array, table: ColourTable, valid: Mask | None, specimen: Mask | None) -> None:
    channels = table.signal.shape[1]
    if light.ndim != 3 or light.shape[2] != channels:
        raise InputError("colour_frame_row_col", channels=channels, shape=light.shape)
    for name, mask, shape in (
        ("valid", valid, light.shape),
        ("specimen", specimen, light.shape[:2]),
    ):
        if mask is not None and mask.shape != shape:
            raise InputError("mask_must_reshape", name=name, shape=mask.shape, shape_2=shape)


def _blocks(shown: ColourSignal, factor: int) -> tuple[Array, Array]:
    """Means of the signal over blocks of pixels, and their variance."""
    if factor == 1:
        return shown.signal, shown.variance
    trusted = np.isfinite(shown.signal)
    count = _sums(trusted.astype(np.float32), factor)
    signal = _sums(np.nan_to_num(shown.signal), factor)
    variance = _sums(np.where(trusted, shown.variance, 0.0), factor)
    some = np.maximum(count, 1.0)
    return np.where(count > 0.0, signal / some, np.nan), np.where(
        count > 0.0, variance / some**2 + _BLOCK_ERROR**2, 1.0
    )


def _sums(values: Array, factor: int) -> Array:
    """Sums (rows, cols, channels) over blocks of pixels, which at the rim hold fewer of them."""
    values = np.pad(values, [*((0, -n % factor) for n in values.shape[:2]), (0, 0)])
    rows, cols, channels = values.shape
    blocks = values.reshape(rows // factor, factor, cols // factor, factor, channels)
    return np.asarray(blocks.sum(axis=(1, 3)))


def _reading(
    shown: ColourSignal, value: ColourValue, table: ColourTable, specimen: Mask | None
) -> ColourReading:
    """What is known of the refined orders, and how well."""
    trusted = np.isfinite(shown.signal)
    variance = shown.order_variance + (_FOUND_ENDS * shown.blind) ** 2
    variance = variance + shown.exposure.order_variance(shown.signal, table, value.order)
    uncertainty = np.sqrt(value.uncertainty**2 + variance)
    readable = (trusted.sum(axis=-1) >= 2) & (np.hypot(*np.gradient(value.order)) < STEEPEST)
    span = max(1.0, float(np.ptp(table.signal)))
    described = (value.misfit < _LARGEST_MISFIT) | (value.residual < _LARGEST_RESIDUAL * span)
    pixels = max(int(np.count_nonzero(readable)), 1)
    strange = float(np.count_nonzero(readable & ~described) / pixels)
    lost = strange >= (LOST if table.spread.max() < _SPREAD else LOST_SPREAD)
    highest = table.highest_of(_LEAST_CONTRAST[shown.blind]) - _BELOW_WHITE
    known = readable & described & value.agreed & (value.order < highest) & (not lost)
    known &= (value.doubt < _LARGEST_DOUBT) & (uncertainty < _LARGEST_UNCERTAINTY)
    if shown.unlit_unknown and specimen is None:  # black places might be no specimen at all
        core = ndimage.distance_transform_edt(value.order < _UNLIT_ORDER) > _UNLIT_PX
        if core.any():
            known &= ndimage.distance_transform_edt(~core) > _UNLIT_PX + 4
    # without what is beside a jump of the order, and pieces too small to be guided
    known &= ~ndimage.binary_dilation(beside_jumps(value.order, JUMP), iterations=2)
    pieces, _ = ndimage.label(known)
    size = np.bincount(pieces.ravel())
    size[0] = 0
    known &= (size >= _SMALLEST_ISLAND * size.sum())[pieces]
    sure = probability(uncertainty) * (1.0 - value.doubt)
    degrees = float(value.degrees[readable].sum(dtype=float))
    body = int(np.count_nonzero(shown.lit if specimen is None else specimen))
    return ColourReading(
        order=masked(value.order, known),
        uncertainty=masked(uncertainty, known),
        confidence=np.where(known, sure, 0.0).astype(np.float32),
        kept=float(np.count_nonzero(known) / max(body, 1)),
        signal=shown.signal,
        chi=float(np.sqrt(value.chi2[readable].sum(dtype=float) / max(degrees, 1.0))),
        misfit=masked(value.misfit, readable),
        blind=shown.blind,
        noise=float(np.sqrt(np.median(shown.variance[trusted]))) if trusted.any() else float("nan"),
        strange=strange,
        lost=lost,
        exposure=shown.exposure,
    )
