"""Discs and beams on a pixel grid: the reference's fields in the picture's own axes."""

from contextlib import nullcontext
from importlib import import_module

import numpy as np
import pytest

from isochrome.errors import InputError
from isochrome.scene import BODIES, parse_scene
from isochrome.specimens import SpecimenModel, specimen_model
from isochrome.stress import pixel_grid
from scene_texts import beam_text, camera_text, disc_text

DISC = disc_text(200.0, fringe_value=14.6) + camera_text(81, 81, 0.26)
BEAM = beam_text(150.0, fringe_value=14.6, spans_mm=(10.0, 30.0)) + camera_text(81, 101, 0.25)


@pytest.mark.parametrize("name", [*BODIES, "contact", "block"])
def test_every_shape_of_a_scene_has_a_model_in_the_module_of_its_name(name):
    module = import_module(f"isochrome.specimens.{name}")
    assert isinstance(module.MODEL, SpecimenModel) and module.MODEL.unknowns


def test_a_disc_is_centred_in_the_picture_and_its_centre_has_the_closed_forms_difference():
    scene = parse_scene(DISC)
    pixels = pixel_grid(scene)
    field = specimen_model(scene).difference(scene, None, pixels)
    # 8 P/(pi D d) with horizontal tension above vertical compression: real and positive
    assert field[40, 40] == pytest.approx(8 * 200 / (np.pi * 20 * 6), rel=1e-12)
    x, z = pixels.x_mm[None, :], pixels.z_mm[:, None] - 10.0
    np.testing.assert_array_equal(np.isnan(field), np.hypot(x, z) > 10.0)
    # left-right and up-down symmetry, to rounding near the loads
    np.testing.assert_allclose(field, field[:, ::-1].conj(), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(field, field[::-1].conj(), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("key", ["width_px = 81\n", "height_px = 81\n", "pixel_mm = 0.26\n"])
def test_a_picture_without_its_size_names_the_key(key):
    with pytest.raises(InputError, match=f"camera.{key.split()[0]} is missing; add it"):
        pixel_grid(parse_scene(DISC.replace(key, "")))


def test_a_picture_takes_its_size_from_captured_frames_where_the_scene_gives_none():
    scene = parse_scene(DISC.replace("width_px = 81\n", "").replace("height_px = 81\n", ""))
    pixels = pixel_grid(scene, (60, 70))
    assert (pixels.rows, pixels.cols) == (60, 70)
    assert pixels.x_mm.mean() == pytest.approx(0.0, abs=1e-12)


def test_a_picture_beyond_memory_is_refused():
    scene = parse_scene(DISC.replace("_px = 81", "_px = 100000"))
    with pytest.raises(InputError, match="is over 100000000 pixels; lower them"):
        pixel_grid(scene)


@pytest.mark.parametrize(("pixel", "fits"), [(8230.0, True), (8231.0, False)])
def test_a_picture_a_kilometre_wide_is_a_slip_of_the_unit(pixel, fits):
    """81 pixels about the middle: 40.5 to the left edge, and 81 from there, 1e6 mm together."""
    scene = parse_scene(DISC.replace("pixel_mm = 0.26", f"pixel_mm = {pixel}\ntop_mm = 0.0"))
    words = r"camera\.pixel_mm = 8231, .* 1e\+06 mm .*; give them"
    with nullcontext() if fits else pytest.raises(InputError, match=words):
        assert pixel_grid(scene).pixel_mm == pixel
