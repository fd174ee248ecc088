"""What pictures of a simulation are made of: fringes, principal stresses, pressure, worn depth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import SurfaceState
from isochrome.errors import InputError
from isochrome.figures import (
    BOLD_PT,
    DIFFERENCE_MAP,
    FINE_PT,
    INK,
    LINE_COLOURS,
    PaperPanels,
    PictureKind,
    Plot,
    add_legend,
    centred_limit,
    given_axes,
    plain_name,
    plot_frame,
    show_image,
    style_axes,
)
from isochrome.scene import Scene
from isochrome.simulation.model import SceneState
from isochrome.stress import PixelGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

    from isochrome.simulation.rendering import Rendered

_NAMES = {"sigma_1": "σ₁", "sigma_2": "σ₂"}
"""In letters that are no smaller than the others'."""


def stress_kinds(pixels: PixelGrid, items: Sequence[Rendered]) -> list[PictureKind]:
    """Maps of sigma_1 and of sigma_2, each of one scale; none where they were not asked for."""
    kinds = []
    for name, plain in _NAMES.items():
        maps = [item.components.maps[name] for item in items if item.components]
        if len(maps) == len(items):
            limit = centred_limit(*maps, percentile=99.8)

            def draw(axes: Axes, k: int, maps: Any = maps, limit: float = limit) -> AxesImage:
                return _draw_stress(axes, items[k], maps[k], pixels, limit)

            kinds.append(PictureKind(name=plain, draw=draw, bar=f"{plain} (MPa)"))
    return kinds


def _draw_stress(
    axes: Axes, item: Rendered, image: np.ndarray, pixels: PixelGrid, limit: float
) -> AxesImage:
    """A map, red in tension, a cross at the largest shear, carets at the contact's edges."""
    look: dict[str, Any] = {"cmap": DIFFERENCE_MAP, "vmin": -limit, "vmax": limit}
    shown = show_image(axes, image, **look, **pixels.scale)
    assert item.components is not None
    peak, surface = item.components.peak, item.state.surface
    _, right, *_ = pixels.window
    if surface is not None and pixels.top_mm <= 0.0:
        from matplotlib.markers import CARETDOWN  # its tip, not its middle, is at the place

        edges = [x for x in surface.edges_mm if pixels.left_mm <= x <= right]
        axes.plot(edges, [0.0] * len(edges), marker=CARETDOWN, color=INK, ls="", clip_on=False)
    axes.plot(peak.x_mm, peak.z_mm, "x", color=LINE_COLOURS[2], ms=8, mew=BOLD_PT, clip_on=False)
    axes.set_xlim(pixels.left_mm, right)
    return shown


def simulation_panels(scene: Scene, pixels: PixelGrid, items: Sequence[Rendered]) -> PaperPanels:
    """Frames, maps of the principal stresses where they were asked for, a contact's profiles."""
    bits = scene.camera.bit_depth if scene.camera is not None else None
    full = 1.0 if bits is None else 2**bits - 1

    def frame(axes: Axes, k: int) -> AxesImage:
        plot_frame(items[k].frames[0], axes, full=full, **pixels.scale)
        return axes.images[0]

    kinds = [PictureKind(name="frame", draw=frame), *stress_kinds(pixels, items)]
    states = [item.state for item in items]
    plots = []
    if items[0].state.surface is not None:
        plots.append(Plot(title="pressure", draw=partial(plot_pressure, states)))
        surfaces = [state.surface for state in states if state.surface is not None]
        if any(np.any(surface.wear_depth_mm != 0.0) for surface in surfaces):
            plots.append(Plot(title="worn depth", draw=partial(plot_scar, states)))
    return PaperPanels(
        kinds=kinds,
        labels=[plain_name(item.state.label, 24) for item in items],
        plots=plots,
        legend=[state.label for state in states] if plots and len(items) > 1 else (),
        notes=[
            f"{item.state.label}: N up to {float(np.nanmax(item.picture.order)):.2f}."
            for item in items
        ],
    )


States = SceneState | Sequence[SceneState]


def plot_pressure(states: States, axes: Axes | None = None) -> Axes:
    """Draw the pressure along the surface of a contact, one line a state.

    It reaches a little beyond the widest contact.

    Parameters
    ----------
    states : SceneState or sequence of SceneState
        States of a contact, of `scene_states` or of what `simulate` gave.
    axes : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure of matplotlib.pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        What was drawn on.

    Raises
    ------
    InputError
        Where a state is not a contact's.

    Examples
    --------
    >>> import isochrome
    >>> states = isochrome.scene_states(isochrome.load_scene("line-contact-wear"))
    >>> isochrome.plot_pressure(states).get_ylabel()
    'pressure p (MPa)'
    """
    return _along_surface(states, axes, "pressure p (MPa)", lambda own: own.pressure_mpa)


def plot_scar(states: States, axes: Axes | None = None) -> Axes:
    """Draw the worn depth along the surface of a contact, downwards, one line a state.

    It reaches a little beyond the widest contact.

    Parameters
    ----------
    states : SceneState or sequence of SceneState
        States of a contact, of `scene_states` or of what `simulate` gave.
    axes : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure of matplotlib.pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        What was drawn on.

    Raises
    ------
    InputError
        Where a state is not a contact's.

    Examples
    --------
    >>> import isochrome
    >>> states = isochrome.scene_states(isochrome.load_scene("line-contact-wear"))
    >>> isochrome.plot_scar(states).get_ylabel()
    'worn depth h (µm)'
    """
    drawn = _along_surface(states, axes, "worn depth h (µm)", lambda own: 1e3 * own.wear_depth_mm)
    if not drawn.yaxis_inverted():
        drawn.invert_yaxis()
    return drawn


def _along_surface(
    states: States, axes: Axes | None, label: str, value: Callable[[SurfaceState], NDArray[Any]]
) -> Axes:
    """One line a state, over the widest contact and a little beyond."""
    given = [states] if isinstance(states, SceneState) else list(states)
    surfaces = [state.surface for state in given if state.surface is not None]
    if not surfaces or len(surfaces) < len(given):
        raise InputError("states_without_surface_under")
    drawn = given_axes(axes)
    for state, surface, colour in zip(given, surfaces, cycle(LINE_COLOURS), strict=False):
        drawn.plot(surface.grid.x_mm, value(surface), color=colour, lw=BOLD_PT, label=state.label)
    widest = max(abs(edge) for surface in surfaces for edge in surface.edges_mm)
    style_axes(drawn, x_label="x (mm)", z_label=label)
    drawn.set_xlim(-1.25 * widest, 1.25 * widest)
    drawn.grid(alpha=0.3, lw=FINE_PT)
    if axes is None and len(given) > 1:
        add_legend(drawn)
    return drawn
