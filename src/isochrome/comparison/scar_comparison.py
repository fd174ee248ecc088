"""`compare` for scars: measured traces beside the scars that a scene's wear makes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.calibration import WearSet
from isochrome.comparison.scar_figure import scars_figure, scars_panels
from isochrome.comparison.scar_metrics import ScarPair, pair_scar, profile_columns, scar_columns
from isochrome.comparison.simulated_scars import (
    SimulatedScar,
    simulated_scars,
    simulated_text,
)
from isochrome.errors import InputError
from isochrome.figures import PaperPanels
from isochrome.output import (
    Result,
    counted,
    provenance,
    staged,
    with_uncertainty,
    write_csv,
    write_figure,
)
from isochrome.runs import opened_record, seal
from isochrome.scars import UnclearScarError, levelled, read_trace
from isochrome.scene import Scene, dump_scene, load_scene, parse_toml, read_text

MAIN_SCAR_METRICS = (
    "measured_area_mm2", "measured_area_uncertainty_mm2", "simulated_area_mm2",
    "simulated_area_uncertainty_mm2", "measured_width_mm", "simulated_width_mm",
    "difference_rms_um", "difference_chi",
)  # fmt: skip
"""Columns that are shown where all of them are too many."""

_APART = 3.0
"""Standard uncertainties by which areas differ that a warning names."""


@dataclass(frozen=True, repr=False, kw_only=True)
class ScarComparison(Result):
    """Measured scars beside simulated ones.

    Parameters
    ----------
    draw : callable, optional
        Makes the figure.
    scene : Scene
        The scene whose wear made the simulated scars.
    names : tuple of str
        Names of the traces.
    scars : tuple of SimulatedScar
        The simulated scar at the distance of each trace.
    pairs : tuple of ScarPair or None
        Each trace on its scar; None where it shows none.
    messages : tuple of str
        What is to be known of the traces.
    """

    scene: Scene
    names: tuple[str, ...]
    scars: tuple[SimulatedScar, ...]
    pairs: tuple[ScarPair | None, ...]
    messages: tuple[str, ...] = ()

    @property
    def columns(self) -> dict[str, list[Any]]:
        """Those of metrics.csv, a row a trace."""
        rows = [scar_columns(*row) for row in zip(self.names, self.scars, self.pairs, strict=True)]
        return {name: [row[name] for row in rows] for name in rows[0]}

    @property
    def profiles(self) -> dict[str, Any]:
        """Columns of scars.csv: depths over x of each trace that shows a scar."""
        rows = [
            profile_columns(name, pair)
            for name, pair in zip(self.names, self.pairs, strict=True)
            if pair is not None
        ]
        return {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}

    @property
    def main_columns(self) -> tuple[str, ...]:
        """Columns that the command prints."""
        return "trace", "distance_m", *MAIN_SCAR_METRICS

    @property
    def warnings(self) -> tuple[str, ...]:
        """What traces show besides a scar, areas that differ, and inputs taken as exact."""
        found = list(self.messages)
        for name, pair in zip(self.names, self.pairs, strict=True):
            if pair is None:
                continue
            gap, spread = pair.area_difference_mm2
            if abs(gap) > _APART * spread:
                found.append(
                    f"{name}: its worn area, {pair.trace.worn_area_mm2:.4g} mm², differs from the "
                    f"simulated {pair.scar.worn_area_mm2:.4g} mm² by {abs(gap) / spread:.1f} "
                    "standard uncertainties; the scene's load, wear coefficient or distance is "
                    "not that of the scar"
                )
        if not self.scars[0].moved_um:
            found.append(
                f"{self.scene.name}: states no uncertainty, so the simulated scars have no band; "
                "write wear.coefficient_mm2_per_n, load.normal_n, ... as { value = ..., "
                "standard_uncertainty = ... }"
            )
        return tuple(found)

    @property
    def title(self) -> str:
        """How many traces were compared."""
        return f"Comparison of {counted(len(self.names), 'scar trace')}: {self.scene.name}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """Measured and simulated worn area of each trace."""
        for row in zip(*self.columns.values(), strict=True):
            one = dict(zip(self.columns, row, strict=True))
            model = simulated_text(one["simulated_area_mm2"], one["simulated_area_uncertainty_mm2"])
            own = (
                "no clear scar"
                if one["measured_area_mm2"] is None
                else with_uncertainty(
                    one["measured_area_mm2"], one["measured_area_uncertainty_mm2"]
                )
            )
            yield f"{one['trace']}, {one['distance_m']:g} m", f"{own} mm², simulated {model} mm²"

    def to_json(self) -> dict[str, Any]:
        """The metrics of all traces, and the warnings."""
        return {"metrics": self.columns, "warnings": list(self.warnings)}

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give the scars for a paper; see `paper_figure`.

        `frames`: numbers of the distances that are shown. Raises InputError where one is not there.
        """
        return scars_panels(self.names, self.scars, self.pairs, frames)


def compare_scars(
    measured: str | Path | Scene | WearSet | Sequence[tuple[str | Path, float]],
    simulation: str | Path | Scene,
    out: str | Path | None = None,
) -> ScarComparison:
    """Set measured scars beside the simulated ones: depth over x, worn area, width, difference.

    Traces (of a scene, a `calibrate_wear` set, or files with their distances, m) are levelled on
    their shoulders and moved onto the simulated scar by least squares. The band is the root sum of
    squares of [h(+u) - h(-u)]/2 over the inputs: JCGM 100:2008 (GUM), 5.1. `out`: folder for
    metrics.csv, scars.csv, provenance.json, scars.png. PhysicsError: no trace shows a scar.
    """
    files, listed = _traces(measured)
    scene = _simulated_scene(simulation)
    distances = sorted(set(listed))
    by_distance = dict(zip(distances, simulated_scars(scene, distances), strict=True))
    scars = tuple(by_distance[distance] for distance in listed)
    pairs, messages = _paired(files, scars)
    names = tuple(file.name for file in files)
    draw = partial(scars_figure, scene.name, names, scars, pairs)
    result = ScarComparison(
        scene=scene, names=names, scars=scars, pairs=pairs, messages=messages, draw=draw
    )
    if out is not None:
        with staged(out) as folder:
            write_csv(folder / "metrics.csv", result.columns)
            write_csv(folder / "scars.csv", result.profiles)
            inputs = [*files, *scene.files(of_frames=False)]
            write_figure(folder / "scars.png", result.figure())
            seal(folder, provenance(dump_scene(scene), inputs))
    return result


def _traces(
    measured: str | Path | Scene | WearSet | Sequence[tuple[str | Path, float]],
) -> tuple[list[Path], list[float]]:
    """Files of traces, and their distances (m)."""
    rows: list[tuple[Path, float]]
    if isinstance(measured, str | Path) and _is_wear_set(Path(measured)):
        measured = WearSet.read(measured)
    if isinstance(measured, WearSet):
        rows = [(measured.path(trace.file), trace.distance_m) for trace in measured.trace]
    elif isinstance(measured, str | Path | Scene):
        scene = load_scene(measured)
        rows = [(scene.path(scar.file), scar.distance_m) for scar in scene.scar]
        if not rows:
            raise InputError(
                f"{scene.name}: has no [[scar]], with file and distance_m, to compare; add them, "
                "or name a set of `isochrome calibrate wear` with [[trace]]"
            )
    else:
        rows = [(Path(file), float(distance)) for file, distance in measured]
    wrong = [distance for _, distance in rows if not 0.0 < distance < np.inf]
    if wrong or not rows:
        raise InputError(f"distances of traces {wrong}: give traces, each with one above 0 m")
    return [file for file, _ in rows], [distance for _, distance in rows]


def _is_wear_set(path: Path) -> bool:
    """Whether a TOML file has traces, as sets of a wear calibration and no scenes have."""
    return path.is_file() and "trace" in parse_toml(read_text(path), str(path))


def _simulated_scene(simulation: str | Path | Scene) -> Scene:
    """A scene, or that of a folder of `simulate`."""
    if not isinstance(simulation, Scene) and Path(simulation).is_dir():
        file = Path(simulation) / "scene.toml"
        if not file.is_file():
            raise InputError(f"{file}: is not there; name a result folder of simulate, or a scene")
        opened_record(file.parent, [file.name])
        return load_scene(file)
    return load_scene(simulation)


def _paired(
    files: Sequence[Path], scars: Sequence[SimulatedScar]
) -> tuple[tuple[ScarPair | None, ...], tuple[str, ...]]:
    """Each trace on its scar, and what is to be said; PhysicsError where none shows a scar."""
    pairs: list[ScarPair | None] = []
    messages: list[str] = []
    first: UnclearScarError | None = None
    for file, scar in zip(files, scars, strict=True):
        trace = read_trace(file)
        try:
            found = levelled(trace)
        except UnclearScarError as unclear:
            first = first or unclear
            pairs.append(None)
            messages.append(str(unclear))
            continue
        pairs.append(pair_scar(found, scar))
        messages += found.messages
    if first is not None and not any(pairs):
        raise first
    return tuple(pairs), tuple(messages)
