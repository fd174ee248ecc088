"""Rendered frames of surfaces that are pressed and rubbed in patches: truth in closed form."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fitting.engine_frames import prepared
from isochrome.estimation import FrameData
from isochrome.optics import expose
from isochrome.reference import hertz_pressure, sliding_hertz_stress
from isochrome.scene import Camera, Scene, parse_scene
from scene_texts import PAPER_CONTACT, camera_text

THICKNESS, FRINGE_VALUE = 4.0, 14.6
ORDER_PER_MPA = THICKNESS / FRINGE_VALUE
HALF_WIDTH, PEAK = 0.37332, 18.7584
"""Hertz's contact of the scene under its 44 N."""

_POINTS = 3
"""Points of a pixel along each side that its light is the mean of."""


@dataclass(frozen=True)
class Patch:
    """A sliding Hertz patch: its centre and half-width (mm), largest pressure (MPa), friction."""

    centre: float
    half_width: float
    peak: float
    friction: float

    @property
    def load(self) -> float:
        return 0.5 * np.pi * self.half_width * self.peak * THICKNESS


CONTACT = Patch(0.0, HALF_WIDTH, PEAK, 0.25)
LOBE = Patch(0.75, 0.12, 4.0, 0.25)


@dataclass(frozen=True)
class Pressed:
    """Patches, a stress besides, and the camera that sees them."""

    patches: tuple[Patch, ...]
    besides: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
    cols: int = 659
    rows: int = 494
    pixel: float = 0.00607
    top: float = 0.0
    noise: float = 3.0
    seed: int = 0

    @property
    def load(self) -> float:
        return sum(p.load for p in self.patches)

    @property
    def tangential(self) -> float:
        return sum(p.friction * p.load for p in self.patches)

    def pressure(self, x: np.ndarray) -> np.ndarray:
        return sum(
            hertz_pressure(x - p.centre, half_width_mm=p.half_width, peak_pressure_mpa=p.peak)
            for p in self.patches
        )

    def difference(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        total = np.zeros(np.broadcast_shapes(x.shape, z.shape), complex)
        for p in self.patches:
            s = sliding_hertz_stress(
                x - p.centre, np.maximum(z, 0.0), half_width_mm=p.half_width,
                peak_pressure_mpa=p.peak, friction=p.friction,
            )  # fmt: skip
            total += (s.sigma_x - s.sigma_z) + 2j * s.tau_xz
        return total if self.besides is None else total + self.besides(x, z)

    def places(self, dx: float = 0.0, dz: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        left = -0.5 * self.cols * self.pixel
        x = left + self.pixel * (np.arange(self.cols) + 0.5 + dx)
        return x[None, :], (self.top + self.pixel * (np.arange(self.rows) + 0.5 + dz))[:, None]

    @property
    def order(self) -> np.ndarray:
        """True order (rows, cols), NaN above the surface."""
        x, z = self.places()
        return np.where(z > 0.0, ORDER_PER_MPA * np.abs(self.difference(x, z)), np.nan)

    def frame(self) -> np.ndarray:
        """Grey levels: 8 bits, 30 % vignette."""
        offsets = (np.arange(_POINTS) + 0.5) / _POINTS - 0.5
        signal = 0.0
        for dz in offsets:
            for dx in offsets:
                x, z = self.places(dx, dz)
                order = ORDER_PER_MPA * np.abs(self.difference(x, z))
                signal = signal + np.where(z > 0.0, np.sin(np.pi * order) ** 2, 0.0) / _POINTS**2
        camera = Camera(
            bit_depth=8, noise_grey=self.noise, vignette=0.3, brightness=0.85, background=0.05,
            seed=self.seed,
        )  # fmt: skip
        return expose(signal, camera)

    def text(self, load: float = 44.0) -> str:
        """A scene of the contact alone, which is what a user has."""
        contact = PAPER_CONTACT.replace("44.0", f"{load}")
        left, top = f"{-0.5 * self.cols * self.pixel:.9g}", f"{self.top:.9g}"
        camera = camera_text(
            self.cols, self.rows, self.pixel, left_mm=left, top_mm=top, bit_depth=8
        )
        return contact + "\n[friction]\ncoefficient = 0.25\n" + camera

    def scene(self, load: float = 44.0) -> Scene:
        return parse_scene(self.text(load))

    def data(self) -> FrameData:
        return prepared(self.frame(), self.scene())
