"""One frame of a set, without the others: as `process` reads it, or as known orders would have it.

For the latter the fringes are followed once. Each order that is tried is then asked of the patches
alone, which takes some hundredths of a second where the whole frame takes seconds.

`check`: what is wrong with frames, and what one of them asks for, before a long run.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, PhysicsError
from isochrome.frames import (
    Check,
    Finding,
    Frame,
    FrameReader,
    Level,
    load_no_load,
    look_through,
    open_scene_frames,
    to_linear,
    with_file_scale,
)
from isochrome.fringes import FollowedFringes, common_orders, follow_fringes, skeletons
from isochrome.messages import frame_messages, message
from isochrome.output import named_frames, numbers
from isochrome.processing.api import check_scene
from isochrome.processing.frame_task import FrameSource, FrameTask, own_scene
from isochrome.processing.kinds.image_only import (
    ALMOST_ALL,
    WORTH_SAYING,
    frame_signal,
    orders_of,
    refused_beforehand,
    refused_low,
    told_exposure,
    wave_of,
)
from isochrome.processing.kinds.kind import kind_of
from isochrome.processing.kinds.known_loads import KnownLoads, known_series, tells_load
from isochrome.processing.kinds.with_model import frame_causes
from isochrome.processing.processed import Processed, tabulate_set
from isochrome.processing.result import (
    CAUSES,
    REFINED,
    Capture,
    ProcessedFrame,
    cell_values,
    fitted_pairs,
)
from isochrome.runs import single_threaded
from isochrome.scene import FramesLike, Scene, SceneLike, check_pixel, load_scene

Array = NDArray[Any]

_SAME, _MOST_PATCHES = 0.05, 0.9
"""Fringes within which an order is as it was, or a whole one away from it; and share of a part's
patches of which that is so where it is said of the part."""


@dataclass(frozen=True)
class FrameValue:
    """A value that was fitted to a frame, by its key of the scene.

    `asked`, whether the frame asked for it, besides the scene's unknowns; `refined`, whether the
    scene states it, the frame knows more of it, and both agree.
    """

    key: str
    value: float
    standard_uncertainty: float
    asked: bool
    refined: bool = False


@dataclass(frozen=True)
class FrameResult:
    """What `process` finds in a frame of a set, its row of frames.csv, and what that says."""

    frame: ProcessedFrame
    row: dict[str, Any]
    summary_text: str

    @property
    def values(self) -> tuple[FrameValue, ...]:
        """The fitted values; none where the frame does not show the scene's model."""
        causes, refined = (cell_values(self.row.get(name) or "") for name in (CAUSES, REFINED))
        pairs = fitted_pairs(self.row) | causes | refined
        return tuple(
            FrameValue(key, float(value), float(spread), key in causes, key in refined)
            for key, (value, spread) in pairs.items()
            if np.isfinite(numbers([value]))[0]
        )


def process_frame(frames: FramesLike, scene: Scene, index: int) -> FrameResult:
    """Read one frame of a set, as `process` reads it, by its number, or its state's, from 0."""
    with _captured(frames, scene, index) as (source, states):
        result = source.processed(index, states)
        row = source.task.kind.row(result, scene)
    one_state = Processed(
        scene=scene, model=scene.model, columns=tabulate_set([row]), frames=[result], fitted=None,
        warnings=result.warnings, messages=[frame_messages(result.warnings)],
    )  # fmt: skip
    return FrameResult(result, row, one_state.summary_text)


@dataclass(frozen=True, kw_only=True)
class PatchOrders:
    """The orders (m, n) of a frame's patches with their middles `rows`, `cols` (px of the region).

    NaN = not known; `said`, what `process` says of it.
    """

    rows: NDArray[Any]
    cols: NDArray[Any]
    order: Array = field(repr=False)
    said: tuple[str, ...]


class AnchorPreview:
    """A frame whose fringes are followed, and asked what known orders would make of it.

    The `scene` has no model; what it knows of the orders matters where fringes have lost contrast.
    """

    def __init__(self, frame: Frame, scene: Scene, capture: Capture) -> None:
        self._capture = capture
        self.refusal = ""
        self._followed: tuple[FollowedFringes, ...] = ()
        linear = to_linear(frame, bit_depth=capture.bit_depth, gamma=scene.frames.first_gamma)
        try:
            signal = frame_signal(frame, linear, scene, capture)
        except InputError as error:  # no fringe in it
            self.refusal = str(error)
            return
        lines = len(skeletons(np.clip(signal.signal, 0.0, 1.0)))
        self.refusal = refused_beforehand(frame, signal, lines, capture, requested=True)
        if self.refusal:
            return
        self._followed = tuple(
            follow_fringes(*wave_of(one, scene), one.valid, orders_of(scene), error=one.error)[0]
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
        order, notes = common_orders(self._followed, orders_of(scene))
        if few := refused_low(order, self._capture):
            order, notes = np.full_like(order, np.nan), (*notes, few)
        patches = self._followed[0].patches
        return PatchOrders(rows=patches.rows, cols=patches.cols, order=order, said=notes)

    def part_at(self, row: float, col: float, *, on_line: bool = False) -> NDArray[np.bool_]:
        """The patches (m, n) that hang together with a place of the region, px; none where no
        fringe could be followed. `on_line`, whether it is a fringe line's place."""
        if not self._followed:
            return np.zeros((0, 0), dtype=bool)
        return self._followed[0].part_at(row, col, on_line=on_line)


def part_change(before: Array, after: Array, under: str, what: str) -> tuple[str, str]:
    """Say what becomes of the orders (p,) of a part's patches, which is called `under`, by `what`.

    The kind, 'nothing', 'new', 'moved', 'changed', 'same' or 'lost', and the words; NaN: unknown.
    """
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


def anchor_preview(frames: FramesLike, scene: Scene, index: int) -> AnchorPreview:
    """Follow the fringes of one frame, to say what known orders would make of it.

    InputError where the scene's frames tell their orders themselves.
    """
    if scene.polariscope.tells_orders:
        raise InputError("colours_phase_steps_read", name=scene.name)
    with _captured(frames, scene, index) as (source, states):
        return AnchorPreview(states[0], scene, source.capture)


@contextmanager
def _captured(
    frames: FramesLike, scene: Scene, index: int
) -> Iterator[tuple[FrameSource, list[Frame]]]:
    """A set that is opened for one of its states, and its frames."""
    check_scene(scene)
    with single_threaded(), open_scene_frames(frames, scene) as reader:
        scene = with_file_scale(scene, reader)
        check_pixel(scene, reader.shape)
        task = FrameTask(frames=frames, scene=scene, reader=reader, kind=kind_of(scene))
        source = FrameSource(task)
        try:
            ((_, states),) = source.captured(index, index + 1)
            yield source, states
        finally:
            source.close()


_FIRST = 3
"""Frames from the first on in which the scene's fringes are looked for, and then one in the middle
of the set: one takes seconds."""


_OF_LOST = {"disc": "disc_of_residual_stress"}
"""What there is for a scene that explains no frame, by its model."""


def check(path: FramesLike, scene: SceneLike) -> Check:
    """Look through captured frames once, and say what is wrong with them for this scene.

    Counts, sizes, times, bit depth, exposure, saturation, noise and no-load frames are looked at,
    in one pass with one frame in memory; a frame that shows the unloaded specimen among loaded ones
    is named. Where they can be the scene's, and it has a model, the
    first frame that shows its fringes is fitted, and what it asks for besides what the scene states
    is a warning, as `process` says it: the key that mends it, and its value. A slip in the scene
    with which nothing can be read, such as a picture that lies otherwise, is an error, and so is a
    model that is too far from all frames that are looked at: `process` gives no value then. Without
    a model frames that are exposed otherwise than both no-load frames are named with their factor.

    Parameters
    ----------
    path : str, Path, sequence of them, array or sequence of arrays
        The frames, as for `open_frames`.
    scene : str, Path, Scene or mapping
        What stood in front of the camera, as `load_scene` takes it.

    Returns
    -------
    Check
        The findings, errors first; frames that cannot be read are a finding, not an exception.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0})
    >>> simulated = isochrome.simulate(scene, "simulated")
    >>> found = isochrome.check("simulated/frames.tif", scene)
    >>> found.ok, found.count
    (True, 1)
    """
    scene = load_scene(scene)
    result = look_through(path, scene)
    frames = scene.frames
    tells = scene.has_model or (frames.no_load_dark and frames.no_load_bright)
    orders_told = scene.polariscope.tells_orders  # by their states themselves
    if not result.ok or not result.count or orders_told or not tells:
        return result
    with single_threaded():
        return result.with_more(_by_fringes(path, scene, result.count))


def _by_fringes(path: FramesLike, scene: Scene, count: int) -> Iterator[Finding]:
    """What the fringes of some frames say of the scene."""
    with open_scene_frames(path, scene) as reader:
        scene = with_file_scale(scene, reader)
        capture = Capture(reader.bit_depth, *load_no_load(scene, full_shape=reader.full_shape))
        if scene.frames.has_known_loads:
            yield from _against_others(reader, scene, capture)
            return
        if not scene.has_model:
            for frame in islice(reader, _FIRST + 1):  # exposed otherwise than no-load frames
                for text in told_exposure(frame, own_scene(scene, frame), capture):
                    yield Finding("warning", f"{named_frames([frame.index])}: " + text, frame.index)
            return
        tried = {*range(_FIRST), count // 2}
        frames = (frame for frame in islice(reader, max(tried) + 1) if frame.index in tried)
        yield from _asked(frames, scene, capture, count)


def _against_others(reader: FrameReader, scene: Scene, capture: Capture) -> Iterator[Finding]:
    """What some frames' loads say, each read against the frames of known loads."""
    try:
        series = known_series(scene, reader)
    except (InputError, PhysicsError) as error:
        yield Finding("error", str(error))
        return
    capture_of_set = replace(capture, series=series)
    looked = [f for f in reader if f.index in (0, len(scene.frames.known_loads_n) // 2)]
    result = [KnownLoads().read([frame], scene, capture_of_set) for frame in looked]
    read = any(tells_load(frame) for frame in result)
    for frame in result:
        for text in frame.warnings[:1] if not tells_load(frame) else ():
            level: Level = "warning" if read else "error"
            yield Finding(level, f"{named_frames([frame.index])}: " + text, frame.index)


def _asked(
    frames: Iterator[Frame], scene: Scene, capture: Capture, count: int
) -> Iterator[Finding]:
    """What the first frame that the scene explains asks for; why, where it explains none."""
    bare: list[int] = []
    lost: list[Finding] = []
    refused = None
    for frame in frames:
        reading = None
        try:
            reading = frame_causes(frame, own_scene(scene, frame), capture)
        except (InputError, PhysicsError) as error:
            refused = refused or str(error)
        if reading is None:
            bare.append(frame.index)
            continue
        texts, explained = reading
        level: Level = "error" if explained == "with a slip" else "warning"
        findings = [
            Finding(level, f"{named_frames([frame.index])}: {t}", frame.index) for t in texts
        ]
        if explained != "not at all":
            yield from findings
            return
        lost = lost or findings
    code = _OF_LOST.get(scene.model or "")
    more = message(code) if code else ""
    if lost:
        *before, last = lost
        yield from before
        yield replace(last, level="error", text=last.text + more)
    if bare:
        text = refused or message("scene_fringes_not_there") + more
        grave: Level = "error" if len(bare) == count else "warning"
        yield Finding(grave, f"{named_frames(bare)}: " + text)
