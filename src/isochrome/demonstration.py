"""`demo`: the paper's case and the sample images, end to end and offline."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.calibration import calibrate_bending, calibrate_disc, load_set, save_calibration
from isochrome.comparison import Comparison, ScarComparison, compare
from isochrome.figures import PaperPanels
from isochrome.frames import look_through, open_frames
from isochrome.output import Result, output_folder, with_uncertainty, write_json
from isochrome.processing import process
from isochrome.runs import single_threaded
from isochrome.samples import samples_path
from isochrome.scene import load_scene
from isochrome.simulation import simulate

Progress = Callable[[str], None]

_SWING = 45
"""Frames of the sample film, every other of which the demo follows: its load swings once."""


@dataclass(frozen=True, repr=False)
class Demo(Result):
    """What the demo found: `rows` of (quantity, found, expected), and the `folder` it left.

    `comparison`, of the sample frames with what was found in them.
    """

    folder: Path
    rows: list[tuple[str, str, str]]
    summary: dict[str, Any]
    comparison: Comparison | ScarComparison

    @property
    def columns(self) -> dict[str, list[str]]:
        """A row a quantity: what was found, and what was to be expected."""
        names = ("quantity", "found", "expected")
        return dict(zip(names, map(list, zip(*self.rows, strict=True)), strict=True))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Those of the sample frames and of the film."""
        return tuple(self.summary["warnings"])

    @property
    def title(self) -> str:
        """Where all of it is."""
        return f"Demo: {self.folder}"

    def main_values(self) -> list[tuple[str, str]]:
        """What was found."""
        return [(quantity, result) for quantity, result, _ in self.rows]

    def to_json(self) -> dict[str, Any]:
        """What demo.json holds."""
        return self.summary

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give the comparison's panels for a paper; see `paper_figure`."""
        return self.comparison.panels(frames)


def demo(out: str | Path = "isochrome-demo", *, progress: Progress | None = None) -> Demo:
    """Run the main job on the paper's case and the shipped sample images.

    Solves the contact of `line-contact-wear`; checks and processes the six sample frames (rendered,
    with a camera's faults); simulates what was found in them; compares the two side by side;
    follows the sample film (rendered too) for one swing of its load in every other frame, with
    load, friction and wear over the distance, and the order; calibrates the fringe value from the
    sample bending and disc images.

    Parameters
    ----------
    out : str or Path, default 'isochrome-demo'
        Folder for all results.
    progress : callable, optional
        Called with each step's name.

    Returns
    -------
    Demo
        The main numbers beside their true values.

    Raises
    ------
    InputError
        Where the folder cannot be written.
    PhysicsError
        Where a step fails.

    Examples
    --------
    About a minute:

    >>> import isochrome
    >>> isochrome.demo("isochrome-demo")  # doctest: +SKIP
    """
    import xarray

    say = progress or (lambda _: None)
    # frames are read as stated, for time: of the six nothing is freed that `process` tries, and of
    # the film a band of wavelengths, which moves the load by 0.003 %
    with single_threaded():  # threads would spend time without saving any
        folder, samples = output_folder(out), samples_path()
        contact = samples / "line-contact-wear"
        say("pressing and wearing the paper's contact")
        paper = simulate("line-contact-wear")  # whose frames are drawn below, as they were found
        say("checking the sample frames")
        scene = load_scene(contact / "scene.toml")
        checked = look_through(contact / "captured.tif", scene)
        say("reading the fringe order of the sample frames")
        experiment = process(contact / "captured.tif", scene, folder / "experiment", as_stated=True)
        assert experiment.fitted is not None
        say("simulating what was found")
        simulate(experiment.fitted, folder / "simulation")
        say("comparing the two")
        comparison = compare(folder / "experiment", folder / "simulation", folder / "comparison")
        say("following the sample film")
        with open_frames(samples / "sliding-film" / "film.avi") as reader:
            swing = list(islice(reader, 0, _SWING, 2))
        images, times = np.stack([f.image for f in swing]), [f.time_s for f in swing]
        axes, places = ("frame", "row", "col"), {"time_s": ("frame", times)}
        film = xarray.DataArray(images, places, axes)
        film_scene = load_scene(samples / "sliding-film" / "scene.toml")
        followed = process(film, film_scene, folder / "film", track=True, as_stated=True)
        say("calibrating the fringe value from bending and disc images")
        bending = calibrate_bending(samples / "bending" / "set.toml")
        save_calibration(bending, folder / "calibration-bending")
        discs = load_set(samples / "disc" / "set.toml", specimen="disc")
        # a line through two loads is as certain: its ± is that of load and diameter
        disc = calibrate_disc(discs.model_copy(update={"image": (discs.image[0], discs.image[-1])}))
        save_calibration(disc, folder / "calibration-disc")
        truth = read_truth(samples)
        rows = [
            ("static p_max (MPa)", f"{paper.history['p_max_mpa'][0]:.3f}",
             "18.758 by Hertz; 18.75 in the paper"),
            ("static contact width (mm)", f"{paper.history['contact_width_mm'][0]:.4f}",
             "0.7466 by Hertz; 0.758 in the paper"),
            ("chi of the six frames", _range(experiment.columns["chi"], 3), "1: fits to the noise"),
            ("experiment - simulation, RMS (fringes)",
             _range(comparison.columns["order_rms_fringe"], 4), "0.01 or less"),
            ("load (N)", _range(experiment.columns["load.normal_n"], 2), truth["load"]),
            ("load of the film (N)", _range(followed.columns["load.normal_n"], 2), truth["film"]),
            ("f_sigma from bending (N/mm)", _with_u(bending), truth["bending"]),
            ("f_sigma from the disc (N/mm)", _with_u(disc), truth["disc"]),
        ]  # fmt: skip
        summary: dict[str, Any] = {"folder": str(folder), "history": paper.history}
        summary |= {"frames": experiment.columns, "metrics": comparison.columns}
        summary |= {"calibration_bending": bending.to_json(), "calibration_disc": disc.to_json()}
        summary |= {"check": [one.text for one in checked.findings], "film": followed.columns}
        summary["warnings"] = [*experiment.warnings, *followed.warnings]
        write_json(folder / "demo.json", summary)
        return Demo(folder, rows, summary, comparison, draw=comparison.figure)


def read_truth(samples: Path) -> dict[str, str]:
    """What the sample images were rendered with, as text for the summary."""
    keys = {
        "load": ("line-contact-wear", "load.normal_n"), "film": ("sliding-film", "load.normal_n"),
        "bending": ("bending", "fringe_value_n_per_mm"), "disc": ("disc", "fringe_value_n_per_mm"),
    }  # fmt: skip
    texts = {}
    for name, (folder, key) in keys.items():
        value = json.loads((samples / folder / "truth.json").read_text("utf-8"))[key]
        text = _range(value, 2) if isinstance(value, list) else f"{value:g}"
        texts[name] = f"{text}, rendered"
    return texts


def _range(values: list[float], digits: int) -> str:
    low, high = f"{min(values):.{digits}f}", f"{max(values):.{digits}f}"
    return low if low == high else f"{low} to {high}"


def _with_u(calibration: Any) -> str:
    return with_uncertainty(calibration.fringe_value_n_per_mm, calibration.standard_uncertainty)
