"""Render every sample image: `python tests/render_samples.py OUT`; one seed gives the same bytes.

A pixel is the mean of several points in it, so that the samples do not share the first-order
expression for a pixel's area with the model that is fitted to them.
"""

import argparse
import sys
import tomllib
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import SurfaceState, contact_states
from isochrome.errors import IsochromeError
from isochrome.optics import expose, fringe_order, make_chain, pixel_visibility, polariscope_signal
from isochrome.output import staged, write_csv, write_json, write_text
from isochrome.reference import beam_stress
from isochrome.scene import LIBRARY, Camera, Polariscope, Scene, load_scene, parse_scene
from isochrome.simulation import SceneState, scene_states, state_difference
from isochrome.specimens import specimen_model
from isochrome.stress import StressDifference, pixel_grid

SEED = 2026
"""Seed of the noise and of the faulty pixels of the shipped images."""

Array = NDArray[np.floating]
Grey = NDArray[np.uint8]


def sample_text(name: str) -> str:
    """A text among the samples, as a user would have written it beside their own frames."""
    return (Path(__file__).parent / "sample_texts" / name).read_text("utf-8")


TRUTH: dict[str, Any] = tomllib.loads(sample_text("truth.toml"))
"""What the samples are rendered of."""

CAMERA = Camera(**TRUTH["camera"])

RENDERING: dict[str, Any] = TRUTH["rendering"]
_POINTS: int = RENDERING["points"]

LABEL = "Rendered by Isochrome (tests/render_samples.py), not captured"


@dataclass(frozen=True)
class Sensor:
    """A camera's own faults, the same in all its frames. `dead`, `hot` (n, 2), (row, col) of pixels
    that read 0 or 255; `glare` (row, col, radius) of a lamp's reflection, in pixels, or None."""

    dead: NDArray[np.int64]
    hot: NDArray[np.int64]
    glare: tuple[float, float, float] | None = None
    camera: Camera = CAMERA

    def expose(self, signal: Array, rng: np.random.Generator) -> Grey:
        """Grey levels of one frame, with the glare, the noise and the faulty pixels."""
        light = signal
        if self.glare is not None:
            row, col, radius = self.glare
            rows, cols = np.ogrid[: signal.shape[0], : signal.shape[1]]
            light = signal + RENDERING["glare"] * (np.hypot(rows - row, cols - col) <= radius)
        image = np.asarray(expose(light, self.camera, rng=rng), dtype=np.uint8)
        image[tuple(self.dead.T)] = 0
        image[tuple(self.hot.T)] = 255
        return image

    def picture(self, order: Array, seed: list[int]) -> Grey:
        """Grey levels of a frame in the dark field, from its order at the points of its pixels."""
        return self.expose(dark_field(order), np.random.default_rng(seed))


def make_sensor(shape: tuple[int, int], seed: list[int], *, faulty: int, **more: Any) -> Sensor:
    """Draw a sensor with so many `faulty` pixels: one half dead, the other hot; see `Sensor`."""
    rng = np.random.default_rng(seed)
    places = np.stack([rng.integers(0, n, faulty) for n in shape], axis=1)
    return Sensor(places[: faulty // 2], places[faulty // 2 :], **more)


def write_truth(
    folder: Path, seed: int, values: dict[str, Any], sensor: Sensor | None = None
) -> None:
    """Write what a sample was rendered of, by the scene's keys, and its faults, as truth.json."""
    origin = "by Isochrome: every value below was put in, none was measured"
    record: dict[str, Any] = {"rendered": origin, "seed": seed, **values}
    if sensor is not None:
        faults: dict[str, Any] = {"dead_row_col": sensor.dead, "hot_row_col": sensor.hot}
        if sensor.glare is not None:
            faults["glare_row_col_radius_px"] = sensor.glare
        record["camera_faults"] = faults
    write_json(folder / "truth.json", record)


def finer(scene: Scene, factor: int) -> Scene:
    """A scene whose camera has factor x factor points in place of every pixel."""
    keys = ("camera.width_px", "camera.height_px")
    pixel = {"camera.pixel_mm": scene.get("camera.pixel_mm") / factor}
    return scene.with_values(pixel | {key: scene.get(key) * factor for key in keys})


def dark_field(order: Array) -> Array:
    """The ideal dark-field signal of pixels, each the mean of its points; NaN: no light."""
    known = np.isfinite(order)
    visibility, _ = pixel_visibility(order)
    chain = make_chain(Polariscope(field="dark"))
    signal = polariscope_signal(np.where(known, order, 0.0), chain, visibility=visibility)
    return block_mean(np.where(known, signal, 0.0))


def block_mean(points: Array) -> Array:
    """Means over the points of each pixel, (rows, cols)."""
    rows, cols = points.shape
    blocks = points.reshape(rows // _POINTS, _POINTS, cols // _POINTS, _POINTS)
    return np.asarray(blocks.mean(axis=(1, 3)))


def write_png(path: Path, image: Grey) -> None:
    """Write an 8-bit image as PNG, labelled as rendered."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    label = PngInfo()
    label.add_text("Comment", LABEL)
    Image.fromarray(image).save(path, pnginfo=label, compress_level=9)


def write_small_tiff(path: Path, frames: NDArray[Any], *, pixel_mm: float) -> None:
    """Write frames (frame, row, col) as a zlib-compressed TIFF with its scale, labelled."""
    import tifffile

    per_cm = 10.0 / pixel_mm
    with tifffile.TiffWriter(path, byteorder="<") as tif:
        for frame in frames:
            tif.write(
                frame, photometric="minisblack", compression="zlib", compressionargs={"level": 9},
                rowsperstrip=frame.shape[0], resolution=(per_cm, per_cm),
                resolutionunit="CENTIMETER", description=LABEL, software="isochrome", metadata=None,
            )  # fmt: skip


SCENE = "line-contact-wear"


def render_contact(folder: Path, seed: int) -> None:
    """Write the stack, its no-load frames, its scene and its truth to a folder."""
    given, truth = TRUTH["contact"], true_contact()
    pixel = truth.get("camera.pixel_mm")
    states = scene_states(truth)
    shape = (truth.get("camera.height_px"), truth.get("camera.width_px"))
    sensor = make_sensor(shape, [seed, 0], **given["sensor"])
    frames, orders = [], []
    for i, state in enumerate(states):
        placed = truth.with_values({key: places[i] for key, places in given["place"].items()})
        order = fine_order(placed, state, _POINTS)
        frames.append(sensor.picture(order, [seed, 1, i]))
        middle = order[_POINTS // 2 :: _POINTS, _POINTS // 2 :: _POINTS]
        step = RENDERING["order_step"]
        orders.append((np.rint(middle / step) * step).astype(np.float32))
        if i == 0:
            material = np.isfinite(order)
    write_small_tiff(folder / "captured.tif", np.stack(frames), pixel_mm=pixel)
    write_small_tiff(folder / "true_fringe_order.tif", np.stack(orders), pixel_mm=pixel)
    _write_no_load(folder, material, sensor, (seed, 2), pixel)
    values = {  # a list has one value a frame
        **_values_of(truth, "load.normal_n", "wear.coefficient_mm2_per_n"),
        "frames": [s.label for s in states],
        "distance_m": [s.distance_m for s in states],
        "friction.coefficient": [s.surface.friction for s in states if s.surface],
        **given["place"],
        "camera": TRUTH["camera"],
        "fringe_order_step": RENDERING["order_step"],
    }
    write_truth(folder, seed, values, sensor)


def _write_no_load(
    folder: Path, material: NDArray[np.bool_], sensor: Sensor, seed: tuple[int, int], pixel: float
) -> None:
    """Write the unloaded specimen in the dark and in the bright field, each a mean of frames."""
    lit = block_mean(material.astype(float))
    for number, (name, signal) in enumerate((("dark", 0.0 * lit), ("bright", lit))):
        rng = np.random.default_rng([*seed, number])
        count = RENDERING["averaged"]
        total = sum(sensor.expose(signal, rng).astype(float) for _ in range(count))
        image = np.asarray(np.rint(np.asarray(total) / count), dtype=np.uint8)
        write_small_tiff(folder / f"no-load-{name}.tif", image[None], pixel_mm=pixel)


def true_contact() -> Scene:
    """The contact as it truly was: other load, wear and friction than the nominal scene's."""
    return load_scene(SCENE).with_values(TRUTH["contact"]["scene"])


def _values_of(truth: Scene, *keys: str) -> dict[str, Any]:
    return {key: truth.get(key) for key in keys}


def fine_order(scene: Scene, state: SceneState, points: int) -> Array:
    """Fringe order at points x points of every pixel; NaN above the surface."""
    pixels = pixel_grid(finer(scene, points))
    order = _order(scene, state_difference(scene, state, pixels))
    return np.where((pixels.z_mm >= 0.0)[:, None], order, np.nan)


def _order(scene: Scene, difference: StressDifference) -> Array:
    names = ("thickness_mm", "fringe_value_n_per_mm")
    return fringe_order(difference, **{n: scene.get(f"specimen.{n}") for n in names})


FILM = "film.avi"
"""The film's file."""


def render_film(folder: Path, seed: int) -> None:
    """Write the film, its no-load frames, its scene and its truth to a folder."""
    import cv2

    truth = true_film(parse_scene(sample_text("film-scene.toml"), name="film"))
    shape = truth.get("camera.height_px"), truth.get("camera.width_px")
    given = TRUTH["film"]
    camera = CAMERA.model_copy(update={"noise_grey": given["noise_grey"]})
    sensor = make_sensor(shape, [seed, 40], faulty=given["faulty"], camera=camera)
    frames = []
    for i, state in enumerate(scene_states(truth)):
        order = fine_order(truth, state, _POINTS)
        frames.append(sensor.picture(order, [seed, 41, i]))
    # uncompressed: OpenCV reads that by itself, and hides no damage
    codec, size = cv2.VideoWriter.fourcc(*"Y800"), (shape[1], shape[0])
    film = cv2.VideoWriter(str(folder / FILM), codec, given["frames_per_s"], size, isColor=False)
    if not film.isOpened():
        raise OSError(f"{folder / FILM}: cannot be opened as a film by this OpenCV")
    for frame in frames:
        film.write(frame)
    film.release()
    _write_no_load(folder, np.isfinite(order), sensor, (seed, 42), truth.get("camera.pixel_mm"))
    write_text(folder / "scene.toml", sample_text("film-scene.toml"))
    load, friction = truth.get("load.normal_n"), truth.get("friction.coefficient")
    values = {  # a list has one value a frame
        "distance_m": list(load.distance_m),
        "load.normal_n": list(load.value),
        "friction.coefficient": list(friction.value),
        **_values_of(truth, "wear.coefficient_mm2_per_n", "camera.left_mm", "camera.top_mm"),
        "camera": camera.model_dump(exclude_unset=True),
    }
    write_truth(folder, seed, values, sensor)


def true_film(nominal: Scene) -> Scene:
    """The contact as it truly was, a state a frame."""
    assert nominal.frames.sliding_speed_mm_per_s is not None
    given = TRUTH["film"]
    seconds = np.arange(given["frames"]) / given["frames_per_s"]
    distance = tuple((1e-3 * nominal.frames.sliding_speed_mm_per_s * seconds).round(9).tolist())
    swing = given["swing"] * np.sin(2.0 * np.pi * seconds / given["period_frames"])
    load = given["load_n"] * (1.0 + swing)
    first, last = given["friction"]
    friction = last + (first - last) * np.exp(-5.0 * seconds / seconds[-1])
    values = {
        "load.normal_n": {"distance_m": distance, "value": load.round(6)},
        "friction.coefficient": {"distance_m": distance, "value": friction.round(6)},
        "wear.distances_m": distance,
        "numerics.spacing_mm": nominal.get("camera.pixel_mm") / (_POINTS * RENDERING["nodes"]),
    }
    return nominal.with_values(values | given["scene"])


def render_bending(folder: Path, seed: int) -> None:
    """Write the images, the calibration set and the truth to a folder."""
    text = sample_text("bending-set.toml")
    given = tomllib.loads(text)
    shape, faulty = RENDERING["bending_shape"], RENDERING["calibration_faulty"]
    sensor = make_sensor(shape, [seed, 10], faulty=faulty)
    for i, item in enumerate(given["image"]):
        order = true_order(item["load_n"], given["beam"], given["camera"]["pixel_mm"])
        write_png(folder / item["file"], sensor.picture(order, [seed, 11, i]))
    write_text(folder / "set.toml", text)
    write_truth(folder, seed, TRUTH["bending"] | {"camera": TRUTH["camera"]}, sensor)


def true_order(load_n: float, beam: dict[str, float], pixel_mm: float) -> Array:
    """Fringe order at the points of every pixel; NaN outside the beam, of the set's sizes."""
    shape = RENDERING["bending_shape"]
    row, col = ((np.arange(n * _POINTS) + 0.5) / _POINTS - 0.5 for n in shape)
    given = TRUTH["bending"]
    down = pixel_mm * (row - given["neutral_axis_row_px"])[:, None]
    right = pixel_mm * (col - 0.5 * (shape[1] - 1))[None, :]
    tilt = np.radians(given["tilt_deg"])
    eta = down * np.cos(tilt) + right * np.sin(tilt)
    stress = beam_stress(eta, load_n=load_n, **beam)
    residual = given["order_at_zero_load"] * eta / (0.5 * beam["height_mm"])
    order = stress * beam["thickness_mm"] / given["fringe_value_n_per_mm"] + residual
    return np.asarray(np.abs(order))


def render_disc(folder: Path, seed: int) -> None:
    """Write the images, the calibration set, a scene and the truth to a folder."""
    truth = TRUTH["disc"]
    place = {key: truth[key] for key in ("camera.left_mm", "camera.top_mm")}
    scene = parse_scene(sample_text("disc-scene.toml"), name="disc").with_values(place)
    rows, cols = scene.get("camera.height_px"), scene.get("camera.width_px")
    sensor = make_sensor((rows, cols), [seed, 20], faulty=RENDERING["calibration_faulty"])
    fine = finer(scene, _POINTS)
    for i, item in enumerate(tomllib.loads(sample_text("disc-set.toml"))["image"]):
        loaded = fine.with_values({"load.normal_n": item["load_n"]})
        order = _order(loaded, specimen_model(loaded).difference(loaded, None, pixel_grid(loaded)))
        write_png(folder / item["file"], sensor.picture(order, [seed, 21, i]))
    for name in ("set.toml", "scene.toml"):
        write_text(folder / name, sample_text(f"disc-{name}"))
    write_truth(folder, seed, truth | {"camera": TRUTH["camera"]}, sensor)


def render_wear(folder: Path, seed: int) -> None:
    """Write the traces, the friction, the calibration set and the truth to a folder."""
    given, truth = TRUTH["wear"], true_contact()
    states = {state.distance_m: state for state in contact_states(truth)}
    text = sample_text("wear-set.toml")
    places, areas = {}, {}
    for number, item in enumerate(tomllib.loads(text)["trace"]):
        state = states[item["distance_m"]]
        x, z, middle = _trace(state, np.random.default_rng([seed, 30, number]))
        write_csv(folder / item["file"], {"x_mm": x.tolist(), "z_um": z.tolist()})
        places[item["file"]] = middle
        worn = float(np.trapezoid(state.wear_depth_mm, state.grid.x_mm))
        areas[f"{item['distance_m']:g}"] = float(f"{worn:.6g}")
    # the friction that a tester recorded over the test's time: the true one, and scatter
    assert truth.wear is not None
    tester, speed = given["friction"], given["sliding_speed_mm_per_s"]
    end_s = 1e3 * max(truth.wear.distances_m) / speed
    time = np.arange(int(end_s * tester["rate_hz"]) + 2) / tester["rate_hz"]
    scatter = _correlated(len(time), tester["keep"], np.random.default_rng([seed, 31]))
    coefficient = truth.friction_at(1e-3 * speed * time) + tester["scatter"] * scatter
    rows = {"time_s": np.round(time, 1).tolist(), "coefficient": np.round(coefficient, 4).tolist()}
    write_csv(folder / "friction.csv", rows)
    write_text(folder / "set.toml", text)
    values = {
        **_values_of(truth, "load.normal_n", "wear.coefficient_mm2_per_n"),
        "worn_area_mm2_by_distance_m": areas,
        "scar_middle_mm": places,
        "friction_distance_m": list(truth.get("friction.coefficient").distance_m),
        "friction.coefficient": list(truth.get("friction.coefficient").value),
        **{key: given[key] for key in ("sliding_speed_mm_per_s", "ra_um", "correlation_mm")},
    }
    write_truth(folder, seed, values)


def _trace(state: SurfaceState, rng: np.random.Generator) -> tuple[Array, Array, float]:
    """Places (n,), mm, heights (n,), µm, both rounded as a file has them, and the scar's middle."""
    given = TRUTH["wear"]
    look = given["trace"]
    x = np.round(np.linspace(0.0, look["length_mm"], look["points"]), 4)
    half = 0.5 * look["length_mm"]
    middle = round(float(half + rng.uniform(-look["off_mm"], look["off_mm"])), 4)
    z = -1e3 * np.interp(x - middle, state.grid.x_mm, state.wear_depth_mm, left=0.0, right=0.0)
    # ground: Gaussian heights of Ra 1, Ra = Rq sqrt(2/pi), correlated as exp(-distance/length)
    keep = float(np.exp(-(x[1] - x[0]) / given["correlation_mm"]))
    z += given["ra_um"] * (_correlated(len(x), keep, rng) * np.sqrt(np.pi / 2.0))
    u = x - half
    z += 1e3 * np.tan(np.radians(rng.uniform(-look["tilt_deg"], look["tilt_deg"]))) * u
    z += 1e3 * u**2 / (2.0 * rng.uniform(*look["round_mm"]))
    dust = rng.integers(0, len(x), rng.integers(0, look["dust"] + 1))
    z[dust] += rng.uniform(0.3, 1.0, len(dust)) * look["highest_um"]
    return x, np.round(z, 3), middle


def _correlated(count: int, keep: float, rng: np.random.Generator) -> Array:
    """Gaussian numbers (count,) of variance 1, of each of which a part is in the next."""
    fresh = rng.standard_normal(count) * np.sqrt(1.0 - keep**2)
    numbers = accumulate(fresh, lambda last, new: keep * last + new, initial=rng.standard_normal())
    return np.array(list(numbers)[1:])


SETS = {
    SCENE: render_contact, "bending": render_bending, "disc": render_disc, "wear": render_wear,
    "sliding-film": render_film,
}  # fmt: skip


def render_samples(out: str | Path, seed: int) -> Path:
    """All sample images with their scenes, sets, truths and README; all or none."""
    with staged(out) as folder:
        for name, draw in SETS.items():
            (folder / name).mkdir()
            draw(folder / name, seed)
        scene = (LIBRARY / f"{SCENE}.toml").read_text("utf-8").rstrip()
        write_text(folder / SCENE / "scene.toml", f"{scene}\n{sample_text('contact-frames.toml')}")
        write_text(folder / "README.md", sample_text("README.md").replace("@SEED@", str(seed)))
    return Path(out)


def main() -> int:
    """Read the arguments, render, and return the exit code."""
    parser = argparse.ArgumentParser(description="Render the sample images.")
    parser.add_argument("out", help="folder for the files; made if missing")
    parser.add_argument("--seed", type=int, default=SEED, help=f"of the noise (default {SEED})")
    given = parser.parse_args()
    if given.seed < 0:
        print(f"--seed {given.seed}: give a whole number from 0 on", file=sys.stderr)
        return 2
    try:
        print(render_samples(given.out, given.seed))
    except IsochromeError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
