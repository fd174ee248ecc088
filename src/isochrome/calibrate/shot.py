"""A captured frame with its load, ready for a fit: linear intensities, valid pixels and noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shot:
    """`image` (rows, cols) linear in light, `mask` True = valid, `sigma` the noise (rows, cols)."""

    file: str
    load_n: float
    image: Array
    mask: NDArray[np.bool_]
    sigma: Array


def as_shots(
    images: Sequence[ArrayLike],
    loads_n: Sequence[float],
    *,
    sigma: float | Sequence[ArrayLike] | None = None,
    masks: Sequence[NDArray[np.bool_]] | None = None,
    names: Sequence[str] | None = None,
) -> tuple[Shot, ...]:
    """Arrays to shots.

    Parameters: `images`, linear intensities, each (rows, cols), those at the top of an integer
    type's range taken as saturated; `loads_n`, as many, N; `sigma`,
    their noise: one number, or one number or map an image, estimated where None; `masks`,
    True = valid; `names` for messages.
    Returns the shots. Raises InputError for counts or shapes that do not agree.
    """
    if len(images) != len(loads_n) or not images:
        raise InputError(
            f"{len(images)} images and {len(loads_n)} loads; give as many of each, at least one"
        )
    shots = []
    for i, image in enumerate(images):
        frame = np.asarray(image, dtype=float)
        if frame.ndim != 2 or min(frame.shape) < 16:
            raise InputError(
                f"image {i + 1} has the shape {frame.shape}; give rows x cols, at least 16 each"
            )
        mask = np.isfinite(frame) if masks is None else np.asarray(masks[i], dtype=bool)
        given = sigma if sigma is None or isinstance(sigma, (int, float)) else sigma[i]
        noise = np.asarray(noise_of(frame, mask) if given is None else given, dtype=float)
        kind = np.asarray(image).dtype
        if kind.kind in "ui":
            mask = mask & below_saturation(frame, noise, float(np.iinfo(kind).max))
        shots.append(
            Shot(
                names[i] if names else f"image {i + 1}",
                float(loads_n[i]),
                frame,
                mask & np.isfinite(frame),
                np.broadcast_to(noise, frame.shape),
            )
        )
    return tuple(shots)


def loaded_shots(shots: Sequence[Shot]) -> tuple[list[Shot], tuple[str, ...]]:
    """The shots with a load, and a sentence on those without, which the line does not use.

    Raises InputError where none has a load.
    """
    loaded = [s for s in shots if s.load_n > 0]
    if not loaded:
        raise InputError("no image has a load above zero; a calibration needs a loaded one")
    rest = ", ".join(s.file for s in shots if s.load_n == 0)
    said = f"{rest}: no load, not used; the order at zero load is from the loaded images' line"
    return loaded, (said,) if rest else ()


def below_saturation(image: Array, sigma: ArrayLike, full: float) -> NDArray[np.bool_]:
    """Pixels (rows, cols) whose neighbourhood's mean lies three sigmas below full scale.

    Leaving out the saturated pixels alone would keep the darker half of those beside them, whose
    mean is then too low. Parameters: `image`, raw grey levels, its noise `sigma`, `full` scale.
    """
    from scipy.ndimage import uniform_filter

    if float(np.max(image)) < full:
        return np.ones(image.shape, dtype=bool)
    return np.asarray((image < full) & (uniform_filter(image, 3) + 3.0 * np.asarray(sigma) < full))


def noise_of(image: Array, mask: NDArray[np.bool_]) -> Array:
    """Noise of a linear image at its local level, (rows, cols); see `isochrome.frames`."""
    from scipy.ndimage import uniform_filter

    from isochrome.frames import estimate_noise

    filled = np.where(mask & np.isfinite(image), image, np.median(image[mask]))
    sigma = estimate_noise(filled, mask).sigma(uniform_filter(filled, 3))
    return np.maximum(np.asarray(sigma, dtype=float), 1e-4 * float(np.ptp(filled)) + 1e-12)
