"""Measured scars beside simulated ones, where both are known: the arc of a stiff contact."""

import json
from dataclasses import dataclass

import numpy as np
import pytest

from isochrome.comparison import compare, compare_scars, simulated_scars
from isochrome.errors import InputError, PhysicsError
from isochrome.output import read_csv
from isochrome.scene import load_scene, parse_scene
from scene_texts import WORN_CONTACT

RADIUS, THICKNESS, LOAD, WEAR = 24.61, 4.0, 44.0, 2e-9
STIFF = (
    WORN_CONTACT.replace("young_gpa = 2.1\n", "young_gpa = 4000.0\n")
    .replace("young_gpa = 210.0", "young_gpa = 1e5")
    .replace("[friction]\ncoefficient = 0.25\n", "")
    + "\n[numerics]\nspacing_mm = 0.001\n"
)
STATED = (("normal_n", LOAD, 0.5), ("coefficient_mm2_per_n", WEAR, 5e-11))


def stated(text: str = STIFF) -> str:
    """The scene with uncertainties of load and wear coefficient."""
    for key, value, spread in STATED:
        plain = f"{key} = {'2e-9' if value < 1 else value}"
        assert plain in text
        pair = f"{{ value = {value}, standard_uncertainty = {spread} }}"
        text = text.replace(plain, f"{key} = {pair}")
    return text


def worn_area(distance_m: float) -> float:
    """A = k P s/t, mm²."""
    return WEAR * LOAD * 1e3 * distance_m / THICKNESS


def half_chord(distance_m: float) -> float:
    """a = (3 R A/2)^(1/3), mm."""
    return (1.5 * RADIUS * worn_area(distance_m)) ** (1.0 / 3.0)


@dataclass(frozen=True)
class Bench:
    """A profilometer: where its x begins, how its table leans, and the roughness it meets."""

    origin_mm: float = 1.83
    tilt_um_per_mm: float = 2.0
    rough_um: float = 0.15
    length_mm: float = 4.0
    points: int = 4000

    def trace(self, distance_m: float, rng: np.random.Generator) -> np.ndarray:
        """x (mm) and heights (µm) over a worn arc, (points, 2)."""
        x = np.linspace(0.0, self.length_mm, self.points)
        own = x - self.origin_mm
        arc = 1e3 * np.maximum(half_chord(distance_m) ** 2 - own**2, 0.0) / (2.0 * RADIUS)
        # waves of random phase, their power even between 25 and 0.5 per mm
        f = rng.uniform(0.5, 25.0, 400)
        phase = rng.uniform(0.0, 2.0 * np.pi, 400)
        waves = np.sin(2.0 * np.pi * x[:, None] * f + phase).sum(axis=1)
        rough = self.rough_um * waves / np.sqrt(200.0)
        return np.column_stack([x, self.tilt_um_per_mm * x - 0.3 * own**2 - arc + rough])


def write_trace(path, table) -> None:
    """A CSV as profilometers export it."""
    np.savetxt(path, table, delimiter=",", header="x_mm,z_um", comments="", fmt="%.7g")


@pytest.fixture
def measured(tmp_path):
    """A scene file with one trace at 77 m and one at 233 m, and its path."""
    rng = np.random.default_rng(4)
    text = stated()
    for distance in (77.0, 233.0):
        write_trace(tmp_path / f"{distance:g}.csv", Bench().trace(distance, rng))
        text += f'\n[[scar]]\nfile = "{distance:g}.csv"\ndistance_m = {distance}\n'
    (tmp_path / "scene.toml").write_text(text)
    return tmp_path / "scene.toml"


def test_the_static_state_is_no_scar():
    (scar,) = simulated_scars(parse_scene(STIFF), [233.0])
    a = half_chord(233.0)
    # what the contact yields still widens it, by (hertz/chord)³/3 = 4e-5 or so
    assert scar.worn_area_mm2 == pytest.approx(worn_area(233.0), rel=1e-4)
    assert scar.width_mm == pytest.approx(2.0 * a, rel=5e-3)
    assert scar.depth_um.max() == pytest.approx(1e3 * a**2 / (2.0 * RADIUS), rel=5e-3)
    scene = load_scene("line-contact-wear")
    assert scene.friction.static_state_first
    (scar,) = simulated_scars(scene, [77.0])
    assert scar.distance_m == 77.0
    assert scar.worn_area_mm2 == pytest.approx(worn_area(77.0), rel=1e-3)


def test_the_band_is_that_of_the_closed_form():
    """A goes as P k, the chord as its root (1/3), the depth as (2/3); with R by 1/3 and -1/3."""
    text = stated().replace(
        "radius_mm = 24.61", "radius_mm = { value = 24.61, standard_uncertainty = 0.5 }"
    )
    (scar,) = simulated_scars(parse_scene(text), [233.0])
    shares = {"load.normal_n": 0.5 / 44.0, "wear.coefficient_mm2_per_n": 0.025}
    a = half_chord(233.0)
    depth = 1e3 * a**2 / (2.0 * RADIUS)
    assert set(scar.moved_um) == {*shares, "indenter.radius_mm"}
    for key, share in shares.items():
        area, width, largest = scar.moved[key]
        assert area == pytest.approx(share * worn_area(233.0), rel=5e-3)
        assert width == pytest.approx(share / 3.0 * 2.0 * a, rel=2e-2)
        assert largest == pytest.approx(share * 2.0 / 3.0 * depth, rel=2e-2)
    share = 0.5 / RADIUS
    area, width, largest = scar.moved["indenter.radius_mm"]
    assert width == pytest.approx(share / 3.0 * 2.0 * a, rel=2e-2)
    assert largest == pytest.approx(-share / 3.0 * depth, rel=2e-2)
    assert abs(area) < 1e-4 * worn_area(233.0)


def test_measured_scars_lie_on_the_simulated_ones(measured, tmp_path):
    found = compare(measured, measured, tmp_path / "out")
    table = found.columns
    assert table["trace"] == ["77.csv", "233.csv"] and table["distance_m"] == [77.0, 233.0]
    for i, distance in enumerate(table["distance_m"]):
        row = {name: values[i] for name, values in table.items()}
        assert abs(row["shift_mm"] - 1.83) < 3.0 * row["shift_uncertainty_mm"]
        assert row["shift_uncertainty_mm"] < 0.02
        assert row["simulated_area_mm2"] == pytest.approx(worn_area(distance), rel=1e-4)
        gap, spread = row["area_difference_mm2"], row["area_difference_uncertainty_mm2"]
        assert gap == pytest.approx(row["measured_area_mm2"] - row["simulated_area_mm2"])
        both = row["measured_area_uncertainty_mm2"], row["simulated_area_uncertainty_mm2"]
        assert spread == pytest.approx(np.hypot(*both)) and abs(gap) < 3.0 * spread
        # the edges of a trace are by a shape that runs out more smoothly than an arc
        assert row["measured_width_mm"] == pytest.approx(2.0 * half_chord(distance), rel=0.06)
        assert row["difference_rms_um"] == pytest.approx(0.15, rel=0.5)
        assert 0.5 < row["difference_chi"] < 1.5
    assert found.warnings == () and "77.csv, 77 m" in repr(found) and "simulated" in repr(found)
    check_folder(tmp_path / "out", found)


def check_folder(out, found) -> None:
    """What a comparison leaves on disk."""
    assert read_csv(out / "metrics.csv").keys() == found.columns.keys()
    profiles = read_csv(out / "scars.csv")
    gap = np.subtract(profiles["measured_um"], profiles["simulated_um"])
    assert np.abs(gap - profiles["difference_um"]).max() < 1e-6
    inputs = json.loads((out / "provenance.json").read_text())["inputs_sha256"]
    assert {name.rpartition("/")[2] for name in inputs} == {"77.csv", "233.csv"}
    assert (out / "scars.png").stat().st_size > 20_000


@pytest.mark.long
def test_traces_may_be_named_without_a_scene_of_their_own(measured, tmp_path):
    folder = measured.parent
    traces = [(folder / "233.csv", 233.0), (folder / "77.csv", 77.0)]
    listed = compare_scars(traces, parse_scene(stated()))
    own = compare(load_scene(measured), load_scene(measured))
    assert listed.columns["measured_area_mm2"] == own.columns["measured_area_mm2"][::-1]
    assert listed.columns["difference_chi"] == own.columns["difference_chi"][::-1]
    traces = "".join(
        f'[[trace]]\nfile = "{d}.csv"\ndistance_m = {d}\nnormal_n = 44.0\n' for d in (77, 233)
    )
    (folder / "set.toml").write_text("[scar]\nwidth_mm = 4.0\n" + traces)
    of_set = compare(folder / "set.toml", measured)
    assert of_set.columns == own.columns


def test_another_load_is_said_and_exact_inputs_too(measured):
    other = parse_scene(STIFF).with_values({"load.normal_n": 66.0})
    found = compare(measured, other)
    assert "simulated 0.002541 mm²" in str(found)  # and no ± 0, which nobody knows
    first, last, exact = found.warnings
    assert "77.csv: its worn area" in first and "233.csv" in last
    assert "standard uncertainties; the scene's load" in last
    assert "states no uncertainty" in exact and "standard_uncertainty = ..." in exact
    assert found.columns["difference_chi"][1] > 3.0
    assert found.columns["simulated_area_uncertainty_mm2"] == [0.0, 0.0]


@pytest.mark.long
def test_a_trace_without_a_clear_scar_is_left_out_and_said(measured):
    rough = Bench(rough_um=1.5).trace(1.0, np.random.default_rng(0))
    write_trace(measured.parent / "77.csv", rough)
    found = compare(measured, measured)
    assert found.columns["measured_area_mm2"][0] is None
    assert found.columns["simulated_area_mm2"][0] == pytest.approx(worn_area(77.0), rel=1e-4)
    assert found.columns["measured_area_mm2"][1] is not None
    (said,) = found.warnings
    assert "77.csv: no scar stands out" in said and "no clear scar" in repr(found)
    assert found.figure().axes
    write_trace(measured.parent / "233.csv", rough)
    with pytest.raises(PhysicsError, match=r"77.csv: no scar stands out"):
        compare(measured, measured)


def test_what_cannot_be_compared_is_refused(measured, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    static = STIFF[: STIFF.index("[wear]")]
    with pytest.raises(InputError, match=r"has no \[\[scar\]\], with file and distance_m"):
        compare(parse_scene(STIFF), measured)
    with pytest.raises(InputError, match=r"scene.toml: is not there; name a result folder"):
        compare(measured, empty)
    with pytest.raises(InputError, match=r"has no \[wear\]"):
        compare(measured, parse_scene(static))
    with pytest.raises(InputError, match=r"\[\[scar\]\] needs \[wear\]"):
        parse_scene(static + '\n[[scar]]\nfile = "a.csv"\ndistance_m = 3.0\n')
    with pytest.raises(InputError, match=r"distances of traces \[0.0\]"):
        compare_scars([(tmp_path / "77.csv", 0.0)], parse_scene(STIFF))
    with pytest.raises(InputError, match=r"scar\[1\].distance_m = -3.0 is not allowed"):
        parse_scene(STIFF + '\n[[scar]]\nfile = "a.csv"\ndistance_m = -3.0\n')
    with pytest.raises(InputError, match="frames are compared with frames"):
        compare(tmp_path, parse_scene(STIFF))
    wide = stated().replace("standard_uncertainty = 0.5", "standard_uncertainty = 50.0")
    with pytest.raises(InputError, match=r"load.normal_n with its standard_uncertainty = 50"):
        simulated_scars(parse_scene(wide), [77.0])


@pytest.mark.study
def test_pulls_of_area_and_shift_are_those_of_their_uncertainties():
    """60 rendered traces at four roughnesses; a root mean square of 60 pulls is known to 0.09."""
    scene = parse_scene(STIFF)
    distances = (31.0, 77.0, 155.0, 233.0)
    rows = []
    for seed in range(60):
        rng = np.random.default_rng([7, seed])
        distance = distances[seed % 4]
        bench = Bench(
            origin_mm=rng.uniform(1.6, 2.4),
            tilt_um_per_mm=rng.normal(0.0, 5.0),
            rough_um=(0.05, 0.1, 0.15, 0.2)[seed // 4 % 4],
        )
        rows.append((distance, bench, bench.trace(distance, rng)))
    pulls = np.array([pull_of(scene, *row) for row in rows])
    area, shift = np.sqrt(np.mean(pulls[:, :2] ** 2, axis=0))
    # an area's ± also holds what one trace leaves unknown of its roughness's spectrum
    assert 0.6 < area < 1.25, area
    assert 0.75 < shift < 1.25, shift
    assert 0.7 < pulls[:, 2].mean() < 1.15


def pull_of(scene, distance, bench, table):
    """Area and shift over their ±, and chi, of one rendered trace."""
    from isochrome.comparison import pair_scar
    from isochrome.scars import Trace, levelled

    (scar,) = simulated_scars(scene, [distance])
    pair = pair_scar(levelled(Trace(x_mm=table[:, 0], z_um=table[:, 1])), scar)
    gap, spread = pair.area_difference_mm2
    shift = pair.shift_mm - bench.origin_mm
    return (gap / spread, shift / pair.shift_uncertainty_mm, pair.chi)
