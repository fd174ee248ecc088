"""Frames that are given as arrays, wherever the name of a file may stand."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence, Set
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Protocol, get_args

import numpy as np
from pydantic import PlainSerializer, PlainValidator
from pydantic_core import PydanticCustomError

from isochrome.errors import InputError, reason_of
from isochrome.messages import message

MOST_FRAMES = 1_000_000
"""More frames than that are no recording: some hours at 100 frames a second."""

_WHAT = "frames_array_frame_row"

_NAMED = (("row", "col"), ("z_mm", "x_mm"), ("y", "x"), ("Y", "X"))
"""Names that the axes of a picture have where they have names."""


class FrameSequence(Protocol):
    """What gives frames by their number: an array, or a sequence of them, in memory or not."""

    def __len__(self) -> int:
        """How many frames there are."""

    def __getitem__(self, index: int, /) -> Any:
        """One frame (row, col) or (row, col, 3)."""


class ArrayFrames:
    """Frames in an array, or in what yields arrays, such as those of xarray, Dask and PIMS.

    Of a lazy one nothing is computed but the frame that is asked for. An array of three axes whose
    last has the length 3 is one frame in colour.

    Parameters
    ----------
    given : array_like or sequence of array_like
        An array (frame, row, col), (frame, row, col, 3), (row, col) or (row, col, 3), or a sequence
        of frames. An xarray.DataArray may have its times as the coordinate time_s, and the pixels'
        places as z_mm and x_mm.
    name : str, optional
        What it is called in messages; by default its form.

    Attributes
    ----------
    count : int
        Number of frames.
    form : tuple of int
        Shape of a frame, (row, col) or (row, col, 3).
    dtype : dtype
        Type of its pixels.
    pixel_mm : float or None
        Side of a pixel, mm, where coordinates tell it.

    Raises
    ------
    InputError
        Where it holds no frames; it says what it is, and what is allowed.
    """

    def __init__(self, given: object, name: str | None = None) -> None:
        self.given, self._name = given, name
        # np.asarray would make something of these, and not what was meant
        if isinstance(given, np.ma.MaskedArray):
            self._refuse_masked()
        if isinstance(given, Iterator):
            raise InputError("can_gone_through_once", called=self._called)
        if isinstance(given, Mapping | Set | bytes | bytearray):
            raise InputError("holds_no_frames_order", called=self._called, what=message(_WHAT))
        self._stacked = False
        if hasattr(given, "shape") and hasattr(given, "dtype"):
            shape = tuple(int(size) for size in given.shape)
            single = len(shape) == 2 or (len(shape) == 3 and shape[-1] == 3)
            self._stacked = not single
            self.count = 1 if single else next(iter(shape), 0)
            self.form = shape if single else shape[1:]
            try:
                self.dtype = np.dtype(given.dtype)
            except TypeError:  # numpy does not know it
                self.dtype = np.dtype(object)
        elif hasattr(given, "__len__") and hasattr(given, "__getitem__"):
            self._stacked, self.count = True, len(given)
            self._check_count()
            first = self._item(0)
            self.form, self.dtype = first.shape, first.dtype
        else:
            raise InputError("neither_file_name_nor", called=self._called, what=message(_WHAT))
        self._check_count()
        self._check_form()
        self.pixel_mm = self._scale()

    @property
    def _called(self) -> str:
        return self._name or f"an object of type {type(self.given).__name__}"

    def __str__(self) -> str:
        """Its name, or what it is."""
        if self._name is not None:
            return self._name
        many = f"{self.count} frames, " if self._stacked else ""
        return f"array of {many}{' x '.join(map(str, self.form))} {self.dtype}"

    def __repr__(self) -> str:
        return f"<{self}>"

    def __eq__(self, other: object) -> bool:
        """Whether both hold the very same array."""
        return isinstance(other, ArrayFrames) and other.given is self.given

    def __hash__(self) -> int:
        return id(self.given)

    def frame(self, index: int) -> np.ndarray:
        """A copy of frame `index`, (row, col) or (row, col, 3), in native byte order."""
        image = self._item(index)
        return np.array(image, dtype=image.dtype.newbyteorder("="))

    def label(self, index: int) -> str:
        """What a frame is called."""
        stem = self._name or "array"
        return f"{stem}[{index}]" if self._stacked else stem

    def times(self) -> tuple[float, ...] | None:
        """When the frames were captured (s), from the first on; None where nobody has said."""
        times = self._coordinate("time_s")
        if times is None or times.shape != (self.count,):
            return None
        return tuple((times - times[0]).tolist())

    def digest(self) -> str:
        """The SHA-256 of its form and of all pixels, as hexadecimal text."""
        digest = hashlib.sha256(f"{self.count} {self.form} {self.dtype.name}".encode())
        digest.update(repr(self.times()).encode())
        for index in range(self.count):
            digest.update(np.ascontiguousarray(self.frame(index)).data)
        return digest.hexdigest()

    def _item(self, index: int) -> np.ndarray:
        """A frame as it is given."""
        try:
            item: Any = self.given[index] if self._stacked else self.given  # type: ignore[index]
            if isinstance(item, np.ma.MaskedArray):
                self._refuse_masked()
            return np.asarray(item)
        except InputError:
            raise
        except Exception as error:  # whatever computes or reads a lazy one
            raise InputError(
                "frame_cannot_read", called=self._called, index=index, kind=type(error).__name__,
                reason=reason_of(error), what=message(_WHAT),
            ) from error  # fmt: skip

    def _refuse_masked(self) -> None:
        raise InputError("masked_array_whose_mask", called=self._called)

    def _check_count(self) -> None:
        if not 1 <= self.count <= MOST_FRAMES:
            raise InputError(
                "holds_frames_allowed_give", called=self._called, count=self.count,
                most_frames=MOST_FRAMES,
            )  # fmt: skip

    def _check_form(self) -> None:
        """Refuse frames of other axes, or of axes in another order."""
        form = self.form
        if len(form) not in (2, 3) or (len(form) == 3 and form[2] != 3):
            more = "; leave transparency out, as [..., :3] does" if form[2:] == (4,) else ""
            raise InputError(
                "frame_has_shape", value=self, form=form, what=message(_WHAT), more=more
            )
        if isinstance(self.given, Sequence):
            for index in range(self.count):
                shape = np.shape(self._item(index))
                if shape != form:
                    raise InputError(
                        "frame_has_shape_first_all", value=self, index=index, shape=shape, form=form
                    )
        dims = tuple(getattr(self.given, "dims", ()))
        start = 1 if self._stacked else 0
        for pair in _NAMED:
            if set(pair) <= set(dims) and dims[start : start + 2] != pair:
                raise InputError(
                    "axes_picture_two_put", value=self, dims=dims, pair=pair[0], pair_2=pair[1]
                )

    def _coordinate(self, name: str) -> np.ndarray | None:
        """A coordinate of an array that has them; None where it has not this one."""
        coords = getattr(self.given, "coords", None)
        if not isinstance(coords, Mapping) or name not in coords:
            return None
        return np.asarray(coords[name], dtype=float)

    def _scale(self) -> float | None:
        """The side of a pixel by the coordinates. Raises InputError where they are uneven."""
        common = None
        for name, count in zip(("z_mm", "x_mm"), self.form, strict=False):
            places = self._coordinate(name)
            if places is None or places.shape != (count,) or count < 2:
                continue
            steps = np.diff(places)
            side = float(steps.mean())
            even = side > 0 and np.ptp(steps) <= 1e-3 * side
            if not even or abs((common or side) / side - 1.0) >= 1e-3:
                raise InputError("coordinate_does_not_rise", value=self, name=name)
            common = side
        return common


FramesLike = str | Path | Sequence[str | Path] | FrameSequence | ArrayFrames
"""Frames as a caller may give them: files, or arrays."""


def frames_of(given: FramesLike | Iterator[str | Path]) -> FramesLike:
    """Names of files as a caller gives them, all else as ArrayFrames; InputError for neither."""
    if isinstance(given, str | Path | ArrayFrames):
        return given
    if isinstance(given, Iterator):
        first = tuple(islice(given, 1))
        if not isinstance(next(iter(first), ""), str | Path):
            return ArrayFrames(given)  # which refuses it
        given = (*first, *given)
    if isinstance(given, Sequence):
        named = [isinstance(item, str | Path) for item in given]
        if all(named):
            return tuple(given)
        if any(named):
            raise InputError("frames_files_arrays_mixed")
    return ArrayFrames(given)


def no_escape(name: str) -> str:
    """Refuse a name in which a backslash of TOML's double quotes became another letter."""
    if any(letter in name for letter in "\b\t\n\f\r\x1b"):
        raise ValueError(message("holds_letter_no_name", name=name))
    return name


def _file_or_array(value: Any) -> str | ArrayFrames:
    """A key's image. Raises ValueError."""
    if isinstance(value, ArrayFrames):
        return value
    if isinstance(value, str | Path):
        if not str(value):
            raise PydanticCustomError("empty", "String should have at least 1 character")
        return no_escape(str(value))
    if isinstance(value, int | float | Mapping) or value is None:
        raise PydanticCustomError("image", "Input should be a valid string (or in Python an array)")
    return ArrayFrames(value)


ImageFile = Annotated[
    str | ArrayFrames, PlainValidator(_file_or_array), PlainSerializer(str, when_used="json")
]
"""An image that a scene or a set names: a file, or in Python an array."""


def takes_arrays(annotation: Any) -> bool:
    """Whether a key of this type may be an array that is an image."""
    return annotation is ArrayFrames or any(map(takes_arrays, get_args(annotation)))
