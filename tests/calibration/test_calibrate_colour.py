"""Colour tables from images whose light is not the generic one; the truth is the pictures' own."""

import json
import tomllib

import numpy as np
import pytest
import tifffile

from colour_frames import colour_frames
from isochrome.calibration import ColourSet, calibrate_colour, check_light, save_calibration
from isochrome.errors import InputError, PhysicsError
from isochrome.fringes import OwnLight, read_table
from isochrome.optics import camera_response
from isochrome.output import write_csv, write_tiff
from isochrome.processing import process
from isochrome.scene import Camera, parse_scene
from scene_texts import PAPER_PAIR, beam_text, camera_text

WAVE = np.arange(400.0, 701.0, 5.0)
LIGHTS = {
    # three diodes, as of a lit panel, and a lamp of 3200 K (Planck's law)
    "diodes": sum(
        p * np.exp(-0.5 * ((WAVE - m) / s) ** 2)
        for p, m, s in ((1.0, 455.0, 10.0), (0.8, 530.0, 15.0), (1.0, 625.0, 9.0))
    ),
    "lamp": (560.0 / WAVE) ** 5 / np.expm1(1.4388e7 / (WAVE * 3200.0)) * 3e3,
}
CONTACT = "[load]\nnormal_n = {load}\n[friction]\ncoefficient = 0.2\n"
BEAM = beam_text("{load}", fringe_value=14.6, thickness_mm=4.0)


def middle_of_green(light):
    """Mean wavelength of the green channel's light, by the trapezoid rule."""
    fine = np.linspace(400.0, 700.0, 3001)
    seen = np.interp(fine, WAVE, LIGHTS[light])
    seen = seen * camera_response(Camera(colour=True)).at(fine)[1]
    return float((fine * seen).sum() / seen.sum())


def optics(light, gamma, *, left, top, pixel):
    power = ", ".join(f"{p:.6g}" for p in LIGHTS[light])
    places = ", ".join(f"{w:g}" for w in WAVE)
    lamp = f"[polariscope]\nwavelength_nm = {middle_of_green(light):.3f}\n"
    lamp += f"spectrum = {{ wavelength_nm = [{places}], power = [{power}] }}\n"
    return lamp + camera_text(
        200, 150, pixel, left_mm=left, top_mm=top, bit_depth=8, brightness=0.9, background=0.01,
        vignette=0.2, noise_grey=1.5, gamma=gamma, colour="true",
    )  # fmt: skip


def rendered(text, seed):
    """A colour image of a scene, its no-load images, and its order."""
    return colour_frames(parse_scene(text), seed)


def write_contacts(place, light, gamma):
    """Images of a contact under three loads, and what the set and the scene say of them."""
    seen = optics(light, gamma, left=-2.0, top=0.05, pixel=0.02)
    shots = [
        rendered(PAPER_PAIR + CONTACT.format(load=load) + seen, i)
        for i, load in enumerate((24.0, 34.0, 42.0))
    ]
    for i, (images, _) in enumerate(shots):
        write_tiff(place / f"{i}.tif", images[0][None], photometric="rgb")
    write_tiff(place / "all.tif", np.stack([s[0][0] for s in shots]), photometric="rgb")
    head = f'[polariscope]\nwavelength_nm = {middle_of_green(light):.3f}\nlight = "white"\n'
    head += "[camera]\ncolour = true\n"
    files = "".join(f'[[image]]\nfile = "{i}.tif"\n' for i in range(len(shots)))
    (place / "set.toml").write_text(head + files)
    return head, [order for _, order in shots]


def assert_read(found, orders, kept):
    """The bar for colour up to N = 3: RMS 0.02 fringe, wrong branch 0.1 %."""
    for item, order in zip(found.frames, orders, strict=True):
        error = (item.reading.order - order)[order <= 3.0]
        known = np.isfinite(error)
        assert known.mean() >= kept
        assert np.sqrt(np.mean(error[known] ** 2)) <= 0.02
        assert np.mean(np.abs(error[known]) > 0.5) <= 1e-3


@pytest.mark.study
@pytest.mark.parametrize(("light", "gamma"), [("diodes", 1.0), ("diodes", 2.2), ("lamp", 2.2)])
def test_a_table_of_own_colours_reads_to_the_bar(light, gamma, tmp_path):
    head, orders = write_contacts(tmp_path, light, gamma)
    calibration = calibrate_colour(tmp_path / "set.toml")
    save_calibration(calibration, tmp_path / "out", source=tmp_path / "set.toml")
    numbers = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert numbers["way"] == "own colours" and numbers["residual"] < 0.02
    (tmp_path / "scene.toml").write_text(
        f"[specimen]\nshape = 'other'\n{head}[frames]\ngamma = {numbers['gamma']}\n"
        "colour_table = 'out/colour_table.csv'\nno_load_dark = 'out/background.tif'\n"
        "no_load_bright = 'out/illumination.tif'\n"
    )
    assert_read(process(tmp_path / "all.tif", tmp_path / "scene.toml"), orders, kept=0.9)


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """A bending set of one image, its true order, and the light's keys."""
    place = tmp_path_factory.mktemp("beam")
    seen = optics("diodes", 2.2, left=-10.0, top=0.6, pixel=0.125)
    images, order = rendered(BEAM.format(load=240.0) + seen, 0)
    for name, image in zip(("loaded", "dark", "bright"), images, strict=True):
        write_tiff(place / f"{name}.tif", image[None], photometric="rgb")
    (place / "set.toml").write_text(
        "[beam]\nheight_mm = 20.0\ninner_span_mm = 40.0\nouter_span_mm = 100.0\n"
        "fringe_value_n_per_mm = 14.6\n"
        f"[polariscope]\nwavelength_nm = {middle_of_green('diodes'):.3f}\nlight = 'white'\n"
        "[camera]\ncolour = true\npixel_mm = 0.125\ngamma = 2.2\n"
        "[frames]\nno_load_dark = 'dark.tif'\nno_load_bright = 'bright.tif'\n"
        "[[image]]\nfile = 'loaded.tif'\nload_n = 240.0\n"
    )
    return place, order


@pytest.fixture(scope="module")
def table(beam):
    """What the beam's image gives."""
    return calibrate_colour(beam[0] / "set.toml")


@pytest.mark.long
def test_a_table_of_a_beam_reads_another_specimen_to_the_bar(table, tmp_path):
    calibration = table
    assert calibration.way == "beam" and calibration.colour_table.highest > 3.0
    save_calibration(calibration, tmp_path / "out")
    seen = optics("diodes", 2.2, left=-2.0, top=0.05, pixel=0.02)
    images, order = rendered(PAPER_PAIR + CONTACT.format(load=32.0) + seen, 9)
    for name, image in zip(("loaded", "dark", "bright"), images, strict=True):
        write_tiff(tmp_path / f"{name}.tif", image[None], photometric="rgb")
    (tmp_path / "scene.toml").write_text(
        f"[specimen]\nshape = 'other'\n[polariscope]\nwavelength_nm = {middle_of_green('diodes')}\n"
        "light = 'white'\n[camera]\ncolour = true\n[frames]\ngamma = 2.2\n"
        "colour_table = 'out/colour_table.csv'\nno_load_dark = 'dark.tif'\n"
        "no_load_bright = 'bright.tif'\n"
    )
    found = process(tmp_path / "loaded.tif", tmp_path / "scene.toml")
    assert_read(found, [order], kept=0.9)


@pytest.mark.long
def test_the_folder_holds_table_numbers_and_figure(beam, table, tmp_path):
    (place, _), calibration = beam, table
    save_calibration(calibration, tmp_path / "out", source=place / "set.toml")
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "colour_table.csv", "calibration.json", "calibration.png", "provenance.json",
        "report.html",
    }  # fmt: skip
    again = read_table(tmp_path / "out" / "colour_table.csv")
    np.testing.assert_allclose(again.signal, calibration.colour_table.signal, rtol=0, atol=1e-8)
    np.testing.assert_allclose(again.spread, calibration.colour_table.spread, rtol=0, atol=1e-8)


@pytest.mark.long
def test_what_arrays_give_is_what_their_files_give_bit_by_bit(beam, table):
    place, _ = beam
    tables = tomllib.loads((place / "set.toml").read_text("utf-8"))
    before = sorted(place.iterdir())
    read = {
        name: tifffile.imread(place / f"{name}.tif").reshape(150, 200, 3)
        for name in ("loaded", "dark", "bright")
    }
    tables["image"][0]["file"] = read["loaded"]
    tables["frames"] = {"no_load_dark": read["dark"], "no_load_bright": read["bright"]}
    found = calibrate_colour(tables)
    for name in ("signal", "spread", "order"):
        one, other = (getattr(each.colour_table, name) for each in (found, table))
        np.testing.assert_array_equal(one, other)
    assert found.warnings == table.warnings
    assert sorted(place.iterdir()) == before


def test_an_image_whose_sides_differ_is_no_beam(beam):
    place, _ = beam
    image = tifffile.imread(place / "loaded.tif").reshape(150, 200, 3)
    image[:75] = image[:75, :, ::-1]  # red for blue on one side of the neutral line
    write_tiff(place / "odd.tif", image[None], photometric="rgb")
    text = (place / "set.toml").read_text().replace("loaded.tif", "odd.tif")
    (place / "odd.toml").write_text(text)
    with pytest.raises(PhysicsError, match="no neutral line"):
        calibrate_colour(place / "odd.toml")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("wavelength_nm = ", "axis_deg = ", "wavelength_nm"),
        ("pixel_mm = 0.125\n", "", r"camera\.pixel_mm is missing"),
        ("load_n = 240.0", "", "every .*image.* of a beam needs load_n"),
        ("no_load_dark = 'dark.tif'\n", "", r"need frames\.no_load_dark"),
        ("[frames]\n", "[frames]\nchannel = 'red'\n", "frames.channel leaves one channel"),
    ],
)
def test_an_incomplete_set_is_refused(beam, old, new, words):
    place, _ = beam
    (place / "bad.toml").write_text((place / "set.toml").read_text().replace(old, new))
    with pytest.raises(InputError, match=words):
        calibrate_colour(place / "bad.toml")


@pytest.mark.parametrize(
    ("found", "words"),
    [
        ({"strange": 0.04}, "4.0 % of the pixels are off the table"),
        ({"torn": 0.04}, "jumps beside 4.0 %"), ({"moved": 0.06}, "moved the table by 0.060"),
        ({"highest": 1.1}, "reach N = 1.10, and 1.2 at least"), ({}, None),
    ],
)  # fmt: skip
def test_a_light_that_was_not_found_is_refused_whatever_shows_it(found, words):
    """One sign is enough; each of the shares here is a little over what is let pass, or below."""
    fields = dict.fromkeys(OwnLight.__dataclass_fields__, np.zeros(0))
    fields |= {"strange": 0.02, "torn": 0.02, "moved": 0.04, "highest": 1.3} | found
    given = ColourSet(
        polariscope={"wavelength_nm": 540.0, "light": "white"}, image=[{"file": "a.tif"}]
    )
    if words is None:
        check_light(OwnLight(**fields), given)
    else:
        with pytest.raises(PhysicsError, match=f"light was not found: .*{words}"):
            check_light(OwnLight(**fields), given)


def table_with(**changes):
    order = np.arange(0.0, 2.0, 0.01)
    columns = {"fringe_order": order}
    for name, ratio in (("red", 0.9), ("green", 1.0), ("blue", 1.2)):
        columns[name] = np.sin(np.pi * ratio * order) ** 2
    return {k: v for k, v in (columns | changes).items() if v is not None}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"blue": None}, r"lacks the columns \['blue'\]"),
        ({"fringe_order": np.arange(0.0, 2.0, 0.01)[::-1]}, "must rise from 0"),
        ({"fringe_order": np.arange(0.1, 2.1, 0.01)[:200]}, "must rise from 0"),
        ({"red": np.full(200, np.nan)}, "not finite"),
        ({"red": np.full(200, 0.5)}, "hardly changes"),
        ({"green": np.linspace(0.0, 255.0, 200)}, "1 is full light"),
        ({"green_spread": np.full(200, 0.9)}, "a spread must be"),
    ],
)
def test_a_table_that_is_none_is_refused(changes, words, tmp_path):
    write_csv(tmp_path / "table.csv", table_with(**changes))
    with pytest.raises(InputError, match=f"table.csv: .*{words}"):
        read_table(tmp_path / "table.csv")


def test_a_table_by_hand_is_read_on_its_steps(tmp_path):
    write_csv(tmp_path / "table.csv", table_with())
    table = read_table(tmp_path / "table.csv")
    # straight pieces of 0.01 fringe: (2 pi 1.2 0.01)²/16 = 4e-4
    exact = np.sin(np.pi * np.outer(table.order, (0.9, 1.0, 1.2))) ** 2
    np.testing.assert_allclose(table.signal, exact, rtol=0, atol=5e-4)
    assert not table.spread.any()


@pytest.mark.long
def test_images_without_fringes_are_refused(tmp_path):
    grey = np.random.default_rng(1).normal(100.0, 1.0, (1, 40, 40, 3)).astype(np.uint8)
    tifffile.imwrite(tmp_path / "flat.tif", grey, photometric="rgb")
    (tmp_path / "set.toml").write_text(
        "[polariscope]\nwavelength_nm = 540.0\nlight = 'white'\n[[image]]\nfile = 'flat.tif'\n"
    )
    with pytest.raises(PhysicsError, match=r"reach N = 0\.\d+, and 1\.2 at least"):
        calibrate_colour(tmp_path / "set.toml")
