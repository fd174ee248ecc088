"""Tracking through cameras, plates, masks and videos that are not ideal."""

import numpy as np
import pytest

from fitting.test_fit_track import FRICTION, LEFT, LOAD, SHAPE, contact, film, pulls, save
from fitting.test_fit_track_worn import worn_film
from isochrome.errors import InputError
from isochrome.fitting import track

COUNT = 8


def swinging(count):
    return 44.0 * (1.0 + 0.05 * np.sin(np.arange(count) / 3.0))


def hold(result, courses):
    assert result.searched == (0,) and not result.warnings
    # chi of 14400 pixels scatters by 0.006
    assert np.all(np.abs(result.chi - 1.0) < 0.03)
    # the bar of an imperfect camera, and of a tracked load
    assert np.sqrt(np.mean((result.values[:, 0] / courses[LOAD] - 1.0) ** 2)) < 5e-4
    spread = np.sqrt(np.mean(pulls(result, courses) ** 2))
    assert abs(spread - 1.0) < 0.1 + 3.5 / np.sqrt(2 * result.values.size)


@pytest.mark.long
@pytest.mark.parametrize(
    "camera",
    [
        pytest.param({"camera.gamma": 2.2, "frames.gamma": 2.2}, id="tone curve"),
        pytest.param(
            {
                "polariscope.plate_wavelength_nm": 587.0,
                "polariscope.input_plate_error_deg": 5.0,
                "polariscope.output_plate_error_deg": -5.0,
            },
            id="plates",
        ),
    ],
)
def test_a_camera_and_plates_that_are_not_ideal(tmp_path, camera):
    scene, courses = contact().with_values(camera), {LOAD: swinging(COUNT)}
    save(tmp_path, film(scene, courses, np.random.default_rng(8)))
    hold(track(tmp_path / "film.tif", scene, (LOAD,)), courses)


@pytest.mark.long
def test_a_picture_that_is_blurred(tmp_path):
    size = {"camera.width_px": 659, "camera.height_px": 494, "camera.pixel_mm": 0.00607}
    scene = contact().with_values(size | {LEFT: -2.0, "camera.blur_px": 2.0})
    load = swinging(6)
    save(tmp_path, film(scene, {LOAD: load}, np.random.default_rng(8)))
    result = track(tmp_path / "film.tif", scene, (LOAD,))
    assert result.searched == (0,) and not result.warnings
    # thinned pixels are blurred by the fringes' local slope, which costs some per cent of chi
    assert np.all(result.chi < 1.05)
    assert np.all(np.abs(result.values[:, 0] / load - 1.0) < 5e-4)  # the bar of a blurred picture


@pytest.mark.long
def test_what_a_mask_leaves_out_is_not_looked_at(tmp_path):
    courses = {LOAD: swinging(COUNT)}
    frames = film(contact(), courses, np.random.default_rng(9))
    frames[:, 20:, :40] = 250  # a lamp in the picture
    roi = {"top_px": 0, "left_px": 20, "height_px": SHAPE[0], "width_px": SHAPE[1] - 20}
    corners = [[0.0, 22.0], [0.0, 279.0], [199.0, 279.0], [199.0, 22.0]]
    scene = contact().with_values({"frames.roi": roi, "frames.polygon_px": corners})
    save(tmp_path, frames)
    with pytest.raises(InputError, match="width_px"):
        track(tmp_path / "film.tif", scene, (LOAD,))
    seen = {"camera.width_px": SHAPE[1] - 20, LEFT: -1.9 + 20 * 0.0125}
    hold(track(tmp_path / "film.tif", scene.with_values(seen), (LOAD,)), courses)


@pytest.mark.long
def test_a_lossless_video_is_tracked_at_the_distances_of_its_times(tmp_path):
    import av

    rate, speed = 20, 1000.0  # 50 mm a frame
    load, i = swinging(COUNT), np.arange(COUNT)
    frames, scene = worn_film(0.05 * i, load, np.full(COUNT, 0.2), np.random.default_rng(10))
    with av.open(str(tmp_path / "film.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=rate)
        stream.width, stream.height, stream.pix_fmt = SHAPE[1], SHAPE[0], "gray"
        for image in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray")))
        container.mux(stream.encode(None))
    scene = scene.with_values({"frames.sliding_speed_mm_per_s": speed})
    result = track(tmp_path / "film.mkv", scene, (LOAD, FRICTION, LEFT))
    assert result.distance_m == pytest.approx(0.05 * i, abs=1e-4)  # times are in milliseconds
    hold(result, {LOAD: load, FRICTION: np.full(COUNT, 0.2), LEFT: np.full(COUNT, -1.9)})
