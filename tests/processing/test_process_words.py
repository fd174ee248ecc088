"""The first ± that is read says what it is of: terminal, JSON, page, report, of both kinds of set.
The frames are the first two of the sample, whose true values nobody of the package renders here."""

import html
import json
import re

import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner

from isochrome.cli import app
from isochrome.output import read_csv
from isochrome.samples import samples_path
from isochrome.scene import dump_scene, load_scene
from isochrome.setup_page import fit_answer, open_session

PIXEL, LOAD = "camera.pixel_mm", "load.normal_n"
EXACT = [PIXEL, "specimen.thickness_mm", "specimen.fringe_value_n_per_mm", "indenter.radius_mm",
         "specimen.young_gpa", "indenter.young_gpa", "specimen.poisson",
         "indenter.poisson"]  # fmt: skip
WORDS = (
    "± from the {} alone: camera.pixel_mm, specimen.thickness_mm, specimen.fringe_value_n_per_mm "
    "and 5 more were taken as exact"
)
USUAL = dict(zip(EXACT, (0.002, 0.005, 0.005, 0.002, 0.02, 0.02, 0.02, 0.03), strict=True))
"""Relative standard uncertainties, as a bench knows them."""
DRAWN = np.random.default_rng(36).normal(size=len(USUAL)).clip(-2.0, 2.0)
"""Errors of the stated values over these."""


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """The contact in the sample's first two frames, the static one and the one that slides."""
    folder = tmp_path_factory.mktemp("sample")
    source = samples_path() / "line-contact-wear"
    for name in ("no-load-dark", "no-load-bright", "captured"):
        frames = np.atleast_3d(tifffile.imread(source / f"{name}.tif").T).T[:2, :180, 210:450]
        tifffile.imwrite(folder / f"{name}.tif", np.ascontiguousarray(frames))
    scene = load_scene(source / "scene.toml").with_values({
        "wear.distances_m": [0.0], "camera.width_px": 240, "camera.height_px": 180,
        "camera.left_mm": -0.73, "camera.blur_px": 0.4,
    })  # fmt: skip
    honest = scene.with_values({
        key: {"value": scene.get(key) * (1.0 + off * share),
              "standard_uncertainty": share * scene.get(key)}
        for (key, share), off in zip(USUAL.items(), DRAWN, strict=True)
    })  # fmt: skip
    for name, one in (("bare", scene), ("honest", honest)):
        (folder / f"{name}.toml").write_text(dump_scene(one))
    return folder


def run(folder, command, name, *more):
    """What a command says of the sample by a scene's name: terminal, JSON, and its report."""
    out = folder / f"{command}-{name}"
    line = [command, str(folder / "captured.tif"), "--scene", str(folder / f"{name}.toml"), "--out",
            str(out), *more]  # fmt: skip
    said = CliRunner().invoke(app, line)
    assert said.exit_code == 0, said.output
    again = CliRunner().invoke(app, [*line, "--json"])
    page = html.unescape(re.sub(r"<[^>]*>", "", (out / "report.html").read_text("utf-8")))
    return said, json.loads(again.stdout), page, out


FIT = ("--per-frame", LOAD, "--per-frame", "camera.left_mm", "--per-frame", "camera.top_mm",
       "--per-frame", "friction.coefficient")  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize(("command", "more"), [("process", ()), ("fit", FIT)])
def test_a_scene_that_states_no_uncertainty_is_said_to_be_taken_as_exact(sample, command, more):
    said, found, page, _ = run(sample, command, "bare", *more)
    words = WORDS.format("pictures")
    (line,) = (text for text in said.stdout.splitlines() if words in text)
    assert found["taken_as_exact"] == EXACT and found["summary_text"] == line
    assert f"{line[:1].upper()}{line[1:]}." in page
    assert line.startswith("mean of 2 frames, ± of each: load 44.6") and "refined" not in line
    assert line.endswith("; causes found: none") and not found["warnings"]
    assert all(key in page.partition("Taken as exact")[2].partition(".\n")[0] for key in EXACT)
    assert not re.findall(r"± ?\d+\.?\d*\d{9}", page)


@pytest.mark.long
@pytest.mark.parametrize(
    ("command", "more"), [("process", ()), pytest.param("fit", FIT, marks=pytest.mark.study)]
)
def test_honest_uncertainties_are_in_the_values_and_raise_no_alarm(sample, command, more):
    said, found, page, out = run(sample, command, "honest", *more)
    line = found["summary_text"]
    assert line in said.stdout.splitlines() and line[1:] in page
    assert "taken as exact" not in said.stdout + page.lower() and found["taken_as_exact"] == []
    assert line.endswith("causes found: none") and "contradict" not in said.output + page
    assert not found["warnings"] and "None: the frames ask for nothing besides" in page
    # the truth of the sample within three of a ± that holds what the scene states
    value, spread = map(float, re.search(r"load (\S+) ± (\S+) N", line).groups())
    assert abs(value - 44.66) < 3.0 * spread and spread > 0.1
    assert "; refined: " in line and " (stated " in line and "known better than" in page
    if command == "process":
        table = read_csv(out / "frames.csv")
        assert not any(isinstance(cell, str) for cell in table["causes"])
        # programs read all digits, people two of a ±
        (long,) = re.findall(r"camera.pixel_mm = \S+ ± (\S+);", table["refined"][0])
        assert len(long) > 10 and long not in page


def test_of_a_track_what_is_stated_is_in_no_uncertainty_and_counts_as_exact(sample):
    from isochrome.fitting import taken_as_exact

    scene = load_scene(sample / "honest.toml")
    assert taken_as_exact(scene, (LOAD,), tracked=True)[:8] == tuple(EXACT)
    assert not set(EXACT) & set(taken_as_exact(scene, (LOAD,)))


@pytest.mark.long
def test_the_set_up_page_says_it_of_one_frame(sample):
    for name in ("bare", "honest"):
        session = open_session(sample / "captured.tif", sample / f"{name}.toml")
        answer = fit_answer(session, 0)
        said, exact = answer["summary_text"], WORDS.format("picture")
        assert said.startswith("load 44.") and (exact in said) == (name == "bare")
        refined = [one["key"] for one in answer["values"] if one["refined"]]
        assert (PIXEL in refined) == (name == "honest") == ("refined: " in said)
        assert not any(one["asked"] for one in answer["values"]) and not answer["warnings"]
