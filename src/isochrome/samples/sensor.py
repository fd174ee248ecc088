"""What a sample goes through from fringe order to file: pixels of finite size, and a poor camera.

A pixel is the mean of several points in it, so that the samples do not share the first-order
expression for a pixel's area with the model that is fitted to them.
"""

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.optics import expose, make_chain, pixel_visibility, polariscope_signal
from isochrome.output import write_json
from isochrome.scene import Camera, Polariscope, Scene

Array = NDArray[np.floating]
Grey = NDArray[np.uint8]

CAMERA = Camera(
    bit_depth=8,
    brightness=0.85,
    background=0.05,
    vignette=0.3,
    gamma=1.4,
    blur_px=0.4,
    noise_grey=3.0,
)
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

    def average(self, signal: Array, rng: np.random.Generator, *, count: int) -> Grey:
        """The mean of `count` frames, rounded to grey levels."""
        total = sum(self.expose(signal, rng).astype(float) for _ in range(count))
        return np.asarray(np.rint(np.asarray(total) / count), dtype=np.uint8)


def make_sensor(
    shape: tuple[int, int],
    rng: np.random.Generator,
    *,
    faulty: int,
    glare: tuple[float, float, float] | None = None,
) -> Sensor:
    """Draw a sensor with so many `faulty` pixels: one half dead, the other hot."""
    places = np.stack([rng.integers(0, n, faulty) for n in shape], axis=1)
    return Sensor(places[: faulty // 2], places[faulty // 2 :], glare)


def sample_text(name: str) -> str:
    """A text among the samples, as a user would have written it beside their own frames."""
    return (resources.files("isochrome.samples") / "library" / name).read_text("utf-8")


def write_truth(folder: Path, seed: int, values: dict[str, Any], sensor: Sensor) -> None:
    """Write what a sample was rendered of, by the scene's keys, and its faults, as truth.json."""
    faults: dict[str, Any] = {"dead_row_col": sensor.dead, "hot_row_col": sensor.hot}
    if sensor.glare is not None:
        faults["glare_row_col_radius_px"] = sensor.glare
    origin = "by Isochrome: every value below was put in, none was measured"
    record = {"rendered": origin, "seed": seed, **values, "camera_faults": faults}
    write_json(folder / "truth.json", record)


def finer(scene: Scene, factor: int) -> Scene:
    """A scene whose camera has factor x factor points in place of every pixel."""
    return scene.with_values(
        {
            "camera.pixel_mm": scene.get("camera.pixel_mm") / factor,
            "camera.width_px": scene.get("camera.width_px") * factor,
            "camera.height_px": scene.get("camera.height_px") * factor,
        }
    )


def dark_field(order: Array, factor: int) -> Array:
    """The ideal dark-field signal of pixels, each the mean of factor x factor points.

    `order` N at the points is NaN where there is no specimen and so no light.
    """
    known = np.isfinite(order)
    visibility, _ = pixel_visibility(order)
    chain = make_chain(Polariscope(field="dark"))
    signal = polariscope_signal(np.where(known, order, 0.0), chain, visibility=visibility)
    return block_mean(np.where(known, signal, 0.0), factor)


def block_mean(points: Array, factor: int) -> Array:
    """Means over blocks of factor x factor points: (factor rows, factor cols) to (rows, cols)."""
    rows, cols = points.shape
    blocks = points.reshape(rows // factor, factor, cols // factor, factor)
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
                frame,
                photometric="minisblack",
                compression="zlib",
                compressionargs={"level": 9},
                rowsperstrip=frame.shape[0],
                resolution=(per_cm, per_cm),
                resolutionunit="CENTIMETER",
                description=LABEL,
                software="isochrome",
                metadata=None,
            )
