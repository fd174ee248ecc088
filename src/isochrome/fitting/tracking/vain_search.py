"""A full search that found nothing is not made again in frames that show the same."""

import numpy as np

from isochrome.fitting.arrays import Array
from isochrome.frames import Frame, estimate_noise

_SAME = 1.05
"""Difference of two pictures over what their noise makes of it, up to which they show the same."""
_STRIDE = 4


class VainSearch:
    """The last frame in which a full search found nothing, if any.

    Frames that show the same are not searched anew.

    Parameters
    ----------
    bit_depth : int or None
        Bit depth of the sensor, None where levels are fractions of full scale.
    """

    def __init__(self, bit_depth: int | None) -> None:
        self._bit_depth = bit_depth
        self._last: tuple[Array, float] | None = None

    def remember(self, frame: Frame) -> None:
        """Keep a frame that was searched in vain."""
        thin = _thin(frame)
        model = estimate_noise(frame.image, frame.mask, bit_depth=self._bit_depth)
        self._last = thin, float(np.sqrt(np.nanmean(np.square(model.sigma(thin)))))

    def forget(self) -> None:
        """A frame was found: another search may be worth its time."""
        self._last = None

    def is_repeated(self, frame: Frame) -> bool:
        """Whether a frame shows the same as the one that was searched in vain."""
        if self._last is None:
            return False
        picture, noise = self._last
        change = float(np.sqrt(np.nanmean(np.square(_thin(frame) - picture))))
        result: bool = change <= _SAME * np.sqrt(2.0) * noise
        return result


def _thin(frame: Frame) -> Array:
    """Some of a frame's pixels."""
    return frame.image[::_STRIDE, ::_STRIDE].astype(np.float32)
