"""Where the specimen is in the frame, as the scene says: a mask image, ImageJ areas, a polygon."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.frames.readers import tiff
from isochrome.frames.readers.images import read_image, signature_of
from isochrome.messages import message
from isochrome.output import SUFFIXES, read_roi_mask
from isochrome.scene import ArrayFrames, Frames

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
    """The specimen's pixels, inside frames.mask, frames.polygon_px and closed free boundaries.

    True = specimen, of the roi's size `shape`; all True where the scene names none. InputError
    where the file is missing, a picture, of neither size, or leaves no pixel.
    """
    inside = np.ones(shape, dtype=bool)
    frames = scene.frames
    if frames.mask is not None:
        inside &= _of_file(scene.path(frames.mask), frames, shape, full_shape)
    closed = {f"frames.free_boundary[{i}]": b for i, b in enumerate(frames.free_boundary, start=1)}
    polygons = {key: b.places[:-1] for key, b in closed.items() if b.is_closed}
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
        region = "" if shape == full_shape else f", their region of interest {shape}"
        raise InputError(
            "frames_mask_pixels_rows",
            path=path,
            shape=full.shape,
            full_shape=full_shape,
            region=region,
        )
    if not part.any():
        raise InputError("frames_mask_leaves_no", path=path, where=where)
    return part


def _of_image(path: Path | ArrayFrames) -> Mask:
    """An image's nonzero pixels, (row, col)."""
    values = _values(path)
    values = np.nan_to_num(values if values.ndim == 2 else values.max(axis=2))
    inside = np.asarray(values != 0)
    partly = inside & (values != values.max())
    if partly.mean() > 0.1 and np.unique(values[partly]).size > LEVELS:
        raise InputError("frames_mask_has_many", path=path)
    if inside.all():
        raise InputError("frames_mask_has_no", path=path)
    return inside


def _values(path: Path | ArrayFrames) -> np.ndarray:
    if isinstance(path, ArrayFrames):
        if path.count != 1 or path.dtype.kind not in "biuf":
            raise InputError("frames_mask_one_picture", path=path)
        return path.frame(0)
    if not path.is_file():
        raise InputError("frames_mask_no_such", path=path)
    signature = signature_of(path)
    if signature.name == "JPEG":
        raise InputError("frames_mask_compressed_loss", path=path)
    if signature.kind == "tiff":
        return tiff.read_single(path, inverted_too=True)
    return read_image(path)


def _of_polygon(corners: Sequence[tuple[float, float]], shape: tuple[int, int], key: str) -> Mask:
    """Pixels whose centres lie in a polygon of (row, col)."""
    from skimage.draw import polygon2mask

    if len(corners) > MOST_CORNERS:
        raise InputError(
            "has_corners_allowed_draw",
            key=key,
            corners_count=len(corners),
            most_corners=MOST_CORNERS,
        )
    points = np.array(corners)
    ends = np.roll(points, -1, axis=0)
    area = 0.5 * abs(float(np.sum(points[:, 0] * ends[:, 1] - points[:, 1] * ends[:, 0])))
    sides = crossing_sides(points)
    if sides is not None:
        raise InputError(
            "sides_after_corners_cross", key=key, sides=sides[0] + 1, sides_2=sides[1] + 1
        )
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


def crossing_sides(points: NDArray[np.float64]) -> tuple[int, int] | None:
    """The first two sides of a closed polygon (n, 2) that cross, by the signs of four triangles'
    areas.

    Side i goes from corner i, from 0, to the next. Sides that only touch do not cross. Source:
    O'Rourke (1998), Computational Geometry in C, section 1.5.
    """
    ends = np.roll(points, -1, axis=0)

    def side_of(p: NDArray[np.float64]) -> NDArray[np.float64]:
        """Twice the area of (side i, point j), by its sign the side on which the point lies."""
        along, off = (ends - points)[:, None], p[None] - points[:, None]
        return np.sign(along[..., 0] * off[..., 1] - along[..., 1] * off[..., 0])

    parted = side_of(points) * side_of(ends) < 0
    pairs = np.argwhere(np.triu(parted & parted.T))
    return (int(pairs[0, 0]), int(pairs[0, 1])) if len(pairs) else None
