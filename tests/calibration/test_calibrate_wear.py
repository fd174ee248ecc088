"""The wear coefficient: equation 11, GUM, laws, refusals, the command; truths are `worn_scars`."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import isochrome
from commands import exit_code
from isochrome.calibration import TraceScar, WearSet, calibrate_wear, worn_volumes, write_into_scene
from isochrome.cli import app
from isochrome.errors import InputError, PhysicsError
from isochrome.samples import samples_path
from isochrome.scene import load_scene
from worn_scars import rough_trace, write_set, write_trace

K = 2e-9
DISTANCES = (31.0, 77.0, 155.0, 233.0)


def volumes(values, *, spread=None, normal_n=44.0, friction=None, **uncertainty):
    """A set of volumes at the paper's distances."""
    tests = []
    for k, (distance, value) in enumerate(zip(DISTANCES, values, strict=False)):
        stated = value if spread is None else {"value": value, "standard_uncertainty": spread[k]}
        tests.append({"distance_m": distance, "normal_n": normal_n, "value_mm3": stated})
        if friction is not None:
            tests[-1]["friction"] = friction[k]
    return WearSet(volume=tests, uncertainty=uncertainty)


def exact(k=K, distances=DISTANCES, normal_n=44.0):
    return [k * normal_n * 1e3 * s for s in distances]


@pytest.fixture(scope="module")
def ground_set(tmp_path_factory):
    """Twelve traces of a ground surface, Ra .15 µm."""
    rng = np.random.default_rng(31)
    return write_set(tmp_path_factory.mktemp("ground"), rng, K, 0.15, "ground", count=2000)


@pytest.fixture(scope="module")
def ground(ground_set):
    return calibrate_wear(ground_set)


def write_ground(path, seed, *how):
    x, z, _ = rough_trace(np.random.default_rng(seed), *how, "ground", count=2000)
    write_trace(path, x, z)


def test_one_volume_gives_equation_11_to_rounding():
    """The paper's: .0027 mm³ after 31 m under 44 N."""
    found = calibrate_wear(volumes([0.0027]))
    assert found.coefficient_mm2_per_n == pytest.approx(0.0027 / (44.0 * 31e3), rel=1e-14)
    assert found.chi is None and found.law == "archard"
    assert "one volume without an uncertainty" in found.warnings[-1]


def test_volumes_that_agree_give_their_coefficient_to_rounding():
    found = calibrate_wear(volumes(exact()))
    assert found.coefficient_mm2_per_n == pytest.approx(K, rel=1e-12)
    assert found.standard_uncertainty < 1e-9 * K
    for row in found.by_distance:
        assert row.coefficient_mm2_per_n == pytest.approx(K, rel=1e-12)


def test_the_uncertainty_is_that_of_a_monte_carlo():
    """Volumes, loads and distances drawn anew: the GUM's within 5 %, of which 1.6 % is chance."""
    spread = [2e-4, 3e-4, 4e-4, 5e-4]
    relative = {"load_percent": 1.5, "distance_percent": 1.0}
    rng = np.random.default_rng(7)
    true = np.array(exact())
    found = calibrate_wear(volumes(true.tolist(), spread=spread, **relative))
    work = 44.0 * 1e3 * np.array(DISTANCES)
    weight = 1.0 / np.square(spread)
    own = true + np.array(spread) * rng.standard_normal((20_000, 4))
    common = (1.0 + np.array([0.015, 0.01]) * rng.standard_normal((20_000, 2))).prod(axis=1)
    shared = work * common[:, None]
    draws = (weight * shared * own).sum(axis=1) / (weight * shared**2).sum(axis=1)
    assert found.standard_uncertainty == pytest.approx(np.std(draws), rel=0.05)
    low, high = found.interval_95
    inside = np.mean((draws > low) & (draws < high))
    assert inside == pytest.approx(0.95, abs=0.01)
    assert sum(item.share for item in found.budget) == pytest.approx(1.0)
    assert {item.input for item in found.budget} == {"volumes", "normal_n", "distance_m"}


def test_what_the_volumes_scatter_is_the_uncertainty_where_none_is_stated():
    """Two volumes, one degree of freedom: t is 12.7."""
    values = [1.02 * exact()[0], 0.99 * exact()[1]]
    found = calibrate_wear(volumes(values))
    assert found.degrees_of_freedom == pytest.approx(1.0)
    low, high = found.interval_95
    assert high - low == pytest.approx(2 * 12.706 * found.standard_uncertainty, rel=1e-3)


def test_inputs_beside_their_values_are_common_and_go_as_the_formula():
    """k goes as the width over load and distance."""
    text = {"scar": {"width_mm": {"value": 4.0, "standard_uncertainty": 0.02}}}
    load = {"value": 44.0, "standard_uncertainty": 0.44}
    volume = {"distance_m": 31.0, "normal_n": load}
    value = {"value": 0.0027, "standard_uncertainty": 0.0}
    found = calibrate_wear(WearSet(**text, volume=[volume | {"value_mm3": value}]))
    parts = {item.input: item for item in found.budget}
    assert parts["normal_n"].contribution == pytest.approx(
        0.01 * found.coefficient_mm2_per_n, rel=1e-9
    )
    assert "scar.width_mm" not in parts  # a volume holds it already


@pytest.mark.long
def test_traces_give_the_coefficient_within_its_interval(ground):
    assert abs(ground.coefficient_mm2_per_n - K) < 4.0 * ground.standard_uncertainty
    assert ground.coefficient_mm2_per_n == pytest.approx(K, rel=0.01)
    assert 0.4 < ground.chi < 2.0
    assert [row.volume.distance_m for row in ground.by_distance] == list(DISTANCES)
    assert {item.input for item in ground.budget} >= {"roughness", "levelling"}
    assert "no uncertainty is given for load, distance, width" in ground.warnings[-1]
    assert ground.degrees_of_freedom > 8.0


@pytest.mark.long
def test_what_variances_of_few_degrees_promise_makes_no_scatter_of_chance(ground_set, ground):
    """Areas of one variance, each trace's own estimate of it of six degrees of freedom: the scatter
    over it is chi squared of eight over eight, 1 whatever the six are."""
    settings, rng, freedom = WearSet.read(ground_set), np.random.default_rng(4), 6.0
    base, shares = ground.traces[0].levelled, []
    for _ in range(400):
        drawn = []
        for scar in ground.traces:
            # its variance, widened as Student's t is
            estimate = 1e-10 * rng.chisquare(freedom) / (freedom - 2.0)
            one = replace(
                base, worn_area_mm2=1e-3 + 1e-5 * rng.standard_normal(),
                worn_area_uncertainty_mm2=float(np.sqrt(estimate)), degrees_of_freedom=freedom,
            )  # fmt: skip
            drawn.append(TraceScar(scar.test, one))
        _, scatter = worn_volumes(settings, drawn)
        shares.append(scatter.chi_square / scatter.freedom)
    # 400 draws of a chi squared of eight over eight, its variances' own scatter with it: .03
    assert np.mean(shares) == pytest.approx(1.0, abs=0.09)


@pytest.mark.long
def test_the_profilometer_and_the_width_go_into_the_budget(ground_set, ground):
    settings = WearSet.read(ground_set)
    known = {"height_percent": 0.5, "lateral_percent": 0.2, "width_mm": 0.04, "load_percent": 1.0}
    stated = settings.uncertainty.model_copy(update=known)
    found = calibrate_wear(settings.model_copy(update={"uncertainty": stated}))
    k = found.coefficient_mm2_per_n
    parts = {item.input: item.contribution / k for item in found.budget}
    assert parts["profilometer's height scale"] == pytest.approx(0.005, rel=1e-9)
    assert parts["profilometer's lateral scale"] == pytest.approx(0.002, rel=1e-9)
    assert parts["scar.width_mm"] == pytest.approx(0.01, rel=1e-9)
    assert parts["normal_n"] == pytest.approx(0.01, rel=1e-9)
    own = ground.standard_uncertainty / k
    total = np.sqrt(own**2 + 0.005**2 + 0.002**2 + 2 * 0.01**2)
    assert found.standard_uncertainty == pytest.approx(total * k, rel=1e-6)
    assert found.degrees_of_freedom > ground.degrees_of_freedom


@pytest.mark.long
def test_a_distance_whose_traces_are_not_all_clear_is_left_out(tmp_path, ground_set):
    folder = shutil.copytree(ground_set.parent, tmp_path / "set")
    write_ground(folder / "31m-2.csv", 3, 31.0, 0.33 * K, 1.0)
    found = calibrate_wear(folder / "set.toml")
    assert "no scar stands out of the roughness in 31m-2.csv: 31 m is left out" in found.warnings[0]
    assert [row.volume.distance_m for row in found.by_distance] == [77.0, 155.0, 233.0]
    assert [row["is_clear"] for row in found.to_json()["traces"]][:3] == [True, False, True]


def test_traces_that_show_no_scar_at_all_are_refused(tmp_path):
    write_ground(tmp_path / "a.csv", 4, 31.0, 0.33 * K, 1.0)
    (tmp_path / "set.toml").write_text(HEAD + TRACE.format(31.0), "utf-8")
    with pytest.raises(PhysicsError, match="no distance has traces that all show a scar"):
        calibrate_wear(tmp_path / "set.toml")


@pytest.mark.long
def test_scars_that_are_exchanged_are_said(tmp_path, ground_set):
    folder = shutil.copytree(ground_set.parent, tmp_path / "set")
    for number in (1, 2, 3):
        one, other = folder / f"77m-{number}.csv", folder / f"233m-{number}.csv"
        kept = one.read_bytes()
        one.write_bytes(other.read_bytes())
        other.write_bytes(kept)
    found = calibrate_wear(folder / "set.toml")
    said = " ".join(found.warnings)
    assert "are worn after 155 m, less than" in said
    assert "narrower than" in said
    assert "do not agree on one coefficient" in said


@pytest.mark.long
def test_traces_of_one_distance_that_differ_are_said(tmp_path, ground_set):
    folder = shutil.copytree(ground_set.parent, tmp_path / "set")
    write_ground(folder / "233m-2.csv", 5, 233.0, 0.9 * K, 0.15)
    found = calibrate_wear(folder / "set.toml")
    assert "the traces of a distance differ" in found.warnings[0]
    assert abs(found.coefficient_mm2_per_n - K) < 4.0 * found.standard_uncertainty
    assert "scatter of the traces" in {item.input for item in found.budget}


@pytest.mark.long
def test_a_scene_says_where_width_and_load_are_others(ground_set):
    settings = WearSet.read(ground_set)
    scar = settings.scar.model_copy(update={"scene": "line-contact-wear"})
    plain = calibrate_wear(settings.model_copy(update={"scar": scar})).warnings
    assert len(plain) == 1  # no uncertainty is given ...
    heavy = tuple(t.model_copy(update={"normal_n": 80.0}) for t in settings.trace)
    other = scar.model_copy(update={"width_mm": 6.0})
    found = calibrate_wear(settings.model_copy(update={"scar": other, "trace": heavy}))
    for words in ("normal_n = 80", "mm wide, and", "specimen.thickness_mm = 4"):
        assert any(words in text for text in found.warnings)
    unworn = scar.model_copy(update={"scene": "ring"})
    with pytest.raises(InputError, match=r"scar.scene = 'ring' has no \[indenter\]"):
        calibrate_wear(settings.model_copy(update={"scar": unworn}))


def test_the_law_is_that_of_the_volumes():
    """Friction that falls from .5 to .1: worn by the energy, and by Sarkar's law."""
    mu = np.array([0.5, 0.3, 0.2, 0.1])
    work = 44.0 * 1e3 * np.array(DISTANCES)
    for law, x in (("dissipated_energy", mu), ("sarkar", np.sqrt(1.0 + 3.0 * mu**2))):
        values = (K * work * x).tolist()
        spread = [0.001 * v for v in values]
        found = calibrate_wear(volumes(values, spread=spread, friction=mu.tolist()))
        assert found.law == law
        best = found.laws[0]
        assert best.coefficient_mm2_per_n == pytest.approx(K, rel=1e-9)
        assert any(f"prefer {law}" in text for text in found.warnings)


def test_running_in_is_told_and_its_numbers_are_found():
    """From 3 k to k over 60 m: k (s + (r-1) s0/2) beyond s0, its closed form below."""
    s = np.array(DISTANCES)
    until = np.minimum(s, 60.0)
    values = (K * 44.0 * 1e3 * (s + 2.0 * (until - until**2 / 120.0))).tolist()
    spread = [0.002 * v for v in values]
    found = calibrate_wear(volumes(values, spread=spread))
    best = found.laws[0]
    assert found.law == "running_in"
    assert best.coefficient_mm2_per_n == pytest.approx(K, abs=3.0 * best.own_uncertainty)
    assert best.first_over_last == pytest.approx(3.0, rel=0.05)
    assert best.running_in_distance_m == pytest.approx(60.0, rel=0.05)
    assert any("runs in over" in text for text in found.warnings)
    assert any("do not agree on one coefficient" in text for text in found.warnings)


def test_volumes_of_one_law_do_not_ask_for_another():
    rng = np.random.default_rng(8)
    spread = [0.01 * v for v in exact()]
    for _ in range(10):
        values = np.array(exact()) + np.array(spread) * rng.standard_normal(4)
        found = calibrate_wear(volumes(values.tolist(), spread=spread, friction=[0.3] * 4))
        assert found.law == "archard"


def test_the_shipped_traces_give_what_was_put_in():
    """The set states the nominal load, whose true one is 1.5 % more: k comes out as more."""
    truth = json.loads((samples_path() / "wear" / "truth.json").read_text("utf-8"))
    found = calibrate_wear(samples_path() / "wear" / "set.toml")
    k = truth["wear.coefficient_mm2_per_n"]
    seen = k * truth["load.normal_n"] / 44.0
    load = next(item for item in found.budget if item.input == "normal_n").contribution
    own = np.sqrt(found.standard_uncertainty**2 - load**2)
    assert abs(found.coefficient_mm2_per_n - seen) < 3.0 * own
    assert found.interval_95[0] < k < found.interval_95[1]
    assert found.warnings == ()
    for row in found.by_distance:
        true = truth["worn_area_mm2_by_distance_m"][f"{row.volume.distance_m:g}"]
        area = row.volume.volume_mm3 / 4.0
        assert abs(area - true) < 3.5 * row.standard_uncertainty_mm3 / 4.0
    for scar in found.traces:
        middle = truth["scar_middle_mm"][scar.test.file]
        u = np.hypot(*scar.levelled.edge_uncertainty_mm) / 2.0
        assert abs(scar.levelled.centre_mm - middle) < 4.0 * u


def test_the_value_goes_into_a_scene_by_its_law(tmp_path, ground):
    path = tmp_path / "scene.toml"
    text = isochrome.dump_scene(load_scene("line-contact-wear"))
    path.write_text(text, "utf-8")
    written = write_into_scene(ground, path, source="set.toml")
    scene = load_scene(path)
    assert written == scene.wear.coefficient_mm2_per_n
    assert written == pytest.approx(ground.coefficient_mm2_per_n, abs=0.01e-11)
    u = scene.uncertainties["wear.coefficient_mm2_per_n"]
    assert u == pytest.approx(ground.standard_uncertainty, rel=0.01)
    path.write_text(text.replace("[wear]", '[wear]\nlaw = "sarkar"'), "utf-8")
    with pytest.raises(InputError, match="the set states no friction"):
        write_into_scene(ground, path)
    path.write_text("[specimen]\nthickness_mm = 4.0\n", "utf-8")
    with pytest.raises(InputError, match=r"has no \[wear\]"):
        write_into_scene(ground, path)


def test_by_another_law_the_scene_gets_that_laws_coefficient(tmp_path):
    spread = [0.01 * v for v in exact()]
    found = calibrate_wear(volumes(exact(), spread=spread, friction=[0.25] * 4, load_percent=1.0))
    path = tmp_path / "scene.toml"
    text = isochrome.dump_scene(load_scene("line-contact-wear"))
    path.write_text(text.replace("[wear]", '[wear]\nlaw = "dissipated_energy"'), "utf-8")
    assert write_into_scene(found, path) == pytest.approx(K / 0.25, rel=1e-3)
    relative = found.standard_uncertainty / found.coefficient_mm2_per_n
    u = load_scene(path).uncertainties["wear.coefficient_mm2_per_n"]
    assert u == pytest.approx(relative * K / 0.25, rel=0.01)
    exactly = replace(found, standard_uncertainty=0.0)
    path.write_text(text, "utf-8")
    assert write_into_scene(exactly, path) == pytest.approx(K, rel=1e-6)


def test_the_command_prints_the_coefficient_and_sets_it_in_a_scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = "".join(VOLUME.format(s, v) for s, v in zip(DISTANCES, exact(), strict=True))
    (tmp_path / "set.toml").write_text(text, "utf-8")
    scene = isochrome.dump_scene(load_scene("line-contact-wear"))
    (tmp_path / "scene.toml").write_text(scene, "utf-8")
    done = CliRunner().invoke(app, ["calibrate", "wear", "set.toml", "--into", "scene.toml"])
    assert done.exit_code == 0
    assert "coefficient_mm2_per_n = 2.0" in done.stdout and "law = archard" in done.stdout
    assert "value set in scene.toml" in done.stdout
    assert load_scene(tmp_path / "scene.toml").wear.coefficient_mm2_per_n == pytest.approx(K)
    shipped = ["calibrate", "wear", "set.toml", "--into", "line-contact-wear", "--out", "other"]
    assert exit_code(monkeypatch, *shipped) == 2 and not (tmp_path / "other").exists()


HEAD = "[scar]\nwidth_mm = 4.0\n"
TRACE = '[[trace]]\nfile = "a.csv"\ndistance_m = {}\nnormal_n = 44.0\n'
VOLUME = "[[volume]]\ndistance_m = {}\nnormal_n = 44.0\nvalue_mm3 = {}\n"
LINE = "x_mm,z_um\n" + "".join(f"{0.05 * i:.2f},{0.01 * (i % 7):.2f}\n" for i in range(121))

WRONG_SETS = {
    "nothing": (HEAD, None, "neither a [[trace]] nor a [[volume]]"),
    "no width": (TRACE.format(31.0), LINE, "'scar.width_mm' is missing"),
    "a missing file": (HEAD + TRACE.format(31.0), None, "a.csv: the trace cannot be read"),
    "text": (HEAD + TRACE.format(31.0), "no trace at all\n", "a.csv: no line of numbers"),
    "one point": (HEAD + TRACE.format(31.0), "x_mm,z_um\n0.0,1.0\n", "a.csv: has 1 points"),
    "NaN": (HEAD + TRACE.format(31.0), LINE.replace("3.00,", "nan,"), "line 62 has 'nan'"),
    "no distance": (HEAD + TRACE.format(0.0), LINE, "trace[1].distance_m = 0.0 is not allowed"),
    "volume below zero": (VOLUME.format(31.0, -0.002), None, "volume[1].value_mm3 = -0.002"),
    "no volume above zero": (VOLUME.format(31.0, 0.0), None, "no [[volume]] is above 0"),
    "distances that fall": (
        VOLUME.format(77.0, 0.006) + VOLUME.format(31.0, 0.003), None, "distances must not fall",
    ),
    "one file twice": (HEAD + 2 * TRACE.format(31.0), LINE, "stands twice"),
    "an unknown key": (HEAD + "depth_mm = 1.0\n", None, "unknown key 'scar.depth_mm'"),
    "a volume beside traces": (
        HEAD + TRACE.format(31.0) + VOLUME.format(31.0, 0.003), LINE, "needs its uncertainty",
    ),
    "half of the uncertainties": (
        VOLUME.format(31.0, "{ value = 0.003, standard_uncertainty = 1e-4 }")
        + VOLUME.format(77.0, 0.006),
        None,
        "2 volumes and 1 uncertainties",
    ),
    "twice stated": (
        HEAD.replace("4.0", "{ value = 4.0, standard_uncertainty = 0.1 }")
        + VOLUME.format(31.0, 0.003)
        + "[uncertainty]\nwidth_mm = 0.1\n",
        None,
        "uncertainty.width_mm is stated beside its value too",
    ),
    "metres for kilometres": (VOLUME.format(1e-12, 0.003), None, "k = "),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG_SETS)
def test_a_wrong_set_is_refused_in_a_line_and_leaves_nothing(tmp_path, name, monkeypatch, capsys):
    text, trace, what = WRONG_SETS[name]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "set.toml").write_text(text, "utf-8")
    if trace is not None:
        (tmp_path / "a.csv").write_text(trace, "utf-8")
    before = sorted(p.name for p in tmp_path.iterdir())
    assert exit_code(monkeypatch, "calibrate", "wear", "set.toml") == 2
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("isochrome: ")]
    assert len(said) == 1 and what in said[0]
    assert sorted(p.name for p in tmp_path.iterdir()) == before


def test_a_backslash_in_the_name_of_a_trace_or_a_scene_is_named(tmp_path):
    """It was looked for as a file with a new line in its name."""
    path = tmp_path / "set.toml"
    trace = TRACE.format(31.0).replace("a.csv", r"new\n1.csv")
    for text in (HEAD + trace, HEAD + r'scene = "a\new.toml"' + "\n"):
        path.write_text(text, "utf-8")
        with pytest.raises(InputError, match="a backslash begins an escape"):
            calibrate_wear(path)
