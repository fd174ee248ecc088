r"""Where the camera's pixels look when it is not square to the specimen, and its lens no ideal one.

A point of the specimen, at (x, z) from the picture's middle, is seen at the place that follows from
it by three steps: the picture is turned by the roll φ, counter-clockwise; it grows to one side as a
plane does that is tilted towards the camera,

    (u, v) = (x, z) / (1 - k_x x / X - k_z z / Z),

and the lens stretches it away from its middle,

    (u', v') = (u, v) (1 + k r² / R²),    r² = u² + v²,

with X and Z half the picture's width and height, R half its diagonal. So k_x, k_z and k are the
displacement at the middle of the right edge, of the lower edge, and in the corners, over the
distance from the middle; k < 0 is a barrel. The model is rendered the other way, from each pixel to
the place that it looks at: no captured image is resampled, and its noise stays white.
Source: Brown (1971), Photogramm. Eng. 37, 855-866, for the radial term; Hartley & Zisserman (2004),
Multiple View Geometry, section 2.3, for the projective one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]

_PASSES = 6
"""Newton's steps for the radius: at |k| <= 0.1 four leave less than 1e-12 of it."""


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A camera's roll, keystone and distortion."""

    # the picture's middle from its left and upper edge
    right_mm: float
    down_mm: float
    # half the picture's size
    half_width_mm: float
    half_height_mm: float
    roll_deg: float = 0.0  # about the middle, counter-clockwise
    distortion: float = 0.0  # displacement in the corners over their distance from the middle
    # displacement at the middle of the right and of the lower edge over its distance
    keystone_x: float = 0.0
    keystone_z: float = 0.0

    def looked_at(self, u_mm: Floats, v_mm: Floats) -> tuple[Floats, Floats]:
        """Places on the specimen of places in the picture, both from the picture's middle.

        Parameters: `u_mm`, `v_mm`, to the right and down, of shapes that broadcast. Returns x and
        z (mm).
        """
        radius = math.hypot(self.half_width_mm, self.half_height_mm)
        distance = np.hypot(u_mm, v_mm) / radius
        ideal = distance.copy()
        for _ in range(_PASSES if self.distortion else 0):
            cubic = ideal * (1.0 + self.distortion * ideal**2) - distance
            ideal -= cubic / (1.0 + 3.0 * self.distortion * ideal**2)
        factor = 1.0 / (1.0 + self.distortion * ideal**2)
        tilt = self.keystone_x / self.half_width_mm, self.keystone_z / self.half_height_mm
        factor /= 1.0 + factor * (tilt[0] * u_mm + tilt[1] * v_mm)
        cos, sin = math.cos(math.radians(self.roll_deg)), math.sin(math.radians(self.roll_deg))
        return factor * (cos * u_mm - sin * v_mm), factor * (sin * u_mm + cos * v_mm)
