r"""Fringe order of one monochrome frame without a model of the specimen.

Patches of the frame are fitted by quadratics of the order, their signs and whole numbers settled
between neighbours, and what is left, one sign and one whole number for each connected part, is
taken from where the user knows the order (`[[frames.known_order]]`, `[[frames.known_line]]`,
corners of a `[[frames.free_boundary]]`). A part without any is left unknown: no light can tell its
whole number. Pixels are then the mean of the patches about them; where those disagree, as beside an
isotropic point or where fringes are finer than a patch can follow, the pixel is masked. What blur
and a wide band take of the fringes' contrast is found from the frame (`contrast`), and bodies that
masked pixels keep apart are parts apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from isochrome.errors import InputError
from isochrome.fringes.on_branch import LARGEST_UNCERTAINTY, OrderReading, less_sure, make_reading
from isochrome.fringes.single_frame.contrast import (
    FADED,
    contrast_map,
    everywhere,
    fit_contrast,
    is_faded,
    with_told,
)
from isochrome.fringes.single_frame.known_points import (
    APART,
    Anchored,
    anchor_parts,
    clearly_apart,
    part_near,
)
from isochrome.fringes.single_frame.patch_labels import (
    Labels,
    expected_terms,
    label_patches,
    nearest_patches,
)
from isochrome.fringes.single_frame.patches import (
    HALF,
    TURN,
    Patches,
    basis,
    binned,
    bodies_of,
    fit_patches,
    gather_patches,
    middles,
    offsets,
)
from isochrome.fringes.single_frame.sign_ambiguity import mend_mirrored
from isochrome.fringes.single_frame.stated_orders import (
    KnownOrders,
    KnownPlaces,
    KnownPoint,
    corner_orders,
    known_orders,
)
from isochrome.fringes.stray_light import stray_error
from isochrome.fringes.windows import Array, Mask, innermost
from isochrome.messages import message
from isochrome.scene import FreeCorner

_BINNINGS = (4, 2, 1)
_LEAST_PIXELS = 7 * (2 * HALF + 1) // 2
"""Pixels, after binning, of the shorter side of a frame: three patches and a half without overlap.
"""
_LEAST_COVER = 0.15
_CONTRAST_ROUNDS, _MOSTLY = 4, 98.0
"""Readings at most with a contrast found from the last, and per cent of the frame that must rest.
"""
_LARGEST_SPREAD = 0.03
_GROUND = 1e-3
"""Standard deviation of what a quadratic cannot follow, added to a patch's own, fringes."""
_WORTH_SAYING = 0.01
"""Share of what is read that another light must take away before it is said."""


@dataclass(frozen=True)
class FreeReading:
    """What a frame says without a model.

    Parameters
    ----------
    reading : OrderReading
        The order and how well it is known.
    anchored : float
        Share of what could be followed that hangs together with a known point.
    contrast : ndarray (rows, cols)
        What the fringes have left of their contrast, 1 where nothing is lost to speak of.
    misses : tuple of (row, col, order)
        Known points that were not used.
    said : tuple of str
        Why they were not, what the frame leaves open, and what point would settle it.
    """

    reading: OrderReading
    anchored: float
    contrast: Array = field(repr=False)
    misses: tuple[KnownPoint, ...]
    said: tuple[str, ...] = ()


def read_free(
    wave: Array,
    sigma: Array,
    valid: Mask,
    known: Sequence[KnownPoint | tuple[float, float, float, str]],
    *,
    lines: Sequence[KnownPlaces] = (),
    corners: Sequence[FreeCorner] = (),
    error: Array | None = None,
) -> FreeReading:
    """Read the fringe order of a normalised frame without a model.

    Parameters
    ----------
    wave : ndarray (rows, cols)
        The frame as c = cos 2 pi N.
    sigma : ndarray (rows, cols)
        Noise of that.
    valid : bool ndarray (rows, cols)
        Whether a pixel is trusted.
    known : sequence of (row, col, order) or (row, col, order, extremum)
        Points where the order is known (pixels, fringes); extremum, whether it is the "maximum" or
        the "minimum" of its surroundings.
    lines : sequence of KnownPlaces, optional
        Fringe lines whose order is known.
    corners : sequence of FreeCorner, optional
        Corners of the outline that are free of load. Each part that is wanted needs one of these.
    error : ndarray (rows, cols), optional
        Standard uncertainty of the signal (1 - c)/2 by the ends of the light. From 0.003 on in the
        median a line of N = 0 must be among what is known: in a wrong light it stands for a line of
        N = 1.

    Returns
    -------
    FreeReading
        The order, and what hangs together with the known points.

    Raises
    ------
    InputError
        Where the frame is smaller than a patch.
    """
    if min(wave.shape) <= 2 * HALF:
        raise InputError(
            "frame_pixels_smaller_patch",
            shape=wave.shape[0],
            shape_2=wave.shape[1],
            half=2 * HALF + 1,
        )
    orders = known_orders(known, lines, corners)
    followed, fade = follow_fringes(wave, sigma, valid, orders, error=error)
    result = followed.anchored(orders)
    good = max(1, int((followed.labels.part >= 0).sum()))
    anchored = float(np.isfinite(result.terms[..., 0]).sum() / good)
    dense = _dense(followed.patches, result.terms, valid)
    reading = _beside_stray(dense, followed.wave, sigma / fade)
    return FreeReading(reading, anchored, fade, result.misses, result.said)


@dataclass(frozen=True, kw_only=True)
class FollowedFringes:
    """What a frame's fringes say before an order is known.

    Parameters
    ----------
    faded : bool
        Whether they have lost contrast, so that what can be followed depends on what was known.
    patches, labels : Patches, Labels
        The frame's patches, and their signs and whole numbers within each part.
    wave : ndarray (rows, cols)
        The light c = cos 2 pi N.
    valid : bool ndarray (rows, cols)
        Whether a pixel is trusted.
    unlit : ndarray (m, n)
        The signal's uncertainty by the ends of the light, at the patches.
    """

    faded: bool
    patches: Patches = field(repr=False)
    labels: Labels = field(repr=False)
    wave: Array = field(repr=False)
    valid: Mask = field(repr=False)
    unlit: Array = field(repr=False)

    def anchored(self, known: KnownOrders) -> Anchored:
        """The signed orders of the patches by what is `known`, and what is to be said."""
        patches, labels, valid = self.patches, self.labels, self.valid
        at_corners, unlit = corner_orders(known.corners, patches, labels, self.wave, valid)
        places = [*known.places, *at_corners]
        result = anchor_parts(patches, labels, places, valid, self.unlit)
        return replace(result, said=(*unlit, *result.said))

    def part_at(self, row: float, col: float, *, on_line: bool = False) -> Mask:
        """The patches (m, n) for which an order at a place speaks; none where it has none."""
        number = part_near(self.patches, self.labels, (row, col), on_line=on_line)
        return np.asarray((self.labels.part == number) & (number >= 0))


def follow_fringes(
    wave: Array, sigma: Array, valid: Mask, known: KnownOrders, *, error: Array | None = None
) -> tuple[FollowedFringes, Array]:
    """Follow the fringes of a normalised frame as far as they can be without a known order.

    Low orders of wide fringes lose next to nothing of their contrast and tell what the others lose:
    where contrast is lost, what is followed grows from them by what is known.

    Parameters
    ----------
    wave, sigma, valid : ndarray (rows, cols)
        As in `read_free`.
    known : KnownOrders
        What is known; it matters where the fringes have lost contrast alone.
    error : ndarray (rows, cols), optional
        As in `read_free`.

    Returns
    -------
    FollowedFringes
        What could be followed.
    ndarray (rows, cols)
        What the fringes have left of their contrast.
    """

    fade = np.ones(wave.shape)
    patches, labels = _coarse_to_fine(wave, sigma, valid)
    faded = is_faded(patches)

    def followed(patches: Patches, labels: Labels, wave: Array) -> FollowedFringes:
        unlit = np.zeros(patches.chi.shape) if error is None else _at(error, patches)
        return FollowedFringes(
            patches=patches, labels=labels, wave=wave, valid=valid, unlit=unlit, faded=faded
        )

    if faded:
        patches, labels = _coarse_to_fine(wave, sigma, valid, faded=True)
        for _ in range(_CONTRAST_ROUNDS):
            result = followed(patches, labels, wave / fade).anchored(known)
            if not np.isfinite(result.terms).any():
                break
            own = replace(patches, contrast=patches.contrast * _at(fade, patches))
            before = fade
            law = fit_contrast(own, result.terms)
            fade = contrast_map(patches, result.terms, law, wave.shape)
            patches, labels = _coarse_to_fine(wave / fade, sigma / fade, valid, faded=True)
            if np.percentile(np.abs(fade - before)[valid], _MOSTLY) < FADED:
                break
    return followed(patches, labels, wave / fade), fade


def _at(image: Array, patches: Patches) -> Array:
    """An image at the patches' middles (m, n)."""
    return image[np.ix_(patches.rows, patches.cols)]


def _beside_stray(reading: OrderReading, wave: Array, sigma: Array) -> OrderReading:
    """A reading as uncertain as light leaves it that is not the fringes', see `stray_light`."""
    read = np.isfinite(reading.order)
    order = np.where(read, reading.order, 0.0)
    weight = np.where(read, 1.0 / sigma, 0.0)
    residual = np.where(read, wave - np.cos(TURN * order), 0.0) * weight
    error = stray_error(residual, -TURN * np.sin(TURN * order) * weight, -2.0 * weight)
    return less_sure(reading, error, LARGEST_UNCERTAINTY)


def _coarse_to_fine(
    wave: Array, sigma: Array, valid: Mask, *, faded: bool = False
) -> tuple[Patches, Labels]:
    """Patches and labels, each binning guiding the next finer one.

    Where the order hardly changes, a small patch on a crest cannot tell on which side of it it
    lies; a patch four times as wide can. Where fringes are too fine for it, binned patches fit
    badly and guide nothing.
    """
    expected: tuple[Array, Array] | None = None
    told: Array | None = None
    binnings = [b for b in _BINNINGS if b == 1 or min(wave.shape) // b >= _LEAST_PIXELS]
    for k, binning in enumerate(binnings):
        frame = binned(wave, sigma, valid, binning)
        contrast = None if told is None or not faded else everywhere(told)
        patches = fit_patches(gather_patches(*frame), expected, contrast, own=faded)
        patches = with_told(patches, binning, told)
        labels = mend_mirrored(patches, label_patches(patches))
        if k + 1 < len(binnings):
            ratio = binning // binnings[k + 1]
            finer = [n // binnings[k + 1] for n in wave.shape]
            rows, cols = ((middles(n) - 0.5 * (ratio - 1)) / ratio for n in finer)
            expected = expected_terms(patches, labels, rows, cols, ratio)
            told = patches.contrast[nearest_patches(patches, rows, cols)]
    return patches, labels


def _dense(patches: Patches, terms: Array, valid: Mask) -> OrderReading:
    """The mean of the patches' orders at each pixel, and how far they agree.

    Equation: u² = max(mean of the patches' u², variance of their orders), since noise alone makes
    patches differ; a patch's u is that of the stated noise, times its chi where that is below 1,
    and not below that of half the patches: the stated noise has a floor, many frames have less.
    """
    use = np.isfinite(terms[..., 0])
    terms = np.where(use[..., None], terms, 0.0)
    usual = np.median(patches.chi[use]) if use.any() else 1.0
    own = patches.spread[..., 0] * np.clip(patches.chi, min(usual, 1.0), 1.0)
    trust = np.where(use, 1.0 / (own**2 + _GROUND**2), 0.0)
    dy, dx, window = offsets()
    orders = np.abs(terms.reshape(-1, 6) @ basis(dy.astype(float), dx.astype(float)).T)
    sums = np.zeros((4, *valid.shape))
    bodies, count = bodies_of(valid)
    for k, (y, x, w) in enumerate(zip(dy, dx, window, strict=True)):
        order = orders[:, k].reshape(trust.shape)
        at = np.ix_(patches.rows + y, patches.cols + x)
        share = w * (use if count == 1 else use & (bodies[at] == patches.body))
        first = share * trust * order
        for total, value in zip(sums, (share * trust, first, first * order, share), strict=True):
            total[at] += value
    weight, first, second, cover = sums
    seen = valid & (cover > _LEAST_COVER * max(float(cover.max()), 1e-9))
    safe = np.where(seen, weight, 1.0)
    mean = first / safe
    spread = np.sqrt(np.maximum(second / safe - mean**2, 0.0))
    uncertainty = np.maximum(np.sqrt(np.where(seen, cover, 1.0) / safe), spread)
    known = seen & (spread < _LARGEST_SPREAD) & (uncertainty < LARGEST_UNCERTAINTY)
    return make_reading(mean, uncertainty, known, of=valid)


def common_reading(readings: Sequence[FreeReading]) -> FreeReading:
    """Keep of readings of one frame what they have in common.

    Without no-load frames several smooth lights may explain a frame alike, and under each of them
    other regions are turned over about a crest. A known order that a reading contradicts speaks
    against its light.

    Equation: u' = (u² + sum d²)^(1/2), d the difference of another reading's order; a pixel of more
    than 0.03 fringe, or that another does not know, is not known.

    Parameters
    ----------
    readings : sequence of FreeReading
        Those of one frame under lights that explain it alike, the best first.

    Returns
    -------
    FreeReading
        The first of those that miss the fewest known points, as uncertain as the others of these
        leave it, and what to say of that.
    """
    fewest = min(len(result.misses) for result in readings)
    best, *others = (result for result in readings if len(result.misses) == fewest)
    orders = [result.reading.order for result in others]
    if not orders:
        return best
    square = np.sum([(best.reading.order - order) ** 2 for order in orders], axis=0)
    error = np.sqrt(np.where(np.isnan(square), np.inf, square))
    reading = less_sure(best.reading, error, LARGEST_UNCERTAINTY)
    said = _of_what_is_lost(best.reading, reading, orders)
    return replace(best, reading=reading, said=(*best.said, *said))


def _of_what_is_lost(before: OrderReading, after: OrderReading, orders: list[Array]) -> list[str]:
    """What to say of pixels that other lights take away."""
    read = np.isfinite(before.order)
    lost = read & ~np.isfinite(after.order)
    share = float(lost.sum() / max(1, int(read.sum())))
    if share < _WORTH_SAYING:
        return []
    said = message("another_smooth_light_explains", share=100.0 * share)
    for order in orders:
        away = np.where(lost, np.abs(order - before.order), np.nan)
        if (away > APART).any():  # else no known order rules either light out
            at = innermost(clearly_apart(away))
            first, second = sorted((float(before.order[at]), float(order[at])))
            said += message(
                "known_order_row_column", at=at[0], at_2=at[1], first=first, second=second
            )
            break
    return [said]
