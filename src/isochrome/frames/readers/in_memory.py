"""Frames from arrays in memory, or from what yields them one by one."""

from __future__ import annotations

from collections.abc import Generator
from functools import partial

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.source import (
    Extent,
    RawFrame,
    Source,
    StoredForm,
    check_dtype,
    check_size,
    next_time,
)
from isochrome.scene import ArrayFrames


def open_arrays(frames: ArrayFrames) -> Source:
    """Look at the form of frames in memory. Returns their Source.

    Parameters: `frames`. Raises InputError where their type or size is none that a file may have.
    """
    rows, cols, *colours = frames.form
    dtype = check_dtype(str(frames), frames.dtype)
    check_size(str(frames), rows, cols, dtype.itemsize * (colours[0] if colours else 1))
    form = StoredForm((rows, cols), 3 if colours else 1, dtype)
    times = frames.times()
    if times is not None and not np.isfinite(times).all():
        raise InputError(
            f"{frames}: its coordinate time_s holds what is no number; correct or drop it"
        )
    end = next_time(*times[-2:]) if times is not None and len(times) > 1 else None
    return Source(
        kind="array",
        form=form,
        sensor_bits=None,
        frames=partial(_frames, frames, form, times),
        extent=partial(Extent, frames.count, end),
        files=(frames,),
        pixel_mm=frames.pixel_mm,
        start_s=None if times is None else 0.0,
    )


def _frames(
    frames: ArrayFrames, form: StoredForm, times: tuple[float, ...] | None, start: int
) -> Generator[RawFrame]:
    for index in range(start, frames.count):
        image = frames.frame(index)
        if image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)):
            raise InputError(
                f"{frames}: frame {index} has the shape {image.shape} and the first "
                f"{frames.form}; give all frames alike"
            )
        form.check(str(frames), image, f"frame {index}")
        yield RawFrame(image, None if times is None else times[index], frames.label(index))
