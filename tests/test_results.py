"""What every command gives back: one interface, and the same as it leaves on disk."""

import csv
import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas
import pytest
from matplotlib.image import imread
from typer.testing import CliRunner

import isochrome
from isochrome import calibration
from isochrome.campaigns import process_campaign
from isochrome.cli import app
from isochrome.errors import InputError
from isochrome.fitting import track
from isochrome.output import Result, per_cent, write_csv, write_figure, write_json
from isochrome.processing import check
from isochrome.scene import dump_scene, load_scene, parse_scene
from made_calibrations import dots_in, three_colours
from scene_texts import SMALL_CAMERA, WORN_CONTACT
from shipped_sets import some_of_a_shipped_set

LOAD, LEFT = "load.normal_n", "camera.left_mm"
NAME = "a <b>bold<b> & long.toml"
"""A scene's name as it must not stand in a page."""


@dataclass(frozen=True)
class Left:
    """A result, and what its command left: the files' names, and the command's line.

    `run` gives the result, of a folder or in memory; of a run that is kept, the run taken up.
    """

    result: Result
    folder: Path
    table: str | None = None
    json: str | None = None
    picture: str | None = None
    command: tuple[Any, ...] = ()
    run: Callable[[Path | None], Result] | None = None

    def again(self) -> Result:
        """What the same call gives once more; of what has none, the result."""
        return self.result if self.run is None else self.run(self.folder)


def made(out: Path, run: Callable[[Path | None], Result], *files: str | None, **more: Any) -> Left:
    """What a call leaves in a folder."""
    return Left(run(out), out, *files, run=run, **more)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Makes a result by its name, each once."""
    home = tmp_path_factory.mktemp("results")
    scene, film = home / NAME, home / "film.toml"
    scene.write_text(WORN_CONTACT + SMALL_CAMERA + "noise_grey = 2.0\n", "utf-8")
    distances = {"wear.distances_m": [0.5 * k for k in range(4)]}
    film.write_text(dump_scene(load_scene(scene).with_values(distances)), "utf-8")
    places = {"scene": scene, "film": film, "home": home}

    @cache
    def make(name: str) -> Left:
        return MAKE[name](places, make)

    return make


def frames_of(places: dict[str, Path], which: str = "scene") -> Path:
    folder = places["home"] / f"frames-{which}"
    if not folder.exists():
        isochrome.simulate(places[which], folder)
    return folder / "frames.tif"


def simulated(places, make):
    return made(
        places["home"] / "simulated", lambda out: isochrome.simulate(places["scene"], out),
        "history.csv", None, "simulation.png", command=("simulate", places["scene"]),
    )  # fmt: skip


def processed(places, make):
    frames = frames_of(places)
    return made(
        places["home"] / "processed", lambda out: isochrome.process(frames, places["scene"], out),
        "frames.csv", None, "process.png", command=("process", frames, "--scene", places["scene"]),
    )  # fmt: skip


def process_tracked(places, make):
    frames, film = frames_of(places, "film"), places["film"]
    return made(
        places["home"] / "process-tracked",
        lambda out: isochrome.process(frames, film, out, track=True, every=3),
        "frames.csv", None, "process.png",
        command=("process", frames, "--scene", film, "--track", "--every", "3"),
    )  # fmt: skip


def compared(places, make):
    one, other, out = make("process").folder, make("simulate").folder, places["home"] / "compared"
    found = isochrome.compare(one, other, out)
    command = ("compare", one, other)
    return Left(found, out, "metrics.csv", None, "comparison.png", command=command)


def fitted(places, make):
    frames, scene = frames_of(places), places["scene"]
    return made(
        places["home"] / "fitted",
        lambda out: isochrome.fit(frames, scene, [LOAD], per_frame=[LEFT], out=out),
        "fit.csv", "fit.json", "fit.png",
        command=("fit", frames, "--scene", scene, "--free", LOAD, "--per-frame", LEFT),
    )  # fmt: skip


def fit_tracked(places, make):
    frames, film = frames_of(places, "film"), places["film"]
    command = ("fit", frames, "--scene", film, "--track", "--per-frame", LOAD, "--per-frame", LEFT)
    return made(
        places["home"] / "fit-tracked", lambda out: track(frames, film, [LOAD, LEFT], out=out),
        "fit.csv", "fit.json", "fit.png", command=command,
    )  # fmt: skip


def in_memory(places, make, name):
    """The same call without a folder, beside what it leaves in one."""
    left = make(name)
    return replace(left, result=left.run(None))


def checked(places, make):
    frames, scene = frames_of(places), places["scene"]
    command = ("check", frames, "--scene", scene)
    return made(places["home"], lambda _: check(frames, load_scene(scene)), command=command)


def swept(places, make):
    scene, vary = places["scene"], "load.normal_n=40,44"
    return made(
        places["home"] / "swept", lambda out: isochrome.sweep(scene, [vary], out), "sweep.csv",
        command=("sweep", scene, "--vary", vary),
    )  # fmt: skip


def planned(places, make):
    scene = dump_scene(load_scene(places["scene"]).with_values({"camera.noise_grey": 2.0}))
    file = places["home"] / "planned.toml"
    file.write_text(scene, "utf-8")
    vary = "load.normal_n=40,44"
    return made(
        places["home"] / "planned", lambda out: isochrome.plan(file, [vary], out=out), "plan.csv",
        "plan.json", "plan.png", command=("plan", file, "--vary", vary),
    )  # fmt: skip


def campaigned(places, make):
    recordings, out = [frames_of(places), places["home"] / "none.tif"], places["home"] / "campaign"
    found = process_campaign(recordings, places["scene"], out)
    return Left(found, out, "summary.csv", "summary.json", "summary.png")


def calibrated(specimen: str, run: Callable[..., Any], images: tuple[int, int]):
    def make_one(places, make):
        given = some_of_a_shipped_set(places["home"] / "sets", specimen, images)
        found, out = run(given), places["home"] / specimen
        calibration.save_calibration(found, out)
        return Left(found, out, "images.csv", "calibration.json", "calibration.png")

    return make_one


def calibrated_colour(places, make):
    found = three_colours(
        way="own <b>colours<b> &", gamma_uncertainty=0.03, bands_nm=(600.0, 540.0, 450.0),
        widths_nm=(30.0, 30.0, 30.0), warnings=("be careful",),
    )  # fmt: skip
    out = places["home"] / "colour"
    calibration.save_calibration(found, out)
    return Left(found, out, "colour_table.csv", "calibration.json", "calibration.png")


def calibrated_scale(places, make):
    """A picture whose name must not stand in a page as it is."""
    picture, out = places["home"] / "a <b>bold<b> & board.tif", places["home"] / "scale"
    target = dots_in(picture)
    found = calibration.calibrate_scale(picture, **target)
    calibration.save_calibration(found, out, source=[picture])
    options = [str(part) for key, value in target.items()
               for part in (f"--{key.replace('_', '-')}", value)]  # fmt: skip
    command = ("calibrate", "scale", picture, *options)
    return Left(found, out, "scale.csv", "scale.json", "scale.png", command=command)


def calibrated_wear(places, make):
    text = "".join(
        f"[[volume]]\ndistance_m = {s}\nnormal_n = 44.0\nvalue_mm3 = {8.8e-5 * s + e}\n"
        for s, e in ((31.0, 1e-4), (77.0, -1e-4), (155.0, 2e-4))
    )
    path = places["home"] / "wear.toml"
    path.write_text(text, "utf-8")
    out = places["home"] / "wear"
    found = calibration.calibrate_wear(path)
    calibration.save_calibration(found, out, source=path)
    files = "distances.csv", "calibration.json", "calibration.png"
    return Left(found, out, *files, command=("calibrate", "wear", path))


def benched(places, make):
    out = places["home"] / "bench"
    found = isochrome.bench(out, suite="inputs", quick=True)
    return Left(found, out, "inputs.csv", None, "inputs.png")


def demonstrated(places, make):
    out = places["home"] / "demo"
    found = isochrome.demo(out)
    return Left(found, out, None, "demo.json", "comparison/comparison.png")


MAKE: dict[str, Callable[..., Left]] = {
    "simulate": simulated, "process": processed, "process track": process_tracked,
    "compare": compared, "fit": fitted, "fit track": fit_tracked, "check": checked,
    "sweep": swept, "plan": planned, "campaign": campaigned,
    "calibrate bending": calibrated("bending", calibration.calibrate_bending, (0, 3)),
    "calibrate disc": calibrated("disc", calibration.calibrate_disc, (0, 2)),
    "calibrate colour": calibrated_colour, "calibrate scale": calibrated_scale,
    "calibrate wear": calibrated_wear, "bench": benched, "demo": demonstrated,
    **{f"{name}, in memory": partial(in_memory, name=name)
       for name in ("simulate", "process", "process track", "fit")},
}  # fmt: skip

IN_MINUTES = {"demo", "bench", "calibrate disc", "process, in memory", "process track, in memory"}


def marked(*names: str) -> pytest.MarkDecorator:
    """A test of some results, those of seconds in the slow part."""
    marks = dict.fromkeys(names, pytest.mark.long) | dict.fromkeys(IN_MINUTES, pytest.mark.study)
    marks |= {"sweep": (), "plan": (), "calibrate colour": ()}
    some = [pytest.param(name, marks=marks[name]) for name in names]
    return pytest.mark.parametrize("name", some, scope="module")


every_result = marked(*MAKE)


@every_result
def test_the_table_is_the_one_on_disk(name, results):
    left = results(name)
    table = left.result.table
    assert isinstance(table, pandas.DataFrame) and len(table)
    if left.table is None:
        return
    with open(left.folder / left.table, newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    assert list(table) == header and len(table) == len(rows)
    for number, column in enumerate(header):
        cells = [row[number] for row in rows]
        for cell, value in zip(cells, table[column].tolist(), strict=True):
            assert same(cell, value), (column, cell, value)


def same(cell: str, value: Any) -> bool:
    """Whether a cell of nine digits says what a table holds; what is not known is empty there."""
    if cell == "" or value is None:
        known = value is not None and value == value and value not in ("", np.inf)
        return cell == "" and not known
    if isinstance(value, float):
        return float(cell) == pytest.approx(value, rel=1e-8, abs=0.0)
    return cell == str(value)


@every_result
def test_the_json_is_the_one_on_disk(name, results, tmp_path):
    left = results(name)
    write_json(tmp_path / "result.json", left.result.to_json())
    text = (tmp_path / "result.json").read_bytes()
    assert json.loads(text)
    if left.json is not None:
        kept = json.loads((left.folder / left.json).read_text("utf-8"))
        for name in ("outputs", "outputs_crc32c", "record_crc32c"):  # of the folder's record
            kept.pop(name, None)
        assert json.loads(text) == kept


@marked(
    "simulate", "process", "process track", "compare", "fit", "fit track", "check", "sweep",
    "plan", "calibrate scale", "calibrate wear",
)  # fmt: skip
def test_the_command_prints_that_json(name, results, tmp_path):
    left = results(name)
    out = [] if name == "check" else ["--out", str(left.folder)]
    done = CliRunner().invoke(app, [*map(str, left.command), *out, "--json"])
    printed = json.loads(done.stdout)
    assert printed.pop("out", str(left.folder)) == str(left.folder)
    write_json(tmp_path / "again.json", left.again().to_json())
    assert printed == json.loads((tmp_path / "again.json").read_text("utf-8"))


@pytest.mark.long
@every_result
def test_the_figure_is_the_picture_on_disk(name, results, tmp_path):
    left = results(name)
    write_figure(tmp_path / "figure.png", left.result.figure())
    drawn = imread(tmp_path / "figure.png")
    assert min(drawn.shape[:2]) > 100 and np.ptp(drawn[..., :3]) > 0.5  # no empty page
    if left.picture is not None:
        np.testing.assert_array_equal(drawn, imread(left.folder / left.picture))


@pytest.mark.long
@marked("simulate", "process", "process track", "fit", "fit track")
def test_an_earlier_runs_figure_is_its_picture(name, results, tmp_path):
    left = results(name)
    again = left.again()
    assert again.already  # nothing was computed for it
    write_figure(tmp_path / "again.png", again.figure())
    np.testing.assert_array_equal(
        imread(tmp_path / "again.png"), imread(left.folder / left.picture)
    )


def test_an_earlier_picture_that_is_gone_is_asked_for(tmp_path):
    from isochrome.output import saved_picture

    (tmp_path / "torn.png").write_bytes(b"\x89PNG\r\n")
    for name in ("none.png", "torn.png"):
        with pytest.raises(InputError, match=f"{name}: no readable picture"):
            saved_picture(tmp_path / name)


@every_result
def test_its_warnings_are_sentences_and_its_report_is_short_and_counts_them(name, results):
    result = results(name).result
    assert isinstance(result, Result) and isinstance(result.warnings, tuple)
    assert all(isinstance(text, str) and text for text in result.warnings)
    lines = repr(result).splitlines()
    assert 1 <= len(lines) <= 12 and max(map(len, lines)) <= 120
    said = re.findall(r"^  (\d+) warnings?: see \.warnings$", repr(result), re.M)
    assert said == ([str(len(result.warnings))] if result.warnings else [])


@pytest.mark.long
def test_a_report_says_the_values_with_their_uncertainties(results):
    result = results("fit").result
    found = result.shared[LOAD]
    value, spread = re.search(rf"^  {LOAD} +(\S+) ± (\S+)$", repr(result), re.M).groups()
    assert float(value) == pytest.approx(found["value"], abs=0.05 * found["standard_uncertainty"])
    assert float(spread) == float(f"{found['standard_uncertainty']:.2g}")


def parts_of(result):
    """The tags of its page, which closes what it opens, and the text between them."""
    page = ElementTree.fromstring(result._repr_html_())
    return {part.tag for part in page.iter()}, "".join(page.itertext())


@every_result
def test_its_page_for_a_notebook_holds_table_and_warnings(name, results):
    result = results(name).result
    tags, text = parts_of(result)
    assert {"div", "table", "thead"} <= tags
    assert all(warning in text for warning in result.warnings)
    assert result.title in text and next(iter(result.columns)) in text


@marked("simulate", "process", "fit", "campaign", "calibrate colour")
def test_names_are_text_on_a_page(name, results):
    tags, text = parts_of(results(name).result)
    assert "<b>bold<b> &" in text or "<b>colours<b> &" in text
    assert tags <= {"div", "p", "b", "table", "thead", "tbody", "tr", "th", "td", "ul", "li"}


def test_nothing_is_drawn_where_nothing_was_fitted(tmp_path):
    scene = parse_scene("[specimen]\nthickness_mm = 4.0\n")
    found = process_campaign([tmp_path / "none.tif"], scene, tmp_path / "out")
    with pytest.raises(InputError, match="neither load nor friction"):
        found.figure()


@pytest.mark.long
def test_what_takes_long_to_start_is_imported_only_for_a_table_or_a_dataset(results, tmp_path):
    import subprocess
    import sys

    code = """
import sys
from isochrome.output import Result
from isochrome import check, process
assert "pandas" not in sys.modules and "matplotlib.pyplot" not in sys.modules
process(*sys.argv[1:], as_stated=True)
assert not {"pandas", "xarray", "scipy.stats"} & sys.modules.keys()
"""
    _, frames, _, scene = results("process").command
    subprocess.run([sys.executable, "-c", code, frames, scene, tmp_path / "out"], check=True)
    write_csv(tmp_path / "table.csv", results("check").result.columns)


def test_a_share_of_a_few_pixels_is_not_nothing():
    """A block of nine in the sample's 659 x 494 pixels is 3e-5 of them."""
    assert per_cent(9 / (659 * 494)) == "less than 0.1 %"
    assert per_cent(0.0123) == "1.2 %" and per_cent(0.001) == "0.1 %"
