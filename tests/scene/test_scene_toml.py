"""Scenes in and out of TOML: nothing is lost, and the shipped scene is the paper's."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from isochrome import scene as models
from isochrome.errors import InputError
from isochrome.scene import Scene, dump_scene, load_scene, parse_scene, scene_names
from scene_texts import PAPER_CONTACT

positive = st.floats(1e-6, 1e6)
finite = st.floats(-1e6, 1e6)
distance = st.floats(0.0, 1e6)
coefficients = st.floats(-5, 5)
# any name that a file can have: no lone surrogates, and no letters that a backslash makes
names = st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=12)


def maybe(strategy):
    return st.none() | strategy


def some(kind, **fields):
    """A part with any of its optional keys left out."""
    return st.fixed_dictionaries({}, optional=fields).map(lambda keys: kind(**keys))


@st.composite
def tables(draw, value=finite):
    places = sorted(draw(st.lists(distance, min_size=2, max_size=5, unique=True)))
    values = st.lists(value, min_size=len(places), max_size=len(places))
    return models.DistanceTable(distance_m=places, value=draw(values))


steps = st.builds(models.PolariscopeStep, polariser_deg=finite, analyser_deg=finite) | st.builds(
    models.PolariscopeStep, polariser_deg=finite, input_plate_deg=finite, output_plate_deg=finite,
    analyser_deg=finite,
)  # fmt: skip
wavelengths = st.floats(200, 3000)
polariscopes = st.builds(
    models.Polariscope, wavelength_nm=wavelengths, field=st.sampled_from(["dark", "bright"]),
    plate_wavelength_nm=maybe(wavelengths), step=st.lists(steps, max_size=3),
) | st.sampled_from([
    models.Polariscope(field="plane", axis_deg=12.5, analyser_error_deg=-0.5),
    models.Polariscope(wavelength_nm=587.0, light="white", plate_wavelength_nm=560.0),
    models.Polariscope(
        wavelength_nm=546.1, lines={"wavelength_nm": (435.8, 546.1), "power": (1.0, 2.0)}
    ),
    models.Polariscope(
        wavelength_nm=546.1, spectrum={"wavelength_nm": (400, 700), "power": (1.0, 2.0)}
    ),
])  # fmt: skip
cameras = some(
    models.Camera, width_px=st.integers(1, 100_000), height_px=st.integers(1, 100_000),
    left_mm=finite, top_mm=finite, pixel_mm=positive, bit_depth=st.integers(1, 16),
    vignette=st.floats(0, 0.999),
    gamma=st.floats(0.1, 10), noise_grey=st.floats(0, 65535), full_well_electrons=positive,
    seed=st.integers(0, 2**63 - 1),
)  # fmt: skip
known_orders = st.builds(
    models.KnownOrder, row_px=st.integers(0, 9), col_px=st.integers(0, 9), order=st.floats(0, 50)
)
known_lines = st.builds(
    models.KnownLine, row_px=st.just([1.5, 2.0]),
    col_px=st.lists(st.floats(0, 99), min_size=2, max_size=2),
    order=st.integers(0, 99).map(lambda half: 0.5 * half),
)  # fmt: skip
boundaries = st.builds(models.FreeBoundary, row_px=st.just([0, 0, 9]), col_px=st.just([0, 5, 5]))
frames = some(
    models.Frames,
    roi=st.builds(models.Roi, height_px=st.integers(1, 9), width_px=st.integers(1, 9)),
    no_load_dark=names, gamma=st.floats(0.1, 10), channel=st.sampled_from(["red", "mean"]),
    known_order=st.lists(known_orders, max_size=2), known_line=st.lists(known_lines, max_size=2),
    free_boundary=st.lists(boundaries, max_size=1),
)  # fmt: skip
specimens = st.builds(
    models.Specimen, young_gpa=positive, poisson=st.floats(-0.99, 0.5),
    plane=st.sampled_from(["strain", "stress"]), thickness_mm=positive,
    fringe_value_n_per_mm=positive,
)  # fmt: skip
indenters = st.builds(
    models.Indenter, radius_mm=positive, profile=maybe(names), young_gpa=positive,
    poisson=st.floats(-0.99, 0.5),
) | st.builds(
    models.Indenter, shape=st.just("flat"), half_width_mm=positive, young_gpa=positive,
    poisson=st.floats(-0.99, 0.5),
)  # fmt: skip
wears = st.builds(
    models.Wear, coefficient_mm2_per_n=st.floats(0, 1) | tables(st.floats(0, 1)),
    law=st.sampled_from(["archard", "sarkar"]),
    distances_m=st.lists(distance, min_size=1, max_size=5),
)  # fmt: skip
loads = st.builds(models.Load, normal_n=positive | tables(positive), bulk_mpa=maybe(finite))
frictions = st.builds(
    models.Friction,
    coefficient=coefficients | tables(coefficients),
    static_state_first=st.booleans(),
)


def scene_of(parts):
    """The scene of some parts; a phase-stepped one has no known lines, which it would refuse."""
    stepped = "polariscope" in parts and parts["polariscope"].step
    if stepped and "frames" in parts:
        parts = parts | {"frames": parts["frames"].model_copy(update={"known_line": ()})}
    return Scene(**parts)


contacts = st.fixed_dictionaries(
    {
        "specimen": specimens,
        "indenter": indenters,
        "load": loads,
    },
    optional={
        "friction": frictions, "wear": wears, "polariscope": polariscopes, "camera": cameras,
        "frames": frames,
        "numerics": some(models.Numerics, tolerance=st.floats(1e-10, 0.1), spacing_mm=positive),
    },
).map(lambda parts: scene_of(parts))  # fmt: skip


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(scene=contacts)
def test_a_scene_written_to_toml_reads_back_equal(scene):
    text = dump_scene(scene)
    assert parse_scene(text) == scene
    # and a second time gives the same text: nothing creeps in
    assert dump_scene(parse_scene(text)) == text


@settings(max_examples=8, deadline=None)
@given(scene=contacts)
def test_a_written_scene_holds_only_the_parts_that_it_was_given(scene):
    written = tomllib.loads(dump_scene(scene))
    assert set(written) == scene.model_fields_set
    assert "folder" not in written and "name" not in written


def test_the_shipped_scene_is_the_papers_experiment():
    # numbers from the paper: block 60 x 40 x 4 mm of 2.1 GPa and 0.4, a steel cylinder of diameter
    # 49.22 mm, 44 N, mu up to 0.25, k = 2e-9 mm²/N, 14.6 kN/m, 587 nm, 659 x 494 px over 4 x 3 mm
    scene = load_scene("line-contact-wear")
    assert "line-contact-wear" in scene_names()
    specimen, indenter = scene.specimen, scene.indenter
    assert (specimen.young_gpa, specimen.poisson, specimen.plane) == (2.1, 0.4, "strain")
    assert (specimen.thickness_mm, specimen.fringe_value_n_per_mm) == (4.0, 14.6)
    assert (indenter.radius_mm, indenter.young_gpa, indenter.poisson) == (49.22 / 2, 210.0, 0.3)
    assert scene.load.normal_n == 44.0
    assert scene.friction_at(0.0) == scene.friction_at(233.0) == 0.25
    assert scene.friction.static_state_first and scene.wear.coefficient_mm2_per_n == 2e-9
    assert scene.wear.distances_m == (0.0, 31.0, 77.0, 155.0, 233.0)
    assert (scene.polariscope.wavelength_nm, scene.polariscope.field) == (587.0, "dark")
    camera = scene.camera
    assert (camera.width_px, camera.height_px, camera.bit_depth) == (659, 494, 8)
    # 4 mm and 3 mm to one pixel
    assert camera.width_px * camera.pixel_mm == pytest.approx(4.0, abs=camera.pixel_mm)
    assert camera.height_px * camera.pixel_mm == pytest.approx(3.0, abs=camera.pixel_mm)
    assert (camera.left_mm, camera.top_mm) == (-2.0, 0.0)


def test_absent_parts_are_absent_and_stand_for_nothing():
    scene = parse_scene('[specimen]\nshape = "ring"\n')
    assert scene.model is None
    parts = (scene.indenter, scene.load, scene.friction, scene.wear, scene.camera)
    assert parts == (None,) * len(parts) and scene.friction_at(10.0) == 0.0
    assert scene.polariscope.plate_wavelength_nm is None and scene.polariscope.step == ()
    assert dump_scene(scene).strip() == '[specimen]\nshape = "ring"'
    scene = parse_scene("[specimen]\n")
    assert scene.load_at(1.0) == scene.friction_at(1.0) == scene.wear_coefficient_at(1.0) == 0.0


@pytest.mark.parametrize(
    ("text", "model"),
    [
        ('shape = "disc"\ndiameter_mm = 9.0', "disc"), ('shape = "beam"\nheight_mm = 9.0', "beam"),
        ('shape = "other"', None), ("", None),
    ],
)  # fmt: skip
def test_the_model_follows_from_the_shape(text, model):
    rest = "thickness_mm = 4.0\nfringe_value_n_per_mm = 14.6\n"
    load = "[load]\nnormal_n = 9.0\ninner_span_mm = 1.0\nouter_span_mm = 2.0\n"
    assert parse_scene(f"[specimen]\n{text}\n{rest}{load}").model == model


@given(table=tables(coefficients), where=distance)
def test_friction_tables_are_linear_between_their_points_and_constant_beyond(table, where):
    scene = load_scene("line-contact-wear").with_values({"friction.coefficient": table})
    places, values = table.distance_m, table.value
    assert [scene.friction_at(place) for place in places] == list(values)
    mu = scene.friction_at(where)
    if where <= places[0]:
        assert mu == values[0]
    elif where >= places[-1]:
        assert mu == values[-1]
    else:
        k = next(i for i in range(1, len(places)) if places[i] >= where)
        share = (where - places[k - 1]) / (places[k] - places[k - 1])
        straight = values[k - 1] + share * (values[k] - values[k - 1])
        # rounding of the interpolation, relative to the values it is made of
        assert mu == pytest.approx(straight, rel=1e-9, abs=1e-9 * max(map(abs, values)) + 1e-300)


@given(table=tables(positive), where=st.lists(distance, min_size=1, max_size=6))
def test_load_friction_and_wear_answer_for_many_distances_at_once(table, where):
    values = {"load.normal_n": table, "wear.coefficient_mm2_per_n": table}
    scene = load_scene("line-contact-wear").with_values(values)
    for ask in (scene.load_at, scene.wear_coefficient_at, scene.friction_at):
        many = ask(np.array([where, where]))
        assert many.shape == (2, len(where)) and many.tolist() == [[ask(s) for s in where]] * 2
    assert type(scene.load_at(where[0])) is type(scene.friction_at(where[0])) is float


def test_a_value_is_read_and_changed_by_its_dotted_key_alone():
    scene = load_scene("line-contact-wear")
    changed = scene.with_values({"load.normal_n": 50.0, "camera.left_mm": -1.9})
    assert (changed.get("load.normal_n"), changed.get("camera.left_mm")) == (50.0, -1.9)
    assert (scene.get("load.normal_n"), scene.get("camera.left_mm")) == (44.0, -2.0)
    assert changed.with_values({"load.normal_n": 44.0, "camera.left_mm": -2.0}) == scene
    assert changed.name == scene.name
    before = dump_scene(scene).splitlines()
    after = dump_scene(scene.with_values({"load.normal_n": 50.0})).splitlines()
    assert [(b, a) for b, a in zip(before, after, strict=True) if a != b] == [
        ("normal_n = 44.0", "normal_n = 50.0")
    ]
    with pytest.raises(ValueError, match="frozen"):
        scene.load.normal_n = 1.0


def test_paths_in_a_scene_are_relative_to_its_own_file(tmp_path):
    file = tmp_path / "here" / "one.toml"
    file.parent.mkdir()
    file.write_text('[specimen]\nshape = "ring"\n[frames]\nno_load_dark = "dark.tif"\n')
    scene = load_scene(file)
    assert scene.path(scene.frames.no_load_dark) == file.parent / "dark.tif" and scene.name == "one"
    assert load_scene(scene) is scene
    assert parse_scene(dump_scene(scene)).path("x.csv") == Path("x.csv")


def test_every_file_that_a_scene_names_is_listed():
    contact = PAPER_CONTACT.replace("radius_mm = 24.61", 'profile = "profile.csv"')
    text = (
        contact
        + """
[camera]
response = "response.csv"
[frames]
no_load_dark = "dark.tif"
no_load_bright = "bright.tif"
no_load_steps = "steps.tif"
mask = "mask.png"
colour_table = "colours.csv"
"""
    )
    scene = parse_scene(text, folder=Path("here"))
    of_model = {Path("here", name) for name in ("profile.csv", "response.csv")}
    of_frames = ("dark.tif", "bright.tif", "steps.tif", "mask.png", "colours.csv")
    assert set(scene.files(of_frames=False)) == of_model
    assert set(scene.files(of_frames=True)) == of_model | {Path("here", n) for n in of_frames}
    assert len(scene.files(of_frames=True)) == text.count('= "')  # and each once
    assert load_scene("line-contact-wear").files(of_frames=True) == []


def test_numbers_of_any_size_survive_the_round_trip_to_the_last_bit():
    scene = load_scene("line-contact-wear")
    for value in (1e-300, math.pi, 1.7976931348623157e308):
        text = dump_scene(scene.with_values({"load.normal_n": value}))
        assert parse_scene(text).load.normal_n == value


def test_the_scene_file_may_not_set_what_belongs_to_the_program():
    for key in ("folder", "name"):
        with pytest.raises(InputError, match=f"unknown key '{key}'"):
            parse_scene(f'{key} = "x"\n[specimen]\nshape = "ring"\n')
