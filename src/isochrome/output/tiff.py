"""TIFF stacks that ImageJ opens with their scale."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from isochrome.errors import InputError
from isochrome.output.files import replacing

DTYPES = ("uint8", "uint16", "float32")
IMAGEJ_LIMIT = 4_000_000_000
"""ImageJ's TIFF ends at 4 GB; beyond, a BigTIFF is written, which Fiji opens by Bio-Formats."""

Photometric = Literal["minisblack", "rgb"]


class TiffWriter:
    """A stack written one frame at a time, in memory that does not grow with it.

    Frames go to a hidden raw file beside `path`; a clean end of the `with` block turns it into
    the TIFF, an exception discards it.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        pixel_mm: float | None = None,
        description: str | None = None,
        photometric: Photometric = "minisblack",
    ) -> None:
        """Prepare a stack at `path`; `pixel_mm` is the pixel's side, `description` free text."""
        self.path = Path(path)
        self.pixel_mm = pixel_mm
        self.description = description
        self.photometric: Photometric = photometric
        self.count = 0
        self._shape: tuple[int, ...] = ()
        self._dtype = np.dtype(np.uint8)
        self._spool_path = self.path.with_name(f".{self.path.stem}-{secrets.token_hex(4)}.raw")

    def __enter__(self) -> TiffWriter:
        """Open the hidden file. Raises InputError where the folder cannot be written to."""
        try:
            self._spool = open(self._spool_path, "xb")
        except OSError as error:
            raise InputError(
                f"{self.path}: cannot be written ({error.strerror}); make its folder, or name "
                "another"
            ) from error
        return self

    def append(self, frame: npt.ArrayLike) -> None:
        """Add a frame, (row, col) or (row, col, 3) for rgb, of the first frame's shape and type.

        Types: uint8, uint16, float32 (NaN = not known); ImageJ's own layout knows colour in 8 bits
        only, others become a plain TIFF. Raises InputError on another.
        """
        image = np.asarray(frame)
        if self.count == 0:
            _check_frame(self.path, image, self.photometric)
            self._shape, self._dtype = image.shape, image.dtype
        if image.shape != self._shape or image.dtype != self._dtype:
            raise InputError(
                f"{self.path}: frame {self.count} is {image.shape} {image.dtype} and the first is "
                f"{self._shape} {self._dtype}; give all frames one size and type"
            )
        self._spool.write(np.ascontiguousarray(image).data)
        self.count += 1

    def _frames(self) -> Iterator[np.ndarray]:
        size = int(np.prod(self._shape)) * self._dtype.itemsize
        with open(self._spool_path, "rb") as file:
            for _ in range(self.count):
                yield np.frombuffer(file.read(size), self._dtype).reshape(self._shape)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Write the TIFF after a clean block; in any case remove the hidden file."""
        try:
            self._spool.close()
            if kind is None:
                if self.count == 0:
                    raise InputError(f"{self.path}: no frame to write; append at least one")
                shape = (self.count, *self._shape)
                write_frames(self.path, self._frames(), shape, self._dtype, **self._options())
        finally:
            os.unlink(self._spool_path)

    def _options(self) -> dict[str, Any]:
        return {
            "pixel_mm": self.pixel_mm,
            "description": self.description,
            "photometric": self.photometric,
        }


def write_tiff(
    path: str | Path,
    stack: npt.ArrayLike,
    *,
    pixel_mm: float | None = None,
    description: str | None = None,
    photometric: Photometric = "minisblack",
) -> None:
    """Write a stack, whole or not at all, so that ImageJ shows its scale.

    Parameters: `stack` (frame, row, col), or (frame, row, col, 3) with `photometric="rgb"`, of
    uint8, uint16 or float32 (NaN allowed), native byte order kept by value; `pixel_mm`, the
    pixel's side (mm); `description`, free text, ImageJ's Image > Show Info. Raises InputError.
    """
    data = np.asarray(stack)
    if data.ndim < 3 or data.shape[0] == 0:
        raise InputError(
            f"{path}: a stack is (frame, row, col) with a frame at least, not {data.shape}; "
            "add the frame axis"
        )
    _check_frame(path, data[0], photometric)
    write_frames(
        Path(path),
        iter(data),
        data.shape,
        data.dtype,
        pixel_mm=pixel_mm,
        description=description,
        photometric=photometric,
    )


def _check_frame(path: str | Path, image: np.ndarray, photometric: Photometric) -> None:
    ndim = 3 if photometric == "rgb" else 2
    if image.ndim != ndim or 0 in image.shape or (ndim == 3 and image.shape[2] != 3):
        wanted = "(row, col, 3)" if ndim == 3 else "(row, col)"
        raise InputError(f"{path}: a frame is {wanted}, not {image.shape}; reshape it")
    if image.dtype.name not in DTYPES:
        raise InputError(
            f"{path}: frames of type {image.dtype} cannot be written; convert them to "
            f"{' or '.join(DTYPES)}"
        )


def write_frames(
    path: Path,
    frames: Iterator[np.ndarray],
    shape: tuple[int, ...],
    dtype: np.dtype,
    *,
    pixel_mm: float | None = None,
    description: str | None = None,
    photometric: Photometric = "minisblack",
) -> None:
    """Write a stack as `write_tiff` does, from frames that are there one at a time.

    Parameters: `frames`, of the `dtype`, in order; `shape` of all of them; the rest as in
    `write_tiff`. Raises InputError.
    """
    import tifffile

    size = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    imagej = size < IMAGEJ_LIMIT and min(shape[1:3]) > 1  # tifffile turns single columns over
    imagej &= photometric != "rgb" or dtype == np.uint8
    keys: dict[str, Any] = {"photometric": photometric}
    if pixel_mm is not None:
        per_unit = 1 / pixel_mm if imagej else 10 / pixel_mm
        keys |= {"resolution": (per_unit, per_unit)}
        keys |= {} if imagej else {"resolutionunit": "CENTIMETER"}
    if imagej:
        keys["metadata"] = {"axes": "TYXS"[: len(shape)]}
        keys["metadata"] |= {"unit": "mm"} if pixel_mm is not None else {}
        keys["metadata"] |= {"Info": description} if description else {}
    elif description:  # on every page, as each may be read alone
        keys["description"] = description.encode("ascii", "replace").decode()
    order = dtype.newbyteorder("<")  # tifffile takes an iterator's frames as they are
    swapped = (frame.astype(order, copy=False) for frame in frames)
    with (
        replacing(path) as beside,
        tifffile.TiffWriter(
            beside, imagej=imagej, bigtiff=size >= IMAGEJ_LIMIT, byteorder="<"
        ) as tif,
    ):
        if imagej:
            tif.write(swapped, shape=shape, dtype=order, **keys)
        else:
            for frame in swapped:
                tif.write(frame, metadata=None, **keys)
