"""Single pictures for notebooks and scripts: each takes Axes, or makes some, and returns them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from isochrome.errors import InputError
from isochrome.figures.style import FRAME_MAP, Place, show_image
from isochrome.figures.values import draw_values
from isochrome.output import FrameValues

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def given_axes(axes: Axes | None) -> Axes:
    """The caller's Axes, or those of a new figure of matplotlib.pyplot, which a notebook shows."""
    if axes is not None:
        return axes
    from matplotlib import pyplot

    found: Axes = pyplot.subplots(layout="constrained")[1]
    return found


def place_of_image(image: Any, pixel_mm: float | None, left_mm: float, top_mm: float) -> Place:
    """The place of an image: as its coordinates z_mm and x_mm say, or as it is given."""
    coords = getattr(image, "coords", {})
    if pixel_mm is None and "x_mm" in coords and "z_mm" in coords:
        x, z = (np.asarray(coords[name], dtype=float) for name in ("x_mm", "z_mm"))
        if x.ndim == z.ndim == 1 and min(x.size, z.size) > 1:
            pixel = float(x[-1] - x[0]) / (x.size - 1)
            left = float(x[0]) - 0.5 * pixel + _own_shift(coords, "x")
            top = float(z[0]) - 0.5 * pixel + _own_shift(coords, "z")
            return {"pixel_mm": pixel, "left_mm": left, "top_mm": top}
    return {"pixel_mm": pixel_mm, "left_mm": left_mm, "top_mm": top_mm}


def _own_shift(coords: Any, name: str) -> float:
    """How far (mm) the one frame that an image is lies from its axis, where that is known."""
    own = (coords.get(f"{start}shift_{name}_mm") for start in ("", "key_"))
    found = next((float(at) for at in own if at is not None and np.ndim(at) == 0), 0.0)
    return found if np.isfinite(found) else 0.0


def plot_frame(
    frame: ArrayLike,
    axes: Axes | None = None,
    *,
    full: float | None = None,
    pixel_mm: float | None = None,
    left_mm: float = 0.0,
    top_mm: float = 0.0,
    title: str = "",
) -> Axes:
    """Draw a frame in grey at true proportions, x to the right and z down.

    In mm where its coordinates z_mm and x_mm, or `pixel_mm`, tell the scale; else in pixels.

    Parameters
    ----------
    frame : array_like, shape (rows, cols) or (rows, cols, 3)
        Grey levels, light, or colours.
    axes : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure of matplotlib.pyplot.
    full : float, optional
        The level of full light, which is white; by default that of the type, 255, 65535 or 1.
    pixel_mm : float, optional
        Side of a pixel, mm.
    left_mm : float, default 0.0
        Outer edge of the first column, mm.
    top_mm : float, default 0.0
        Outer edge of the first row, mm.
    title : str, default ''
        Title.

    Returns
    -------
    matplotlib.axes.Axes
        What was drawn on.

    Raises
    ------
    InputError
        Where the frame has another shape.

    Examples
    --------
    >>> import isochrome
    >>> sample = isochrome.samples.line_contact_wear()
    >>> axes = isochrome.plot_frame(sample.frames[0], pixel_mm=0.00607)
    >>> axes.get_xlabel()
    'x (mm)'
    """
    values = np.asarray(frame)
    if full is None:
        full = float(np.iinfo(values.dtype).max) if values.dtype.kind == "u" else 1.0
    place = place_of_image(frame, pixel_mm, left_mm, top_mm)
    drawn = given_axes(axes)
    show_image(drawn, values, cmap=FRAME_MAP, vmin=0, vmax=full, title=title, **place)
    return drawn


class WithFrameValues(Protocol):
    """A result with values of each frame: of `process`, `fit` or `track`."""

    @property
    def over_frames(self) -> FrameValues:
        """The values."""


def plot_over_distance(result: WithFrameValues, key: str, axes: Axes | None = None) -> Axes:
    """Draw a fitted value over the sliding distance, or the frames, with its band of 2 u.

    Frames that stand still are squares at the distance 0; frames without distances are counted.

    Parameters
    ----------
    result : Processed, Fit or Track
        What `process`, `fit` or `track` found.
    key : str
        A key with values in each frame, such as 'friction.coefficient'.
    axes : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure of matplotlib.pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        What was drawn on.

    Raises
    ------
    InputError
        Where the result has no such key.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0})
    >>> found = isochrome.process(isochrome.simulate(scene).frames, scene)
    >>> isochrome.plot_over_distance(found, "load.normal_n").get_ylabel()
    'normal load (N)'
    """
    values = result.over_frames
    if key not in values.keys:
        known = ", ".join(values.keys) or "none"
        raise InputError(f"{key}: has no value in each frame here; those that have: {known}")
    drawn = given_axes(axes)
    draw_values(drawn, values, key)
    return drawn
