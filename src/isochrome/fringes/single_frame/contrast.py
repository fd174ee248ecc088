r"""What a frame's fringes lose of their contrast, by blur and by the width of the light's band.

A lens or a pixel that blurs by s (standard deviation, pixels) leaves exp(-2 pi² s² |∇N|²) of a
fringe, and a band of wavelengths of relative width b leaves exp(-2 pi² b² N²) of one of order N:
the Fourier transforms of Gaussians (Born & Wolf (1999), Principles of Optics, section 7.5.8). Read
as if nothing were lost, a crest that the light does not reach looks like one that the order turns
back at. Patches that span crest and flank alike say what contrast they have besides their order;
s² and b² are what they say together, and the light is divided by it.
"""

from dataclasses import dataclass, replace

import numpy as np

from isochrome.fringes.single_frame.patches import TURN, Patches
from isochrome.fringes.windows import Array, Mask

FADED = 0.05
"""Contrast that is lost from which it moves the order by more than its uncertainty."""
_SOME = 0.05
"""Share of the patches that have lost as much."""
_FILLED, _FAINTEST, _FEWEST = 0.6, 0.1, 30
_FINEST = 0.2
"""Fringes a bin beyond which a bin says nothing of the light's contrast."""
_ROUNDS = 6
_OUTLIER = 2.0
"""Robust deviations from which a patch counts for less."""


@dataclass(frozen=True)
class Contrast:
    """The law a = exp(-2 pi² (blur |∇N|² + band N²)).

    `blur`, variance of the blur, pixels²; `band`, variance of the wavenumber over its mean squared.
    """

    blur: float = 0.0
    band: float = 0.0

    def left(self, order: Array, slope: Array) -> Array:
        """Contrast at `order`, fringes, whose gradient's size is `slope`, fringes a pixel."""
        lost = self.blur * slope**2 + self.band * order**2
        return np.asarray(np.exp(-0.5 * TURN**2 * lost))


def with_told(patches: Patches, by: int, told: Array | None) -> Patches:
    """Patches with the contrast that wider ones tell where they tell none.

    Parameters: `patches` of bins of `by` pixels, whose own blur is taken out; `told` by wider ones
    (m, n), NaN where nothing is, None for none. Returns Patches.
    """
    own = patches.contrast
    if by > 1:
        slope = np.hypot(patches.terms[..., 1], patches.terms[..., 2])
        lost = Contrast(blur=(1.0 - by**-2.0) / 12.0).left(np.zeros_like(slope), slope)
        own = np.where(slope < _FINEST, own / lost, np.nan)
    return replace(patches, contrast=own if told is None else np.where(own > 0.0, own, told))


def everywhere(told: Array) -> Array:
    """The contrast (m, n) of the nearest patch that tells one; 1 where none does."""
    known = np.isfinite(told)
    return told[_nearest(known)] if known.any() else np.ones_like(told)


def _nearest(known: Mask) -> tuple[Array, ...]:
    from scipy.ndimage import distance_transform_edt

    return tuple(distance_transform_edt(~known, return_distances=False, return_indices=True))


def is_faded(patches: Patches) -> bool:
    """Whether a frame's fringes have lost so much that it must be reckoned with."""
    own = patches.contrast[(patches.filled > _FILLED) & np.isfinite(patches.contrast)]
    return bool(len(own) >= _FEWEST and np.mean(own < 1.0 - FADED) > _SOME)


def fit_contrast(patches: Patches, terms: Array) -> Contrast:
    """Find what fringes lose from patches whose order is known.

    Parameters: `patches`; `terms` (m, n, 6) of their signed order, NaN = not known. Returns the
    Contrast, of no loss where too few patches tell.
    """
    use = np.isfinite(terms[..., 0]) & (patches.contrast > _FAINTEST)
    if np.count_nonzero(use) < _FEWEST:
        return Contrast()
    own = terms[use]
    lost = -2.0 * np.log(patches.contrast[use]) / TURN**2
    return _law(np.stack([own[:, 1] ** 2 + own[:, 2] ** 2, own[:, 0] ** 2], axis=-1), lost)


def _law(causes: Array, lost: Array) -> Contrast:
    """Least squares of both variances, neither negative, patches off the law counting for less."""
    from scipy.optimize import nnls

    weight = np.ones(len(lost))
    for _ in range(_ROUNDS):
        result, _ = nnls(causes * weight[:, None], lost * weight)
        away = np.abs(lost - causes @ result)
        scale = max(1.4826 * float(np.median(away)), 1e-6)
        weight = np.sqrt(np.minimum(1.0, _OUTLIER * scale / np.maximum(away, 1e-9)))
    return Contrast(*(float(v) for v in result))


def contrast_map(patches: Patches, terms: Array, law: Contrast, shape: tuple[int, ...]) -> Array:
    """The contrast at each pixel (rows, cols); where no order is known, that of the nearest patch.

    Parameters: `patches`; `terms` (m, n, 6), NaN = not known; `law`; `shape` of the frame.
    """
    near = terms[_nearest(np.isfinite(terms[..., 0]))]
    left = law.left(near[..., 0], np.hypot(near[..., 1], near[..., 2]))
    down, across = (_hats(at, n) for at, n in zip((patches.rows, patches.cols), shape, strict=True))
    return np.asarray(down @ left @ across.T)


def _hats(at: Array, length: int) -> Array:
    """Weights of linear interpolation between places: (length, places)."""
    return np.stack([np.interp(np.arange(length), at, unit) for unit in np.eye(len(at))], axis=-1)
