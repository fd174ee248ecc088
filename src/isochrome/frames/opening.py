"""Which reader a path needs, and what is read from it: channel, region, bit depth."""

from __future__ import annotations

import glob
import os
from pathlib import Path

from isochrome.errors import InputError
from isochrome.frames import images, tiff, video
from isochrome.frames.mask import load_mask
from isochrome.frames.parts import open_parts
from isochrome.frames.reader import Channel, FrameReader, FramesPath
from isochrome.frames.source import Kind, Source, natural_key, refusing
from isochrome.scene import Camera, Roi, Scene

KNOWN = images.SUFFIXES + tiff.SUFFIXES + video.SUFFIXES

SCALE = 0.005
"""Pixel sizes that differ by more than this part are not one size rounded to three digits."""


def open_frames(
    path: FramesPath,
    *,
    channel: Channel | None = None,
    wavelength_nm: float | None = None,
    roi: Roi | None = None,
    bit_depth: int | None = None,
) -> FrameReader:
    """Open captured frames: a TIFF stack, an image, a video, or a folder, list or glob of them.

    Several videos, or several TIFF stacks, are one recording, in natural order (part2 before
    part10) but for a list, which has its own.
    Parameters: `path`; `channel` of a colour source ('red', 'green', 'blue', 'mean'; when None, the
    one nearest to `wavelength_nm`: below 490 blue, below 580 green, else red, unknown green);
    `roi`, the part to yield; `bit_depth` of the sensor (when None, 8 or 16 by the file's type;
    give 10 or 12 for such a sensor in a 16-bit file). Returns a FrameReader, also a context
    manager. Raises InputError that names the file, the value and what to do.
    """
    source = _source(path)
    label = path if isinstance(path, str | Path) else f"{path[0]} ..."
    rows, cols = source.form.shape
    dtype = source.form.dtype
    if roi is not None and (roi.top_px + roi.height_px > rows or roi.left_px + roi.width_px > cols):
        raise InputError(
            f"{label}: the roi, rows {roi.top_px} to {roi.top_px + roi.height_px} and columns "
            f"{roi.left_px} to {roi.left_px + roi.width_px}, lies outside the frame of {rows} rows "
            f"and {cols} columns; correct frames.roi"
        )
    container = 8 * dtype.itemsize if dtype.kind == "u" else None
    if bit_depth is None:
        bit_depth = source.sensor_bits or container
    elif not 1 <= bit_depth <= (container or 16):
        raise InputError(
            f"{label}: bit_depth = {bit_depth} does not fit pixels of type {dtype}, which "
            f"take 1 to {container or 16}; correct camera.bit_depth"
        )
    taken = channel or channel_for(wavelength_nm)
    return FrameReader(source, path=path, channel=taken, roi=roi, bit_depth=bit_depth)


def open_scene_frames(
    path: FramesPath, scene: Scene, *, masked: bool = True, any_scale: bool = False
) -> FrameReader:
    """Open captured frames as a scene says: its roi, channel, wavelength, bit depth and mask.

    Parameters: `path` as for `open_frames`; `scene`; `masked`, False to leave the specimen's mask
    out, as for no-load frames; `any_scale`, True to open a file that names another pixel size than
    the scene too. Returns a FrameReader. Raises InputError.
    """
    reader = open_frames(
        path,
        channel=scene.frames.channel,
        wavelength_nm=scene.polariscope.wavelength_nm,
        roi=scene.frames.roi,
        bit_depth=scene.camera.bit_depth if scene.camera else None,
    )
    if not any_scale:
        check_scale(reader, scene.camera)
    if masked:
        mask = load_mask(scene, reader.shape, reader.full_shape)
        reader.mask = None if mask.all() else mask
    return reader


def check_scale(reader: FrameReader, camera: Camera | None) -> None:
    """Refuse frames whose file names another pixel size than the camera that they are read for.

    Parameters: `reader`; `camera`, a scene's or a calibration set's. Raises InputError.
    """
    ours, file = camera.pixel_mm if camera else None, reader.pixel_mm
    if ours and file and abs(file / ours - 1) > SCALE:
        raise InputError(
            f"{reader.files[0]}: names {file:.6g} mm a pixel, and camera.pixel_mm is {ours:.6g}; "
            "correct the one that is wrong (the file's in ImageJ: Analyze > Set Scale)"
        )


def with_file_scale(scene: Scene, reader: FrameReader) -> Scene:
    """The scene with the pixel size that the frames' file names, where it gives none itself.

    A disc's is left open, as its rim tells it better. Parameters: `scene`; `reader` of its frames.
    Returns the scene, the same where there is nothing to take.
    """
    camera = scene.camera or Camera()
    if camera.pixel_mm is not None or reader.pixel_mm is None or scene.model == "disc":
        return scene
    return scene.model_copy(
        update={"camera": camera.model_copy(update={"pixel_mm": reader.pixel_mm})}
    )


def channel_for(wavelength_nm: float | None) -> Channel:
    """The colour channel that sees a wavelength (nm) best; green where it is not known."""
    if wavelength_nm is None:
        return "green"
    return "blue" if wavelength_nm < 490 else "green" if wavelength_nm < 580 else "red"


def _source(path: FramesPath) -> Source:
    if not isinstance(path, str | Path):
        files = tuple(Path(p) for p in path)
        if not files:
            raise InputError("the list of frames is empty; name at least one image")
        return _of_files(files, "list")
    place = Path(path)
    try:
        folder, there = place.is_dir(), os.path.lexists(place)
    except (OSError, ValueError) as error:  # a name that no file can have
        raise InputError(f"{path}: cannot be read ({error}); check its name") from error
    if folder:
        return _of_files(_files_in(place), "folder")
    if not there:
        found = sorted(glob.glob(os.fspath(path)), key=natural_key)
        if not found:
            raise InputError(f"{path}: no such file or folder; check its name")
        return _of_files(tuple(map(Path, found)), "list")
    return _of_files((place,), "image")


def _files_in(folder: Path) -> tuple[Path, ...]:
    """The frame files of a folder in natural order, hidden ones left out. Raises InputError."""
    with refusing(folder, "the folder cannot be read"):
        found = [p for p in folder.iterdir() if p.is_file() and not p.name.startswith(".")]
    wanted = sorted((p for p in found if _suffix(p) in KNOWN), key=lambda p: natural_key(p.name))
    if not wanted:
        raise InputError(
            f"{folder}: the folder holds no image and no video; they end in {', '.join(KNOWN)}; "
            "name a folder with frames"
        )
    return tuple(wanted)


def _suffix(path: Path) -> str:
    return path.suffix.lower()


def _of_files(files: tuple[Path, ...], kind: Kind) -> Source:
    for file in files:
        if _suffix(file) not in KNOWN:
            raise InputError(
                f"{file}: frames cannot be read from a file of this kind; known are "
                f"{', '.join(KNOWN)}, or a folder of images or videos"
            )
    moving = [f for f in files if _suffix(f) in video.SUFFIXES]
    if moving and len(moving) < len(files):
        still = next(f for f in files if f not in moving)
        raise InputError(
            f"{moving[0]}: is a video and {still.name} an image, and frames are either; name the "
            f"ones wanted, such as '{moving[0].with_name('*' + moving[0].suffix)}'"
        )
    if moving:
        alone = len(files) == 1
        return video.open_video(files[0]) if alone else open_parts(files, video.open_video)
    if all(_suffix(f) in tiff.SUFFIXES for f in files):
        first = tiff.open_tiff(files[0])
        if len(files) == 1 and (kind == "image" or first.extent().count > 1):
            return first
        if first.extent().count > 1:
            return open_parts(files, tiff.open_tiff)
    return images.open_images(files, kind)
