"""Tractions besides a contact's model: their stress, their prior, and their key in a scene."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import case_contacts, case_defects
from benchmarks.outside_unlisted import UnlistedContact
from fitting.engine_frames import prepared
from fitting.sliding_bench import bench
from isochrome import fit, samples, simulate
from isochrome.contact import SurfaceState
from isochrome.errors import InputError
from isochrome.estimation import Evidence, Hypothesis, Sets
from isochrome.fitting import SceneRenderer, fit_with_causes
from isochrome.fitting.causes.cause import MODULUS
from isochrome.fitting.causes.modes import traction_modes
from isochrome.fitting.causes.score import TRACTIONS, WAVES, Asked
from isochrome.fitting.causes.solution import FrameSolution
from isochrome.fitting.frame.frame_model import trust_of_slopes
from isochrome.scene import dump_scene, load_scene, parse_scene
from isochrome.simulation import scene_states
from isochrome.stress import pixel_grid


def test_the_modes_stress_is_that_of_the_renderer():
    """Their table of the distance alone against the waves of the same tractions."""
    scene = bench(164, 220).with_values({"friction.coefficient": 0.2})
    surface = scene_states(scene)[-1].surface
    grid = pixel_grid(scene).every(3)
    modes = traction_modes(scene, surface, grid.pixel_mm)
    root = 0.1 * modes.root(0.3)
    values = root @ np.random.default_rng(0).normal(size=root.shape[1])
    added = scene.with_values({"load.added_tractions": modes.added(values)})
    assert modes.values_of(added.load.added_tractions) == pytest.approx(values, abs=1e-12)
    with_them, without = (
        SceneRenderer(one, (164, 220)).field_alone(one)[::3, ::3] for one in (added, scene)
    )
    want = np.tensordot(values.astype(np.float32), modes.fields(grid), 1)
    below = slice(3, None)
    error = np.abs((with_them - without - want)[below]).max()
    # of the hats' tips, which lie between the surface's nodes
    assert error < 0.01 * np.abs(want[below]).max()


@pytest.mark.parametrize(("size", "length"), [(0.01, 0.12), (0.3, 0.8)])
def test_the_process_has_its_size_and_no_sum(size, length):
    scene = bench(164, 220)
    modes = traction_modes(scene, scene_states(scene)[-1].surface, 0.05)
    root = size * modes.root(length)
    count = len(modes.inner)
    assert np.abs(root[:count].sum(axis=0)).max() < 1e-9
    assert np.abs(root[count:].sum(axis=0)).max() < 1e-9
    spread = np.sqrt(np.square(root[:count]).sum(axis=1)) / modes.largest_mpa
    # what the sum of nought takes: the longer the process is alike, the more
    assert np.all(spread < 1.01 * size) and np.median(spread) > 0.5 * size


def test_pixels_whose_fringes_are_off_count_by_what_their_slopes_do_not_know():
    """On the left the phase is off by 0.8, and the signal by more than its slope times that."""
    rows, cols = np.indices((60, 120))
    phase, off, gain = 2.0 * np.pi * cols / 12.0 + rows / 9.0, 0.8 * (cols < 60), 40.0
    missed = 0.5 * (np.cos(phase) - np.cos(phase + off))
    noise = np.random.default_rng(0).normal(size=phase.shape)
    seen = SimpleNamespace(
        problem=SimpleNamespace(keep=cols >= 0), amplitude=gain,
        residual=(gain * missed + noise).ravel(),
    )  # fmt: skip
    trust = trust_of_slopes(seen).reshape(phase.shape)
    beyond = gain * np.std((missed - 0.5 * off * np.sin(phase))[:, :60])
    # of the third order the estimate has nothing: 4 %; a window holds fringes and a quarter
    assert np.median(trust[:, :50]) == pytest.approx(1.0 / np.hypot(1.0, beyond), rel=0.1)
    assert trust[:, 70:].min() > 0.99


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        ("single", 41),
        pytest.param("single", 18, marks=pytest.mark.study),
        pytest.param("two", 20, marks=pytest.mark.study),
        pytest.param("two", 33, marks=pytest.mark.long),
    ],
)
def test_what_moves_fringes_by_more_than_half_of_one_is_named_alone(kind, seed):
    """A layer, and a wave that parts the contact: from where the scene is, slopes point elsewhere.
    A worn flat, which a modulus looks like, and shear that is uneven, beside which a roll looks
    likely until tractions are fitted without it; with a smooth stress both.

    Frames by strips of even traction; chi is 3 to 12 as the scene states it.
    """
    row = case_contacts.judged(kind, seed)
    assert row.named and row.first, row.found
    assert row.chi < 1.03
    # four standard uncertainties: one in ten thousand
    assert max(abs(row.load_pull), abs(row.friction_pull)) < 4.0


@pytest.mark.long
def test_a_fact_that_is_in_no_list_is_not_tried_for_ever(monkeypatch):
    """A shutter that rolls on a table which shakes: by 45 trials causes are bent to it, and the
    friction by 3.4 of its uncertainties."""
    tried = []
    trial = FrameSolution.trial
    monkeypatch.setattr(FrameSolution, "trial", lambda *args: tried.append(args) or trial(*args))
    row = case_contacts.judged("unlisted", 97)
    # three rounds of them
    assert len(tried) == 27
    assert max(abs(row.load_pull), abs(row.friction_pull)) < 3.0 and row.flagged


def test_a_pressure_that_is_wider_as_a_whole_is_the_tractions():
    """Of sets with a modulus only those count for it that have no tractions besides."""
    names = MODULUS.name, TRACTIONS
    hypotheses = [Hypothesis(n, slice(k, k + 1), np.eye(1), 0.0) for k, n in enumerate(names)]
    evidence = Evidence(np.eye(2), np.zeros(2), hypotheses)
    sets = Sets(evidence, ((0,), (0, 1)), np.array([0.3, 0.7]))
    none = np.zeros((0, 0))
    asked = Asked(noise=1.0,
        evidence=evidence, given=(), now=np.zeros(2), order_power=np.empty((0, 0)), causes=(),
        along=none, counted=none, judged=sets,
    )  # fmt: skip
    assert asked.chances == pytest.approx({MODULUS.name: 0.3, TRACTIONS: 0.7})


@pytest.mark.long
def test_pixels_of_a_beam_that_a_lens_moves_off_it_end_no_trial():
    """A rendered frame whose roll and tone the scene leaves out: both are found."""
    sample = samples.bending()
    scene = load_scene({
        "specimen": {"shape": "beam", "height_mm": 20.0, "thickness_mm": 6.0,
                     "fringe_value_n_per_mm": 14.6},
        "load": {"normal_n": 150.0, "inner_span_mm": 40.0, "outer_span_mm": 100.0},
        "polariscope": {"wavelength_nm": 587.0},
        "camera": {"width_px": 480, "height_px": 440, "pixel_mm": 0.05, "bit_depth": 8},
    })  # fmt: skip
    freed = fit_with_causes(prepared(sample.images[2], scene, bit_depth=8), scene)
    found = dict(zip(freed.fit.keys, freed.fit.values, strict=True))
    # their uncertainties are .0006 degree and .0005
    assert found["camera.roll_deg"] == pytest.approx(sample.truth["tilt_deg"], abs=0.01)
    assert found["frames.gamma"] == pytest.approx(sample.truth["camera"]["gamma"], abs=0.002)


def test_a_layer_needs_an_indenter():
    with pytest.raises(InputError, match=r"\[contact\] says what lies between two bodies"):
        load_scene("ring").with_values({"contact.layer_um_per_mpa": 0.1})


@pytest.mark.parametrize(
    ("key", "true", "slid_m"),
    [
        ("load.tilt", 0.25, None), ("load.tilt", 0.8, None), ("load.tilt", 0.25, 31.0),
        ("contact.roughness_um", 0.2, None), ("contact.roughness_um", 0.2, 31.0),
    ],
)  # fmt: skip
def test_what_a_bench_adds_to_a_contact_is_fitted_from_none(key, true, slid_m, tmp_path):
    """Hard cases: one side lifted off, and worn with it. A tilt has no slope at nought, and the
    bare worn contact is solved on a mesh of its own."""
    plain = bench(124, 165).with_values({"camera.noise_grey": 2.0})
    if slid_m is not None:
        wear = {"coefficient_mm2_per_n": 2e-9, "distances_m": (slid_m,)}
        plain = load_scene(plain.model_dump(exclude_none=True) | {"wear": wear})
    load_n = plain.load_at(0.0)
    simulate(plain.with_values({key: true}), tmp_path / "simulated")
    start = plain.with_values({"load.normal_n": 0.98 * load_n})
    frames = tmp_path / "simulated" / "frames.tif"
    free = ["load.normal_n", "friction.coefficient", key]
    table = fit(frames, start, free, as_stated=True).table
    found = dict(
        zip(
            table["key"],
            zip(table["value"], table["standard_uncertainty"], strict=True),
            strict=True,
        )
    )
    for one, want in ((key, true), ("load.normal_n", load_n)):
        value, spread = found[one]
        assert abs(value - want) < 4.0 * spread and spread < 0.01 * want


def test_a_free_tilt_that_is_none_leaves_the_load(tmp_path):
    plain = bench(124, 165).with_values({"camera.noise_grey": 2.0})
    simulate(plain, tmp_path / "simulated")
    table = fit(
        tmp_path / "simulated" / "frames.tif", plain, ["load.normal_n", "load.tilt"], as_stated=True
    ).table
    assert abs(table["value"][0] - plain.load_at(0.0)) < 4.0 * table["standard_uncertainty"][0]
    assert table["value"][1] < 0.03


def test_added_tractions_are_in_the_simulation_and_in_the_scenes_text():
    plain = bench(60, 80)
    added = {
        "x_mm": [-0.2, 0.0, 0.3], "pressure_mpa": [0.0, 2.0, 0.0], "shear_mpa": [0.0, 1.0, 0.0],
    }  # fmt: skip
    scene = plain.with_values({"load.added_tractions": added})
    before, after = (scene_states(one)[-1].surface for one in (plain, scene))
    assert isinstance(after, SurfaceState) and after.edges_mm == before.edges_mm
    # the integral of a triangle, by trapezoids whose nodes miss its tip by half a spacing at most
    assert after.line_load_n_per_mm - before.line_load_n_per_mm == pytest.approx(0.5, rel=1e-3)
    assert parse_scene(dump_scene(scene), name=scene.name) == scene


def test_tractions_that_reach_beyond_the_contacts_window_widen_it():
    plain = bench(60, 80)
    x = scene_states(plain)[-1].surface.grid.x_mm
    end = float(x[-1]) + 0.3
    wide = {"x_mm": [0.0, end - 0.1, end], "pressure_mpa": [0.0, 1.0, 0.0], "shear_mpa": [0.0] * 3}
    surface = scene_states(plain.with_values({"load.added_tractions": wide}))[-1].surface
    assert surface.grid.x_mm[-1] >= end and surface.pressure_mpa.max() > 1.0


@pytest.mark.long
@pytest.mark.parametrize(
    "fact", [{"warm": 0.02}, pytest.param({"edge_mpa": 0.2}, marks=pytest.mark.study)], ids=str
)
def test_an_order_that_no_cause_explains_is_said_with_its_size_and_counted(fact):
    """A share of the fringes, and a stress along the edge, which is there without a fringe too."""
    rows, cols = 164, 220
    made, plain = (
        UnlistedContact(
            load_n=44.0, friction=0.2, shape=(rows, cols), pixel_mm=4.0 / cols, left_mm=-2.0,
            top_mm=0.0, **values,
        )
        for values in (fact, {})
    )  # fmt: skip
    scene = load_scene(made.scene() | {"load": {"normal_n": 46.0}})
    freed = fit_with_causes(prepared(made.frame(1), scene), scene)
    z = 4.0 / cols * (np.arange(2, rows) + 0.5)[:, None]
    x = 4.0 / cols * (np.arange(cols) + 0.5)[None, :] - 2.0
    size = np.sqrt(np.mean((made.orders(x, z, 44.0) - plain.orders(x, z, 44.0)) ** 2))
    assert max(freed.chances[name] for name in WAVES) > 0.9
    # what is fitted besides takes a part of it
    assert 0.2 * size < freed.asked.order_size < 1.2 * size
    for key, true in (("load.normal_n", 44.0), ("friction.coefficient", 0.2)):
        k = freed.fit.keys.index(key)
        # three standard uncertainties: one in 400
        assert abs(freed.fit.values[k] - true) < 3.0 * freed.fit.standard_uncertainty[k]


@pytest.mark.long
@pytest.mark.parametrize(("kind", "seed"), [("single", 90), ("three", 23)])
def test_what_takes_any_form_makes_up_for_nothing(kind, seed):
    """Of a roll, and of a keystone with plates and a tone: blocks that the surface cuts, and a
    cause that came late, left it to tractions and to an order, whose ± was 19 and 92 of the bound.
    """
    row = case_defects.judged(kind, seed)
    assert row.named and row.over_bound < 1.5  # the causes' own uncertainty is in it
    assert max(abs(row.load_pull), abs(row.friction_pull)) < 3.0
