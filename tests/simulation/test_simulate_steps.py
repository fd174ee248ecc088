"""The steps of a simulation, one by one, make the very frames of `simulate`."""

import numpy as np
import pytest

import isochrome
from isochrome.errors import PhysicsError
from refusals import refusal

SMALL = {"camera.width_px": 96, "camera.height_px": 72, "camera.noise_grey": 2.0}
CONTACT = isochrome.load_scene("line-contact-wear").with_values(SMALL | {"camera.pixel_mm": 0.04})
RING = isochrome.load_scene("ring").with_values(
    SMALL | {"load.normal_n": 60.0, "camera.pixel_mm": 0.64, "polariscope.wavelength_nm": 546.0}
)
STEPS = tuple(
    {"polariser_deg": 90.0, "input_plate_deg": 45.0, "output_plate_deg": -45.0, "analyser_deg": a}
    for a in (0.0, 45.0, 90.0)
)
SCENES = {
    "worn contact": CONTACT,
    "ring": RING,
    "steps": RING.with_values({"polariscope.step": STEPS}),
    "colour": RING.with_values({"camera.colour": True}),
    "shot noise": RING.with_values(
        {
            "camera.full_well_electrons": 9000.0, "camera.gamma": 2.2, "camera.vignette": 0.2,
            "camera.bit_depth": 12, "camera.blur_px": 0.7,
        }
    ),
}  # fmt: skip


def frames_by_steps(scene):
    for number, state in enumerate(isochrome.scene_states(scene)):
        stress = isochrome.stress_map(scene, state)
        rng = np.random.default_rng([scene.camera.seed, number])
        for step in range(len(scene.polariscope.step)) or [None]:
            light = isochrome.polariscope_light(scene, stress, step=step)
            yield isochrome.camera_frame(scene, light, rng=rng)


@pytest.mark.parametrize("name", SCENES)
def test_the_steps_one_by_one_make_the_frames_of_simulate(name):
    wanted = isochrome.simulate(SCENES[name]).frames
    found = list(frames_by_steps(SCENES[name]))
    assert [frame.dtype for frame in found] == [wanted.dtype] * len(wanted)
    assert np.array_equal(np.stack([frame.values for frame in found]), wanted)


def test_the_first_state_has_its_noise_without_being_asked():
    state, *_ = isochrome.scene_states(CONTACT)
    light = isochrome.polariscope_light(CONTACT, isochrome.stress_map(CONTACT, state))
    frame = isochrome.camera_frame(CONTACT, light)
    assert np.array_equal(frame, isochrome.simulate(CONTACT).frames[0])


def test_each_step_has_axes_in_mm_and_units():
    state, *_ = isochrome.scene_states(CONTACT)
    stress = isochrome.stress_map(CONTACT, state)
    light = isochrome.polariscope_light(CONTACT, stress)
    frame = isochrome.camera_frame(CONTACT, light)
    simulated = isochrome.simulate(CONTACT).dataset
    for array, units in ((stress, "MPa"), (light, "1"), (frame, "grey level")):
        assert array.dims == ("z_mm", "x_mm") and array.attrs["units"] == units
        assert array.x_mm.equals(simulated.x_mm) and array.z_mm.equals(simulated.z_mm)
        assert array.x_mm.attrs["units"] == "mm"
    assert (frame - simulated.frames[0]).shape == frame.shape  # aligned, not empty
    assert float(abs(stress).max()) > 10.0


def test_the_tractions_carry_the_load():
    """The pressure's integral is the load on a unit of thickness, the shear's mu times that."""
    static, first, *_ = isochrome.scene_states(CONTACT)
    for state, friction in ((static, 0.0), (first, CONTACT.friction_at(0.0))):
        found = isochrome.surface_tractions(state)
        line_load = CONTACT.load_at(0.0) / CONTACT.specimen.thickness_mm
        assert found.pressure_mpa.integrate("x_mm").item() == pytest.approx(line_load, rel=2e-4)
        shear = abs(found.shear_mpa.integrate("x_mm").item())
        assert shear == pytest.approx(friction * line_load, rel=2e-4, abs=1e-12)
    assert {name: found[name].attrs["units"] for name in found.data_vars} == {
        "pressure_mpa": "MPa", "shear_mpa": "MPa", "wear_depth_um": "um",
    }  # fmt: skip


STRESS = np.zeros((72, 96), complex)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: isochrome.surface_tractions(isochrome.scene_states(RING)[0]),
         "no contact's state"),
        (lambda: isochrome.polariscope_light(RING, STRESS[1:]), "shape (71, 96)"),
        (lambda: isochrome.polariscope_light(RING, STRESS.real), "float64"),
        (lambda: isochrome.polariscope_light(RING, STRESS, step=0), "step = 0"),
        (lambda: isochrome.polariscope_light(SCENES["steps"], STRESS, step=3), "step = 3"),
        (lambda: isochrome.camera_frame(RING, STRESS.real[1:]), "light of shape (71, 96)"),
        (lambda: isochrome.camera_frame(RING, STRESS), "complex128"),
        (lambda: isochrome.camera_frame(SCENES["colour"], STRESS.real), "(72, 96, 3)"),
        (lambda: isochrome.scene_states(isochrome.load_scene({"specimen": {}})), "simulated"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_in_one_line(call, words):
    assert words in refusal(call)


def test_fringes_finer_than_the_pixels_are_refused_as_by_simulate():
    wild = np.random.default_rng(0).normal(0.0, 300.0, STRESS.shape) + 0j
    with pytest.raises(PhysicsError, match="finer than two pixels"):
        isochrome.polariscope_light(RING, wild)
