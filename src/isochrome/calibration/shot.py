"""Prepared frames with the load of each."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import uniform_filter

from isochrome.errors import InputError
from isochrome.estimation import Observation
from isochrome.frames import estimate_noise, saturation_level

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Shot(Observation):
    """A prepared frame and the load that it was taken under."""

    load_n: float
    bright: bool = False  # the polariscope's field is
    no_load_light: Array | None = None  # bright less dark frame of no load, where there are both

    def lamp(self, *pick: Any) -> Array | None:
        """The no-load light at the pixels of an index."""
        return None if self.no_load_light is None else self.no_load_light[pick]


def as_shots(
    images: Sequence[ArrayLike],
    loads_n: Sequence[float],
    *,
    sigma: float | Sequence[ArrayLike] | None = None,
    bright: bool = False,
    no_load_light: ArrayLike | None = None,
) -> tuple[Shot, ...]:
    """Shots of arrays of linear intensity, of integer types saturated on a plateau at the top.

    `sigma`: one number, or a number or map an image; by default the noise is estimated.
    `no_load_light`: bright less dark frame. InputError for counts or shapes that do not agree.
    """
    if len(images) != len(loads_n) or not images:
        raise InputError(
            "images_loads_give_many", images_count=len(images), loads_n_count=len(loads_n)
        )
    lamp = None if no_load_light is None else np.asarray(no_load_light, dtype=float)
    shots = []
    for i, image in enumerate(images):
        frame = np.asarray(image, dtype=float)
        if frame.ndim != 2 or min(frame.shape) < 16:
            raise InputError("image_has_shape_give", i=i + 1, shape=frame.shape)
        mask = np.isfinite(frame)
        given = sigma if sigma is None or isinstance(sigma, (int, float)) else sigma[i]
        noise = np.asarray(noise_of(frame, mask) if given is None else given, dtype=float)
        kind = np.asarray(image).dtype
        if kind.kind in "ui":
            level = saturation_level(np.asarray(image), full=float(np.iinfo(kind).max))
            mask = mask & below_saturation(frame, noise, level)
        noise = np.broadcast_to(noise, frame.shape)
        shots.append(
            Shot(
                name=f"image {i + 1}", light=frame, sigma=noise, valid=mask, raw=frame,
                raw_sigma=noise, gamma=1.0, load_n=float(loads_n[i]), bright=bright,
                no_load_light=lamp,
            )
        )  # fmt: skip
    return tuple(shots)


def by_load(shots: Sequence[Shot]) -> tuple[list[Shot], list[Shot]]:
    """The shots with a load and those without. Raises InputError where none has a load."""
    loaded = [s for s in shots if s.load_n > 0]
    if not loaded:
        raise InputError("no_image_has_load")
    return loaded, [s for s in shots if s.load_n == 0]


def unused(idle: Sequence[Shot], why: str) -> tuple[str, ...]:
    """A sentence on the shots without a load, where there are some."""
    return (f"{', '.join(s.name for s in idle)}: no load, not used{why}",) if idle else ()


def below_saturation(image: Array, sigma: ArrayLike, level: float) -> NDArray[np.bool_]:
    """Pixels (rows, cols) whose neighbourhood's mean lies three sigmas below saturation's `level`.

    Leaving out the saturated pixels alone would keep the darker half of those beside them, whose
    mean is then too low.
    """
    if float(np.max(image)) < level:
        return np.ones(image.shape, dtype=bool)
    return np.asarray(
        (image < level) & (uniform_filter(image, 3) + 3.0 * np.asarray(sigma) < level)
    )


def noise_of(image: Array, mask: NDArray[np.bool_]) -> Array:
    """Noise of a linear image at its local level, (rows, cols); see `isochrome.frames`."""
    filled = np.where(mask, image, np.median(image[mask]))
    sigma = estimate_noise(filled, mask).sigma(uniform_filter(filled, 3))
    least = 1e-4 * float(np.ptp(filled)) + 1e-12
    return np.asarray(np.maximum(np.asarray(sigma, dtype=float), least))
