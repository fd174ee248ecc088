"""From states to what the camera stores of them, one state at a time, with axes in mm.

States are rendered chunk by chunk, by whoever asks. The wear run comes first and is sequential:
each process solves it once, as far as it needs it, a tenth of what rendering costs.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.contact import SurfaceState
from isochrome.errors import InputError, PhysicsError
from isochrome.optics import expose, fringe_order
from isochrome.output import csv_text, evenly_spaced
from isochrome.runs import Column, Results, make_dataset
from isochrome.scene import Scene
from isochrome.simulation.model import (
    Picture,
    SceneState,
    iter_scene_states,
    make_picture,
    picture_signal,
    refuse_too_fine,
    required_model,
    state_difference,
)
from isochrome.specimens import specimen_model
from isochrome.stress import PixelGrid, ShearPeak, pixel_grid, principal_direction

if TYPE_CHECKING:
    from isochrome.runs import RunArray, RunDataset

LAYERS = ("sigma_1", "sigma_2", "sigma_1_direction", "sigma_x", "sigma_z", "tau_xz")
"""Names of the maps that `simulate` leaves: MPa, the direction in degrees."""


@dataclass(frozen=True)
class Components:
    """All that the model knows of one state's stress."""

    # each of LAYERS by its name (rows, cols), NaN outside the material
    maps: dict[str, NDArray[np.float32]]
    # the largest shear in the material in view, its surface included (under point loads, which
    # make it infinite, that at the pixels' centres)
    peak: ShearPeak


def state_components(
    scene: Scene, state: SceneState, picture: Picture, pixels: PixelGrid
) -> Components:
    """Stress components, principal stresses and the largest shear of one state.

    sigma_1,2 = (sigma_x + sigma_z)/2 ± |(sigma_x - sigma_z) + 2i tau_xz|/2; direction of sigma_1
    counter-clockwise from the image's +x, -90 to 90. Source: Timoshenko & Goodier (1970), section
    9.
    """
    model = specimen_model(scene)
    stress = model.components(scene, state.surface, pixels)
    first, second = stress.principal
    direction = np.degrees(principal_direction(stress.difference))
    arrays = (first, second, direction, stress.sigma_x, stress.sigma_z, stress.tau_xz)
    maps = {
        name: np.where(picture.material, array, np.nan).astype(np.float32)
        for name, array in zip(LAYERS, arrays, strict=True)
    }
    difference = maps["sigma_1"] - maps["sigma_2"]
    return Components(maps, model.peak(scene, state.surface, difference, pixels))


def picture_array(
    values: NDArray[Any], pixels: PixelGrid, name: str, label: Mapping[str, str]
) -> RunArray:
    """A picture (rows, cols) or (rows, cols, 3) with its axes in mm, and attributes `label`."""
    names = ("row", "col", "channel")[: values.ndim]
    places = picture_axes(pixels, coloured=values.ndim == 3)
    array: RunArray = make_dataset({name: Column(names, values, label)}, places, {})[name]
    return array


def picture_axes(pixels: PixelGrid, *, coloured: bool = False) -> dict[str, Column]:
    """Coordinates of a picture: row, col, z_mm, x_mm, and with red, green and blue channel."""
    units = {"units": "mm"}
    names = Column(("channel",), np.array(["red", "green", "blue"]), {})
    return {
        "row": Column(("row",), np.arange(pixels.rows), {"units": "pixel"}),
        "col": Column(("col",), np.arange(pixels.cols), {"units": "pixel"}),
        "z_mm": Column(("row",), pixels.z_mm, units | {"long_name": "z"}),
        "x_mm": Column(("col",), pixels.x_mm, units | {"long_name": "x"}),
    } | ({"channel": names} if coloured else {})


HISTORY, PICTURE = "history.csv", "simulation.png"
"""The table of these rows, and the run's figure."""

PROFILE = ("state", "x_mm", "pressure_mpa", "shear_mpa", "wear_depth_um")
"""Columns of pressure.csv."""


def history_row(index: int, item: Rendered, pixels: PixelGrid) -> dict[str, Any]:
    """One row of history.csv: contact, wear, and the largest fringe order and shear in view.

    Without the item's components the largest shear is that of the pixel with the largest order.
    """
    order = np.where(item.picture.material, item.picture.order, -1.0)
    row, col = np.unravel_index(int(order.argmax()), order.shape)
    place = pixels.place(int(row), int(col))
    shear = 0.5 * float(np.abs(item.picture.difference[row, col]))
    peak = item.components.peak if item.components else ShearPeak(shear, *place)
    surface = item.state.surface
    nothing = float("nan")
    columns: dict[str, Any] = {
        "state": index,
        "label": item.state.label,
        "distance_m": item.state.distance_m,
        "friction": surface.friction if surface else nothing,
        "p_max_mpa": surface.p_max_mpa if surface else nothing,
        "contact_width_mm": surface.contact_width_mm if surface else nothing,
        "contact_centre_mm": sum(surface.edges_mm) / 2 if surface else nothing,
        "wear_depth_um": 1e3 * float(surface.wear_depth_mm.max()) if surface else nothing,
        "worn_area_mm2": surface.worn_area_mm2 if surface else nothing,
        "n_max": float(order[row, col]),
        "n_max_x_mm": place[0],
        "n_max_z_mm": place[1],
        "shear_max_mpa": peak.shear_mpa,
        "shear_max_x_mm": peak.x_mm,
        "shear_max_z_mm": peak.z_mm,
        "residual": surface.residual if surface else nothing,
    }
    if item.block_order is not None:  # how far a half-plane would be off
        columns["block_order_max"] = item.block_order
    return columns


def profile_rows(index: int, surface: SurfaceState) -> dict[str, Any]:
    """The rows of pressure.csv for one state: what is loaded or worn, and a zero at both ends."""
    p, q, h = surface.pressure_mpa, surface.shear_mpa, 1e3 * surface.wear_depth_mm
    places = np.flatnonzero((p != 0.0) | (q != 0.0) | (h != 0.0))
    span = slice(max(int(places[0]) - 1, 0), int(places[-1]) + 2)
    x = surface.grid.x_mm[span]
    return dict(zip(PROFILE, ([index] * len(x), x, p[span], q[span], h[span]), strict=True))


def add_state_row(columns: dict[str, list[Any]], row: dict[str, Any]) -> None:
    """Add a row to a table's columns."""
    for name, value in row.items():
        columns.setdefault(name, []).append(value)


@dataclass(frozen=True)
class Rendered:
    """A state with its picture and the camera's frames of it."""

    state: SceneState
    picture: Picture
    frames: NDArray[np.generic]  # grey levels, (steps, rows, cols[, 3])
    components: Components | None = None  # of its stress; None: nobody asked
    # largest change of the order in view by the sides of a block; None: a half-plane
    block_order: float | None = None

    @property
    def stacks(self) -> dict[str, NDArray[Any]]:
        """What of it goes into each stack, by the names of their files."""
        maps = self.components.maps if self.components else {}
        order = self.picture.order.astype(np.float32)
        return {FRAMES: self.frames, ORDER: order, **{f"{n}.tif": maps[n] for n in maps}}


def render(
    scene: Scene,
    states: Iterable[SceneState],
    pixels: PixelGrid,
    *,
    components: bool = False,
    first: int = 0,
) -> Iterator[Rendered]:
    """Render state after state; noise of state i, from `first`, is seeded with (camera.seed, i).

    PhysicsError where a contact is wider than the picture, or fringes are too fine.
    """
    assert scene.camera is not None
    for index, state in enumerate(states, first):
        width = pixels.cols * pixels.pixel_mm
        if state.surface is not None and state.surface.contact_width_mm > width:
            wide = state.surface.contact_width_mm
            raise PhysicsError(
                "contact_mm_wide_wider", name=scene.name, contact_width_mm=wide, width=width
            )
        picture = make_picture(scene, state_difference(scene, state, pixels), pixels)
        refuse_too_fine(scene, picture)
        rng = np.random.default_rng([scene.camera.seed, index])
        frames = [
            expose(picture_signal(scene, picture, step), scene.camera, rng=rng)
            for step in scene.polariscope.step_numbers
        ]
        parts = state_components(scene, state, picture, pixels) if components else None
        yield Rendered(state, picture, np.stack(frames), parts, _block_order(scene, state, pixels))


def _block_order(scene: Scene, state: SceneState, pixels: PixelGrid) -> float | None:
    """How far a half-plane would be off, in fringes: the most that a block's sides add in view."""
    if state.surface is None:
        return None
    added = specimen_model(scene).side_stress(scene, state.surface, pixels)
    if not added:
        return None
    few = pixels.every(max(1, min(pixels.rows, pixels.cols) // 32))  # smooth: no pixel differs
    x, z = few.places
    order = fringe_order(
        added.difference(x, np.maximum(z, 0.0)),
        thickness_mm=scene.specimen.thickness_mm or 0.0,
        fringe_value_n_per_mm=scene.specimen.fringe_value_n_per_mm or 0.0,
    )
    return float(order.max())


FRAMES, ORDER, PRESSURE = "frames.tif", "fringe_order.tif", "pressure.csv"

_SHOWN = 6
"""States kept for the figure: the paper's six, or evenly spaced ones of a long history."""


def shown_states(count: int) -> list[int]:
    """Which of a number of states the figure shows."""
    return evenly_spaced(range(count), _SHOWN)


class RenderWork:
    """Renders states of a scene, in other processes too; those that the figure shows are kept."""

    def __init__(self, scene: Scene, pixels: PixelGrid, count: int, *, components: bool) -> None:
        self.scene, self.pixels, self.count, self.components = scene, pixels, count, components
        self.shown = shown_states(count)
        self._kept: dict[int, Rendered] = {}
        self._solved = threading.local()

    def __getstate__(self) -> dict[str, Any]:
        unshared = ("_kept", "_solved")
        return {k: v for k, v in self.__dict__.items() if k not in unshared}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _kept={}, _solved=threading.local())

    @property
    def stacks(self) -> tuple[str, ...]:
        """The stacks that the states make, by the names of their files."""
        layers = LAYERS if self.components else ()
        return FRAMES, ORDER, *(f"{name}.tif" for name in layers)

    def __call__(self, start: int, stop: int) -> Results:
        """States [start, stop). Raises PhysicsError where one cannot be solved or rendered."""
        parts: dict[str, bytearray] = {name: bytearray() for name in self.stacks}
        rows, tables = [], []
        for index, item in enumerate(self.rendered(start, stop), start):
            rows.append(history_row(index, item, self.pixels))
            if item.state.surface is not None:
                tables.append(csv_text(profile_rows(index, item.state.surface), header=False))
            for name, images in item.stacks.items():
                little_endian = images.astype(images.dtype.newbyteorder("<"), copy=False)
                parts[name] += np.ascontiguousarray(little_endian).data
        records = {name: bytes(part) for name, part in parts.items()}
        records[PRESSURE] = "".join(tables).encode()
        return Results({}, rows, [{"status": "ok"}] * len(rows), records)

    def rendered_states(self, numbers: Iterable[int]) -> list[Rendered]:
        """Some states, rendered again where they are not kept; `numbers` in any order."""
        wanted = list(numbers)
        state = dict(self._kept)
        for index in sorted(set(wanted) - set(state)):
            (state[index],) = self.rendered(index, index + 1)
        return [state[index] for index in wanted]

    def rendered(self, start: int, stop: int) -> Iterator[Rendered]:
        """States [start, stop), one after the other; those for the figure are kept."""
        states = self._states(start, stop)
        items = render(self.scene, states, self.pixels, components=self.components, first=start)
        for index, item in enumerate(items, start):
            if index in self.shown:
                self._kept[index] = item
            yield item

    def _states(self, start: int, stop: int) -> Iterator[SceneState]:
        """States [start, stop), of the run as far as it is solved if that is before them."""
        states: Iterator[SceneState] | None = getattr(self._solved, "states", None)
        at: int = getattr(self._solved, "at", 0)
        if states is None or at > start:
            states, at = iter_scene_states(self.scene), 0
        while at < stop:
            state = next(states)
            at += 1
            self._solved.states, self._solved.at = states, at
            if at > start:
                yield state


def surface_tractions(state: SceneState) -> RunDataset:
    """Give the pressure, the shear and the worn depth along the surface of a contact's state.

    The first two are what acts on the specimen, and what `stress_map` takes the stress from.

    Parameters
    ----------
    state : SceneState
        One of `scene_states`.

    Returns
    -------
    RunDataset
        An xarray.Dataset over x_mm: pressure_mpa, shear_mpa (along +x) and wear_depth_um.

    Raises
    ------
    InputError
        Where the state is not a contact's.

    Examples
    --------
    >>> import isochrome
    >>> static, *_ = isochrome.scene_states(isochrome.load_scene("line-contact-wear"))
    >>> print(f"{isochrome.surface_tractions(static).pressure_mpa.max().item():.2f} MPa")
    18.76 MPa
    """
    surface = state.surface
    if surface is None:
        raise InputError("no_contact_state_has", label=state.label)
    values = {
        "pressure_mpa": (surface.pressure_mpa, "MPa", "pressure p"),
        "shear_mpa": (surface.shear_mpa, "MPa", "shear traction q along +x"),
        "wear_depth_um": (1e3 * surface.wear_depth_mm, "um", "worn depth h"),
    }
    columns = {
        name: Column(("x_mm",), along, {"units": units, "long_name": what})
        for name, (along, units, what) in values.items()
    }
    place = Column(("x_mm",), surface.grid.x_mm, {"units": "mm", "long_name": "along the surface"})
    return make_dataset(columns, {"x_mm": place}, {"label": state.label})


def stress_map(scene: Scene, state: SceneState) -> RunArray:
    """Compute the stress difference of a state on the pixels of the scene's camera.

    It is what photoelastic fringes show: sigma_1 - sigma_2, and the direction of sigma_1.

    Parameters
    ----------
    scene : Scene
        The scene, with [camera].
    state : SceneState
        One of its `scene_states`.

    Returns
    -------
    RunArray
        An xarray.DataArray of complex numbers over (z_mm, x_mm): (sigma_x - sigma_z) + 2i tau_xz,
        MPa; its size is sigma_1 - sigma_2. NaN where there is no specimen.

    Raises
    ------
    InputError
        Where the scene has no model, or no camera.

    Notes
    -----
    Source: Johnson (1985), Contact Mechanics, section 2.5, for the half-plane under tractions.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("line-contact-wear")
    >>> static, *_ = isochrome.scene_states(scene)
    >>> stress = isochrome.stress_map(scene, static)
    >>> print(f"{abs(stress).max().item():.2f} MPa")  # 0.6 p_max (Johnson, section 4.2)
    11.27 MPa
    """
    required_model(scene)
    pixels = pixel_grid(scene)
    values = state_difference(scene, state, pixels)
    attributes = {"units": "MPa", "long_name": "(sigma_x - sigma_z) + 2i tau_xz"}
    return picture_array(values, pixels, "stress_difference", attributes)


def polariscope_light(scene: Scene, stress: ArrayLike, *, step: int | None = None) -> RunArray:
    """Compute the light behind the scene's polariscope of a stress field.

    In the dark field it is sin²(πN), with the order N = t (sigma_1 - sigma_2)/f_sigma; a pixel
    shows the mean over its area.

    Parameters
    ----------
    scene : Scene
        The scene: thickness and fringe value, [polariscope] and [camera].
    stress : array_like of complex, shape (rows, cols)
        Stress difference, MPa, such as `stress_map` gives.
    step : int, optional
        Which of [[polariscope.step]]; by default the dark, bright or plane field.

    Returns
    -------
    RunArray
        An xarray.DataArray over (z_mm, x_mm), 1 for full light; of a colour camera over (z_mm,
        x_mm, channel).

    Raises
    ------
    InputError
        Where the field does not fit the camera, or thickness or fringe value are missing.
    PhysicsError
        Where the fringes are finer than the pixels.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("line-contact-wear")
    >>> static, *_ = isochrome.scene_states(scene)
    >>> light = isochrome.polariscope_light(scene, isochrome.stress_map(scene, static))
    >>> light.dims, bool(light.max() <= 1.0)
    (('z_mm', 'x_mm'), True)
    """
    pixels, values = pixel_grid(scene), np.asarray(stress)
    if values.shape != (pixels.rows, pixels.cols) or values.dtype.kind != "c":
        raise InputError(
            "stress_difference_shape_type", name=scene.name, shape=values.shape, dtype=values.dtype,
            rows=pixels.rows, cols=pixels.cols,
        )  # fmt: skip
    for key in ("thickness_mm", "fringe_value_n_per_mm"):
        if getattr(scene.specimen, key) is None:
            raise InputError("specimen_missing_add", name=scene.name, key=key)
    if step is not None and step not in scene.polariscope.step_numbers:
        count = len(scene.polariscope.step)
        raise InputError(
            "step_polariscope_has_polariscope", name=scene.name, step=step, step_count=count
        )
    picture = make_picture(scene, values, pixels)
    refuse_too_fine(scene, picture)
    attributes = {"units": "1", "long_name": "light, 1 = full"}
    return picture_array(picture_signal(scene, picture, step), pixels, "light", attributes)


def camera_frame(
    scene: Scene, light: ArrayLike, *, rng: np.random.Generator | None = None
) -> RunArray:
    """Make the frame that the scene's camera stores of light.

    Background, vignette, blur, shot noise, gamma, read noise and bit depth are the scene's.

    Parameters
    ----------
    scene : Scene
        The scene, with [camera].
    light : array_like, shape (rows, cols) or (rows, cols, 3)
        Light, 1 for full light, such as `polariscope_light` gives.
    rng : numpy.random.Generator, optional
        Source of the noise; by default that of `simulate` for the scene's first state,
        ``numpy.random.default_rng([scene.camera.seed, 0])``. Number i has ``[seed, i]``, and the
        frames of its phase steps draw from it one after the other.

    Returns
    -------
    RunArray
        An xarray.DataArray of grey levels over (z_mm, x_mm): uint8 or uint16 by the bit depth,
        float32 without one.

    Raises
    ------
    InputError
        Where the scene has no camera, or the light is not of its size.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("line-contact-wear")
    >>> static, *_ = isochrome.scene_states(scene)
    >>> light = isochrome.polariscope_light(scene, isochrome.stress_map(scene, static))
    >>> frame = isochrome.camera_frame(scene, light)
    >>> frame.dtype, frame.shape
    (dtype('uint8'), (494, 659))
    """
    pixels, camera = pixel_grid(scene), scene.camera
    values: NDArray[np.floating] = np.asarray(light)
    channels = (3,) if camera is not None and camera.colour else ()
    if values.shape != (pixels.rows, pixels.cols, *channels) or values.dtype.kind != "f":
        raise InputError(
            "light_shape_type_give",
            name=scene.name,
            shape=values.shape,
            dtype=values.dtype,
            value=(pixels.rows, pixels.cols, *channels),
        )
    assert camera is not None
    source = np.random.default_rng([camera.seed, 0]) if rng is None else rng
    attributes = {"units": "grey level", "long_name": "the camera's frame"}
    return picture_array(expose(values, camera, rng=source), pixels, "frame", attributes)
