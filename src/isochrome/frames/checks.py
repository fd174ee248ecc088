"""What is wrong with a set of frames, in plain words, before a long run: one pass, and findings.

Among them frames of the unloaded specimen, by means over blocks of pixels: a frame is nearly the
scene's no-load picture, or its light hardly swings where that of the frames beside it swings from
fringe to fringe. A load that begins or ends at nought goes through few fringes, and is none.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.figures import LINE_COLOURS, LINE_PT, new_figure, style_axes
from isochrome.frames import linear
from isochrome.frames.images import signature_of
from isochrome.frames.opening import check_scale, open_scene_frames, with_file_scale
from isochrome.frames.reading import Frame, FrameReader
from isochrome.messages import message, messages_data
from isochrome.output import Result, counted, named_frames
from isochrome.scene import Camera, FramesLike, Scene, check_moduli, check_pixel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.floating]

_BLOCKS = 64
"""Blocks along the shorter side of a frame."""

_NONE, _MANY = 2.0, 4.0
"""How far light goes up and down along a line, in what the set's light spans: at most by a lamp's
own slope and noise, and at least by three fringes, which are seldom as bright and dark as all."""

_USUAL, _FARTHEST = 95.0, 99.9
"""Per cent of the lines whose light goes so far, and of the blocks that lie so near a picture: a
small contact at a low load lights few blocks."""

_ALIKE = 0.04
"""Of the light's span, by which a frame may differ from a no-load picture and be one."""

_DRIFT = 1.25
"""Factor by which a lamp may have drifted from that picture, up or down."""

UNLOADED = "looks_like_unloaded_specimen"


NoLoad = tuple[linear.Linear | None, linear.Linear | None]
"""The scene's dark and bright no-load frame."""


def no_load_pictures(scene: Scene, no_load: NoLoad) -> dict[str, Array] | None:
    """Block means of the no-load frames' light; None where unloaded frames are not looked for.
    Where loads change, some frames have none, or steps or colours tell the orders."""
    frames, load = scene.frames, scene.load
    changes = load is not None and not isinstance(load.normal_n, int | float)
    without = frames.starts_unloaded or frames.known_loads_n or scene.polariscope.tells_orders
    if changes or without:
        return None
    pictures = {}
    for key, one in zip(("no_load_dark", "no_load_bright"), no_load, strict=True):
        if one is not None:
            # by the means of its levels, edges included, as that of frames
            levels = _blocks(np.maximum(one.image, 0.0) ** (1.0 / frames.first_gamma), one.valid)
            pictures[f"frames.{key}"] = np.asarray(levels**frames.first_gamma)
    return pictures


def _load_signs(
    frame: Frame, pictures: dict[str, Array], full: float, gamma: float
) -> dict[str, float]:
    """How far a frame's light is from each picture, whose lamp may have drifted; inf: unknown. And
    how far its levels go up and down along its lines, at `most` and as is `usual`."""
    blocks = _blocks(frame.image, frame.mask) / full
    light = np.sign(blocks) * np.abs(blocks) ** gamma
    signs = {}
    for key, picture in pictures.items():
        known = np.isfinite(light) & np.isfinite(picture) if light.shape == picture.shape else False
        signs[key] = float("inf")
        if np.any(known):
            here, reference = light[known], picture[known]
            gain = float(np.median(here)) / max(float(np.median(reference)), 1e-9)
            gain = min(max(gain, 1.0 / _DRIFT), _DRIFT)
            signs[key] = float(np.percentile(np.abs(here - gain * reference), _FARTHEST))
    steps = (np.abs(np.nan_to_num(np.diff(blocks, axis=k), posinf=0.0)) for k in (0, 1))
    paths = [step.sum(axis=k) for k, step in enumerate(steps)]
    signs["usual"] = max(float(np.percentile(path, _USUAL)) for path in paths)
    return signs | {"most": max(float(path.max()) for path in paths)}


def _blocks(image: NDArray[Any], mask: NDArray[np.bool_] | None) -> Array:
    """Means over blocks of pixels, NaN where a block is not the specimen's or holds no number."""
    by = max(1, min(image.shape) // _BLOCKS)
    values = image.astype(np.float32)
    if mask is not None:
        values = np.where(mask, values, np.nan)
    rows, cols = (n // by for n in values.shape)
    cut = values[: rows * by, : cols * by]
    return np.asarray(cut.reshape(rows, by, cols, by).mean(axis=(1, 3)))


Level = Literal["error", "warning", "note"]
SATURATED, LOW_CONTRAST, JUMP = 0.01, 0.1, 0.2
"""Share of pixels, part of full scale, and change between frames, that are reported."""


@dataclass(frozen=True)
class Finding:
    """One thing to know of a set of frames.

    Parameters
    ----------
    level : {'error', 'warning', 'note'}
        How grave it is.
    text : str
        A sentence.
    frame : int, optional
        The frame that it is of; None: of the set.
    """

    level: Level
    text: str
    frame: int | None = None


@dataclass(kw_only=True)
class Survey:
    """Raw figures of the specimen's pixels, grey levels, by frame in `rows`: `low`, `high`, 2nd and
    98th percentile, `smallest`, `largest` of the finite ones (NaN: none), the shares `saturated`
    (on the plateau, where clipped) and `not_finite`, and, where asked, the signs of a load; and of
    all frames."""

    rows: list[dict[str, float]] = field(default_factory=list)
    noise: list[float] = field(default_factory=list)  # sigma at mid level of frames 0, 1, 3, 7, ...
    twins: list[int] = field(default_factory=list)  # frames equal to an earlier one
    untimed: int = 0
    bits: int = 0  # all values or-ed together
    failure: str | None = None  # why reading ended before the end
    pictures: dict[str, Array] | None = None  # that unloaded frames are like; None: not asked

    @property
    def count(self) -> int:
        """Frames that were read."""
        return len(self.rows)

    def of(self, name: str) -> NDArray[np.float64]:
        """One figure of each frame."""
        return np.array([row[name] for row in self.rows], float)


def survey(reader: FrameReader, scene: Scene, no_load: NoLoad) -> Survey:
    """Read all frames once, in memory that does not grow with them; an InputError ends it."""
    light, digests = Survey(pictures=no_load_pictures(scene, no_load)), set[bytes]()
    full, nan = linear.full_scale(reader.bit_depth), float("nan")
    try:
        for frame in reader:
            # light off the specimen says nothing
            image = frame.image.ravel() if frame.mask is None else frame.image[frame.mask]
            values = image[np.isfinite(image)]
            row = {"low": nan, "high": nan, "smallest": nan, "largest": nan, "saturated": 0.0}
            row["not_finite"] = 1 - values.size / image.size
            if values.size:
                low, high = np.percentile(values[:: max(1, values.size // 50_000)], (2, 98))
                clipped = values >= linear.saturation_level(frame.image, full=full)
                row |= {"low": low, "high": high, "saturated": float(np.mean(clipped))}
                row |= {"smallest": float(values.min()), "largest": float(values.max())}
            if values.size and image.dtype.kind == "u":
                light.bits |= int(np.bitwise_or.reduce(values, axis=None))
            if light.pictures is not None:
                row |= _load_signs(frame, light.pictures, full, scene.frames.first_gamma)
            digest = hashlib.sha1(frame.image.data, usedforsecurity=False).digest()
            light.twins += [frame.index] * (digest in digests)
            digests.add(digest)
            light.untimed += frame.time_s is None
            if frame.index & (frame.index + 1) == 0:
                with suppress(InputError):  # too small: said by the size's own finding
                    model = linear.estimate_noise(frame.image, bit_depth=reader.bit_depth)
                    middle = np.median(frame.image[np.isfinite(frame.image)])
                    light.noise.append(float(model.sigma(middle)))
            light.rows.append(row)
    except InputError as error:
        light.failure = str(error)
    return light


def refusals(*looks: Callable[[], object]) -> Iterator[Finding]:
    """A finding for each look at something that is refused."""
    for look in looks:
        try:
            look()
        except InputError as error:
            yield Finding("error", str(error))


def misfits(reader: FrameReader, scene: Scene, count: int | None) -> Iterator[tuple[str, str]]:
    """What of a set cannot be its scene's (size, count, known points): whose, and a sentence."""
    rows, cols = reader.shape
    wear, steps = scene.wear, scene.polariscope.frames_a_state
    each = count is not None and count % steps == 0
    if count is not None and not each:
        yield str(reader.path), message("frames_not_multiple_polariscope", count=count, steps=steps)
    loads = len(scene.frames.known_loads_n)
    if loads and count is not None and loads != count:
        numbers = counted(loads, "number"), counted(count, "frame")
        text = message("frames_known_loads_n_has_set", counted=numbers[0], counted_2=numbers[1])
        yield scene.name, text
    yield from _places_beyond(scene, rows, cols)
    yield from _other_size(reader, scene.camera or Camera())
    if wear is None or scene.frames.sliding_speed_mm_per_s is not None:
        return
    first = scene.friction is not None and scene.friction.static_state_first
    states = len(wear.distances_m) + int(first)
    if count is not None and each and count != states * steps:
        text = message(
            "give_one_frame_state", counted=counted(count, "frame"),
            states=counted(states, "state"), first=message("static_state_first") * first,
            step=message("each_steps", steps=steps) if steps > 1 else "",
        )  # fmt: skip
        yield str(reader.path), text


def _other_size(reader: FrameReader, camera: Camera) -> Iterator[tuple[str, str]]:
    """Tell of frames of another size than the scene's camera has."""
    rows, cols = reader.shape
    wanted = (camera.height_px or rows, camera.width_px or cols)
    if wanted == (rows, cols):
        return
    after = "after the roi" if reader.roi else message("no_frames_roi_set")
    text = message(
        "frames_rows_columns_scene", rows=rows, cols=cols, after=after, wanted=wanted[0],
        wanted_2=wanted[1],
    )  # fmt: skip
    if wanted == (cols, rows):
        text += message("turn_pictures_lie_their")
    yield str(reader.path), text


def _places_beyond(scene: Scene, rows: int, cols: int) -> Iterator[tuple[str, str]]:
    """Tell of known points, and of the first one of lines and boundaries, beyond the picture."""
    frames = scene.frames
    for i, known in enumerate(frames.known_order, start=1):
        row, col = known.row_px, known.col_px
        if row >= rows or col >= cols:
            text = message("frames_known_order_row_column", i=i, row_px=row, col_px=col)
            yield scene.name, f"{text}outside {rows} x {cols} pixels; move it"
    # an outline may run along the picture's edge, half a pixel beyond its last centre
    lines: list[Any] = [("known_line", *line, 0.0) for line in enumerate(frames.known_line, 1)]
    lines += [("free_boundary", *line, 1.0) for line in enumerate(frames.free_boundary, start=1)]
    for name, i, path, slack in lines:
        for k, (row, col) in enumerate(path.places, start=1):
            if row > rows - 1 + slack or col > cols - 1 + slack:
                text = message("frames_point_row_column", name=name, i=i, k=k, row=row, col=col)
                yield scene.name, f"{text}{rows} x {cols} pixels; move it"
                break


def of_depth(reader: FrameReader, light: Survey) -> Iterator[Finding]:
    """Findings on bit depth: 12 bits in a 16-bit file, floats without a full scale."""
    depth, largest = reader.bit_depth, max(light.of("largest").tolist(), default=0.0)
    if reader.dtype.kind == "f" and depth is None and largest > 1:
        yield Finding("error", message("float_frames_reach_set", largest=largest))
    if reader.dtype.kind == "f" and depth is not None and 0 < largest <= 1:
        yield Finding("warning", message("float_frames_end_but", largest=largest, depth=depth))
    if depth is None or depth <= 8 or reader.dtype.kind != "u" or not light.bits:
        return
    likely = next(b for b in (8, 10, 12, 14, 16) if largest < 2**b)
    if likely < depth:
        text = message("bit_frames_whose_largest", depth=depth, largest=largest, likely=likely)
        yield Finding("warning", text)
    if shift := (light.bits & -light.bits).bit_length() - 1:
        text = message(
            "all_values_multiples_bit", shift=2**shift, shift_2=depth - shift,
            shift_3=2**depth - 2**shift,
        )  # fmt: skip
        yield Finding("note", text)


def of_light(reader: FrameReader, light: Survey) -> Iterator[Finding]:
    """Findings on each frame's light: blank, saturated, weak, jumping, repeated, noisy."""
    if not light.count:
        return
    full = linear.full_scale(reader.bit_depth)
    low, high, small, large = map(light.of, ("low", "high", "smallest", "largest"))
    empty, flat = np.isnan(large), small == large
    yield from _frames("error", empty, message("no_number_nan_only"))
    yield from _frames("error", flat & (large <= 0), message("all_black_light"))
    yield from _frames("error", flat & (large >= full), message("all_white_lower_exposure"))
    within = flat & (large > 0) & (large < full)
    yield from _frames("error", within, message("constant_captured_frame"))
    holes = (light.of("not_finite") > 0) & ~empty
    yield from _frames("note", holes, message("some_pixels_not_finite"))
    clear, share = ~(empty | flat), light.of("saturated")
    worst = message("saturated_up_pixels_which", max=100 * share.max())
    yield from _frames("warning", clear & (share > SATURATED), worst + "the exposure")
    weak = clear & (high - low < LOW_CONTRAST * full) & (share <= SATURATED)
    yield from _frames("warning", weak, message("low_contrast_under_full"))
    change = np.zeros(light.count)
    with np.errstate(divide="ignore", invalid="ignore"):
        change[1:] = np.abs(np.diff(high)) / np.maximum(high[1:], high[:-1])
    jumps = (change > JUMP) & clear
    text = message("brightness_jumps_against_frame", max=100 * change.max(initial=0))
    yield from _frames("warning", jumps, text)
    # brightest places dimmer than another frame's, by steps too small for a jump
    usable = clear & ~weak & (share <= SATURATED)
    top = float(high[usable].max(initial=0.0))
    dim = usable & (high < (1.0 - JUMP) * top)
    if dim.any() and not jumps.any():
        text = message("brightest_places_down_those", least=top / float(high[dim].min()))
        yield from _frames("warning", dim, text)
    twins = np.isin(np.arange(light.count), light.twins)
    yield from _frames("warning", twins & clear, message("same_pixel_pixel_earlier"))
    if light.noise:
        unit = "of full scale" if reader.bit_depth is None else "grey levels"
        text = message("camera_noise_about_rounding", noise=np.median(light.noise), unit=unit)
        yield Finding("note", text)


def _frames(level: Level, where: np.ndarray, text: str) -> Iterator[Finding]:
    """One finding for all frames that share a fault, as 'frames 2-5, 9: ...'."""
    index = np.flatnonzero(where)
    if index.size:
        yield Finding(level, f"{named_frames(index.tolist())}: " + text, int(index[0]))


def of_unloaded(reader: FrameReader, light: Survey, scene: Scene) -> Iterator[Finding]:
    """Findings on frames that show the unloaded specimen among those to be processed."""
    high, span = light.of("high"), light.of("high") - light.of("low")
    if light.pictures is None or not np.isfinite(span).any():
        return
    full, gamma = linear.full_scale(reader.bit_depth), scene.frames.first_gamma
    unit = float((max(np.nanmax(high), 0.0) / full) ** gamma)
    named = np.zeros(light.count, bool)
    far = np.reshape([light.of(key) for key in light.pictures], (-1, light.count))
    for k, key in enumerate(light.pictures):
        numbers = np.flatnonzero((far[k] < _ALIKE * unit) & (far.argmin(axis=0) == k))
        if numbers.size:
            named[numbers] = True
            why = message(UNLOADED, value=message("nearly_same_picture", key=key), value_2="")
            text = f"{named_frames(numbers.tolist())}: {why}"
            yield Finding("warning", text, int(numbers[0]))
    largest = np.nanmax(span)
    many = light.of("usual") * full >= _MANY * largest
    none = light.of("most") * full <= _NONE * largest
    # runs of frames without fringes between frames of many; at an end of the set, beside two
    fringeless = np.zeros_like(none)
    ends = np.flatnonzero(np.diff(np.r_[False, none, False].astype(int))).reshape(-1, 2)
    for start, stop in ends.tolist():
        before, after = many[:start][-2:], many[stop:][:2]
        within = start and stop < len(none)
        beside = np.r_[before[-1:], after[:1]] if within else np.r_[before, after]
        fringeless[start:stop] = beside.size == 2 and beside.all()
    if largest > 0:
        name = message("name_frames_no_load_dark_no_load_bright")
        why = message(UNLOADED, value=message("no_fringes_where_frames"), value_2=name)
        yield from _frames("warning", fringeless & ~named, why)


def of_no_load(
    reader: FrameReader, light: Survey, scene: Scene, no_load: NoLoad
) -> Iterator[Finding]:
    """Findings on the no-load frames: missing, unreadable, of another size or exposure."""
    frames = scene.frames
    if scene.polariscope.step:
        if frames.no_load_steps is not None:
            yield from refusals(lambda: linear.open_no_load_steps(scene, reader.full_shape).close())
        return
    keys = ("no_load_dark", "no_load_bright")
    missing = " and ".join(f"frames.{key}" for key in keys if getattr(frames, key) is None)
    if missing:
        yield Finding("warning", message("not_given_unloaded_specimen", missing=missing))
    dark, bright = no_load
    if np.isnan(light.of("low")).all():
        return
    full = linear.full_scale(reader.bit_depth)
    low = (max(float(np.nanmin(light.of("low"))), 0) / full) ** frames.first_gamma
    high = (max(float(np.nanmax(light.of("high"))), 0) / full) ** frames.first_gamma
    if bright is not None:
        top = float(np.percentile(bright.image, 98))
        if high > 1.15 * top:
            yield Finding("warning", message("frames_reach_full_scale", high=high, top=top))
    if dark is not None:
        bottom = float(np.percentile(dark.image, 2))
        if bottom > low + 0.05:
            text = message("no_load_dark_begins_full_scale", bottom=bottom, low=low)
            yield Finding("warning", text)


ENDINGS = {
    ".tif": "TIFF", ".tiff": "TIFF", ".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG",
    ".bmp": "BMP", ".webp": "WebP",
}  # fmt: skip
"""What a picture's name says that it is."""


@dataclass(frozen=True, repr=False)
class Check(Result):
    """What was found in a set of frames.

    Parameters
    ----------
    findings : tuple of Finding
        What to know, errors first.
    count : int
        Number of frames that were read.
    shape : tuple of int or None
        Size of a frame, (rows, cols); None where they could not be opened.
    light : Survey, optional
        Light of the frames; None where they could not be opened.
    """

    findings: tuple[Finding, ...]
    count: int
    shape: tuple[int, int] | None
    light: Survey | None = None

    def with_more(self, findings: Iterable[Finding]) -> Check:
        """The same with more findings."""
        return replace(self, findings=_sorted((*self.findings, *findings)))

    @property
    def columns(self) -> dict[str, list[Any]]:
        """A row a finding: how grave, of which frame, and a sentence."""
        names = ("level", "frame", "text")
        return {name: [getattr(finding, name) for finding in self.findings] for name in names}

    @property
    def warnings(self) -> tuple[str, ...]:
        """The errors and warnings among the findings."""
        return tuple(finding.text for finding in self.findings if finding.level != "note")

    @property
    def title(self) -> str:
        """How many frames were read, and whether anything is wrong."""
        verdict = "no error found" if self.ok else "errors found"
        return f"Check of {counted(self.count, 'frame')}: {verdict}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """The findings, errors first."""
        return ((finding.level, finding.text) for finding in self.findings)

    def to_json(self) -> dict[str, Any]:
        """The verdict, the number of frames and the findings."""
        texts = messages_data(f.text for f in self.findings)
        rows = [
            {"level": finding.level, "frame": finding.frame, **data}
            for finding, data in zip(self.findings, texts, strict=True)
        ]
        return {"ok": self.ok, "frames": self.count, "findings": rows}

    def figure(self) -> Figure:
        """The span of the grey levels of each frame, and the share of its pixels at full scale."""
        light = self.light
        if light is None or not self.count:
            raise InputError("no_frame_read_there")
        figure = new_figure(7.5, 4.6)
        levels, saturated = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        frame, low, high = np.arange(light.count), light.of("low"), light.of("high")
        levels.fill_between(frame, low, high, color=LINE_COLOURS[0], alpha=0.3, lw=0)
        look: Any = {"marker": "o", "ms": 3, "lw": LINE_PT}
        for name, values in (("98 %", high), ("2 %", low)):
            levels.plot(frame, values, color=LINE_COLOURS[0], **look)
            beside = {"xytext": (5, -3), "textcoords": "offset points"}
            levels.annotate(name, (frame[-1], values[-1]), **beside)
        levels.margins(x=0.1)  # room for what stands beside the last
        style_axes(levels, z_label="grey level", title="98 % and 2 % of the pixels are darker")
        saturated.plot(frame, 100.0 * light.of("saturated"), color=LINE_COLOURS[1], **look)
        style_axes(saturated, x_label="frame", z_label="saturated (% of pixels)")
        return figure

    @property
    def ok(self) -> bool:
        """Whether no finding is an error."""
        return all(f.level != "error" for f in self.findings)


def look_through(path: FramesLike, scene: Scene) -> Check:
    """What is wrong with captured frames for this scene, in one pass, without a model."""
    findings = []
    if not scene.has_model:
        open_shape, why = scene.specimen.shape is None, scene.no_model_reason
        code = "so_has_no_model" if open_shape else "no_simulation_no_fit"
        text = message(code, no_model_reason=why, text=message("process_still_gives_normalised"))
        findings.append(Finding("note" if open_shape else "warning", text))
    try:
        reader = open_scene_frames(path, scene, any_scale=True)
    except InputError as error:
        return Check(_sorted([Finding("error", str(error)), *findings]), 0, None)
    no_load: NoLoad = None, None
    try:
        no_load = linear.load_no_load(scene, full_shape=reader.full_shape)
    except InputError as error:
        findings.append(Finding("error", str(error)))
    with reader:
        light = survey(reader, scene, no_load)
    if light.failure is not None:
        findings.append(Finding("error", light.failure, light.count))
    findings += _of_file(reader, scene)
    count = None if light.failure else light.count
    findings += [Finding("error", text) for _, text in misfits(reader, scene, count)]
    if light.failure is None and scene.frames.sliding_speed_mm_per_s is not None and light.untimed:
        text = message("frames_carry_no_time", untimed=light.untimed, count=light.count)
        findings.append(Finding("error", text))
    if light.failure is None and reader.claimed_count not in (None, light.count):
        claim = counted(reader.claimed_count, "frame")
        text = message("video_head_claims_can", counted=claim, count=light.count)
        findings.append(Finding("warning", text))
    findings += of_depth(reader, light)
    findings += of_light(reader, light)
    findings += of_no_load(reader, light, scene, no_load)
    findings += of_unloaded(reader, light, scene)
    return Check(_sorted(findings), light.count, reader.shape, light)


def _sorted(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    return tuple(sorted(findings, key=lambda f: ("error", "warning", "note").index(f.level)))


def _of_file(reader: FrameReader, scene: Scene) -> Iterator[Finding]:
    yield from refusals(
        lambda: check_scale(reader, scene.camera),
        lambda: check_pixel(with_file_scale(scene, reader), reader.shape),
        lambda: check_moduli(scene),
    )
    if reader.channel is not None:
        yield Finding("note", message("colour_frames_channel_used", channel=reader.channel))
    names = reader.names or (str(reader.path),)
    if reader.mask is not None:
        yield Finding("note", message("mask_takes_pixels_specimen", mean=100 * reader.mask.mean()))
    lossy = reader.lossy
    if isinstance(reader.files[0], Path):  # arrays have no first bytes
        kind = signature_of(reader.files[0]).name
        lossy = lossy or kind in ("JPEG", "WebP")
        claimed = ENDINGS.get(Path(names[0]).suffix.lower(), kind)
        if kind != claimed:
            text = message("first_bytes_name_read", names=names[0], kind=kind, claimed=claimed)
            yield Finding("note", text)
    if lossy:
        yield Finding("note", message("compressed_loss_which_hides", names=names[0]))
    if scene.frames.gamma == 1 and (lossy or reader.kind == "video" or reader.channel is not None):
        yield Finding("note", message("frames_gamma_says_grey"))
