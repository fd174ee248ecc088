"""What a user knows of a bench before a scene is written: sizes, material, load, and the rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from isochrome.frames import Channel

Shape = Literal["contact", "disc", "other"]


@dataclass(frozen=True, kw_only=True)
class KnownValues:
    """What is known besides the frames; None = not known.

    Parameters
    ----------
    shape : {'contact', 'disc', 'other'}, default 'contact'
        What stands in front of the camera: a cylinder on a block, a disc, or something without a
        model.
    young_gpa, poisson, thickness_mm, fringe_value_n_per_mm : float, optional
        The specimen's Young's modulus, GPa, Poisson's ratio, thickness, mm, and material fringe
        value, N/mm per fringe.
    radius_mm, indenter_young_gpa, indenter_poisson : float, optional
        The cylinder's radius, mm, Young's modulus, GPa, and Poisson's ratio.
    load_n : float, optional
        The load, within a factor of three, N.
    diameter_mm : float, optional
        A disc's diameter, mm.
    pixel_mm : float, optional
        Side of a pixel, mm, where the file does not name it.
    bit_depth : int, optional
        Bits of the sensor, where they are not those of the file's type.
    wavelength_nm : float, optional
        Wavelength of the light, nm.
    channel : {'red', 'green', 'blue', 'mean'}, optional
        The channel of colour frames that is read.
    field : {'dark', 'bright'}, optional
        The polariscope's field; searched for where it is not known.
    gamma : float, optional
        The camera's exponent; searched for where it is not known.
    rotate_deg : {0, 90, 180, 270}, optional
        Quarter turns after which the load comes from above; searched for where not known.
    frame : int, optional
        The frame to look at; by default the first that shows fringes.
    """

    shape: Shape = "contact"
    young_gpa: float | None = None
    poisson: float | None = None
    thickness_mm: float | None = None
    fringe_value_n_per_mm: float | None = None
    radius_mm: float | None = None
    indenter_young_gpa: float | None = None
    indenter_poisson: float | None = None
    load_n: float | None = None
    diameter_mm: float | None = None
    pixel_mm: float | None = None
    bit_depth: int | None = None
    wavelength_nm: float | None = None
    channel: Channel | None = None
    field: Literal["dark", "bright"] | None = None
    gamma: float | None = None
    rotate_deg: Literal[0, 90, 180, 270] | None = None
    frame: int | None = None
