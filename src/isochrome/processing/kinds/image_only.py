"""A frame without a model: normalised, its fringe skeleton, and its order from known points.

A frame's brightest line tells its exposure where it is a fringe of N = 1/2, 3/2, .... Under more
light it would be a ridge of an order below 1/2, and the frame alone cannot tell one from the other:
a dark fringe in it can, or known orders on both sides of a half, or one beside the line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from isochrome import fringes
from isochrome.errors import InputError
from isochrome.frames import (
    Frame,
    Linear,
    Normalised,
    estimate_noise,
    full_scale,
    noise_between_pixels,
    normalise,
    saturation_level,
    to_linear,
)
from isochrome.messages import message
from isochrome.output import with_uncertainty
from isochrome.processing.kinds.kind import FrameKind
from isochrome.processing.kinds.largest_order import LARGEST, order_columns
from isochrome.processing.result import SPREAD, Capture, ProcessedFrame, frame_fields
from isochrome.scene import Frames, Scene

Array = NDArray[Any]
Mask = NDArray[np.bool_]

SAME_EXPOSURE = "fringes_do_not_tell"
CREST_OR_RIDGE = "brightest_line_has_light"
NOT_ALIKE = "fringes_do_not_tell_whether"
_REACH, WORTH_SAYING = 4.0, 0.01
"""How far the unknown background may reach, in its standard uncertainties: to three times as long
an exposure as the bright frame's; and the share of the specimen that is said."""
_POOLED_PX = 3.0
_BEYOND_HALF = fringes.CLEAR**0.5 * fringes.STATED_SPREAD
"""Fringes from a half from which two known orders say one between; half as near, one says it."""

_ToldEnds = tuple[fringes.BackgroundModulation, list[str], str, bool]


def no_load_light(
    light: Array, sigma: Array, valid: Mask, no_load: tuple[Array, Array], frames: Frames
) -> _ToldEnds:
    """The ends of a frame's linear `light` (rows, cols) by the no-load frames, what to say of them,
    why no order can be told, and whether the dark end is known as well as it says."""
    dark, bright = no_load
    alike: _ToldEnds = (fringes.exact_ends(dark, bright), [], "", True)
    if frames.no_load_exposure == "same":
        return alike
    result = fringes.find_no_load_exposure(light, sigma, valid, dark=dark, bright=bright)
    if result.ends is None:
        if result.told:
            return alike
        places = _places(light, valid, no_load, frames)
        if len(places) and np.median(_costs(places)) >= fringes.CLEAR:
            row, col, stated, shown = max(places.tolist(), key=lambda at: abs(at[3] - at[2]))
            off = message(NOT_ALIKE, row=row, col=col, light=shown, stated=stated)
            return alike[0], [], off, True
        return alike[0], [message(SAME_EXPOSURE)], "", True
    if result.crest_sure or says_a_half(frames.stated_orders):
        notes = [message("exposed_times_long_frames", bright=result.bright)]
        return result.ends, notes, "", result.dark_told
    if result.bright < 1.0:
        unexposed, other = (
            float(np.sum(_costs(_places(light, valid, ends, frames))))
            for ends in (no_load, (result.dark * dark, result.bright * bright))
        )
        # known orders are clearly those of the no-load frames
        if unexposed + fringes.CLEAR < other:
            return alike
    return result.ends, [], message(CREST_OR_RIDGE, bright=result.bright), True


def says_a_half(orders: Sequence[float]) -> bool:
    """Whether known orders say that N = 1/2, 3/2, ... is in the frame: by one, or between two."""
    if any(abs(order % 1.0 - 0.5) < 0.5 * _BEYOND_HALF for order in orders):
        return True
    least, most = min(orders, default=0.0), max(orders, default=0.0)
    return bool(most > np.ceil(least + _BEYOND_HALF - 0.5) + 0.5 + _BEYOND_HALF)


def _costs(places: Array) -> Array:
    """How badly the light at known places agrees with their orders, chi² each."""
    off = (places[:, 3] - places[:, 2]) / fringes.STATED_SPREAD
    return np.minimum(off**2, fringes.MOST_COST)


def _places(light: Array, valid: Mask, ends: tuple[Array, Array], frames: Frames) -> Array:
    """The known places (n) that are seen: row, col, distance from a dark fringe as stated, as seen.
    In a light s the order is k ± asin(sqrt s)/pi."""
    dark, bright = ends
    signal = np.where(valid, (light - dark) / np.maximum(bright - dark, 1e-6), 0.0)
    weight = np.maximum(gaussian_filter(valid.astype(float), _POOLED_PX), 1e-6)
    pooled = np.clip(gaussian_filter(signal, _POOLED_PX) / weight, 0.0, 1.0)
    away = np.arcsin(np.sqrt(pooled)) / np.pi
    known = [(float(k.row_px), float(k.col_px), k.order) for k in frames.known_order]
    known += [(*place, line.order) for line in frames.known_line for place in line.places]
    result = []
    for row, col, order in known:
        at = round(row), round(col)
        if all(0 <= i < n for i, n in zip(at, valid.shape, strict=True)) and valid[at]:
            result.append((row, col, abs(order - round(order)), float(away[at])))
    return np.array(result).reshape(-1, 4)


def above_background(signal: Array, error: Array, valid: Mask) -> tuple[Mask, tuple[str, ...]]:
    """Where a brighter background would make no dark fringe, and what to say of the rest. The order
    may go on through a fringe there or turn back, and what lies beyond is a part apart."""
    above = np.where(valid, signal - _REACH * error, 0.0)
    above_noise = valid & (gaussian_filter(above, _POOLED_PX) > 0.0)
    share = 1.0 - float(np.mean(above_noise[valid])) if valid.any() else 0.0
    notes = (message("no_dark_fringe_tells", share=100.0 * share),) if share > WORTH_SAYING else ()
    return above_noise, notes


FEWEST_LINES = 3
"""Fringe lines without which the shape of the light alone, a lamp's as well as a fringe's, would
say where the bright end is."""

LEAST_ORDER = 1.25
"""Highest order below which that is so too, whatever lines the light's own spots add."""
ALMOST_ALL = 99.5
"""Per cent of the pixels, of whose order that is."""

FEW_FRINGES = "least_needed_without_frames"
SIGNIFICANT, WRONG_GAMMA = 5.0, 0.1
"""Of a stated gamma that the fringes contradict: standard uncertainties, and share of its value."""
FLAWS = 0.015
"""What dust, texture and compression add to any frame, over its contrast: a lossy file hides its
noise, and what no smooth order can follow would be taken for fringes lost."""

MOST_SATURATED = 0.03
"""Share of the specimen's pixels: beyond it, without a bright no-load frame, the bright end is cut
out of the picture, and an order beyond a bright crest may be mirrored about it."""


@dataclass(frozen=True, kw_only=True)
class FrameSignal:
    """The fringe signal 0..1 (rows, cols), its noise, where it is trusted, and words; `error`,
    what ends and tone curve leave open besides the noise; `gamma_check`, what the fringes' contrast
    (rows, cols) and shape make of a stated gamma: an error more, and words."""

    signal: Array
    sigma: Array
    valid: Mask
    error: Array
    ends: fringes.BackgroundModulation
    refusal: str = ""
    notes: tuple[str, ...] = ()
    columns: dict[str, Any] = field(default_factory=dict)
    gamma_check: Callable[[Array], tuple[Array, list[str]]] | None = None
    others: tuple[FrameSignal, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ImageOnly(FrameKind):
    """Single frames without a model, whose orders hang together with places of known order."""

    loads: ClassVar[tuple[str, ...]] = ()
    """Columns of a frame's load, where that is read."""

    def read(self, frames: Sequence[Frame], scene: Scene, capture: Capture) -> ProcessedFrame:
        """See `read_alone`."""
        return read_alone(frames[0], scene, capture)[0]

    def values(self, scene: Scene) -> tuple[str, ...]:
        """Fringe lines, and the orders where one is known."""
        gamma = ("gamma", f"gamma {SPREAD}") if scene.frames.gamma == "unknown" else ()
        lines = ("fringe_lines", *gamma, *self.loads)
        return ("kept_share", *lines, *LARGEST) if scene.frames.orders_known else lines


def read_alone(
    frame: Frame, scene: Scene, capture: Capture, *, inside: Mask | None = None
) -> tuple[ProcessedFrame, fringes.BackgroundModulation | None]:
    """Normalise a frame without a model, find its fringe skeleton, and read its order where it
    hangs together with a known one. A frame in which no fringe shows (an unloaded specimen) is kept
    as it is. Besides, the ends of the frame's light, None without any."""
    linear = to_linear(frame, bit_depth=capture.bit_depth, gamma=scene.frames.first_gamma)
    if inside is not None:
        linear = replace(linear, valid=linear.valid & inside)
    blank = ProcessedFrame(
        **frame_fields(frame, scene),
        normalised=np.where(linear.valid, linear.image, np.nan).astype(np.float32),
    )
    signal, lines, refusal = _beforehand(frame, linear, scene, capture, inside=inside)
    if signal is None:
        return replace(blank, warnings=("not normalised: " + refusal,)), None
    result, warnings = None, [refusal]
    if not refusal and not scene.frames.orders_known:
        warnings = [message("no_order_light_alone")]
    elif not refusal:
        result, warnings = _read_signal(signal, scene)
        if signal.others:
            others = (_read_signal(other, scene)[0] for other in signal.others)
            result = fringes.common_reading([result, *others])
        few = refused_low(result.reading.order, capture)
        warnings = [*warnings, *result.said, *([few] if few else [])]
        result = None if few else result
    columns = {"fringe_lines": len(lines)} | signal.columns
    if result:
        columns = {"kept_share": result.reading.kept} | columns
        if np.isfinite(result.reading.order).any():
            columns |= order_columns(result.reading.order, result.reading.uncertainty)
    complete = replace(
        blank, normalised=signal.signal.astype(np.float32), columns=columns, lines=lines,
        reading=result.reading if result else None, warnings=(*signal.notes, *warnings),
        noise=float(np.median(signal.sigma[signal.valid])),
    )  # fmt: skip
    return complete, signal.ends


def _beforehand(
    frame: Frame, linear: Linear, scene: Scene, capture: Capture, *,
    requested: bool = False, inside: Mask | None = None,
) -> tuple[FrameSignal | None, list[fringes.Skeleton], str]:  # fmt: skip
    """A frame's signal, None where no fringe is in it, its lines, and why no order is read in it.
    `requested`, whether one is tried though none is known."""
    try:
        signal = frame_signal(frame, linear, scene, capture)
    except InputError as error:
        return None, [], error.message
    lines, refusal = fringes.skeletons(np.clip(signal.signal, 0.0, 1.0)), signal.refusal
    if capture.bright is None:
        specimen = np.ones(frame.image.shape, dtype=bool)
        for mask in (frame.mask, inside):
            specimen = specimen if mask is None else specimen & mask
        level = saturation_level(frame.image, full=full_scale(capture.bit_depth))
        saturated = float(np.mean(frame.image[specimen] >= level))
        few = len(lines) < FEWEST_LINES and (requested or scene.frames.known_order)
        if saturated > MOST_SATURATED:
            refusal = message("specimen_saturated_no_order", saturated=100.0 * saturated)
        elif few and not refusal:
            value = f"{len(lines)} fringe lines"
            refusal = message(FEW_FRINGES, value=value, fewest_lines=FEWEST_LINES)
    return signal, lines, refusal


def refused_low(order: Array, capture: Capture) -> str:
    """Why orders are too low to be told without a bright no-load frame; empty if they are not."""
    known = order[np.isfinite(order)]
    highest = float(np.percentile(known, ALMOST_ALL)) if known.size else 0.0
    if capture.bright is None and 0.0 < highest < LEAST_ORDER:
        return message(
            FEW_FRINGES, value=f"fringes up to order {highest:.2f}", fewest_lines=LEAST_ORDER
        )
    return ""


def _light(
    frame: Frame, linear: Linear, scene: Scene, capture: Capture
) -> tuple[Array, Array, Mask]:
    """Besides the noise, where light and no-load frames are trusted."""
    bit_depth = capture.bit_depth
    model = estimate_noise(frame.image, linear.valid, bit_depth=bit_depth)
    sigma = model.linear_sigma(frame.image, bit_depth=bit_depth, gamma=scene.frames.first_gamma)
    sigma *= noise_between_pixels(frame.image, linear.valid, model)
    low, high = np.percentile(linear.image[linear.valid], [1.0, 99.0])
    sigma = np.maximum(sigma, FLAWS * (high - low))
    given = [part.valid for part in (capture.dark, capture.bright) if part]
    valid = np.logical_and.reduce([linear.valid, *given])
    return np.where(valid, linear.image, 0.0), sigma, valid


def frame_signal(frame: Frame, linear: Linear, scene: Scene, capture: Capture) -> FrameSignal:
    """Background and illumination out, by no-load frames where there are, else by the fringes."""
    light, sigma, valid = _light(frame, linear, scene, capture)
    dark, bright = (part.image if part else None for part in (capture.dark, capture.bright))
    tone = scene.frames.gamma == "unknown"
    columns: dict[str, Any] = {}
    refusal, dark_told = "", True
    if dark is not None and bright is not None and not tone:
        no_load = no_load_light(light, sigma, valid, (dark, bright), scene.frames)
        ends, notes, refusal, dark_told = no_load
    else:
        ends = fringes.fit_background_modulation(
            light, sigma, valid, dark=dark, bright=bright, tone=tone
        )
        refusal = "" if ends.settled else message("search_light_dark_bright")
        notes = [message("normalised_own_fringes_without")] * (dark is None or bright is None)
        if tone:
            gamma = with_uncertainty(ends.tone, ends.tone_uncertainty)
            notes.append(message("gamma_found_from_fringes", gamma=gamma))
            columns = {"gamma": ends.tone, f"gamma {SPREAD}": ends.tone_uncertainty}
    done, result = _by_ends(light, sigma, valid, ends)
    if not dark_told:
        valid, left_out = above_background(result.signal, result.error, result.valid)
        result, notes = replace(result, valid=valid), [*notes, *left_out]
    others = tuple(_by_ends(light, sigma, valid, other)[1] for other in ends.others)
    # an end that is not known says nothing of the tone, and without a reading nobody asks
    check = None
    if not tone and not refusal and scene.frames.orders_known:
        given = (dark is not None, bright is not None)
        check = partial(_contradicted, light, sigma, done, given, scene.frames.first_gamma)
    known = replace(result, refusal=refusal, notes=tuple(notes), columns=columns)
    return replace(known, gamma_check=check, others=others)


def _by_ends(
    light: Array, sigma: Array, valid: Mask, ends: fringes.BackgroundModulation
) -> tuple[Normalised, FrameSignal]:
    linear = np.maximum(light, 0.0) ** ends.tone
    done = normalise(*(Linear(part, valid) for part in (linear, ends.dark, ends.bright)))
    slope = ends.tone * np.maximum(light, sigma) ** (ends.tone - 1.0)
    signal = FrameSignal(
        signal=done.signal, sigma=slope * sigma / np.where(done.valid, done.contrast, 1.0),
        valid=done.valid, error=ends.signal_uncertainty(light), ends=ends,
    )  # fmt: skip
    return done, signal


def told_exposure(frame: Frame, scene: Scene, capture: Capture) -> list[str]:
    """What a frame's fringes say of its exposure, where it is not that of both no-load frames."""
    dark, bright = capture.dark, capture.bright
    if dark is None or bright is None or scene.frames.gamma == "unknown":
        return []
    linear = to_linear(frame, bit_depth=capture.bit_depth, gamma=scene.frames.first_gamma)
    try:
        _, notes, refusal, _ = no_load_light(
            *_light(frame, linear, scene, capture), (dark.image, bright.image), scene.frames
        )
    except InputError:  # no fringe in it
        return []
    return [text for text in (*notes, refusal) if text and text != message(SAME_EXPOSURE)]


def _contradicted(
    light: Array,
    sigma: Array,
    done: Normalised,
    given: tuple[bool, bool],
    gamma: float,
    contrast: Array,
) -> tuple[Array, list[str]]:
    """What another gamma would make of the signal, where the fringes speak for it; and a warning.
    The fringes' shape is compared with that of a cosine: a wrong tone curve bends it. What blur and
    a band's width took of their `contrast` (rows, cols) is no bend: it draws both ends together."""
    lost = 0.5 * (1.0 - contrast) * done.contrast
    ends = done.background + lost, done.background + done.contrast - lost
    dark, bright = (faded if known else None for known, faded in zip(given, ends, strict=True))
    none = np.zeros(light.shape)
    try:
        away, spread = fringes.gamma_misfit(light, sigma, done.valid, ends)
        if abs(away) < max(SIGNIFICANT * spread, WRONG_GAMMA):
            return none, []
        result = fringes.fit_background_modulation(
            light, sigma, done.valid, dark=dark, bright=bright, tone=True
        )
    except InputError:  # no fringes to tell it from
        return none, []
    if abs(result.tone - 1.0) < max(SIGNIFICANT * result.tone_uncertainty, WRONG_GAMMA):
        return none, []
    linear = np.maximum(light, 0.0) ** result.tone
    other = (linear - result.dark) / np.maximum(result.bright - result.dark, 1e-6)
    other = 0.5 + contrast * (other - 0.5)  # of the signal as it is, faded
    error = np.abs(np.where(done.valid, other - done.signal, 0.0))
    best = gamma * result.tone
    value = with_uncertainty(best, gamma * result.tone_uncertainty)
    return error, [message("frames_gamma_does_not", gamma=gamma, with_uncertainty=value, best=best)]


def _read_signal(signal: FrameSignal, scene: Scene) -> tuple[fringes.FreeReading, list[str]]:
    error, messages = signal.error, list[str]()
    result = fringes.read_free(*wave_of(signal, scene), signal.valid, orders_of(scene), error=error)
    if signal.gamma_check is not None:
        other, messages = signal.gamma_check(result.contrast)
        error = np.hypot(error, other)
    return replace(result, reading=fringes.widened(result.reading, error)), messages


def orders_of(scene: Scene) -> fringes.KnownOrders:
    """What a scene says of them."""
    stated = scene.frames
    points = [
        fringes.KnownPlaces(((k.row_px, k.col_px),), k.order, extremum=k.extremum)
        for k in stated.known_order
    ]
    lines = [
        fringes.KnownPlaces(line.places, line.order, f"frames.known_line[{i}]")
        for i, line in enumerate(stated.known_line, start=1)
    ]
    corners = tuple(c for edge in stated.free_boundary for c in edge.corners)
    return fringes.KnownOrders((*points, *lines), corners)


def wave_of(signal: FrameSignal, scene: Scene) -> tuple[Array, Array]:
    """The light c = cos 2 pi N of a signal `signal` in the `scene`'s field, and its noise."""
    turn = -1.0 if scene.polariscope.field == "bright" else 1.0
    wave = np.where(signal.valid, turn * (1.0 - 2.0 * signal.signal), 0.0)
    return wave, np.where(signal.valid, 2.0 * signal.sigma, 1.0)


_SAME, _MOST_PATCHES = 0.05, 0.9
"""Fringes within which an order is as it was, or a whole one away from it; and share of a part's
patches of which that is so where it is said of the part."""


@dataclass(frozen=True, kw_only=True)
class PatchOrders:
    """The orders (m, n) of a frame's patches with their middles `rows`, `cols` (px of the region).
    NaN = not known; `said`, what `process` says of it."""

    rows: Array
    cols: Array
    order: Array = field(repr=False)
    said: tuple[str, ...]


class AnchorPreview:
    """A frame whose fringes are followed once, and asked what known orders would make of it. The
    `scene` has no model; what it knows of the orders matters where fringes have lost contrast."""

    def __init__(self, frame: Frame, scene: Scene, capture: Capture) -> None:
        self._capture = capture
        self._followed: tuple[fringes.FollowedFringes, ...] = ()
        linear = to_linear(frame, bit_depth=capture.bit_depth, gamma=scene.frames.first_gamma)
        signal, _, self.refusal = _beforehand(frame, linear, scene, capture, requested=True)
        if signal is None or self.refusal:
            return
        self._followed = tuple(
            fringes.follow_fringes(
                *wave_of(one, scene), one.valid, orders_of(scene), error=one.error
            )[0]
            for one in (signal, *signal.others)
        )

    @property
    def depends_on_known(self) -> bool:
        """Whether what could be followed depends on what the scene knew, as with faded fringes."""
        return any(one.faded for one in self._followed)

    def orders(self, scene: Scene) -> PatchOrders:
        """The patches' orders under what a `scene` says of them. Raises InputError where none is
        read of this frame whatever is said."""
        if self.refusal:
            raise InputError(self.refusal)
        order, notes = fringes.common_orders(self._followed, orders_of(scene))
        if few := refused_low(order, self._capture):
            order, notes = np.full_like(order, np.nan), (*notes, few)
        patches = self._followed[0].patches
        return PatchOrders(rows=patches.rows, cols=patches.cols, order=order, said=notes)

    def part_at(self, row: float, col: float, *, on_line: bool = False) -> Mask:
        """The patches (m, n) that hang together with a place of the region, px; none where no
        fringe could be followed. `on_line`, whether it is a fringe line's place."""
        if not self._followed:
            return np.zeros((0, 0), dtype=bool)
        return self._followed[0].part_at(row, col, on_line=on_line)


def part_change(before: Array, after: Array, under: str, what: str) -> tuple[str, str]:
    """The kind and words of what becomes of the orders (p,) of a part, called `under`, by `what`:
    'nothing', 'new', 'moved', 'changed', 'same' or 'lost'; NaN: unknown."""
    if not np.isfinite(after).any():
        if not np.isfinite(before).any():
            return "nothing", message("would_anchor_nothing_stays", what=what, under=under)
        return "lost", message("now_would_not_known", under=under, span=_span(before))
    if not np.isfinite(before).any():
        return "new", message("gets_no_order_known", under=under, span=_span(after))
    away = (after - before)[np.isfinite(before) & np.isfinite(after)]
    step = round(float(np.median(away))) if away.size else 0
    if np.mean(np.abs(away - step) < _SAME) < _MOST_PATCHES:
        return "changed", f"{under} changes from {_span(before)} to {_span(after)}"
    if not step:
        grown = int(np.isfinite(after).sum()) - int(np.isfinite(before).sum())
        if abs(grown) > WORTH_SAYING * after.size:
            share = f"{100.0 * abs(grown) / after.size:.0f} % of it"
            more = f"{share} more would be known" if grown > 0 else f"{share} would be lost"
            return "changed", f"{under} stays at {_span(after)}; {more}"
        return "same", f"{under} stays at {_span(after)}"
    orders = f"{abs(step)} whole order{'s' * (abs(step) > 1)} {'up' if step > 0 else 'down'}"
    return "moved", f"{under} moves from {_span(before)} to {_span(after)}, {orders}"


def _span(order: Array) -> str:
    """Between which orders a part lies, but for a few of its patches."""
    low, high = np.percentile(order[np.isfinite(order)], (100.0 - ALMOST_ALL, ALMOST_ALL))
    return f"{low:.1f}..{high:.1f}"
