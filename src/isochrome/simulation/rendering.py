"""From scene to what the camera stores: states, stress, fringe order, signal, frames.

States are rendered one at a time, chunk by chunk, by whoever asks. The wear run is sequential: each
process solves it once, as far as it needs it, a tenth of what rendering costs.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome import optics
from isochrome.contact import SurfaceState, iter_contact_states, pressed_again
from isochrome.errors import InputError, PhysicsError
from isochrome.messages import message
from isochrome.output import csv_text, evenly_spaced
from isochrome.runs import Column, Results, make_dataset
from isochrome.scene import Camera, Scene
from isochrome.specimens import specimen_model
from isochrome.stress import PixelGrid, ShearPeak, StressDifference, pixel_grid, principal_direction

if TYPE_CHECKING:
    from isochrome.runs import RunArray, RunDataset

Array = NDArray[np.floating]

_TOO_FINE_SHARE = 0.03
"""Share of the fringed pixels with fringes finer than two pixels at which a picture is refused: a
few at the edge of a contact or beside point loads, where the stress is steep, are no harm."""

_FLOAT32_BITS = 10
"""Bits up to which single precision, 1e-5 of the signal at N = 50, is below half a grey level."""


@dataclass(frozen=True)
class SceneState:
    """One state of a scene.

    Parameters
    ----------
    label : str
        Its name, such as 'static' or '31 m'.
    distance_m : float
        Distance slid, m.
    surface : SurfaceState or None
        What acts on the surface; None but in a contact.
    """

    label: str
    distance_m: float
    surface: SurfaceState | None


@dataclass(frozen=True)
class Picture:
    """What the camera would see (rows, cols), before the camera."""

    difference: StressDifference  # (sigma_x - sigma_z) + 2i tau_xz, MPa
    order: Array  # in the pixels' middles, fringes
    mean_order: Array  # that the pixels show, the mean over their area
    material: NDArray[np.bool_]  # False: no specimen
    visibility: Array  # of the fringes in a pixel's area
    too_fine: float  # share of the fringed pixels with fringes finer than two pixels


def scene_states(scene: Scene) -> list[SceneState]:
    """Solve a scene's mechanics: every state, in the scene's order.

    With `stress_map`, `polariscope_light` and `camera_frame` it is the way of `simulate`, step by
    step.

    Parameters
    ----------
    scene : Scene
        The scene.

    Returns
    -------
    list of SceneState
        The states; those of a contact have what acts on its surface, see `surface_tractions`.

    Raises
    ------
    InputError
        Where the scene has no model.
    PhysicsError
        Where it cannot be solved.

    Notes
    -----
    Source: Johnson (1985), Contact Mechanics, sections 4.2 and 5.4; Archard (1953), J. Appl. Phys.
    24, 981, for the wear.

    Examples
    --------
    >>> import isochrome
    >>> states = isochrome.scene_states(isochrome.load_scene("line-contact-wear"))
    >>> [state.label for state in states][:3]
    ['static', 'initial sliding', '31 m']
    """
    return list(iter_scene_states(scene))


def iter_scene_states(scene: Scene) -> Iterator[SceneState]:
    """The states of `scene_states`, each solved when it is asked for; InputError at once."""
    model = required_model(scene)
    if not scene.is_contact:
        return iter((SceneState(model, 0.0, None),))
    return (
        SceneState(
            f"{s.distance_m:g} m" if s.distance_m else "initial sliding" if s.sliding else "static",
            s.distance_m,
            with_added_tractions(scene, s),
        )
        for s in iter_contact_states(scene)
    )


def with_added_tractions(scene: Scene, surface: SurfaceState) -> SurfaceState:
    """A surface with the scene's added tractions; PhysicsError outside the contact's window."""
    added = scene.added_tractions
    if added is None:
        return surface
    grid, x = surface.grid, surface.grid.x_mm
    beyond = np.array([x[0] - added.x_mm[0], added.x_mm[-1] - x[-1]])
    if beyond.max() > x[-1] - x[0]:
        raise PhysicsError(
            "load_added_tractions_outside_window",
            first=added.x_mm[0], last=added.x_mm[-1], left_mm=float(x[0]), right=float(x[-1]),
        )  # fmt: skip
    before, behind = np.ceil(np.maximum(0.0, beyond) / grid.spacing_mm).astype(int).tolist()
    left_mm = grid.left_mm - before * grid.spacing_mm
    wider = replace(grid, left_mm=left_mm, nodes=grid.nodes + before + behind)
    pressure, shear, depth = (
        np.pad(values, (before, behind))
        for values in (surface.pressure_mpa, surface.shear_mpa, surface.wear_depth_mm)
    )
    more = (
        np.interp(wider.x_mm, added.x_mm, values, left=0.0, right=0.0)
        for values in (added.pressure_mpa, added.shear_mpa)
    )
    return replace(
        surface, grid=wider, pressure_mpa=pressure + next(more), shear_mpa=shear + next(more),
        wear_depth_mm=depth, scar_edges_mm=surface.edges_mm,
    )  # fmt: skip


def state_count(scene: Scene) -> int:
    """Number of states of a scene, without solving them."""
    if not scene.is_contact or (scene.load is not None and scene.load.tangential_n is not None):
        return 1
    static = scene.friction is not None and scene.friction.static_state_first
    return int(static) + (len(scene.wear.distances_m) if scene.wear else 1)


def required_model(scene: Scene) -> str:
    """The name of a scene's model; InputError where it has none."""
    if scene.model is None:
        raise InputError(no_model_sentence(scene))
    return scene.model


def no_model_sentence(scene: Scene) -> str:
    """Why a scene has no model, and what can be done with its frames all the same."""
    return message(
        "so_cannot_simulated_isochrome", name=scene.name, no_model_reason=scene.no_model_reason
    )


def state_difference(scene: Scene, state: SceneState, pixels: PixelGrid) -> StressDifference:
    """(sigma_x - sigma_z) + 2i tau_xz (rows, cols), MPa, of a state; NaN: no specimen."""
    return specimen_model(scene).difference(scene, state.surface, pixels)


def swing_states(scene: Scene, state: SceneState) -> tuple[SceneState, ...]:
    """A state at the moments of an exposure over which the load swings; none where it does not.

    A mean over a sine, P (1 + s cos φ), is one over cos φ = 0, ±√3/2, exact to the fifth power of s
    (Abramowitz & Stegun, 1964, 25.4.38): the state itself is the moment between.
    """
    swing = scene.load.swing if scene.load else 0.0
    if not swing or state.surface is None:
        return ()
    surfaces = (
        pressed_again(scene, state.surface, 1.0 + sign * 0.75**0.5 * swing) for sign in (-1, 1)
    )
    return tuple(replace(state, surface=surface) for surface in surfaces)


def swung_order(order: Array, moments: Sequence[Array]) -> tuple[Array, Array]:
    """The order N that a mean over some moments shows, and what it leaves of the fringes' contrast.
    <cos 2πN_k> = v cos 2πN: the mean of turning pointers."""
    turns = sum(np.exp(2j * np.pi * (moment - order)) for moment in moments)
    pointer = (1.0 + turns) / (1 + len(moments))
    return order + np.angle(pointer) / (2.0 * np.pi), np.abs(pointer)


def make_picture(
    scene: Scene,
    difference: StressDifference,
    pixels: PixelGrid,
    moments: Sequence[StressDifference] = (),
) -> Picture:
    """Fringe order, mask and visibility of a stress field (sigma_x - sigma_z) + 2i tau_xz, MPa, and
    of those at other `moments` of the exposure."""
    thickness, value = scene.specimen.thickness_mm, scene.specimen.fringe_value_n_per_mm
    assert thickness is not None and value is not None
    order, *others = (
        optics.fringe_order(field, thickness_mm=thickness, fringe_value_n_per_mm=value)
        for field in (difference, *moments)
    )
    contrast: Array | float = 1.0
    if others:
        order, contrast = swung_order(order, others)
    material = np.isfinite(order)
    if scene.model:  # of any other specimen the field itself says where it is
        material &= specimen_model(scene).inside(pixels)
    order = order if material.all() else np.where(material, order, np.nan)
    visibility, too_fine = optics.pixel_visibility(order)
    shown = optics.mean_order(order)
    return Picture(difference, order, shown, material, visibility * contrast, too_fine)


def picture_signal(scene: Scene, picture: Picture, step: int | None = None) -> Array:
    """A picture's signal, 1 for full light: (rows, cols), of a colour camera (rows, cols, 3).
    `step`: phase step, None: the field. InputError: a response or a light that cannot be used."""
    camera, polariscope = scene.camera, scene.polariscope
    order, covered = picture.mean_order, picture.material.all()
    if not covered:
        order = np.where(picture.material, order, 0.0)
    if camera is None or camera.bit_depth is None or camera.bit_depth > _FLOAT32_BITS:
        order = order.astype(float)
    coloured = camera is not None and (camera.colour or camera.response is not None)
    if polariscope.several_wavelengths or coloured:
        signal = _spectral(scene, picture, order, step)
    else:
        chain = optics.make_chain(polariscope, step)
        direction = None if chain.ideal else principal_direction(picture.difference)
        signal = optics.polariscope_signal(
            order, chain, direction=direction, visibility=picture.visibility
        )
    if not covered:
        signal[~picture.material] = 0.0
    return signal


def _spectral(scene: Scene, picture: Picture, order: Array, step: int | None) -> Array:
    """The signal for several wavelengths, or in several channels."""
    camera, polariscope = scene.camera or Camera(), scene.polariscope
    path = scene.path(camera.response) if camera.response is not None else None
    response = optics.camera_response(camera, path)
    highest = optics.highest_visible(order, picture.visibility)
    light = optics.make_light(polariscope, response, highest_order=highest)
    chains = [
        optics.make_chain(polariscope, step, wavelength_nm=float(w)) for w in light.wavelength_nm
    ]
    ideal = all(chain.ideal for chain in chains)
    assert polariscope.wavelength_nm is not None
    direction = None if ideal else principal_direction(picture.difference)
    signal = optics.spectral_signal(
        order, light, chains, reference_nm=polariscope.wavelength_nm, direction=direction,
        visibility=picture.visibility,
    )  # fmt: skip
    return signal if camera.colour else signal[..., 0]


def refuse_too_fine(scene: Scene, picture: Picture) -> None:
    """Raise PhysicsError where too many fringes are finer than two pixels."""
    if picture.too_fine > _TOO_FINE_SHARE:
        share, pixel = 100 * picture.too_fine, scene.camera.pixel_mm if scene.camera else None
        raise PhysicsError("fringes_finer_two_pixels", name=scene.name, too_fine=share, pixel=pixel)


LAYERS = ("sigma_1", "sigma_2", "sigma_1_direction", "sigma_x", "sigma_z", "tau_xz")
"""Names of the maps that `simulate` leaves: MPa, the direction in degrees."""


def state_components(
    scene: Scene, state: SceneState, picture: Picture, pixels: PixelGrid
) -> tuple[dict[str, NDArray[np.float32]], ShearPeak]:
    """Each of LAYERS by name (rows, cols), NaN: no material, and the largest shear in view.
    sigma_1,2 = (sigma_x + sigma_z)/2 ± |(sigma_x - sigma_z) + 2i tau_xz|/2; the direction from the
    image's +x, -90 to 90. The shear is the surface's too; under point loads, which make it
    infinite, that at the pixels' centres. Source: Timoshenko & Goodier (1970), section 9."""
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
    return maps, model.peak(scene, state.surface, difference, pixels)


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
    """One row of history.csv; without maps the largest shear is that where the order is largest."""
    order = np.where(item.picture.material, item.picture.order, -1.0)
    row, col = np.unravel_index(int(order.argmax()), order.shape)
    place = pixels.place(int(row), int(col))
    shear = 0.5 * float(np.abs(item.picture.difference[row, col]))
    peak = item.peak or ShearPeak(shear, *place)
    surface, nothing = item.state.surface, float("nan")
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
    maps: dict[str, NDArray[np.float32]] = field(default_factory=dict)  # of its stress, where asked
    peak: ShearPeak | None = None
    # largest change of the order in view by the sides of a block; None: a half-plane
    block_order: float | None = None

    @property
    def stacks(self) -> dict[str, NDArray[Any]]:
        """What of it goes into each stack, by the names of their files."""
        stacks = {FRAMES: self.frames, ORDER: self.picture.order.astype(np.float32)}
        return stacks | {f"{name}.tif": values for name, values in self.maps.items()}


def render(
    scene: Scene,
    states: Iterable[SceneState],
    pixels: PixelGrid,
    *,
    components: bool = False,
    first: int = 0,
) -> Iterator[Rendered]:
    """Render state after state; noise of state i, from `first`, is seeded with (camera.seed, i).
    PhysicsError where a contact is wider than the picture, or fringes are too fine."""
    assert scene.camera is not None
    for index, state in enumerate(states, first):
        width = pixels.cols * pixels.pixel_mm
        if state.surface is not None and state.surface.contact_width_mm > width:
            wide = state.surface.contact_width_mm
            raise PhysicsError(
                "contact_mm_wide_wider", name=scene.name, contact_width_mm=wide, width=width
            )
        difference, *moments = (
            state_difference(scene, moment, pixels)
            for moment in (state, *swing_states(scene, state))
        )
        picture = make_picture(scene, difference, pixels, moments)
        refuse_too_fine(scene, picture)
        rng = np.random.default_rng([scene.camera.seed, index])
        frames = [
            optics.expose(picture_signal(scene, picture, step), scene.camera, rng=rng)
            for step in scene.polariscope.step_numbers
        ]
        maps, peak = dict[str, NDArray[np.float32]](), None
        if components:
            maps, peak = state_components(scene, state, picture, pixels)
        block_order = _block_order(scene, state, pixels)
        yield Rendered(state, picture, np.stack(frames), maps, peak, block_order)


def _block_order(scene: Scene, state: SceneState, pixels: PixelGrid) -> float | None:
    """How far a half-plane would be off, in fringes: the most that a block's sides add in view."""
    if state.surface is None:
        return None
    added = specimen_model(scene).side_stress(scene, state.surface, pixels)
    if not added:
        return None
    few = pixels.every(max(1, min(pixels.rows, pixels.cols) // 32))  # smooth: no pixel differs
    x, z = few.places
    difference, specimen = added.difference(x, np.maximum(z, 0.0)), scene.specimen
    thickness, value = specimen.thickness_mm or 0.0, specimen.fringe_value_n_per_mm or 0.0
    order = optics.fringe_order(difference, thickness_mm=thickness, fringe_value_n_per_mm=value)
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
        return {k: v for k, v in self.__dict__.items() if k not in ("_kept", "_solved")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _kept={}, _solved=threading.local())

    @property
    def stacks(self) -> tuple[str, ...]:
        """The stacks that the states make, by the names of their files."""
        return FRAMES, ORDER, *(f"{name}.tif" for name in LAYERS if self.components)

    def __call__(self, start: int, stop: int) -> Results:
        """States [start, stop). Raises PhysicsError where one cannot be solved or rendered."""
        parts: dict[str, bytearray] = {name: bytearray() for name in self.stacks}
        rows, tables = [], []
        for index, item in enumerate(self.rendered(start, stop), start):
            rows.append(history_row(index, item, self.pixels))
            if (surface := item.state.surface) is not None:
                p, q, h = surface.pressure_mpa, surface.shear_mpa, 1e3 * surface.wear_depth_mm
                # what is loaded or worn, and a zero at both ends
                places = np.flatnonzero((p != 0.0) | (q != 0.0) | (h != 0.0))
                span = slice(max(int(places[0]) - 1, 0), int(places[-1]) + 2)
                x = surface.grid.x_mm[span]
                values = [index] * len(x), x, p[span], q[span], h[span]
                tables.append(csv_text(dict(zip(PROFILE, values, strict=True)), header=False))
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
    columns = {
        name: Column(("x_mm",), along, {"units": units, "long_name": what})
        for name, along, units, what in (
            ("pressure_mpa", surface.pressure_mpa, "MPa", "pressure p"),
            ("shear_mpa", surface.shear_mpa, "MPa", "shear traction q along +x"),
            ("wear_depth_um", 1e3 * surface.wear_depth_mm, "um", "worn depth h"),
        )
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
    about = {"units": "MPa", "long_name": "(sigma_x - sigma_z) + 2i tau_xz"}
    return picture_array(state_difference(scene, state, pixels), pixels, "stress_difference", about)


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
            "light_shape_type_give", name=scene.name, shape=values.shape, dtype=values.dtype,
            value=(pixels.rows, pixels.cols, *channels),
        )  # fmt: skip
    assert camera is not None
    source = np.random.default_rng([camera.seed, 0]) if rng is None else rng
    attributes = {"units": "grey level", "long_name": "the camera's frame"}
    return picture_array(optics.expose(values, camera, rng=source), pixels, "frame", attributes)
