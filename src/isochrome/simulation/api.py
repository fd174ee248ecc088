"""`simulate`: wear and frames at a scene's distances, in memory or streamed to a folder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.figures import PaperPanels, chosen_frames
from isochrome.messages import message
from isochrome.output import Result, counted, over_items, read_csv, saved_picture
from isochrome.progress import RunProgress, Tally
from isochrome.runs import (
    Job,
    RunDataset,
    RunOptions,
    refuse_without_folder,
    run_identity,
    run_job,
    single_threaded,
)
from isochrome.scene import Scene, SceneLike, check_moduli, check_pixel, dump_scene, load_scene
from isochrome.simulation.figure import simulation_figure, simulation_panels
from isochrome.simulation.folder import finish_simulation_folder, run_layout
from isochrome.simulation.model import SceneState, iter_scene_states, required_model, state_count
from isochrome.simulation.rendering import (
    HISTORY,
    PICTURE,
    RenderWork,
    add_state_row,
    history_row,
    render,
    shown_states,
    simulation_dataset,
)
from isochrome.stress import PixelGrid, pixel_grid

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_SHOWN_VALUES = ("p_max_mpa", "contact_width_mm", "wear_depth_um", "worn_area_mm2", "n_max")


@dataclass(frozen=True, repr=False, kw_only=True)
class Simulation(Result):
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
    states: list[SceneState] = field(default_factory=list)
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
            raise InputError(message("frames_maps_tiff_stacks", title=self.title))
        maps = {"frames": self.frames, "fringe_order": self.orders, **self.maps}
        return simulation_dataset(self.scene, self.pixels, self.history, maps)

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
        return f"Simulation of {self.scene.name}: {counted(len(self.history['state']), 'state')}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """The contact's and the fringes' largest values over the states."""
        for name in _SHOWN_VALUES:
            if name in self.history:
                yield name, over_items(self.history[name], items="states")

    def to_json(self) -> dict[str, Any]:
        """The history of all states."""
        return {"history": self.history}

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give the states for a paper, rendered again; see `paper_figure`.

        `frames`: numbers of the states that are shown. Raises InputError where one is not there.
        """
        count = len(self.history["state"])
        shown = chosen_frames(frames, count, shown_states(count), items="states")
        work = RenderWork(self.scene, self.pixels, count, components=self.components)
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
    required_model(scene)
    check_moduli(scene)
    check_pixel(scene, None)
    pixels, count = pixel_grid(scene), state_count(scene)
    if out is not None:
        seed = scene.camera.seed if scene.camera else None
        files = scene.files(of_frames=False)
        identity = run_identity(dump_scene(scene), files, {"components": components}, seed)
        if cluster is not None:  # another machine stands in another folder
            scene = scene.model_copy(update={"folder": (scene.folder or Path()).absolute()})
        with single_threaded():
            work = RenderWork(scene, pixels, count, components=components)
            job = Job(work, run_layout(work), identity)
            finish = partial(finish_simulation_folder, work=work, record=identity)
            options = RunOptions(workers, cluster, restart)
            columns = run_job(job, Path(out), finish, means=options, progress=progress)
        already = columns is None
        draw = partial(_draw, work, Path(out).absolute() / PICTURE, already)
        return Simulation(
            scene=scene, pixels=pixels, history=columns or read_csv(Path(out) / HISTORY),
            already=already, draw=draw, components=components,
        )  # fmt: skip
    refuse_without_folder(out, workers, cluster)
    states, shown = iter_scene_states(scene), shown_states(count)
    items, results, frames, orders = [], [], [], []
    history: dict[str, list[Any]] = {}
    maps: dict[str, list[NDArray[np.float32]]] = {}
    for index, item in enumerate(render(scene, states, pixels, components=components)):
        add_state_row(history, history_row(index, item, pixels))
        add_state_row(maps, item.components.maps if item.components else {})
        results.append(item.state)
        frames.append(item.frames)
        if index in shown:
            items.append(item)
        orders.append(item.picture.order.astype(np.float32))
        if progress is not None:
            progress(Tally(index + 1, count, 0, 0))
    layers = {name: np.stack(images) for name, images in maps.items()}
    return Simulation(
        scene=scene, pixels=pixels, history=history, states=results, frames=np.concatenate(frames),
        orders=np.stack(orders), maps=layers, draw=partial(simulation_figure, scene, pixels, items),
        components=components,
    )  # fmt: skip


def _draw(work: RenderWork, file: Path, already: bool) -> Figure:
    """The picture of a simulation in a folder."""
    if already:
        return saved_picture(file)
    return simulation_figure(work.scene, work.pixels, work.figure_items())
