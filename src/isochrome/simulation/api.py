"""`simulate`: wear and frames at a scene's distances, in memory or in a folder; its report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome import figures, output, reporting, runs
from isochrome.contact import SurfaceState
from isochrome.errors import InputError
from isochrome.optics import stored_type
from isochrome.progress import RunProgress, Tally
from isochrome.scene import Scene, SceneLike, check_moduli, check_pixel, dump_scene, load_scene
from isochrome.simulation import rendering
from isochrome.stress import PixelGrid, pixel_grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

    from isochrome.runs import RunDataset

Array = NDArray[Any]

_QUANTITIES = (
    ("p_max_mpa", "largest pressure", "MPa"),
    ("contact_width_mm", "contact width", "mm"),
    ("wear_depth_um", "wear depth", "µm"),
    ("worn_area_mm2", "worn area", "mm²"),
    ("n_max", "largest fringe order", "fringes"),
    ("shear_max_mpa", "largest shear stress", "MPa"),
)
"""Columns of history.csv that are drawn and said, their names and units."""

_MAPS = {
    "frames": ("grey level", "the camera's frames"),
    "fringe_order": ("1", "fringe order N"),
    "sigma_1_direction": ("degree", "direction of sigma_1, counter-clockwise from x"),
}
"""Units of maps that are no stresses in MPa, and what they are."""


def simulation_report(
    folder: Path, scene: Scene, record: Mapping[str, Any]
) -> reporting.ReportContent:
    """What a simulation's report says. OSError, ValueError or KeyError: a file is not as it was."""
    history = output.read_csv(folder / rendering.HISTORY)
    count = len(history["state"])
    frames = _frames(folder, scene, history)
    distance, across = output.numbers(history["distance_m"]), "sliding distance (m)"
    slid = distance[np.isfinite(distance)]
    if len(slid) < len(distance) or np.ptp(distance) == 0.0:  # nothing slides
        distance, across = np.arange(len(distance), dtype=float), "state"
    few = ", chosen for the reason that stands beside each" if len(frames) < count else ""
    curves, quantities = [], []
    for key, name, unit in _QUANTITIES:
        values = output.numbers(history[key])
        known = values[np.isfinite(values)]
        if not known.size:  # the simulation has none
            continue
        curves.append(figures.course_plot(f"{name} ({unit})", across, distance, values))
        span = f"{known[0]:.4g}" if known[0] == known[-1] else f"{known[0]:.4g} to {known[-1]:.4g}"
        quantities.append(f"{name} {span} {unit}")
    where = f"From {slid[0]:g} to {slid[-1]:g} m of sliding: " if np.ptp(slid) > 0.0 else ""
    text = f"{where}{', '.join(quantities)}."
    return reporting.ReportContent(
        command="simulate", title=f"Simulation of {scene.name}: {output.counted(count, 'state')}",
        verdict=f"{text[:1].upper()}{text[1:]}", frames=frames, curves=curves,
        no_budget="A simulation has none: isochrome sweep shows what another number of the scene "
        "changes.",
        choice=f"{len(frames)} of {output.counted(count, 'rendered state')} are shown{few}.",
        tables=[reporting.ReportTable(f"The states ({rendering.HISTORY})", history)],
        causes_text="A simulation asks no frames for anything: it is what the scene below makes.",
        scene=dump_scene(scene), paper=reporting.paper_rows(scene, record),
        picture=(folder / rendering.PICTURE).read_bytes(),
    )  # fmt: skip


def _frames(
    folder: Path, scene: Scene, history: Mapping[str, Sequence[Any]]
) -> list[reporting.ReportFrame]:
    """The states that are shown: all of a few, else those that stand out and some between."""
    pixels, steps = pixel_grid(scene), len(scene.polariscope.step_numbers)
    largest = output.numbers(history["n_max"])
    chosen = reporting.choose_frames(np.full(len(largest), np.nan), largest)
    size, camera = (pixels.rows, pixels.cols), scene.camera
    colours = (3,) if camera is not None and camera.colour else ()
    stored = _stack(folder / rendering.FRAMES, (len(largest) * steps, *size, *colours))
    orders = _stack(folder / rendering.ORDER, (len(largest), *size))
    images = [np.array(stored[k * steps], np.float32) for k in chosen]
    if colours:
        images = [image.mean(axis=2) for image in images]
    light = (0.0, max(float(image.max()) for image in images))
    span = (0.0, float(np.nanmax(largest)))
    notes = ["the first of its phase steps is shown"] if steps > 1 else []
    notes += ["the mean of its three colours is shown"] if colours else []
    frames = []
    for (number, why), image in zip(chosen.items(), images, strict=True):
        order = np.array(orders[number])
        panes = (
            reporting.Pane("rendered", "rendered frame", image, light, reporting.GREY_LEVELS),
            reporting.Pane("order", "fringe order N", order, span, reporting.FRINGES),
        )
        frame = reporting.ReportFrame(
            number=number, label=str(history["label"][number]), why=why, panes=panes, order=order,
            notes=tuple(notes), **pixels.scale,
        )  # fmt: skip
        frames.append(frame)
    return frames


def _stack(path: Path, shape: tuple[int, ...]) -> Array:
    """A stack on disk, of which only what is asked for is read. Raises OSError, ValueError."""
    import tifffile

    with tifffile.TiffFile(path) as file:  # mapped, or through a temporary file where it cannot be
        return np.asarray(file.series[0].asarray(out="memmap")).reshape(shape)


def finish_simulation_folder(
    run: runs.RunFolder, work: rendering.RenderWork, record: Mapping[str, Any]
) -> dict[str, list[Any]]:
    """Make the files from what is kept of the chunks, a chunk in memory at a time."""
    folder, scene = run.results, work.scene
    history: dict[str, list[Any]] = {}
    for row, _ in runs.rows(run):
        rendering.add_state_row(history, row)
    output.write_csv(folder / rendering.HISTORY, history)
    with output.replacing(folder / rendering.PRESSURE) as beside, open(beside, "wb") as file:
        file.write(output.csv_text(dict.fromkeys(rendering.PROFILE, ())).encode())
        file.writelines(runs.parts(run, rendering.PRESSURE))
    pixels, camera = work.pixels, scene.camera
    assert camera is not None
    for name in work.stacks:
        (steps, *shape), dtype = _form(work, name)
        if name == rendering.FRAMES:
            span = (0.0, 1.0 if camera.bit_depth is None else 2.0**camera.bit_depth - 1.0)
        elif name == rendering.ORDER:
            span = (0.0, float(max(history["n_max"])))
        else:
            chunks = (np.frombuffer(part, dtype) for part in runs.parts(run, name))
            ends = [np.nanpercentile(chunk, (0.1, 99.9)) for chunk in chunks]
            span = (float(np.min(ends)), float(np.max(ends)))
        labels = [
            f"{label}, step {step}" if steps > 1 else str(label)
            for label in history["label"]
            for step in range(steps)
        ]
        chunks = (np.frombuffer(part, dtype).reshape(-1, *shape) for part in runs.parts(run, name))
        output.write_frames(
            folder / name, chain.from_iterable(chunks), (work.count * steps, *shape), dtype,
            pixel_mm=pixels.pixel_mm, photometric="rgb" if len(shape) == 3 else "minisblack",
            metadata=output.imagej_view(name, span, labels=labels, **pixels.scale),
        )  # fmt: skip
    output.write_text(folder / "scene.toml", dump_scene(scene))
    output.write_figure(folder / rendering.PICTURE, _drawn(work))
    if work.components:
        shown = work.rendered_states(work.shown)
        marks = "× largest shear" + ", ▼ edges of contact" * scene.is_contact
        head = f"{figures.plain_name(scene.name)}, simulated: principal stresses\n{marks}"
        labels = [figures.plain_name(item.state.label) for item in shown]
        panels = figures.PaperPanels(kinds=stress_kinds(work.pixels, shown), labels=labels)
        output.write_figure(folder / "stress.png", figures.panels_figure(panels, head))
    reporting.write_report(folder / runs.REPORT, simulation_report(folder, scene, record))
    return history


def _form(work: rendering.RenderWork, name: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape (steps, rows, cols[, 3]) and type of a state's part of a stack."""
    size, camera = (work.pixels.rows, work.pixels.cols), work.scene.camera
    assert camera is not None
    if name != rendering.FRAMES:
        return (1, *size), np.dtype("<f4")
    steps, colours = len(work.scene.polariscope.step_numbers), (3,) if camera.colour else ()
    return (steps, *size, *colours), stored_type(camera.bit_depth).newbyteorder("<")


_NAMES = {"sigma_1": "σ₁", "sigma_2": "σ₂"}
"""In letters that are no smaller than the others'."""


def stress_kinds(
    pixels: PixelGrid, items: Sequence[rendering.Rendered]
) -> list[figures.PictureKind]:
    """Maps of sigma_1 and of sigma_2, each of one scale; none where they were not asked for."""
    kinds = []
    for name, plain in _NAMES.items():
        maps = [item.maps[name] for item in items if item.maps]
        if len(maps) == len(items):
            limit = figures.centred_limit(*maps, percentile=99.8)
            draw = partial(_draw_stress, items=items, name=name, pixels=pixels, limit=limit)
            kinds.append(figures.PictureKind(name=plain, draw=draw, bar=f"{plain} (MPa)"))
    return kinds


def _draw_stress(
    axes: Axes,
    k: int,
    *,
    items: Sequence[rendering.Rendered],
    name: str,
    pixels: PixelGrid,
    limit: float,
) -> AxesImage:
    """A map, red in tension, a cross at the largest shear, carets at the contact's edges."""
    look: dict[str, Any] = {"cmap": figures.DIFFERENCE_MAP, "vmin": -limit, "vmax": limit}
    item = items[k]
    shown = figures.show_image(axes, item.maps[name], **look, **pixels.scale)
    peak, surface, (_, right, *_) = item.peak, item.state.surface, pixels.window
    assert peak is not None
    if surface is not None and pixels.top_mm <= 0.0:
        from matplotlib.markers import CARETDOWN  # its tip, not its middle, is at the place

        edges = [x for x in surface.edges_mm if pixels.left_mm <= x <= right]
        look = {"marker": CARETDOWN, "color": figures.INK, "ls": "", "clip_on": False}
        axes.plot(edges, [0.0] * len(edges), **look)
    look = {"color": figures.LINE_COLOURS[2], "ms": 8, "mew": figures.BOLD_PT, "clip_on": False}
    axes.plot(peak.x_mm, peak.z_mm, "x", **look)
    axes.set_xlim(pixels.left_mm, right)
    return shown


def simulation_panels(
    scene: Scene, pixels: PixelGrid, items: Sequence[rendering.Rendered]
) -> figures.PaperPanels:
    """Frames, maps of the principal stresses where they were asked for, a contact's profiles."""
    bits = scene.camera.bit_depth if scene.camera is not None else None
    full = 1.0 if bits is None else 2**bits - 1

    def frame(axes: Axes, k: int) -> AxesImage:
        figures.plot_frame(items[k].frames[0], axes, full=full, **pixels.scale)
        return axes.images[0]

    kinds = [figures.PictureKind(name="frame", draw=frame), *stress_kinds(pixels, items)]
    states = [item.state for item in items]
    plots = []
    if items[0].state.surface is not None:
        plots.append(figures.Plot(title="pressure", draw=partial(plot_pressure, states)))
        surfaces = [state.surface for state in states if state.surface is not None]
        if any(np.any(surface.wear_depth_mm != 0.0) for surface in surfaces):
            plots.append(figures.Plot(title="worn depth", draw=partial(plot_scar, states)))
    most = (float(np.nanmax(item.picture.order)) for item in items)
    return figures.PaperPanels(
        kinds=kinds, labels=[figures.plain_name(state.label, 24) for state in states], plots=plots,
        legend=[state.label for state in states] if plots and len(items) > 1 else (),
        notes=[f"{state.label}: N up to {n:.2f}." for state, n in zip(states, most, strict=True)],
    )  # fmt: skip


States = rendering.SceneState | Sequence[rendering.SceneState]


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
    given = [states] if isinstance(states, rendering.SceneState) else list(states)
    surfaces = [state.surface for state in given if state.surface is not None]
    if not surfaces or len(surfaces) < len(given):
        raise InputError("states_without_surface_under")
    drawn = figures.given_axes(axes)
    for state, surface, colour in zip(given, surfaces, cycle(figures.LINE_COLOURS), strict=False):
        look: Any = {"color": colour, "lw": figures.BOLD_PT, "label": state.label}
        drawn.plot(surface.grid.x_mm, value(surface), **look)
    widest = max(abs(edge) for surface in surfaces for edge in surface.edges_mm)
    figures.style_axes(drawn, x_label="x (mm)", z_label=label)
    drawn.set_xlim(-1.25 * widest, 1.25 * widest)
    drawn.grid(alpha=0.3, lw=figures.FINE_PT)
    if axes is None and len(given) > 1:
        figures.add_legend(drawn)
    return drawn


@dataclass(frozen=True, repr=False, kw_only=True)
class Simulation(output.Result):
    """A simulated scene.

    Parameters
    ----------
    draw : callable, optional
        Makes the figure.
    scene : Scene
        The scene.
    pixels : PixelGrid
        The pixels.
    history : dict of str to list
        The columns of history.csv, of an earlier run with nine digits.
    states : list of SceneState, optional
        The states; empty where they were streamed to a folder.
    frames : ndarray, shape (frame, row, col) or (frame, row, col, 3), optional
        The camera's frames, grey levels, the second shape of a colour camera; None where they were
        streamed to a folder.
    orders : ndarray of float32, shape (state, row, col), optional
        Fringe orders, fringes; None where they were streamed to a folder.
    maps : dict of str to ndarray, shape (state, row, col), optional
        Where components were asked for and not streamed: each by the name of its file, MPa, the
        direction in degrees.
    already : bool, default False
        Whether an earlier run had left it all.
    components : bool, default False
        Whether the principal stresses were asked for apart.
    """

    scene: Scene
    pixels: PixelGrid
    history: dict[str, list[Any]]
    states: list[rendering.SceneState] = field(default_factory=list)
    frames: NDArray[np.generic] | None = None
    orders: NDArray[np.float32] | None = None
    maps: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    already: bool = False
    components: bool = False

    @property
    def dataset(self) -> RunDataset:
        """Frames, fringe orders, components and history as an xarray.Dataset with axes.

        Maps are over (state, z_mm, x_mm), frames of phase steps over (state, step, z_mm, x_mm), of
        a colour camera with channel at the end. Raises InputError where they are in a folder.
        """
        if self.frames is None or self.orders is None:
            raise InputError("frames_maps_tiff_stacks", title=self.title)
        count = len(self.history["state"])
        columns = {n: runs.column(list(values), "state", n) for n, values in self.history.items()}
        places = {name: columns.pop(name) for name in ("state", "label", "distance_m")}
        places |= rendering.picture_axes(self.pixels, coloured=self.frames.ndim == 4)
        maps = {"frames": self.frames, "fringe_order": self.orders, **self.maps}
        for name, values in maps.items():
            stack = values.reshape(count, len(values) // count, *values.shape[1:])
            names: tuple[str, ...] = ("state", "step", "row", "col", "channel")[: stack.ndim]
            if stack.shape[1] == 1:
                stack, names = stack[:, 0], ("state", *names[2:])
            units, what = _MAPS.get(name, ("MPa", name))
            columns[name] = runs.Column(names, stack, {"units": units, "long_name": what})
        about = runs.attributes({"scene": dump_scene(self.scene)})
        return runs.make_dataset(columns, places, about)

    @property
    def columns(self) -> Mapping[str, Sequence[Any]]:
        """Those of history.csv."""
        return self.history

    @property
    def warnings(self) -> tuple[str, ...]:
        """None: what cannot be simulated is refused."""
        return ()

    @property
    def title(self) -> str:
        """The scene and how many states it has."""
        count = output.counted(len(self.history["state"]), "state")
        return f"Simulation of {self.scene.name}: {count}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """The contact's and the fringes' largest values over the states."""
        for name, *_ in _QUANTITIES:
            if name in self.history:
                yield name, output.over_items(self.history[name], items="states")

    def to_json(self) -> dict[str, Any]:
        """The history of all states."""
        return {"history": self.history}

    def panels(self, frames: tuple[int, ...] | None = None) -> figures.PaperPanels:
        """Give the states for a paper, rendered again; see `paper_figure`.

        `frames`: numbers of the states that are shown. Raises InputError where one is not there.
        """
        count = len(self.history["state"])
        shown = figures.chosen_frames(frames, count, rendering.shown_states(count), items="states")
        work = rendering.RenderWork(self.scene, self.pixels, count, components=self.components)
        return simulation_panels(self.scene, self.pixels, work.rendered_states(shown))


def simulate(
    scene: SceneLike,
    out: str | Path | None = None,
    *,
    components: bool = False,
    workers: int | None = 1,
    cluster: str | None = None,
    restart: bool = False,
    progress: RunProgress | None = None,
) -> Simulation:
    """Simulate a scene: contact, wear, stress and fringes at its distances.

    A worn contact's depth grows by dh = kappa p ds; at each distance the pressure p and the shear q
    solve the contact, the stress follows from them, and the frame is I = B + A sin²(πN) in the dark
    field, with N = t (sigma_1 - sigma_2)/f_sigma, as the scene's camera records it. Discs, rings
    and beams are simulated by their closed forms.

    Parameters
    ----------
    scene : str, Path, Scene or mapping
        A TOML file, the name of a scene of the package, a Scene, or its tables.
    out : str or Path, optional
        Folder for history.csv, frames.tif, fringe_order.tif, pressure.csv, scene.toml,
        provenance.json, simulation.png and report.html, to which the states go as soon as they are
        known, so that memory does not grow with their number.
    components : bool, default False
        Whether sigma_1.tif, sigma_2.tif, sigma_x.tif, sigma_z.tif, tau_xz.tif (MPa),
        sigma_1_direction.tif (degrees) and stress.png are left too; the history's largest shear is
        then that of all the material in view, not of the pixels' centres.
    workers : int or None, default 1
        Processes on this machine; None: as many as are useful. A script that asks for more than
        one needs the usual ``if __name__ == "__main__":``.
    cluster : str, optional
        Address of a Dask scheduler, in place of `workers`, such as 'tcp://host:8786'.
    restart : bool, default False
        Whether to begin anew where an earlier run was interrupted or is complete.
    progress : callable, optional
        Called with a Tally of the states.

    Returns
    -------
    Simulation
        The history, a row a state; states, frames (frame, row, col) in grey levels and orders
        (state, row, col) in fringes, these in memory only without `out`.

    Raises
    ------
    InputError
        Where the scene is wrong, or workers are asked for without `out`.
    PhysicsError
        Where the scene cannot be solved, or its fringes are finer than the pixels.

    Notes
    -----
    What is finished is kept in ``OUT.partial`` until all is: after a crash, the same call resumes
    from there. Sources: Johnson (1985), Contact Mechanics, sections 2.4 and 4.2; Archard (1953), J.
    Appl. Phys. 24, 981; Dally & Riley (1991), Experimental Stress Analysis, section 12.2.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0})
    >>> found = isochrome.simulate(scene)
    >>> found.frames.shape
    (1, 128, 128)
    >>> print(f"{found.table['n_max'][0]:.2f}")
    5.35
    """
    scene = load_scene(scene)
    rendering.required_model(scene)
    check_moduli(scene)
    check_pixel(scene, None)
    pixels, count = pixel_grid(scene), rendering.state_count(scene)
    if out is not None:
        seed = scene.camera.seed if scene.camera else None
        files = scene.files(of_frames=False)
        identity = runs.run_identity(dump_scene(scene), files, {"components": components}, seed)
        if cluster is not None:  # another machine stands in another folder
            scene = scene.model_copy(update={"folder": (scene.folder or Path()).absolute()})
        with runs.single_threaded():
            work = rendering.RenderWork(scene, pixels, count, components=components)
            forms = [_form(work, name) for name in work.stacks]
            size = sum(int(np.prod(shape)) * dtype.itemsize for shape, dtype in forms)
            chunk = runs.chunk_size(count, size)
            layout = runs.RunLayout(
                axes={"state": count}, chunk=chunk, store=False, part_bytes=size
            )
            job = runs.Job(work, layout, identity)
            finish = partial(finish_simulation_folder, work=work, record=identity)
            options = runs.RunOptions(workers, cluster, restart)
            columns = runs.run_job(job, Path(out), finish, options=options, progress=progress)
        already = columns is None
        picture = partial(output.saved_picture, Path(out).absolute() / rendering.PICTURE)
        return Simulation(
            scene=scene, pixels=pixels, already=already, components=components,
            history=columns or output.read_csv(Path(out) / rendering.HISTORY),
            draw=picture if already else partial(_drawn, work),
        )  # fmt: skip
    runs.refuse_without_folder(out, workers, cluster)
    work = rendering.RenderWork(scene, pixels, count, components=components)
    states: list[rendering.SceneState] = []
    history: dict[str, list[Any]] = {}
    stacks: dict[str, list[NDArray[Any]]] = {}
    for index, item in enumerate(work.rendered(0, count)):
        rendering.add_state_row(history, rendering.history_row(index, item, pixels))
        rendering.add_state_row(stacks, item.stacks)
        states.append(item.state)
        if progress is not None:
            progress(Tally(index + 1, count, 0, 0))
    frames = np.concatenate(stacks.pop(rendering.FRAMES))
    orders = np.stack(stacks.pop(rendering.ORDER))
    maps = {name.removesuffix(".tif"): np.stack(images) for name, images in stacks.items()}
    return Simulation(
        scene=scene, pixels=pixels, history=history, states=states, frames=frames, orders=orders,
        maps=maps, draw=partial(_drawn, work), components=components,
    )  # fmt: skip


def _drawn(work: rendering.RenderWork) -> Figure:
    """Simulated frames on millimetre axes; for a contact, pressure and worn depth below them."""
    scene, steps = work.scene, len(work.scene.polariscope.step_numbers)
    which = f"rendered frames, the first of {steps} steps" if steps > 1 else "rendered frames"
    head = f"{figures.plain_name(scene.name)}, simulated ({which})"
    shown = [replace(item, maps={}) for item in work.rendered_states(work.shown)]
    return figures.panels_figure(simulation_panels(scene, work.pixels, shown), head)
