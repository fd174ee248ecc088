"""Independent truth for the polariscope: its Jones matrices, multiplied out in numpy."""

from collections.abc import Callable

import numpy as np
import pytest


def retarder(retardance, axis):
    """A retarder as two phases along and across its axis: the textbook form, no half angles."""
    c, s = np.cos(axis), np.sin(axis)
    turn = np.array([[c, -s], [s, c]])
    return turn @ np.diag([np.exp(-0.5j * retardance), np.exp(0.5j * retardance)]) @ turn.T


@pytest.fixture(scope="session")
def jones_intensity() -> Callable[..., float]:
    """Light behind analyser · plate · specimen · plate · polariser. Angles in degrees, in the order
    of the light's way; None for a plate that is not there."""

    def intensity(angles, order, theta, plate):
        polariser, first, second, analyser = (
            None if angle is None else np.deg2rad(angle) for angle in angles
        )
        field = np.array([np.cos(polariser), np.sin(polariser)], complex)
        if first is not None:
            field = retarder(plate, first) @ field
        field = retarder(2 * np.pi * order, theta) @ field
        if second is not None:
            field = retarder(plate, second) @ field
        return abs(np.array([np.cos(analyser), np.sin(analyser)]) @ field) ** 2

    return intensity
