"""Which reader files or arrays need, and what is read: channel, region, bit depth, mask.

Several videos or TIFF stacks are one recording, as are a command line's names, folders and globs.
"""

import glob
import os
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.frames import images, reading, video
from isochrome.frames.reading import FrameReader
from isochrome.messages import message
from isochrome.output import SUFFIXES, read_roi_mask
from isochrome.scene import ArrayFrames, Camera, Frames, FramesLike, Roi, Scene, frames_of

Mask = NDArray[np.bool_]
LEVELS = 64
"""A mask has few grey levels; an image with more of them on a tenth of its pixels is a picture."""

MOST_CORNERS = 2000
"""Of a polygon: all pairs of its sides are looked at."""


class WithFrames(Protocol):
    """A scene, or a calibration set: it has [frames], and knows where their files are."""

    @property
    def frames(self) -> Frames:
        """How the frames are to be read."""

    def path(self, name: Any, /) -> Any:
        """A path relative to the file that names it; an array as it is."""


def load_mask(scene: WithFrames, shape: tuple[int, int], full_shape: tuple[int, int]) -> Mask:
    """The specimen's pixels, of the roi's size `shape`: inside frames.mask, frames.polygon_px and
    closed free boundaries; all where none is named. InputError: no file, no mask, another size."""
    inside = np.ones(shape, dtype=bool)
    frames = scene.frames
    if frames.mask is not None:
        inside &= _of_file(scene.path(frames.mask), frames, shape, full_shape)
    polygons = {
        f"frames.free_boundary[{i}]": boundary.places[:-1]
        for i, boundary in enumerate(frames.free_boundary, start=1)
        if boundary.is_closed
    }
    if frames.polygon_px is not None:
        polygons["frames.polygon_px"] = frames.polygon_px
    for key, corners in polygons.items():
        polygon = _of_polygon(corners, shape, key)
        if not (inside & polygon).any():
            others = "frames.mask" if frames.mask else "the others"
            raise InputError("have_no_pixel_common", key=key, others=others)
        inside &= polygon
    return inside


def _of_file(
    path: Path | ArrayFrames, frames: Frames, shape: tuple[int, int], full_shape: tuple[int, int]
) -> Mask:
    if isinstance(path, Path) and path.suffix.lower() in SUFFIXES:
        full = read_roi_mask(path, full_shape)
        where = message("rois_placed_full_frame")
    else:
        full = _of_image(path)
        where = message("nonzero_pixels_specimen")
    if full.shape == shape:
        part = full
    elif full.shape == full_shape:
        top, left_px = (0, 0) if frames.roi is None else (frames.roi.top_px, frames.roi.left_px)
        part = full[top : top + shape[0], left_px : left_px + shape[1]]
    else:
        raise InputError(
            "frames_mask_pixels_rows", path=path, shape=full.shape, full_shape=full_shape,
            region="" if shape == full_shape else f", their region of interest {shape}",
        )  # fmt: skip
    if not part.any():
        raise InputError("frames_mask_leaves_no", path=path, where=where)
    return part


def _of_image(path: Path | ArrayFrames) -> Mask:
    """An image's nonzero pixels, (row, col)."""
    if isinstance(path, ArrayFrames):
        if path.count != 1 or path.dtype.kind not in "biuf":
            raise InputError("frames_mask_one_picture", path=path)
        values = path.frame(0)
    elif not path.is_file():
        raise InputError("frames_mask_no_such", path=path)
    elif (signature := images.signature_of(path)).name == "JPEG":
        raise InputError("frames_mask_compressed_loss", path=path)
    else:
        is_tiff = signature.kind == "tiff"
        values = images.read_single(path, inverted_too=True) if is_tiff else images.read_image(path)
    values = np.nan_to_num(values if values.ndim == 2 else values.max(axis=2))
    inside = np.asarray(values != 0)
    partly = inside & (values != values.max())
    if partly.mean() > 0.1 and np.unique(values[partly]).size > LEVELS:
        raise InputError("frames_mask_has_many", path=path)
    if inside.all():
        raise InputError("frames_mask_has_no", path=path)
    return inside


def _of_polygon(corners: Sequence[tuple[float, float]], shape: tuple[int, int], key: str) -> Mask:
    from skimage.draw import polygon2mask

    if (count := len(corners)) > MOST_CORNERS:
        raise InputError(
            "has_corners_allowed_draw", key=key, corners_count=count, most_corners=MOST_CORNERS
        )
    points = np.array(corners)
    ends = np.roll(points, -1, axis=0)

    def side_of(p: NDArray[np.float64]) -> NDArray[np.float64]:
        """Twice the area of (side i, point j), by its sign the side on which the point lies."""
        along, off = (ends - points)[:, None], p[None] - points[:, None]
        return np.asarray(np.sign(along[..., 0] * off[..., 1] - along[..., 1] * off[..., 0]))

    # sides that only touch do not cross (O'Rourke (1998), Computational Geometry in C, 1.5)
    parted = side_of(points) * side_of(ends) < 0
    if len(crossing := np.argwhere(np.triu(parted & parted.T)) + 1):
        first, second = crossing[0].tolist()
        raise InputError("sides_after_corners_cross", key=key, sides=first, sides_2=second)
    area = 0.5 * abs(float(np.sum(points[:, 0] * ends[:, 1] - points[:, 1] * ends[:, 0])))
    if area < 1:
        raise InputError("encloses_pixels_give_least", key=key, area=area)
    outside, swapped = (
        (each < -1).any() or (each > np.array(shape)).any() for each in (points, points[:, ::-1])
    )
    if outside and not swapped:
        raise InputError("leaves_region_interest_pixels", key=key, shape=shape)
    inside: Mask = np.asarray(polygon2mask(shape, points), dtype=np.bool_)
    if not inside.any():
        raise InputError("holds_no_pixel_region", key=key, shape=shape)
    return inside


def open_arrays(frames: ArrayFrames) -> reading.Source:
    """The Source of frames in memory; InputError where no file may have their type or size."""
    rows, cols, *colours = frames.form
    dtype = reading.check_dtype(str(frames), frames.dtype)
    reading.check_size(str(frames), rows, cols, dtype.itemsize * (colours[0] if colours else 1))
    form = reading.StoredForm((rows, cols), 3 if colours else 1, dtype)
    times = frames.times()
    if times is not None and not np.isfinite(times).all():
        raise InputError("coordinate_time_s_holds_what", frames=frames)
    end = reading.next_time(*times[-2:]) if times is not None and len(times) > 1 else None
    return reading.Source(
        kind="array", form=form, sensor_bits=None, frames=partial(_frames, frames, form, times),
        extent=partial(reading.Extent, frames.count, end), files=(frames,),
        pixel_mm=frames.pixel_mm, start_s=None if times is None else 0.0,
    )  # fmt: skip


def _frames(
    frames: ArrayFrames, form: reading.StoredForm, times: tuple[float, ...] | None, start: int
) -> Generator[reading.Frame]:
    for index in range(start, frames.count):
        image = frames.frame(index)
        if image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)):
            raise InputError(
                "frame_has_shape_first", frames=frames, index=index, shape=image.shape,
                form=frames.form,
            )  # fmt: skip
        form.check(str(frames), image, f"frame {index}")
        yield reading.Frame(
            index, image, None if times is None else times[index], frames.label(index)
        )


class Parts:
    """The frames of several files in order. A file's first follows the last of the one before by
    that one's frame interval, or by its own time stamp where this goes on, as of recorders with one
    clock."""

    def __init__(
        self,
        files: tuple[Path, ...],
        opener: Callable[[Path], reading.Source],
        first: reading.Source,
    ) -> None:
        """`opener` opens one of the files; `first` is the first one's source."""
        self.files, self._opener = files, opener
        self._sources: dict[int, reading.Source] = {0: first}

    def source(self, number: int) -> reading.Source:
        """The source of a part, opened once; InputError where it is unlike the first."""
        if number not in self._sources:
            path, name, first = self.files[number], self.files[0].name, self._sources[0]
            source = self._opener(path)
            if (source.form, source.sensor_bits) != (first.form, first.sensor_bits):
                form, other = source.form, first.form
                raise InputError(
                    "holds_pixels_ones_files",
                    path=path, rows=form.shape[0], cols=form.shape[1], pixels=form.pixels,
                    bits=source.sensor_bits, name=name, shape=other.shape[0],
                    shape_2=other.shape[1], pixels_2=other.pixels, bits_2=first.sensor_bits,
                )  # fmt: skip
            scales = source.pixel_mm, first.pixel_mm
            if scales[0] and scales[1] and abs(scales[0] / scales[1] - 1) > reading.SAME:
                raise InputError(
                    "names_mm_pixel_files", path=path, scales=scales[0], name=name,
                    scales_2=scales[1],
                )  # fmt: skip
            self._sources[number] = source
        return self._sources[number]

    def listed(self) -> reading.Extent:
        """All parts' frames, by their packets where that can be done."""
        for source in map(self.source, range(len(self.files))):
            if source.listed is not None:
                source.listed()
        return self.extent()

    def begins(self, start: int) -> int:
        """The frame that decoding begins with to come to frame `start`, once all are counted."""
        for source, before, _, extent in self._in_turn(by_packets=True):
            if start < before + extent.count:
                return before + source.begins(start - before)
        return start

    def extent(self) -> reading.Extent:
        """All parts' frames, counted as surely as each of them is."""
        *_, (_, before, begin, last) = self._in_turn()
        end = None if begin is None or last.end_s is None else begin + last.end_s
        return reading.Extent(before + last.count, end)

    def frames(self, start: int) -> Generator[reading.Frame]:
        """The frames from number `start` on."""
        for source, before, begin, extent in self._in_turn(by_packets=True):
            if before + extent.count > start:
                for raw in source.frames(max(start - before, 0)):
                    time = None if raw.time_s is None or begin is None else begin + raw.time_s
                    yield replace(raw, index=before + raw.index, time_s=time)

    def _in_turn(
        self, *, by_packets: bool = False
    ) -> Iterator[tuple[reading.Source, int, float | None, reading.Extent]]:
        """Each part, the frames before it, when it begins (s; None: not known), and its extent."""
        before, first = 0, self._sources[0].start_s
        begin: float | None = 0.0
        for source in map(self.source, range(len(self.files))):
            if before and begin is not None:
                stamp = source.start_s
                begin = None if stamp is None or first is None else max(begin, stamp - first)
            extent = ((by_packets and source.listed) or source.extent)()
            yield source, before, begin, extent
            before += extent.count
            begin = None if begin is None or extent.end_s is None else begin + extent.end_s


def open_parts(files: tuple[Path, ...], opener: Callable[[Path], reading.Source]) -> reading.Source:
    """Several videos or TIFF stacks as one recording; a later one is opened when it is come to."""
    first = opener(files[0])
    if len(files) == 1:
        return first
    parts = Parts(files, opener, first)
    return replace(
        first, frames=parts.frames, extent=parts.extent, files=files, claimed=None, names=(),
        listed=parts.listed, begins=parts.begins,
    )  # fmt: skip


KNOWN = images.SUFFIXES + images.TIFF_SUFFIXES + video.SUFFIXES

SCALE = 0.005
"""Pixel sizes that differ by more than this part are not one size rounded to three digits."""


def open_frames(
    path: FramesLike,
    *,
    channel: reading.Channel | None = None,
    wavelength_nm: float | None = None,
    rotate_deg: Literal[0, 90, 180, 270] = 0,
    flip: Literal["horizontal", "vertical"] | None = None,
    roi: Roi | None = None,
    bit_depth: int | None = None,
    leave_out: Sequence[str | Path] = (),
) -> FrameReader:
    """Open captured frames: a TIFF stack, an image, a video, or a folder, list or glob of them.

    Several videos, or several TIFF stacks, are one recording, in natural order (part2 before
    part10) but for a list, which has its own. In place of files, frames may be given that are in
    memory, or that come one by one as they are asked for: an array (frame, row, col) or (frame,
    row, col, 3) of numpy, xarray or Dask, one picture (row, col) or (row, col, 3), or a list or
    PIMS sequence of pictures. They are taken as those of a file of their type, uint8, uint16 or
    float, where NaN is a pixel that is not known.

    Parameters
    ----------
    path : str, Path, sequence of them, array or sequence of arrays
        Where the frames are, or the frames themselves.
    channel : {'red', 'green', 'blue', 'mean'}, optional
        Channel of a colour source; by default the one nearest to `wavelength_nm`: below 490 blue,
        below 580 green, else red, unknown green.
    wavelength_nm : float, optional
        Wavelength of the light, nm.
    rotate_deg : {0, 90, 180, 270}, default 0
        Quarter turns of each picture, counter-clockwise as it is seen, degrees.
    flip : {'horizontal', 'vertical'}, optional
        How the turned picture is mirrored: left to right, or top to bottom.
    roi : Roi, optional
        The part of each turned picture to yield; by default all of it.
    bit_depth : int, optional
        Bits of the sensor; by default 8 or 16 by the file's type. Give 10 or 12 for such a sensor
        in a 16-bit file.
    leave_out : sequence of str or Path, optional
        Files of a folder that are no frames, such as a scene's no-load frames and mask.

    Returns
    -------
    FrameReader
        Streams frames (row, col) of raw grey levels; also a context manager.

    Raises
    ------
    InputError
        Where the frames cannot be read, or `roi` or `bit_depth` does not fit them; it names the
        file, the value and what to do.

    Examples
    --------
    >>> import isochrome
    >>> from isochrome.samples import samples_path
    >>> stack = samples_path() / "line-contact-wear" / "captured.tif"
    >>> with isochrome.open_frames(stack) as frames:
    ...     frames.kind, frames.bit_depth, frames.count()
    ('tiff', 8, 6)
    >>> import numpy
    >>> dark = numpy.zeros((2, 494, 659), dtype="uint16")
    >>> with isochrome.open_frames(dark, bit_depth=12) as frames:
    ...     frames.kind, frames.bit_depth, frames.count()
    ('array', 12, 2)
    """
    path = frames_of(path)
    if rotate_deg not in (0, 90, 180, 270):
        raise InputError("rotate_deg_no_quarter_turn", rotate_deg=rotate_deg)
    if flip not in (None, "horizontal", "vertical"):
        raise InputError("flip_not_known_give", flip=flip)
    source = _source(path, leave_out)
    label = f"{path[0]} ..." if isinstance(path, tuple) else path
    rows, cols = source.form.shape[:: -1 if rotate_deg in (90, 270) else 1]
    dtype = source.form.dtype
    if roi is not None and (roi.top_px + roi.height_px > rows or roi.left_px + roi.width_px > cols):
        raise InputError(
            "roi_rows_columns_lies",
            label=label, top_px=roi.top_px, height_px=roi.top_px + roi.height_px,
            left_px=roi.left_px, width_px=roi.left_px + roi.width_px, rows=rows, cols=cols,
            after=message("after_turn_frames_rotate_deg") if rotate_deg in (90, 270) else "",
        )  # fmt: skip
    container = 8 * dtype.itemsize if dtype.kind == "u" else None
    most = container or 16
    if bit_depth is None:
        bit_depth = source.sensor_bits or container
    elif not 1 <= bit_depth <= most:
        raise InputError(
            "bit_depth_does_not_fit", label=label, bit_depth=bit_depth, dtype=dtype, container=most
        )
    return FrameReader(
        source, path=path, channel=channel or channel_for(wavelength_nm), roi=roi,
        turn=(int(rotate_deg), flip), bit_depth=bit_depth,
    )  # fmt: skip


def open_scene_frames(
    path: FramesLike, scene: Scene, *, masked: bool = True, any_scale: bool = False
) -> FrameReader:
    """Open captured frames as a scene says; of a folder, files that it names are no frames.
    `masked` is False for no-load frames; with `any_scale` a file may name another pixel size than
    the scene."""
    options = reading_options(scene)
    reader = open_frames(path, **options, roi=scene.frames.roi, leave_out=named_files(scene))
    if not any_scale:
        check_scale(reader, scene.camera)
    if masked:
        mask = load_mask(scene, reader.shape, reader.full_shape)
        reader.mask = None if mask.all() else mask
    return reader


def reading_options(scene: Scene) -> dict[str, Any]:
    """How a scene says that whole frames are read, as options of `open_frames`."""
    stated = {name: getattr(scene.frames, name) for name in ("rotate_deg", "flip", "channel")}
    bits = scene.camera.bit_depth if scene.camera else None
    return stated | {"wavelength_nm": scene.polariscope.wavelength_nm, "bit_depth": bits}


def input_files(reader: FrameReader, scene: Scene) -> list[Path | ArrayFrames]:
    """The files, or arrays in their place, that results depend on: captured, then the scene's."""
    return [*reader.files, *scene.files(of_frames=True)]


def named_files(scene: Scene) -> list[Path]:
    """Files that a scene names, which are no frames of their folder, of a glob each."""
    named = (name for name in scene.files(of_frames=True) if isinstance(name, Path))
    return [
        each
        for name in named
        for each in ([name] if os.path.exists(name) else map(Path, glob.glob(os.fspath(name))))
    ]


def absolute(frames: FramesLike, scene: Scene) -> tuple[FramesLike, Scene]:
    """Frames and scene with absolute paths, as another machine stands in another folder."""
    located = frames_of(frames)
    if isinstance(located, str | Path):
        located = str(Path(located).absolute())
    elif isinstance(located, tuple):
        located = tuple(str(Path(path).absolute()) for path in located)
    return located, scene.model_copy(update={"folder": (scene.folder or Path()).absolute()})


def check_scale(reader: FrameReader, camera: Camera | None) -> None:
    """Refuse frames whose file names another pixel size than their camera's, by more than 0.5 %."""
    ours, file = camera.pixel_mm if camera else None, reader.pixel_mm
    if ours and file and abs(file / ours - 1) > SCALE:
        raise InputError("names_mm_pixel_camera", files=reader.files[0], file=file, ours=ours)


def with_file_scale(scene: Scene, reader: FrameReader) -> Scene:
    """The scene with the pixel size of the frames' file, where neither it nor a rim tells one."""
    camera = scene.camera or Camera()
    if camera.pixel_mm is not None or reader.pixel_mm is None or scene.rim_diameter_mm:
        return scene
    camera = camera.model_copy(update={"pixel_mm": reader.pixel_mm})
    return scene.model_copy(update={"camera": camera})


def channel_for(wavelength_nm: float | None) -> reading.Channel:
    """The colour channel that sees a wavelength best; green where it is not known."""
    if wavelength_nm is None:
        return "green"
    return "blue" if wavelength_nm < 490 else "green" if wavelength_nm < 580 else "red"


def _source(path: FramesLike, leave_out: Sequence[str | Path]) -> reading.Source:
    if isinstance(path, ArrayFrames):
        return open_arrays(path)
    if isinstance(path, tuple):
        if not path:
            raise InputError("list_frames_empty_name")
        return _of_files(tuple(map(Path, path)), "list")
    assert isinstance(path, str | Path)
    place = Path(path)
    try:
        folder, exists = place.is_dir(), os.path.lexists(place)
    except (OSError, ValueError) as error:  # a name that no file can have
        raise InputError("cannot_read_check_name_2", path=path, error=error) from error
    if folder:
        return _of_files(_files_in(place, leave_out), "folder")
    return _of_files((place,), "image") if exists else _of_files(matches(path), "list")


def matches(name: str | Path) -> tuple[Path, ...]:
    """The files and folders that a glob stands for, in natural order. Raises InputError."""
    paths = sorted(glob.glob(os.fspath(name)), key=reading.natural_key)
    if not paths:
        raise InputError("no_such_file_folder_check", name=name)
    return tuple(map(Path, paths))


_MOST_NAMED = 4
"""Files that a message names."""


def _files_in(folder: Path, leave_out: Sequence[str | Path]) -> tuple[Path, ...]:
    """The frame files of a folder in natural order, hidden ones left out. Raises InputError."""
    with reading.refusing(folder, message("folder_cannot_read")):
        files = [p for p in folder.iterdir() if p.is_file() and not p.name.startswith(".")]
        apart = {Path(name).resolve() for name in leave_out}
        known = [p for p in files if p.suffix.lower() in KNOWN]
        known.sort(key=lambda p: reading.natural_key(p.name))
        wanted = [p for p in known if p.resolve() not in apart]
    if known and not wanted:
        names = ", ".join(p.name for p in known[:_MOST_NAMED])
        raise InputError("holds_no_frame_besides", folder=folder, names=names)
    if not wanted:
        raise InputError("folder_holds_no_image", folder=folder, known=", ".join(KNOWN))
    return tuple(wanted)


def _of_files(files: tuple[Path, ...], kind: reading.Kind) -> reading.Source:
    for file in files:
        if file.suffix.lower() not in KNOWN:
            raise InputError("frames_cannot_read_from", file=file, known=", ".join(KNOWN))
    first_of: dict[str, Path] = {}
    for file in files:
        first_of.setdefault(images.signature_of(file).kind, file)
    moving = first_of.pop("video", None)
    if moving and first_of:
        still = next(iter(first_of.values()))
        alike = moving.with_name("*" + moving.suffix)
        raise InputError(
            "video_image_frames_either", moving=moving, name=still.name, with_name=alike
        )
    if moving:
        return open_parts(files, video.open_video)
    if set(first_of) == {"tiff"}:
        first = images.open_tiff(files[0])
        if len(files) == 1 and (kind == "image" or first.extent().count > 1):
            return first
        if first.extent().count > 1:
            return open_parts(files, images.open_tiff)
    return images.open_images(files, kind)


def recordings_of(
    names: Sequence[str | Path], *, join: bool = False
) -> tuple[reading.FramesPath, ...]:
    """The recordings that names stand for, in order, told without decoding: a folder, video or TIFF
    stack is one, images one to a file are one together; `join`: all are one. Globs, and names in
    the alphabet's order, as of a shell's glob, are in natural order (part2 before part10)."""
    places = _places(names)
    if len(names) == 1 and (join or len(places) == 1):
        return (names[0],)
    first = dict[bool | None, Path]()
    for place in places:
        if join and place.is_dir():
            raise InputError("folder_which_recording_itself", folder=place)
        if place.suffix.lower() not in KNOWN and not place.is_dir():
            raise InputError("frames_cannot_read_from_file", place=place, known=", ".join(KNOWN))
        first.setdefault(None if join else _holds_several(place), place)
    if join:
        return (tuple(places),)
    if False not in first:
        return tuple({os.path.abspath(place): place for place in places}.values())
    if True in first:
        raise InputError(
            "single_image_whole_recording", single=first[False], recordings=first[True]
        )
    return (names[0],) if len(names) == 1 else (tuple(places),)


def one_recording(names: Sequence[str | Path], *, join: bool = False) -> reading.FramesPath:
    """The one recording that names stand for, see `recordings_of`; several are refused."""
    recordings = recordings_of(names, join=join)
    if (count := len(recordings)) > 1:
        raise InputError(
            "recordings_one_wanted_here", recordings=recordings[0], recordings_2=recordings[1],
            words=" ..." if count > 2 else "", recordings_count=count,
        )  # fmt: skip
    return recordings[0]


def _places(names: Sequence[str | Path]) -> list[Path]:
    """Files and folders, in natural order where names are in the alphabet's (letters or codes)."""
    if not names:
        raise InputError("no_frames_named_name")
    texts = [str(name) for name in names]
    letters = ["".join(c for c in text.casefold() if c.isalnum()) for text in texts]
    if texts == sorted(texts) or letters == sorted(letters):
        names = sorted(names, key=reading.natural_key)
    places: list[Path] = []
    for name in names:
        plain = os.path.lexists(name) or not glob.has_magic(os.fspath(name))
        places += (Path(name),) if plain else matches(name)
    return places


def _holds_several(place: Path) -> bool | None:
    """Whether a place holds a recording by itself, None where a file does not tell."""
    if place.is_dir():
        return True
    try:
        kind = images.signature_of(place).kind
        return images.holds_several(place) if kind == "tiff" else kind == "video"
    except InputError:  # said of it when it is its turn
        return place.suffix.lower() in video.SUFFIXES or None
