"""Films of a contact whose truth is known, as a camera with noise sees them."""

from fractions import Fraction

import numpy as np
import tifffile

from isochrome.optics import expose
from isochrome.processing import process
from isochrome.scene import load_scene
from isochrome.simulation import make_picture, picture_signal, scene_states, state_difference
from isochrome.stress import pixel_grid

LOAD, FRICTION = "load.normal_n", "friction.coefficient"
LEFT, TOP = "camera.left_mm", "camera.top_mm"
WIDTH_MM = 4.0
RATE = 50


def contact(shape=(160, 240), *, sliding=False, wearing=False):
    """The paper's contact in frames of `shape` (rows, cols): at rest, sliding, or wearing too."""
    scene = load_scene("line-contact-wear").with_values({"friction.static_state_first": False})
    parts = {} if sliding or wearing else {"friction": None}
    parts |= {} if wearing else {"wear": None}
    return scene.model_copy(update=parts).with_values(
        {
            LOAD: 44.0, "camera.width_px": shape[1], "camera.height_px": shape[0],
            "camera.pixel_mm": round(WIDTH_MM / shape[1], 5), LEFT: -1.9, TOP: 0.0,
            "camera.vignette": 0.3, "camera.brightness": 0.85, "camera.background": 0.05,
            "camera.noise_grey": 3.0,
        }
        | ({FRICTION: 0.2} if sliding or wearing else {})
    )  # fmt: skip


def light_of(scene, state=None):
    """The light of a state (rows, cols), of the scene's last one by default, without noise."""
    state = state or scene_states(scene)[-1]
    assert scene.camera is not None
    pixels = pixel_grid(scene, (scene.camera.height_px, scene.camera.width_px))
    made = make_picture(scene, state_difference(scene, state, pixels), pixels)
    return picture_signal(scene, made)


def signals(scene, values):
    """The light of a scene at each set of values of some keys, one after the other."""
    for own in zip(*values.values(), strict=True):
        yield light_of(scene.with_values(dict(zip(values, map(float, own), strict=True))))


def film(scene, values, seed):
    """Frames of a scene, one for each set of values of some keys."""
    rng = np.random.default_rng(seed)
    return np.stack([expose(light, scene.camera, rng=rng) for light in signals(scene, values)])


def write_video(path, frames, codec, pixels, options=None, *, rate=RATE, numbers=None):
    """Write grey frames by PyAV; a subsampled format takes an even number of columns of them.
    `numbers` of the frames in time, where some between them are missing."""
    import av

    with av.open(str(path), "w") as out:
        stream = None
        for k, image in enumerate(frames):
            image = image[:, : image.shape[1] // 2 * 2] if pixels.startswith("yuv") else image
            if stream is None:
                stream = out.add_stream(codec, rate=rate, options=options or {})
                stream.height, stream.width = image.shape
                stream.pix_fmt = pixels
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="gray")
            frame = frame.reformat(format=pixels)
            frame.pts = k if numbers is None else numbers[k]
            frame.time_base = Fraction(1, rate)
            out.mux(stream.encode(frame))
        assert stream is not None
        out.mux(stream.encode(None))


def leaves_the_same_bytes(place, frames, scene, **options):
    """Whether one worker and two leave the same, which is what is kept in memory."""
    tifffile.imwrite(place / "film.tif", frames)
    one = process(place / "film.tif", scene, place / "one", **options)
    process(place / "film.tif", scene, place / "two", workers=2, **options)
    for name in ("fringe_order.tif", "confidence.tif", "normalised.tif", "frames.csv"):
        assert (place / "one" / name).read_bytes() == (place / "two" / name).read_bytes()
    memory = process(place / "film.tif", scene, **options).dataset.fringe_order.values
    on_disk = tifffile.imread(place / "one" / "fringe_order.tif")
    return len(one.table["frame"]) == len(frames) and np.array_equal(
        memory, on_disk, equal_nan=True
    )
