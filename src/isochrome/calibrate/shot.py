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

    Parameters: `images`, linear intensities, each (rows, cols); `loads_n`, as many, N; `sigma`,
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
        noise = noise_of(frame, mask) if given is None else given
        shots.append(
            Shot(
                names[i] if names else f"image {i + 1}",
                float(loads_n[i]),
                frame,
                mask & np.isfinite(frame),
                np.broadcast_to(np.asarray(noise, dtype=float), frame.shape),
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


def noise_of(image: Array, mask: NDArray[np.bool_]) -> Array:
    """Noise of a linear image at its local level, (rows, cols); see `isochrome.frames`."""
    from scipy.ndimage import uniform_filter

    from isochrome.frames import estimate_noise

    filled = np.where(mask & np.isfinite(image), image, np.median(image[mask]))
    sigma = estimate_noise(filled, mask).sigma(uniform_filter(filled, 3))
    return np.maximum(np.asarray(sigma, dtype=float), 1e-4 * float(np.ptp(filled)) + 1e-12)
