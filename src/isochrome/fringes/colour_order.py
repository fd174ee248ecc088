"""Fringe order from a colour frame: three-fringe (RGB) photoelasticity.

In light of several wavelengths each order has a colour of its own, as far as the fringes have
contrast; black in the dark field is N = 0 alone. A channel's light is I_c = D_c + A_c s_c(N), D and
A those of no-load frames, or what the frame itself says of them (`unknown_light`). Each pixel's
three signals are compared with a calibration table; the branch is chosen with the neighbours
(`choose_orders`), never by the nearest colour alone. The value then comes from the neighbourhood:
N = N_branch + d, d = Σ w J r / Σ w J² over a small Gaussian window and all channels, J = ds/dN,
r = y - s(N), repeated, so that curvature of the order over the window does not shift it.
Sources: Ajovalasit, Barone & Petrucci (1995), J. Strain Analysis 30, 29; Quiroga, García-Botella
& Gómez-Pedrero (2002), Applied Optics 41, 3461, for the guidance by neighbours.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import ndimage

from isochrome.errors import InputError
from isochrome.fringes.colour_table import STEP, Choice, ColourTable, choose_orders
from isochrome.fringes.on_branch import (
    LARGEST_MISFIT,
    LARGEST_UNCERTAINTY,
    STEEPEST,
    SURE,
    OrderReading,
    probability,
)
from isochrome.fringes.unknown_light import BLOCKS, FrameExposure, find_frame_light
from isochrome.fringes.windows import (
    DIMMEST,
    LARGEST_CHANGE,
    LIGHT_ERROR,
    MOVES,
    Array,
    Mask,
    beside_jumps,
    block_means,
    expanded,
    gaussian_sum,
    masked,
    nearest_known,
)


def _lit(contrast: Array, valid: Mask) -> Mask:
    """Where there is light; the contrast of a no-load pair is noise where there is none."""
    if not valid.any():
        raise InputError("frame_has_no_pixel")
    used = np.asarray(valid.any(axis=(0, 1)))
    usual = np.full(len(used), np.inf)
    for c in np.flatnonzero(used):
        usual[c] = np.percentile(contrast[..., c][valid[..., c]], 95)
    if not (usual > 0.0).all():
        raise InputError("frame_has_no_contrast_between")
    share = (contrast / usual).sum(axis=-1) / np.count_nonzero(used)
    smooth = ndimage.gaussian_filter(share.astype(np.float32), 1.0, mode="nearest")
    return np.asarray((smooth > DIMMEST) & (share > 0.5 * DIMMEST))


_WINDOW_PX = 1.5
"""Window over which an order is pooled, in pixels or blocks."""
_LARGEST_STEP = 0.1


def _refined(
    start: Array, signal: Array, weight: Array, table: ColourTable
) -> tuple[Array, Array, Array, Array]:
    """Orders as the neighbourhood's colours move them, their last step, table and slope there."""
    order, step = start, np.zeros_like(start)
    for _ in range(MOVES):
        ideal, slope = _look_up(order, table)
        pull = weight * slope
        information = gaussian_sum((pull * slope).sum(axis=-1), _WINDOW_PX) + _LARGEST_STEP**-2
        step = gaussian_sum((pull * (signal - ideal)).sum(axis=-1), _WINDOW_PX) / information
        step = np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
        order = np.clip(order + step, -table.highest, table.highest)
    return order, step, *_look_up(order, table)


def _base(choice: Choice, factor: int, shape: tuple[int, int]) -> tuple[Array, Mask, Array]:
    """A smooth start for the pixels, whether it is to be trusted, and the doubt in its branch."""
    known = np.isfinite(choice.order)
    if not known.any():
        return np.zeros(shape), np.zeros(shape, bool), np.ones(shape)
    filled = nearest_known(choice.order, known)
    middle = ndimage.median_filter(filled, size=5, mode="nearest")
    outliers = known & (np.abs(filled - middle) > LARGEST_CHANGE)
    filled = np.where(outliers, middle, filled)
    smooth = ndimage.gaussian_filter(filled, _WINDOW_PX / factor, mode="nearest")
    count = np.maximum(gaussian_sum(known.astype(float), _WINDOW_PX), 1e-6)
    chi2 = gaussian_sum(np.where(known, choice.misfit, 0.0), _WINDOW_PX) / count
    evidence = gaussian_sum(np.where(known, choice.margin, 0.0), _WINDOW_PX)
    doubt = np.exp(-0.5 * np.clip(evidence / np.maximum(0.5 * chi2, 1.0), 0.0, 200.0))
    inside = np.ix_(*(np.arange(n) // factor for n in shape))
    return expanded(smooth, shape, factor), (known & ~outliers)[inside], doubt[inside]


def _look_up(order: Array, table: ColourTable) -> tuple[Array, Array]:
    """Signal, mixed over the pixel, and slope at orders of either sign (rows, cols, channels)."""
    place = np.minimum(np.abs(order) / STEP, len(table.signal) - 1.001)
    below = place.astype(np.intp)
    share = (place - below)[..., None].astype(np.float32)
    signal, slope = table.signal.astype(np.float32), table.slope.astype(np.float32)
    s = signal[below] + share * (signal[1:] - signal[:-1])[below]
    j = slope[below] + share * (slope[1:] - slope[:-1])[below]
    side = np.where(order < 0.0, np.float32(-1.0), np.float32(1.0))[..., None]
    # a pixel's own width adds |grad N|²/24 d²s/dN² to its signal, the mean over a square; at 0.25
    # fringe a pixel the fourth order is 0.01 of full light
    steepness = sum(step**2 for step in np.gradient(order))
    steepness = np.minimum(ndimage.gaussian_filter(steepness, _WINDOW_PX), STEEPEST**2)
    bend = table.bend.astype(np.float32)[table.place(np.abs(order))]
    return s + steepness[..., None].astype(np.float32) / 24.0 * bend, j * side


def _spread(order: Array, weight: Array, slope: Array, table: ColourTable) -> Array:
    """Standard deviation of the pooled order; about N = 0, where s is even, that of N² counts."""

    def spread(information: Array) -> Array:
        square = gaussian_sum(information, _WINDOW_PX / np.sqrt(2.0))
        return np.sqrt(square) / np.maximum(gaussian_sum(information, _WINDOW_PX), 1e-9)

    plain = spread((weight * slope**2).sum(axis=-1))
    flat = spread((weight * (0.5 * table.bend[0].astype(np.float32)) ** 2).sum(axis=-1))
    return np.where(order**2 < flat, np.minimum(plain, np.sqrt(flat)), plain)


@lru_cache
def _kernel(factor: int) -> tuple[float, float]:
    """Noise of the order over that of one pooling, and the freedom it takes from each pixel. What
    repeated poolings leave of a wave of frequency f is 1 - Π (1 - G_i(f)) of it, G_i the windows'
    transfer. With h the kernel of that, a residual keeps 1 - 2 h(0) + Σ h² of the noise along
    dI/dN."""
    f = np.linspace(0.0, 0.5, 257)[:, None]
    last = np.exp(-(2.0 * np.pi**2 * (f**2 + f.T**2)) * _WINDOW_PX**2)
    smoothing = 1.0 - last * np.sinc(factor * f) * np.sinc(factor * f.T)
    smoothing = smoothing * (1.0 - last) ** MOVES
    gain = np.sqrt(np.mean((1.0 - smoothing) ** 2) / np.mean(last**2))
    return float(gain), float(1.0 - np.mean(smoothing**2))


LOST = 0.04
"""Share of pixels whose colours are not the table's from which on nothing is read: frames that the
table describes leave 0.6 %, or 3 % where loads stand, a wrong spectrum or gamma 5 % on."""
_LARGEST_DOUBT = 0.02
_LARGEST_RESIDUAL = 0.05
_UNLIT_PX = 6


@dataclass(frozen=True, kw_only=True)
class ColourReading(OrderReading):
    """An OrderReading of a colour frame, with what it was read from. Without a no-load bright frame
    all pixels count as lit in `kept`."""

    signal: Array  # without background and illumination, 1 = full light; NaN = not trusted
    chi: float  # residual over noise where it can be read, 1 where table and frame agree
    blind: bool  # illumination or background is from the frame itself
    noise: float  # of the signal, the median
    strange: float  # share of the pixels whose colours are not the table's
    lost: bool  # these are too many: no order is known
    exposure: FrameExposure  # over that of the no-load frames, by the colours


def read_colour(
    light: Array, table: ColourTable,
    *, sigma: Array | float, dark: Array | None = None, bright: Array | None = None,
    valid: Mask | None = None, specimen: Mask | None = None,
) -> ColourReading:  # fmt: skip
    """Read the absolute order of a linear colour frame (rows, cols, channels) by its table. Not
    known: fewer than two channels trusted; a branch in doubt by over 2 %; over 0.03 fringe of
    noise; light and table apart by over twice the noise and 0.05 of the table; fringes finer than 4
    pixels, or fading to white; beside a jump; without `bright` and `specimen` wide black places,
    maybe no specimen. Missing no-load frames are found from it. InputError: no contrast."""
    trusted = np.isfinite(light) if valid is None else valid & np.isfinite(light)
    if specimen is not None:
        trusted = trusted & specimen[..., None]
    noise = np.broadcast_to(np.asarray(sigma, dtype=float), light.shape)
    shown, variance, contrast, order_variance, exposure = find_frame_light(
        light, table, sigma=noise, dark=dark, bright=bright, valid=trusted
    )
    lit = _lit(contrast, trusted)
    shown = np.where(lit[..., None], shown, np.nan).astype(np.float32)
    variance = (variance + table.spread**2 + LIGHT_ERROR**2).astype(np.float32)
    factor = 2 if trusted[..., 0].size >= BLOCKS else 1
    choice = choose_orders(*_blocks(shown, variance, factor), table)
    trusted = np.isfinite(shown)
    start, agreed, doubt = _base(choice, factor, trusted.shape[:2])
    weight = np.where(trusted, 1.0 / variance, 0.0).astype(np.float32)
    signal = np.nan_to_num(shown).astype(np.float32)
    order, step, ideal, slope = _refined(start, signal, weight, table)
    # residual over noise, and its root mean square in full lights, about each pixel
    square = np.where(trusted, signal - ideal, 0.0) ** 2
    count = trusted.sum(axis=-1)
    near = np.maximum(gaussian_sum(count, _WINDOW_PX), 1e-6)
    chi2 = (weight * square).sum(axis=-1)
    residual = np.sqrt(gaussian_sum(square.sum(axis=-1), _WINDOW_PX) / near)
    misfit = np.sqrt(gaussian_sum(chi2, _WINDOW_PX) / near)
    gain, taken = _kernel(factor)
    spread = gain * _spread(order, weight, slope, table) * np.maximum(misfit, 1.0)
    order, noise_off = np.abs(order), np.hypot(spread, step)
    uncertainty = np.sqrt(noise_off**2 + order_variance)
    readable = (count >= 2) & (np.hypot(*np.gradient(order)) < STEEPEST)
    span = max(1.0, float(np.ptp(table.signal)))
    described = (misfit < 2.0) | (residual < _LARGEST_RESIDUAL * span)
    pixels = max(int(np.count_nonzero(readable)), 1)
    strange = float(np.count_nonzero(readable & ~described) / pixels)
    lost = strange >= LOST
    known = readable & described & agreed & (order < table.highest_of(LARGEST_MISFIT)) & (not lost)
    known &= (doubt < _LARGEST_DOUBT) & (uncertainty < LARGEST_UNCERTAINTY)
    # only the frame says where light is: black places might be no specimen at all
    if bright is None and specimen is None:
        core = ndimage.distance_transform_edt(order < SURE) > _UNLIT_PX
        if core.any():
            known &= ndimage.distance_transform_edt(~core) > _UNLIT_PX + 4
    # without what is beside a jump of the order
    known &= ~ndimage.binary_dilation(beside_jumps(order), iterations=2)
    sure = probability(uncertainty) * (1.0 - doubt)
    degrees = float(np.maximum(count - taken, 0.0)[readable].sum(dtype=float))
    body = int(np.count_nonzero(lit if specimen is None else specimen))
    return ColourReading(
        order=masked(order, known), uncertainty=masked(uncertainty, known),
        confidence=np.where(known, sure, 0.0).astype(np.float32),
        kept=float(np.count_nonzero(known) / max(body, 1)), signal=shown,
        chi=float(np.sqrt(chi2[readable].sum(dtype=float) / max(degrees, 1.0))),
        blind=dark is None or bright is None,
        noise=float(np.sqrt(np.median(variance[trusted]))) if trusted.any() else float("nan"),
        strange=strange, lost=lost, exposure=exposure,
    )  # fmt: skip


def _blocks(signal: Array, variance: Array, factor: int) -> tuple[Array, Array]:
    """Means of the signal over blocks of pixels, and their variance."""
    if factor == 1:
        return signal, variance
    trusted = np.isfinite(signal)
    rim = [*((0, -n % factor) for n in signal.shape[:2]), (0, 0)]  # whose blocks hold fewer pixels
    share, signal, variance = (
        block_means(np.pad(part, rim), factor)
        for part in (
            trusted.astype(np.float32),
            np.nan_to_num(signal),
            np.where(trusted, variance, 0.0),
        )
    )
    some, pixels = np.maximum(share, factor**-2.0), np.float32(factor**2)
    variance = np.where(share > 0.0, variance / (some**2 * pixels) + LIGHT_ERROR**2, 1.0)
    return np.where(share > 0.0, signal / some, np.nan), variance
