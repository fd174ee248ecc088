"""Pressure and shear from frames that no contact model describes; truth is closed forms."""

import json

import numpy as np
import pytest
import tifffile

from fitting.pressed import CONTACT, LOBE, ORDER_PER_MPA, THICKNESS, Patch, Pressed
from imagej_heads import has_whole_head, heads_of
from isochrome.errors import InputError, PhysicsError
from isochrome.fitting import fit
from isochrome.fitting.tractions import invert_tractions
from isochrome.output import read_csv, write_tiff
from isochrome.reference import sliding_hertz_stress
from isochrome.scene import parse_scene
from scene_texts import camera_text, disc_text

SMALL = {"cols": 220, "rows": 164, "pixel": 0.01821}
HALF = {"cols": 330, "rows": 247, "pixel": 0.01214}
FREE = ["load.normal_n", "friction.coefficient", "camera.left_mm", "camera.top_mm"]


def order_rms(found, view, skip=0):
    """RMS error of the order over the specimen, from its first whole pixel (+ skip) down."""
    order = ORDER_PER_MPA * np.abs(found.components().difference)
    rows = (found.pixels.z_mm > 0.5 * view.pixel) & (np.arange(view.rows) >= skip)
    return float(np.sqrt(np.mean((order - view.order)[rows] ** 2)))


@pytest.fixture(scope="module")
def lobe():
    view = Pressed((CONTACT, LOBE), **SMALL)
    return view, invert_tractions(view.data(), view.scene(42.0))


def test_a_lobe_beside_the_contact_is_found_with_load_and_friction(lobe):
    view, found = lobe
    # the bar of a frame nine times larger: over seven seeds the load errs by up to 2.2e-4, the
    # tangential force by up to 6.2e-4; chi is 1.004 to 1.020: noise alone is left
    assert found.load_n.value == pytest.approx(view.load, rel=5e-4)
    assert found.tangential_n.value == pytest.approx(view.tangential, rel=1.2e-3)
    assert found.chi == pytest.approx(1.0, abs=0.03) and found.warnings == ()
    # two rows at the surface are not looked at: there the steep edges of a patch are guessed;
    # 3.6e-4 to 4.5e-4
    assert order_rms(found, view, skip=2) < 9e-4


def test_the_place_and_size_of_the_lobe_are_found(lobe):
    _, found = lobe
    step = np.diff(found.x_mm).min()
    beside = found.x_mm > 0.5
    load = found.pressure_mpa[beside].sum() * step * THICKNESS
    # up to 0.5 % over seven seeds
    assert load == pytest.approx(LOBE.load, rel=0.01)
    centre = np.average(found.x_mm[beside], weights=found.pressure_mpa[beside])
    # up to 0.02 of the nodes' spacing
    assert centre == pytest.approx(LOBE.centre, abs=0.05 * step)


def test_nothing_pulls_and_nothing_rubs_more_than_it_presses(lobe):
    _, found = lobe
    assert found.pressure_mpa.min() >= 0.0
    assert np.all(np.abs(found.shear_mpa) <= found.pressure_mpa * (1.0 + 1e-12))
    assert np.all(found.pressure_standard_uncertainty_mpa > 0.0)
    assert np.all(found.shear_standard_uncertainty_mpa > 0.0)


def test_pressure_is_the_true_one_within_its_uncertainty_inside_the_patches(lobe):
    view, found = lobe
    inside = np.zeros(len(found.x_mm), bool)
    for patch in view.patches:  # at the edges a line between nodes is no root
        inside |= np.abs(found.x_mm - patch.centre) < 0.8 * patch.half_width
    error = found.pressure_mpa - view.pressure(found.x_mm)
    pulls = error[inside] / found.pressure_standard_uncertainty_mpa[inside]
    # smooth tractions: neighbouring errors go together, and there are some ten of them; over seven
    # seeds 0.45 to 0.60: a patch is smoother inside than at its edges, and the process is not
    assert 0.35 < np.sqrt(np.mean(pulls**2)) < 2.0
    # 0.10 to 0.14; with hardly any smoothness 0.3 to 0.5
    assert np.sqrt(np.mean(error[inside] ** 2)) < 0.2


def test_recovered_stress_is_in_equilibrium_and_carries_the_load(lobe):
    view, found = lobe
    stress, h = found.components(), view.pixel
    z = found.pixels.z_mm
    deep = slice(40, -1)
    down = lambda s: np.gradient(s, h, axis=0)[deep, 1:-1]  # noqa: E731
    along = lambda s: np.gradient(s, h, axis=1)[deep, 1:-1]  # noqa: E731
    size = np.abs(down(stress.sigma_z)).max()
    # central differences err by (h/z)²/6 of a derivative's own scale, 1e-4 from 40 pixels down, and
    # single precision by its rounding over a pixel: 1e-3 at every seed
    assert np.abs(along(stress.sigma_x) + down(stress.tau_xz)).max() < 2e-3 * size
    assert np.abs(along(stress.tau_xz) + down(stress.sigma_z)).max() < 2e-3 * size
    # sigma_z over a level in view, and beyond it the far field of the load, 4 P z³ /(3 pi x³)
    row = 8
    half = 0.5 * view.cols * h
    beyond = 2.0 * 2.0 / np.pi * (view.load / THICKNESS) * z[row] ** 3 / (3.0 * half**3)
    carried = -stress.sigma_z[row].sum() * h + beyond
    assert carried * THICKNESS == pytest.approx(found.load_n.value, rel=2e-4)  # 0.9e-4


def test_principal_stresses_apart_are_the_closed_forms(lobe):
    view, found = lobe
    x, z = view.places()
    first, second = found.components().principal
    assert np.all(first >= second)
    trace = sum(
        s.sigma_x + s.sigma_z
        for p in view.patches
        for s in [
            sliding_hertz_stress(
                x - p.centre, z, half_width_mm=p.half_width, peak_pressure_mpa=p.peak,
                friction=p.friction,
            )
        ]
    )  # fmt: skip
    error = (first + second - trace)[4:]
    # the sum of stresses leaves no fringe: it follows from the tractions alone; 1 to 4e-3 MPa
    assert np.sqrt(np.mean(error**2)) < 0.009


def test_a_scene_without_a_contact_is_refused_before_its_frames_are_read():
    text = disc_text(100.0, fringe_value=14.6, thickness_mm=4.0, diameter_mm=10.0)
    disc = parse_scene(text + camera_text(100, 100, 0.11, bit_depth=8))
    with pytest.raises(InputError, match=r"no \[indenter\]; add it, or leave out --tractions"):
        fit("frames-that-are-not-there.tif", disc, ["load.normal_n"], tractions=True)


@pytest.mark.long
def test_an_unloaded_frame_shows_no_pressure():
    view = Pressed((Patch(0.0, 0.37, 1e-6, 0.0),), **SMALL)
    with pytest.raises(PhysicsError, match="the frame shows no fringes"):
        invert_tractions(view.data(), view.scene())


BESIDE = {
    "lobe": Pressed((CONTACT, LOBE)),
    "large lobe": Pressed((CONTACT, Patch(-0.7, 0.2, 8.0, 0.25)), **HALF),
    "overlap": Pressed((CONTACT, Patch(0.30, 0.12, 6.0, 0.25)), **HALF),
    "gradient in z": Pressed((CONTACT,), lambda x, z: 2.0 + 1.5 * z + 0.0 * x, **HALF),
    "gradient in x": Pressed((CONTACT,), lambda x, z: 1.0 + x - 2j * z, **HALF),
}


@pytest.mark.study
@pytest.mark.parametrize(
    ("name", "free_top"),
    [*((name, True) for name in BESIDE), ("large lobe", False), ("gradient in z", False)],
)
def test_truth_beside_the_model_is_found_to_the_bars(name, free_top):
    view = BESIDE[name]
    start = view.scene(42.0)
    if free_top:
        start = start.with_values({"camera.top_mm": 1.5 * view.pixel})
    found = invert_tractions(view.data(), start, free_top=free_top)
    assert found.load_n.value == pytest.approx(view.load, rel=5e-4)
    assert found.tangential_n.value == pytest.approx(view.tangential, rel=0.03)
    assert order_rms(found, view) < 0.003
    assert found.chi == pytest.approx(1.0, abs=0.03)
    assert found.pixels.top_mm == pytest.approx(0.0, abs=0.2 * view.pixel)


@pytest.mark.study
@pytest.mark.parametrize("off_px", [-3.0, 3.0])
def test_a_wrong_place_of_the_surface_is_flagged(off_px):
    view = Pressed((CONTACT, LOBE), **HALF)
    start = view.scene().with_values({"camera.top_mm": off_px * view.pixel})
    found = invert_tractions(view.data(), start)
    assert found.chi > 1.03 and any("camera.top_mm" in text for text in found.warnings)


@pytest.mark.study
def test_uncertainties_of_the_resultants_are_their_errors():
    pulls = []
    for seed in range(0, 12, 2):
        lobe = Patch(0.6 + 0.05 * seed, 0.1 + 0.01 * seed, 3.0 + 0.4 * seed, 0.2)
        view = Pressed((CONTACT, lobe), seed=seed, **HALF)
        found = invert_tractions(view.data(), view.scene(46.0))
        for one, true in ((found.load_n, view.load), (found.tangential_n, view.tangential)):
            pulls.append((one.value - true) / one.standard_uncertainty)
    # 12 pulls: their RMS is known to 20 %; that hats are no roots at the edges adds a bias of
    # a hundredth of a per cent of the load, which is as large as the noise's part
    assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 2.0


@pytest.mark.long
@pytest.mark.parametrize(
    "as_stated", [True, pytest.param(False, marks=pytest.mark.study)], ids=["stated", "asked"]
)
def test_a_fit_that_leaves_a_lobe_says_that_tractions_find_it(tmp_path, as_stated):
    view = Pressed((CONTACT, LOBE), **SMALL)
    write_tiff(tmp_path / "frame.tif", view.frame()[None], pixel_mm=view.pixel)
    plain = fit(tmp_path / "frame.tif", view.scene(42.0), FREE, as_stated=as_stated)
    assert any("--tractions finds the pressure" in text for text in plain.warnings)


@pytest.mark.long
def test_the_command_leaves_tractions_and_principal_stresses(tmp_path):
    view = Pressed((CONTACT, LOBE), cols=160, rows=120, pixel=0.025)
    write_tiff(tmp_path / "frame.tif", view.frame()[None], pixel_mm=view.pixel)
    scene = view.scene(42.0)

    out = tmp_path / "out"
    found = fit(tmp_path / "frame.tif", scene, FREE, tractions=True, as_stated=True, out=out)
    heads = heads_of(out)
    assert set(heads) == {"sigma_1_mpa.tif", "sigma_2_mpa.tif", "fringe_order.tif"}
    assert all(has_whole_head(*head, placed=True) for head in heads.values())
    assert not any("--tractions" in text for text in found.warnings)
    saved = json.loads((out / "fit.json").read_text("utf-8"))["tractions"]
    assert [one["frame"] for one in saved] == [0]
    assert saved[0]["load_n"]["value"] == pytest.approx(view.load, rel=1e-3)
    table = read_csv(out / "tractions.csv")
    assert list(table)[:3] == ["frame", "x_mm", "pressure_mpa"]
    assert table["pressure_mpa"] == pytest.approx(found.tractions[0].pressure_mpa, rel=1e-8)
    sigma_1, sigma_2, order = (
        tifffile.imread(out / name)
        for name in ("sigma_1_mpa.tif", "sigma_2_mpa.tif", "fringe_order.tif")
    )
    assert sigma_1.dtype == np.float32 and sigma_1.shape == (view.rows, view.cols)
    below = np.isfinite(order)
    # float32 maps of some ten MPa
    assert ORDER_PER_MPA * (sigma_1 - sigma_2)[below] == pytest.approx(order[below], abs=1e-5)
    assert (out / "tractions.png").stat().st_size > 0
