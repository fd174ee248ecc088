"""What a real bench adds to a rendered contact: a load that swings within the exposure, a focus off
the plate's middle, a machined edge."""

from dataclasses import replace

import numpy as np
import pytest

from isochrome.contact import pressed_again
from isochrome.errors import InputError
from isochrome.scene import load_scene
from isochrome.simulation import (
    make_picture,
    picture_signal,
    scene_states,
    state_difference,
    swing_states,
)
from isochrome.stress import pixel_grid, stress_components

CAMERA = {
    "camera.width_px": 120, "camera.height_px": 90, "camera.pixel_mm": 0.0333,
    "camera.left_mm": -2.0, "camera.bit_depth": None, "camera.noise_grey": 0.0,
}  # fmt: skip
SCENE = load_scene("line-contact-wear").with_values(CAMERA)


def signal(scene, state):
    pixels = pixel_grid(scene)
    fields = [state_difference(scene, s, pixels) for s in (state, *swing_states(scene, state))]
    return picture_signal(scene, make_picture(scene, fields[0], pixels, fields[1:]))


@pytest.mark.parametrize("number", [0, 1, 3], ids=["static", "sliding", "worn"])
def test_a_swinging_load_is_the_mean_of_64_frames(number):
    """Three moments are a mean over a sine to the fifth power of its amplitude. What is left is the
    mean over a pixel's area of a swing that differs in it, large beside the edge of contact alone:
    of pixels of a tenth of its half-width a fiftieth of the swing's own effect from the fifth row
    on."""

    def frames(swing):
        scene = SCENE.with_values({"load.swing": swing})
        state = scene_states(scene)[number]
        still = scene.with_values({"load.swing": 0.0})
        phases = 2.0 * np.pi * (np.arange(64) + 0.5) / 64
        total = 0.0
        for share in 1.0 + swing * np.cos(phases):
            one = swing_of(still, state, float(share))
            total = total + signal(still, one)
        return signal(scene, state), total / 64, signal(still, state)

    shown, mean, without = frames(0.05)
    effect = np.abs(mean - without)[5:].max()
    assert effect > 0.05  # of full light
    assert np.abs(shown - mean)[5:].max() < 0.02 * effect


def swing_of(scene, state, share):
    return replace(state, surface=pressed_again(scene, state.surface, share))


def test_pressed_again_by_the_same_load_is_the_same_contact():
    for state in scene_states(SCENE)[:3]:
        again = swing_of(SCENE, state, 1.0).surface
        np.testing.assert_array_equal(again.pressure_mpa, state.surface.pressure_mpa)


def test_pressed_again_a_static_contact_is_hertz():
    """p0 goes as the root of the load."""
    scene = SCENE.with_values({"wear.distances_m": (0.0,)})
    state = scene_states(scene)[0]
    again = swing_of(scene, state, 1.44).surface
    assert again.p_max_mpa == pytest.approx(1.2 * state.surface.p_max_mpa, rel=1e-3)
    assert again.line_load_n_per_mm == pytest.approx(1.44 * 11.0, rel=1e-9)


def test_off_the_middle_of_the_plate_a_focus_moves_fringes_in_proportion():
    state = scene_states(SCENE)[1]
    pixels = pixel_grid(SCENE)
    still = state_difference(SCENE, state, pixels)
    deep = slice(6, None)
    moved = []
    for focus in (0.1, 0.2):
        scene = SCENE.with_values({"camera.focus_mm": focus})
        moved.append((state_difference(scene, state, pixels) - still)[deep])
    assert np.abs(moved[0]).max() > 0.02  # MPa
    # a shift of a hundredth of a pixel, twice as large
    np.testing.assert_allclose(moved[1], 2.0 * moved[0], atol=0.03 * np.abs(moved[0]).max())


def test_a_focus_moves_fringes_towards_where_the_sum_of_stresses_grows():
    """By hand at one place: the order there is that of the place d C h grad S before it."""
    scene = SCENE.with_values({"camera.focus_mm": 1.0})
    state, pixels = scene_states(scene)[1], pixel_grid(scene)
    surface = state.surface
    tractions = surface.grid.x_mm, surface.pressure_mpa, surface.shear_mpa
    seen = state_difference(scene, state, pixels)
    row, col = 15, 65
    x, z = pixels.x_mm[col], pixels.z_mm[row]
    step = 1e-4

    def total(x, z):
        stress = stress_components(x, z, *tractions)
        return float(stress.sigma_x + stress.sigma_z)

    at = np.array([x, z])
    for _ in range(5):
        slope = np.array([
            total(at[0] + step, at[1]) - total(at[0] - step, at[1]),
            total(at[0], at[1] + step) - total(at[0], at[1] - step),
        ]) / (2.0 * step)  # fmt: skip
        at = np.array([x, z]) - 4.0 * 1e-4 * 1.0 * slope
    truth = stress_components(at[0], at[1], *tractions).difference
    plain = stress_components(x, z, *tractions).difference
    assert abs(seen[row, col] - truth) < 0.03 * abs(truth - plain)


@pytest.mark.parametrize("key", ["specimen.edge_stress_mpa", "camera.focus_mm", "load.swing"])
def test_without_a_contact_a_bench_key_is_refused(key):
    with pytest.raises(InputError, match="indenter"):
        load_scene("ring").with_values({key: 0.1})
