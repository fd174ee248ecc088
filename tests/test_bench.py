"""The bench: the rival is right, so that the comparison is fair, and every case runs."""

import csv
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile

from hard.hard_cases import COUPLING, LOAD, MODULUS, PAIR, RADIUS, WEAR
from isochrome.benchmarks import bench, load_benchmarks
from isochrome.contact import make_surface, solve_pressure
from isochrome.errors import InputError
from isochrome.frames import open_frames
from isochrome.reference import (
    coupled_contact,
    coupled_pressure,
    dundurs_beta,
    hertz_half_width,
    hertz_peak_pressure,
    hertz_pressure,
)

ROWS = load_benchmarks("rows")


@pytest.fixture(scope="module")
def paper():
    return load_benchmarks("paper_procedure")


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    said = []
    got = bench(folder, quick=True, progress=said.append)
    assert said == list(load_benchmarks("cases").CASES)
    return [ROWS.Row(**row) for row in got.rows], got.text, folder


def test_papers_pressure_is_hertzs_to_its_stated_error(paper):
    elements = paper.make_elements(1024, 1.0, contact_modulus_mpa=MODULUS)
    got = paper.solve(elements, elements.x_mm**2 / (2 * RADIUS), LOAD, tolerance=1e-6)
    p0 = hertz_peak_pressure(LOAD, RADIUS, MODULUS)
    assert got.converged
    assert got.pressure.max() == pytest.approx(p0, rel=1e-5)  # 5.4e-6, in 46 iterations
    assert got.iterations < 60


def test_papers_coupling_leans_to_the_side_of_the_closed_form(paper):
    # a wrong sign of H in (A.4) shifts the contact by 2 x 0.0096 mm the other way
    elements = paper.make_elements(
        1024, 1.0, contact_modulus_mpa=MODULUS, coupling_per_mpa=COUPLING, friction=0.25
    )
    got = paper.solve(elements, elements.x_mm**2 / (2 * RADIUS), LOAD, tolerance=1e-8)
    contact = coupled_contact(LOAD, RADIUS, MODULUS, beta=dundurs_beta(*PAIR), friction=0.25)
    exact = coupled_pressure(elements.x_mm, contact)
    inside = np.abs(elements.x_mm - contact.centre_mm) < 0.8 * contact.half_width_mm
    assert np.abs(got.pressure - exact)[inside].max() < 5e-6 * exact.max()  # 1.7e-6


def test_papers_pressure_agrees_with_ours(paper):
    elements = paper.make_elements(257, 0.8, contact_modulus_mpa=MODULUS)
    surface = make_surface(257, elements.dx_mm, contact_modulus_mpa=MODULUS)
    gap = elements.x_mm**2 / (2 * RADIUS)
    theirs = paper.solve(elements, gap, LOAD, tolerance=1e-9).pressure
    assert theirs.max() == pytest.approx(
        solve_pressure(surface, gap, LOAD).pressure.max(), rel=1.5e-6
    )  # 4.9e-7, one grid and two ways to solve it


def test_explicit_steps_beyond_the_limit_double_the_pressure_and_nothing_warns(paper):
    # the trap: the depth hardly changes, so that only the pressure tells
    elements = paper.make_elements(129, 0.8, contact_modulus_mpa=MODULUS)
    gap = elements.x_mm**2 / (2 * RADIUS)
    limit = paper.explicit_limit_mm(elements.dx_mm, WEAR, MODULUS)
    (stable,) = paper.wear(elements, gap, LOAD, WEAR, [120.0], step_mm=0.25 * limit)
    (beyond,) = paper.wear(elements, gap, LOAD, WEAR, [120.0], step_mm=2.0 * limit)
    assert beyond[0].max() > 2.0 * stable[0].max()  # 2.2
    assert beyond[1].max() == pytest.approx(stable[1].max(), rel=6e-3)  # 2e-3


@pytest.mark.parametrize("fold", [1, 3])
def test_both_direct_sums_of_the_stress_are_the_same_sum(paper, fold):
    x, z = np.linspace(-1.0, 1.0, 41), np.array([0.003, 0.1, 1.0])
    h = 0.05 / fold
    nodes = h * (np.arange(60 * fold) - 20 * fold)
    a, p0 = hertz_half_width(LOAD, RADIUS, MODULUS), hertz_peak_pressure(LOAD, RADIUS, MODULUS)
    p = hertz_pressure(nodes, half_width_mm=a, peak_pressure_mpa=p0)
    sums = [
        s(x, z, nodes[0], h, p, 0.25 * p) for s in (paper.stress_by_edges, paper.stress_by_lags)
    ]
    np.testing.assert_allclose(sums[0], sums[1], atol=4e-15 * p0)  # 1.2e-15, rounding


@pytest.mark.long
def test_quick_bench_has_rows_of_every_case(quick):
    got, _, _ = quick
    for name in ("pressure", "wear", "stress", "fringe frame"):
        rows = [row for row in got if row.case.startswith(name)]
        assert {row.method for row in rows} == {"this project", "the paper's procedure"}
    assert all(row.seconds > 0.0 for row in got if not math.isnan(row.seconds))


@pytest.mark.long
def test_errors_of_the_quick_bench_are_what_its_cases_promise(quick):
    got, _, _ = quick
    ours = [row for row in got if row.method == "this project"]
    assert max(row.error for row in ours if row.case.startswith("pressure")) < 8e-5
    worn = {r.setting.split(":")[0]: r.error for r in ours if r.case.startswith("wear")}
    # far within the tolerance over 5 m: 6.7e-5; and the fixed grid's error in space, 4e-4
    assert worn["tolerance 0.001"] < 2e-4
    assert worn["any profile, tolerance 0.001"] < 1.2e-3
    exact = [row.error for row in ours if row.case.endswith("exact sum")]
    assert exact[0] < 1.5e-7 and exact[1] < 1e-13  # single, double precision: 4.6e-8, 2.9e-14
    frames = [row.error for row in ours if row.case.startswith("fringe frame")]
    assert max(frames) < 3e-4  # fringes: 9.5e-5; a NaN fails too


@pytest.mark.long
def test_bench_writes_a_table_and_a_picture(quick):
    got, _, folder = quick
    assert sorted(p.name for p in folder.iterdir()) == ["bench.csv", "bench.png"]
    with (folder / "bench.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [row["setting"] for row in table] == [row.setting for row in got]


def test_ratio_is_to_the_fastest_rival_as_accurate_and_says_where_there_is_none():
    common = load_benchmarks("common")
    rivals = [
        ROWS.Row("c", common.PAPER, "", 1e-3, 1.0),
        ROWS.Row("c", common.PAPER, "", 1e-5, 8.0),
    ]
    ours = [ROWS.Row("c", common.OURS, "", e, 2.0) for e in (1e-2, 1e-4, 1e-6)]
    rows = common.with_ratios(rivals + ours)[2:]
    assert [row.ratio for row in rows] == [0.5, 4.0, 4.0]
    assert [row.reached for row in rows] == [True, True, False]


def test_among_equally_accurate_rivals_the_fastest_counts():
    """Goes wrong if rounding picks the slower of two sums that are one in exact arithmetic."""
    common = load_benchmarks("common")
    rows = [
        ROWS.Row("c", common.PAPER, "", 1e-3 * (1 + 1e-12), 1.0),
        ROWS.Row("c", common.PAPER, "", 1e-3, 8),
    ]
    (_, _, ours) = common.with_ratios([*rows, ROWS.Row("c", common.OURS, "", 1e-4, 0.5)])
    assert ours.ratio == 2.0 and not ours.reached


def test_an_installed_package_finds_the_benchmarks_of_the_clone_it_is_run_from(code, tmp_path):
    """And without a clone it says where to run it."""
    clone = Path(__file__).parents[1]
    words = f"""
import os
from isochrome.benchmarks import benchmarks_folder
from isochrome.errors import InputError
os.chdir({str(clone)!r})
print(benchmarks_folder())
os.chdir({str(tmp_path)!r})
try:
    benchmarks_folder()
except InputError as error:
    print(error)
"""
    home = os.environ | {"PYTHONPATH": str(code)}
    done = subprocess.run(
        [sys.executable, "-c", words], env=home, capture_output=True, text=True, check=True
    )
    found, said = done.stdout.splitlines()
    assert Path(found) == clone / "tests" / "benchmarks"
    assert said.endswith("run it from a clone")


def test_a_bench_keeps_the_rows_of_all_its_cases(monkeypatch, tmp_path):
    cases = load_benchmarks("cases")
    two = {name: lambda quick, name=name: [ROWS.Row(name, "", "", 1e-3)] for name in ("one", "two")}
    suite = replace(cases.SUITES["speed"], cases=lambda: two, file="both")
    monkeypatch.setitem(cases.SUITES, "both", suite)
    said = []
    got = bench(suite="both", progress=said.append)
    assert [row["case"] for row in got.rows] == said == ["one", "two"]
    assert all(name in got.text for name in ("one", "two"))


@pytest.mark.long
def test_fringes_suite_judges_a_reading_by_the_truth_and_writes_a_table_and_a_picture(
    monkeypatch, tmp_path
):
    case, cases = load_benchmarks("case_fringes"), load_benchmarks("cases")
    assert list(cases.SUITES["fringes"].cases())[: len(case.specimens().NAMES)] == list(
        case.specimens().NAMES
    )
    few = {"beam": case.cases()["beam"]}
    suite = replace(cases.SUITES["fringes"], cases=lambda: few)
    monkeypatch.setitem(cases.SUITES, "fringes", suite)
    got = bench(tmp_path / "out", suite="fringes", quick=True)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["fringes.csv", "fringes.png"]
    arcsine, free = (ROWS.FringeRow(**row) for row in got.rows)
    # of the fringe's crests a pixel alone knows nothing, and a patch of them does: 0.116 of the
    # arcsine's error at most in four seeds, and 0.994 of the specimen
    assert free.rms < 0.2 * arcsine.rms and free.kept > 0.985 and free.wrong == 0.0
    assert free.right == 1.0 and math.isnan(arcsine.right) and arcsine.wrong == 0.0
    assert max(map(len, got.text.splitlines())) <= 120


def test_a_reading_that_is_off_is_counted_as_such():
    case = load_benchmarks("case_fringes")
    seen = case.specimens().view("beam")
    order = np.where(seen.material, seen.order, np.nan)
    order[:200] = np.nan
    order[300:310] += 1.0
    sure = np.ones(order.shape)
    row = case.judged("beam", "", seen, order, sure, 0.0)
    kept = np.isfinite(order).sum()
    assert row.kept == pytest.approx(kept / seen.material.sum())
    assert row.wrong == pytest.approx(10 * order.shape[1] / kept)
    assert row.rms == pytest.approx(math.sqrt(row.wrong)) and row.median == 0.0
    assert row.right == pytest.approx(1.0 - row.wrong)
    nothing = case.judged("beam", "", seen, np.full_like(order, np.nan), None, 0.0)
    assert nothing.kept == 0.0 and math.isnan(nothing.rms)


def test_an_unknown_suite_is_refused_with_the_known_ones():
    with pytest.raises(
        InputError,
        match="speed, fringes, fit, defects, contacts, benches, inputs, track, memory, tolerance, "
        "plan",
    ):
        bench(suite="colour")


@pytest.mark.study
def test_defects_suite_names_a_defect_and_keeps_to_its_uncertainty(tmp_path):
    """The first single one: a roll. Its row, the table and the picture."""
    case = load_benchmarks("case_defects")
    row = case.judged("single", 0)
    assert row.defects == row.found == "roll" and row.named and row.first and not row.refused
    assert 1.0 <= row.over_bound < 1.5
    assert max(abs(row.load_pull), abs(row.friction_pull)) < 4.0 and row.chi < 1.05
    text = case.table([row])
    assert "within 3 u" in text and "roll" in text
    case.figure([row]).savefig(tmp_path / "defects.png")
    gone = replace(row, refused="no fringes")
    assert "single 0: roll: no fringes" in case.table([gone])


@pytest.mark.parametrize("friction", [0.0, 0.2, -0.2])
def test_strips_of_even_traction_are_the_closed_form_of_a_contact(friction):
    """But above the depth of a few strips, of which five lie in a pixel."""
    outside, strips = load_benchmarks("outside_contact"), load_benchmarks("outside_tractions")
    size = {"friction": friction, "shape": (60, 165)}
    closed, made = outside.Contact(**size), strips.RealContact(**size)
    assert made.pressure_mpa() == pytest.approx(closed.pressure_mpa(), rel=1e-4)
    off = np.abs(made.seen(5) - closed.seen(5)).max(axis=1)
    # a strip's own field falls with the depth's square
    assert off[5] < 4e-3 and off[10] < 1.5e-3 and off[50:].max() < 2e-4


@pytest.mark.long
@pytest.mark.parametrize(
    "seed", [4, *(pytest.param(seed, marks=pytest.mark.study) for seed in (0, 3, 6, 7))]
)
def test_contacts_suite_is_within_the_uncertainty_of_real_contacts(seed):
    case = load_benchmarks("case_contacts")
    row = case.judged("single", seed)
    assert row.defects == row.found and row.named and row.chi < 1.05 and not row.refused
    assert max(abs(row.load_pull), abs(row.friction_pull)) < 3.0
    assert row.defects in case.table([row])


@pytest.mark.long
def test_inputs_suite_covers_the_truth_by_the_whole_uncertainty(tmp_path):
    case = load_benchmarks("case_inputs")
    rows = [row for kind in case.cases() for row in case.cases()[kind](quick=True)]
    assert [row.kind for row in rows] == ["held", "asked"]
    # what is held is hardly the noise's, and a frame that is asked says more
    assert all(row.noise_percent < 0.2 * row.combined_percent for row in rows)
    assert rows[1].combined_percent < rows[0].combined_percent and rows[1].freed
    assert max(abs(row.load_pull) for row in rows) < 4.0
    text = case.table([*rows, replace(rows[0], refused="no fringes")])
    assert "load within 1.96 u" in text and "held 0: no fringes" in text
    case.figure(rows).savefig(tmp_path / "inputs.png")


@pytest.mark.long
def test_fit_suite_holds_a_fit_to_the_truth_and_writes_a_table_and_a_picture(monkeypatch, tmp_path):
    case, cases = load_benchmarks("case_fit"), load_benchmarks("cases")
    few = {case.ONE: case.one_frame}
    suite = replace(cases.SUITES["fit"], cases=lambda: few)
    monkeypatch.setitem(cases.SUITES, "fit", suite)
    got = bench(tmp_path / "out", suite="fit", quick=True)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["fit.csv", "fit.png"]
    load, order = (ROWS.FitRow(**row) for row in got.rows)
    # eight seeds: 0.001 % and 8e-5 fringe at most
    assert load.error < 0.003 < load.bar and order.error < 2.4e-4 < order.bar
    # of four normal pulls the root mean square is 0.15 to 2.15 but twice in a thousand
    assert 0.15 < load.pull < 2.15 and math.isnan(order.pull)
    assert load.cpu_ms > 0.0 and load.evaluations > 1.0
    assert max(map(len, got.text.splitlines())) <= 150


@pytest.mark.long
def test_track_suite_counts_frames_and_what_reading_takes(monkeypatch, tmp_path):
    case, cases = load_benchmarks("case_track"), load_benchmarks("cases")
    few = {"TIFF stack": case.cases()["TIFF stack"]}
    monkeypatch.setitem(cases.SUITES, "track", replace(cases.SUITES["track"], cases=lambda: few))
    got = bench(tmp_path / "out", suite="track", quick=True)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["track.csv", "track.png"]
    (row,) = (ROWS.TrackRow(**row) for row in got.rows)
    assert (row.frames, row.workers) == (9, 1) and row.cpu_ms > 0.0 and row.frames_per_s > 0.0
    assert 0.0 < row.reading < 0.03 and 0.0 < row.writing < 0.03  # both up to 0.007
    # nine pulls' root mean square is 1 to a quarter or so; 5 times fewer pixels than the paper's
    assert 0.35 < row.pull < 1.8 and row.load_error < 2.4e-4  # 8e-5
    assert max(map(len, got.text.splitlines())) <= 110


@pytest.mark.study
def test_track_suite_reads_a_film_of_a_codec_whose_columns_are_even():
    (row,) = load_benchmarks("case_track").run_case("MJPEG in AVI", quick=True)
    assert row.frames == 9 and row.load_error < 3.5e-4  # 1.1e-4: a codec adds a little


@pytest.mark.study
def test_track_suite_sets_a_worn_film_beside_its_frames_wholly():
    case = load_benchmarks("case_track")
    rows = [row for name in (case.WORN, case.WORN_WHOLE) for row in case.run_case(name, quick=True)]
    assert [row.frames for row in rows] == [9, 9]
    # 8e-5 in nine frames of a fifth of the size
    assert all(row.load_error < 2.4e-4 for row in rows)
    assert "times the frames a second of each wholly" in case.table(rows)


@pytest.mark.study
def test_track_suite_judges_orders_of_films_without_a_model():
    films, case = load_benchmarks("case_films"), load_benchmarks("case_track")
    assert set(films.FILMS) <= set(case.cases())
    names = f"beam {films.ZERO}", f"disc {films.KEYED}"
    rows = [row for name in names for row in films.run_case(name, quick=True)]
    assert [row.frames for row in rows] == [26, 6]
    # frames of a quarter of the size: fringes are twice as fine as in the films that the row is of
    assert all(row.wrong == 0.0 and 0.0 < row.rms < 0.01 and row.kept > 0.7 for row in rows)
    assert max(map(len, case.table(rows).splitlines())) <= 110


@pytest.mark.study
@pytest.mark.skipif(sys.platform == "win32", reason="no resource module there")
def test_memory_is_that_of_the_run_alone(tmp_path):
    got = bench(tmp_path / "out", suite="memory", quick=True)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["memory.csv", "memory.png"]
    rows = [ROWS.MemoryRow(**row) for row in got.rows]
    assert [row.command for row in rows] == ["simulate", "process --track", "process --track"]
    # the libraries alone take some 80 to 110 MB, three states or seven small frames little more
    assert all(60.0 < row.peak_mb < 300.0 and row.seconds > 0.0 for row in rows)
    assert max(map(len, got.text.splitlines())) <= 110


def test_a_stack_whose_pages_share_pixels_is_read_as_written(tmp_path):
    frames = np.random.default_rng(1).integers(0, 256, (3, 20, 30)).astype(np.uint8)
    order = [0, 2, 1, 1, 0]
    load_benchmarks("case_memory").repeated_stack(tmp_path / "a.tif", frames, order)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "a.tif"), frames[order])
    with open_frames(tmp_path / "a.tif") as reader:
        assert reader.count() == len(order)
        np.testing.assert_array_equal([frame.image for frame in reader.iterate(0)], frames[order])
