"""What a sample goes through from fringe order to file: pixels of finite size, and a poor camera.

A pixel is the mean of several points in it, so that the samples do not share the first-order
expression for a pixel's area with the model that is fitted to them.

The sample of the main job: the paper's six states as a camera might have captured them.

The sample of a film: a sliding contact that wears while its load swings, a frame a second.

The samples of calibrations: a beam in four-point bending seen a little tilted, at four loads; a
disc under three diametral loads, not in the middle.

The sample of a wear test: traces across the scars of the true contact, and its friction.
"""

import tomllib
from dataclasses import dataclass
from importlib import resources
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import SurfaceState, contact_states
from isochrome.errors import InputError
from isochrome.optics import expose, fringe_order, make_chain, pixel_visibility, polariscope_signal
from isochrome.output import write_csv, write_json, write_text
from isochrome.reference import beam_stress
from isochrome.scene import Camera, DistanceTable, Polariscope, Scene, load_scene, parse_scene
from isochrome.simulation import SceneState, scene_states, state_difference
from isochrome.specimens import specimen_model
from isochrome.stress import StressDifference, pixel_grid

Array = NDArray[np.floating]
Grey = NDArray[np.uint8]

CAMERA = Camera(
    bit_depth=8, brightness=0.85, background=0.05, vignette=0.3, gamma=1.4, blur_px=0.4,
    noise_grey=3.0,
)  # fmt: skip
"""The camera of all samples. Background is stray light, a part of full scale before gamma."""

LABEL = "Rendered by Isochrome (python -m isochrome.samples), not captured"

_GLARE = 4.0
"""Light of a glare spot, in full lights: far above saturation."""


@dataclass(frozen=True)
class Sensor:
    """A camera's own faults, the same in all its frames.

    `dead`, `hot` (n, 2), (row, col) of pixels that read 0 or 255; `glare` (row, col, radius) of a
    lamp's reflection, in pixels, or None; `camera`, all that is not the pixels' own.
    """

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
            light = signal + _GLARE * (np.hypot(rows - row, cols - col) <= radius)
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


def sample_text(name: str) -> str:
    """A text among the samples, as a user would have written it beside their own frames."""
    return (resources.files("isochrome.samples") / "library" / name).read_text("utf-8")


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
    """The ideal dark-field signal of pixels, each the mean of its points.

    `order` N at the points is NaN where there is no specimen and so no light.
    """
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
LOAD, WEAR = 1.015, 1.03
"""True load and wear coefficient over their nominal values."""

FRICTION = (0.236, 0.241, 0.246, 0.250, 0.252)
"""True friction coefficient at the scene's distances."""

LEFT_PX = (4.30, 4.42, 4.51, 4.65, 4.71, 4.77)
TOP_PX = (-2.60, -2.65, -2.56, -2.51, -2.47, -2.42)
"""True place of each frame less the nominal one: off by some pixels, and drifting."""

FAULTY, GLARE, AVERAGED = 20, (372.0, 538.0, 4.0), 16
ORDER_STEP = 2.0**-13
"""The stored order is rounded to this, fringes, so that it compresses."""

_POINTS, _TOLERANCE = 3, 1e-6
"""Points along a pixel's side; the truth's contact is solved finer than any fit's."""


def render_contact(folder: Path, seed: int) -> None:
    """Write the stack, its no-load frames, its scene and its truth to a folder."""
    nominal = load_scene(SCENE)
    truth = true_contact(nominal)
    pixel = truth.get("camera.pixel_mm")
    states = scene_states(truth)
    shape = (truth.get("camera.height_px"), truth.get("camera.width_px"))
    sensor = make_sensor(shape, [seed, 0], faulty=FAULTY, glare=GLARE)
    frames, orders = [], []
    for i, state in enumerate(states):
        order = fine_order(placed_contact(truth, nominal, i), state, _POINTS)
        frames.append(sensor.picture(order, [seed, 1, i]))
        middle = order[_POINTS // 2 :: _POINTS, _POINTS // 2 :: _POINTS]
        orders.append((np.rint(middle / ORDER_STEP) * ORDER_STEP).astype(np.float32))
        if i == 0:
            material = np.isfinite(order)
    write_small_tiff(folder / "captured.tif", np.stack(frames), pixel_mm=pixel)
    write_small_tiff(folder / "true_fringe_order.tif", np.stack(orders), pixel_mm=pixel)
    _write_no_load(folder, material, sensor, (seed, 2), pixel)
    places = [placed_contact(truth, nominal, i) for i in range(len(states))]
    values = {  # a list has one value a frame
        **_values_of(truth, "load.normal_n", "wear.coefficient_mm2_per_n"),
        "frames": [s.label for s in states],
        "distance_m": [s.distance_m for s in states],
        "friction.coefficient": [s.surface.friction for s in states if s.surface],
        "camera.left_mm": [p.get("camera.left_mm") for p in places],
        "camera.top_mm": [p.get("camera.top_mm") for p in places],
        "camera": CAMERA.model_dump(exclude_unset=True),
        "fringe_order_step": ORDER_STEP,
    }
    write_truth(folder, seed, values, sensor)


def _write_no_load(
    folder: Path, material: NDArray[np.bool_], sensor: Sensor, seed: tuple[int, int], pixel: float
) -> None:
    """Write the unloaded specimen in the dark and in the bright field, each a mean of frames."""
    lit = block_mean(material.astype(float))
    for number, (name, signal) in enumerate((("dark", 0.0 * lit), ("bright", lit))):
        rng = np.random.default_rng([*seed, number])
        total = sum(sensor.expose(signal, rng).astype(float) for _ in range(AVERAGED))
        image = np.asarray(np.rint(np.asarray(total) / AVERAGED), dtype=np.uint8)
        write_small_tiff(folder / f"no-load-{name}.tif", image[None], pixel_mm=pixel)


def true_contact(nominal: Scene) -> Scene:
    """The contact as it truly was: other load, wear and friction than the nominal scene's."""
    assert nominal.wear is not None
    table = DistanceTable(distance_m=nominal.wear.distances_m, value=FRICTION)
    wear = WEAR * nominal.get("wear.coefficient_mm2_per_n")
    return nominal.with_values(
        {
            "load.normal_n": round(LOAD * nominal.get("load.normal_n"), 9),
            "friction.coefficient": table,
            "wear.coefficient_mm2_per_n": float(f"{wear:.9g}"),
            "numerics.tolerance": _TOLERANCE,
        }
    )


def placed_contact(scene: Scene, nominal: Scene, index: int) -> Scene:
    """A scene with its camera at the true place of frame `index`."""
    return scene.with_values(_moved(nominal, LEFT_PX[index], TOP_PX[index]))


def _moved(nominal: Scene, right_px: float, down_px: float) -> dict[str, float]:
    """The place of a picture that lies so many pixels from its nominal one."""
    moves = {"camera.left_mm": right_px, "camera.top_mm": down_px}
    pixel = nominal.get("camera.pixel_mm")
    return {key: round(nominal.get(key) + move * pixel, 9) for key, move in moves.items()}


def _values_of(truth: Scene, *keys: str) -> dict[str, Any]:
    return {key: truth.get(key) for key in keys}


def fine_order(scene: Scene, state: SceneState, points: int) -> Array:
    """Fringe order at points x points of every pixel; NaN above the surface."""
    pixels = pixel_grid(finer(scene, points))
    order = _order(scene, state_difference(scene, state, pixels))
    return np.where((pixels.z_mm >= 0.0)[:, None], order, np.nan)


def _order(scene: Scene, difference: StressDifference) -> Array:
    """Fringe order of a stress difference, MPa, in a scene's specimen."""
    names = ("thickness_mm", "fringe_value_n_per_mm")
    return fringe_order(difference, **{n: scene.get(f"specimen.{n}") for n in names})


FILM, FRAMES, FRAMES_PER_S = "film.avi", 200, 1.0
"""The film's file, its length, and how fast it was taken."""

LOAD_N, SWING, PERIOD = 44.7, 0.08, 45.0
"""Mean load, its swing as a share of that, and the frames of a swing."""

FILM_FRICTION = (0.21, 0.25)
"""Friction coefficient at the first and at the last frame; it runs in."""

WEAR_MM2_PER_N = 6.2e-9
FILM_LEFT_PX, FILM_TOP_PX = 1.7, -0.8
"""True place of all frames less the nominal one."""

FILM_CAMERA = CAMERA.model_copy(update={"noise_grey": 1.5})
"""The camera of all samples, at a lower gain."""

FILM_FAULTY, _FILM_TOLERANCE = 6, 1e-5
_NODES = 8
"""Nodes of the surface from one point of a pixel to the next."""


def render_film(folder: Path, seed: int) -> None:
    """Write the film, its no-load frames, its scene and its truth to a folder."""
    truth = true_film(parse_scene(sample_text("film-scene.toml"), name="film"))
    shape = truth.get("camera.height_px"), truth.get("camera.width_px")
    sensor = make_sensor(shape, [seed, 40], faulty=FILM_FAULTY, camera=FILM_CAMERA)
    frames = []
    for i, state in enumerate(scene_states(truth)):
        order = fine_order(truth, state, _POINTS)
        frames.append(sensor.picture(order, [seed, 41, i]))
    _write_film(folder / FILM, frames)
    _write_no_load(folder, np.isfinite(order), sensor, (seed, 42), truth.get("camera.pixel_mm"))
    write_text(folder / "scene.toml", sample_text("film-scene.toml"))
    load, friction = truth.get("load.normal_n"), truth.get("friction.coefficient")
    values = {  # a list has one value a frame
        "distance_m": list(load.distance_m),
        "load.normal_n": list(load.value),
        "friction.coefficient": list(friction.value),
        **_values_of(truth, "wear.coefficient_mm2_per_n", "camera.left_mm", "camera.top_mm"),
        "camera": FILM_CAMERA.model_dump(exclude_unset=True),
    }
    write_truth(folder, seed, values, sensor)


def true_film(nominal: Scene) -> Scene:
    """The contact as it truly was, a state a frame."""
    assert nominal.frames.sliding_speed_mm_per_s is not None
    seconds = np.arange(FRAMES) / FRAMES_PER_S
    distance = tuple((1e-3 * nominal.frames.sliding_speed_mm_per_s * seconds).round(9).tolist())
    load = LOAD_N * (1.0 + SWING * np.sin(2.0 * np.pi * seconds / PERIOD))
    first, last = FILM_FRICTION
    friction = last + (first - last) * np.exp(-5.0 * seconds / seconds[-1])
    return nominal.with_values(
        {
            "load.normal_n": {"distance_m": distance, "value": load.round(6)},
            "friction.coefficient": {"distance_m": distance, "value": friction.round(6)},
            "wear.coefficient_mm2_per_n": WEAR_MM2_PER_N,
            "wear.distances_m": distance,
            "numerics.tolerance": _FILM_TOLERANCE,
            "numerics.spacing_mm": nominal.get("camera.pixel_mm") / (_POINTS * _NODES),
            **_moved(nominal, FILM_LEFT_PX, FILM_TOP_PX),
        }
    )


def _write_film(path: Path, frames: list[Grey]) -> None:
    """Write frames as they are, uncompressed: OpenCV reads that by itself, and hides no damage."""
    import cv2

    rows, cols = frames[0].shape
    codec = cv2.VideoWriter.fourcc(*"Y800")
    film = cv2.VideoWriter(str(path), codec, FRAMES_PER_S, (cols, rows), isColor=False)
    if not film.isOpened():
        raise InputError("cannot_opened_film_opencv", path=path)
    for frame in frames:
        film.write(frame)
    film.release()


SHAPE = (440, 480)
FRINGE_VALUE = 14.6
TILT_DEG = 1.3
"""True tilt of the beam, counter-clockwise as the camera sees it."""

MIDDLE_PX = (222.6, 239.5)
"""True row of the neutral axis at the middle column."""

RESIDUAL_ORDER = 0.05
"""Order at the edge that is there without load, spread over the height as bending is."""

OFF_PX = (-5.2, 7.4)
"""True place of the disc's centre in the picture, (rows, cols) from the picture's middle."""

CALIBRATION_FAULTY = 8


def render_bending(folder: Path, seed: int) -> None:
    """Write the images, the calibration set and the truth to a folder."""
    text = sample_text("bending-set.toml")
    given = tomllib.loads(text)
    sensor = make_sensor(SHAPE, [seed, 10], faulty=CALIBRATION_FAULTY)
    for i, item in enumerate(given["image"]):
        order = true_order(item["load_n"], given["beam"], given["camera"]["pixel_mm"])
        write_png(folder / item["file"], sensor.picture(order, [seed, 11, i]))
    write_text(folder / "set.toml", text)
    truth = {
        "fringe_value_n_per_mm": FRINGE_VALUE,
        "order_at_zero_load": RESIDUAL_ORDER,
        "tilt_deg": TILT_DEG,
        "neutral_axis_row_px": MIDDLE_PX[0],
        "camera": CAMERA.model_dump(exclude_unset=True),
    }
    write_truth(folder, seed, truth, sensor)


def true_order(load_n: float, beam: dict[str, float], pixel_mm: float) -> Array:
    """Fringe order at the points of every pixel.

    NaN outside the beam, whose sizes are those of the set.
    """
    row, col = ((np.arange(n * _POINTS) + 0.5) / _POINTS - 0.5 for n in SHAPE)
    down = pixel_mm * (row - MIDDLE_PX[0])[:, None]
    right = pixel_mm * (col - MIDDLE_PX[1])[None, :]
    tilt = np.radians(TILT_DEG)
    eta = down * np.cos(tilt) + right * np.sin(tilt)
    stress = beam_stress(eta, load_n=load_n, **beam)
    residual = RESIDUAL_ORDER * eta / (0.5 * beam["height_mm"])
    return np.asarray(np.abs(stress * beam["thickness_mm"] / FRINGE_VALUE + residual))


def render_disc(folder: Path, seed: int) -> None:
    """Write the images, the calibration set, a scene and the truth to a folder."""
    scene = true_scene()
    rows, cols = scene.get("camera.height_px"), scene.get("camera.width_px")
    sensor = make_sensor((rows, cols), [seed, 20], faulty=CALIBRATION_FAULTY)
    fine = finer(scene, _POINTS)
    for i, item in enumerate(tomllib.loads(sample_text("disc-set.toml"))["image"]):
        loaded = fine.with_values({"load.normal_n": item["load_n"]})
        order = _order(loaded, specimen_model(loaded).difference(loaded, None, pixel_grid(loaded)))
        write_png(folder / item["file"], sensor.picture(order, [seed, 21, i]))
    for name in ("set.toml", "scene.toml"):
        write_text(folder / name, sample_text(f"disc-{name}"))
    truth = {
        "fringe_value_n_per_mm": scene.get("specimen.fringe_value_n_per_mm"),
        "order_at_zero_load": 0.0,
        **_values_of(scene, "camera.left_mm", "camera.top_mm"),
        "centre_row_px": 0.5 * (rows - 1) + OFF_PX[0],
        "centre_col_px": 0.5 * (cols - 1) + OFF_PX[1],
        "camera": CAMERA.model_dump(exclude_unset=True),
    }
    write_truth(folder, seed, truth, sensor)


def true_scene() -> Scene:
    """The disc's scene with the camera at its true place."""
    scene = parse_scene(sample_text("disc-scene.toml"), name="disc")
    grid, down, right = pixel_grid(scene), *OFF_PX
    return scene.with_values(
        {
            "camera.left_mm": round(grid.left_mm - right * grid.pixel_mm, 9),
            "camera.top_mm": round(grid.top_mm - down * grid.pixel_mm, 9),
        }
    )


RA_UM, CORRELATION_MM = 0.12, 0.012
"""Ra of the ground surface, and the length over which its heights forget each other by 1/e."""

POINTS, LENGTH_MM = 2000, 7.0
TRACE_TILT_DEG, ROUND_MM, OFF_MM = 0.5, (2e3, 9e3), 0.3
"""Largest tilt, radii of the block's form, and the scar's largest distance from the middle."""

_DUST, _HIGHEST_UM = 4, 8.0
"""Most points with dust on them, and how high it is."""


SPEED_MM_PER_S, RATE_HZ, SCATTER, KEEP = 257.7, 5.0, 0.006, 0.8
"""The cylinder's 100 revolutions a minute; rows a second of the friction's file, and the scatter of
its tester, of which this part is still there in the next row."""


def render_wear(folder: Path, seed: int) -> None:
    """Write the traces, the friction, the calibration set and the truth to a folder."""
    truth = true_contact(load_scene(SCENE))
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
    end_s = 1e3 * max(truth.wear.distances_m) / SPEED_MM_PER_S
    time = np.arange(int(end_s * RATE_HZ) + 2) / RATE_HZ
    scatter = SCATTER * _correlated(len(time), KEEP, np.random.default_rng([seed, 31]))
    coefficient = truth.friction_at(1e-3 * SPEED_MM_PER_S * time) + scatter
    write_csv(
        folder / "friction.csv",
        {"time_s": np.round(time, 1).tolist(), "coefficient": np.round(coefficient, 4).tolist()},
    )
    write_text(folder / "set.toml", text)
    values = {
        **_values_of(truth, "load.normal_n", "wear.coefficient_mm2_per_n"),
        "worn_area_mm2_by_distance_m": areas,
        "scar_middle_mm": places,
        "friction_distance_m": list(truth.get("friction.coefficient").distance_m),
        "friction.coefficient": list(truth.get("friction.coefficient").value),
        "sliding_speed_mm_per_s": SPEED_MM_PER_S,
        "ra_um": RA_UM,
        "correlation_mm": CORRELATION_MM,
    }
    write_truth(folder, seed, values)


def _trace(state: SurfaceState, rng: np.random.Generator) -> tuple[Array, Array, float]:
    """Places (n,), mm, heights (n,), µm, both rounded as a file has them, and the scar's middle."""
    x = np.round(np.linspace(0.0, LENGTH_MM, POINTS), 4)
    middle = round(float(0.5 * LENGTH_MM + rng.uniform(-OFF_MM, OFF_MM)), 4)
    z = -1e3 * np.interp(x - middle, state.grid.x_mm, state.wear_depth_mm, left=0.0, right=0.0)
    # ground: Gaussian heights of Ra 1, Ra = Rq sqrt(2/pi), correlated as exp(-distance/length)
    keep = float(np.exp(-(x[1] - x[0]) / CORRELATION_MM))
    z += RA_UM * (_correlated(len(x), keep, rng) * np.sqrt(np.pi / 2.0))
    u = x - 0.5 * LENGTH_MM
    z += 1e3 * np.tan(np.radians(rng.uniform(-TRACE_TILT_DEG, TRACE_TILT_DEG))) * u
    z += 1e3 * u**2 / (2.0 * rng.uniform(*ROUND_MM))
    dust = rng.integers(0, POINTS, rng.integers(0, _DUST + 1))
    z[dust] += rng.uniform(0.3, 1.0, len(dust)) * _HIGHEST_UM
    return x, np.round(z, 3), middle


def _correlated(count: int, keep: float, rng: np.random.Generator) -> Array:
    """Gaussian numbers (count,) of variance 1, of each of which a part is in the next."""
    fresh = rng.standard_normal(count) * np.sqrt(1.0 - keep**2)
    numbers = accumulate(fresh, lambda last, new: keep * last + new, initial=rng.standard_normal())
    return np.array(list(numbers)[1:])
