"""What a user knows of a bench before a scene is written: sizes, material, load, and the rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from isochrome.errors import InputError
from isochrome.frames import Channel

Shape = Literal["contact", "disc", "other"]


@dataclass(frozen=True, kw_only=True)
class KnownValues:
    """What is known besides the frames, as captured; None = not known.

    A contact's field, gamma and quarter turns are searched for where they are not known.
    """

    shape: Shape = "contact"  # a cylinder on a half-plane, a disc, or something without a model
    young_gpa: float | None = None
    poisson: float | None = None
    thickness_mm: float | None = None
    fringe_value_n_per_mm: float | None = None
    radius_mm: float | None = None  # the cylinder's, as the next two
    indenter_young_gpa: float | None = None
    indenter_poisson: float | None = None
    load_n: float | None = None  # normal; of a contact within a factor of three
    diameter_mm: float | None = None  # a disc's
    pixel_mm: float | None = None  # where the file does not name it
    bit_depth: int | None = None  # where it is not that of the file's type
    wavelength_nm: float | None = None
    channel: Channel | None = None  # of colour frames
    field: Literal["dark", "bright"] | None = None
    gamma: float | None = None  # the camera's exponent
    # quarter turns after which the load comes from above
    rotate_deg: Literal[0, 90, 180, 270] | None = None
    # of the turned picture, where a mirror stood in the light's way
    flip: Literal["horizontal", "vertical"] | None = None
    frame: int | None = None  # from 0; by default the first that shows the fringes

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of what must be known besides for this shape, in the order of `QUANTITIES`."""
        return tuple(name for name in NEEDED[self.shape] if getattr(self, name) is None)

    @property
    def has_own_scale(self) -> bool:
        """Whether the frames tell the scale, or are read without one."""
        return self.shape in WITH_OWN_SCALE


@dataclass(frozen=True)
class Quantity:
    """A quantity that a user knows, or can look up or measure."""

    key: str
    words: str  # what it is
    unit: str  # empty for a plain number
    usual: str  # what it usually is

    @property
    def question(self) -> str:
        """What to ask for: words, unit and the usual range."""
        return f"{self.words}{self.unit and f' ({self.unit})'}, usually {self.usual}"


QUANTITIES = {
    "young_gpa": Quantity(
        "specimen.young_gpa", "Young's modulus of the specimen", "GPa", "2 to 4 for epoxy, 2.2 to "
        "2.5 for polycarbonate, 60 to 75 for glass",
    ),
    "poisson": Quantity("specimen.poisson", "Poisson's ratio of the specimen", "", "0.33 to 0.42"),
    "thickness_mm": Quantity(
        "specimen.thickness_mm", "thickness of the specimen along the light", "mm", "2 to 10"
    ),
    "fringe_value_n_per_mm": Quantity(
        "specimen.fringe_value_n_per_mm", "material fringe value f_sigma", "N/mm per fringe",
        "9 to 15 for epoxy, 6 to 8 for polycarbonate; isochrome calibrate measures it",
    ),
    "radius_mm": Quantity("indenter.radius_mm", "radius of the cylinder", "mm", "5 to 50"),
    "indenter_young_gpa": Quantity(
        "indenter.young_gpa", "Young's modulus of the cylinder", "GPa", "200 to 215 for steel"
    ),
    "indenter_poisson": Quantity(
        "indenter.poisson", "Poisson's ratio of the cylinder", "", "0.27 to 0.30 for steel"
    ),
    "load_n": Quantity(
        "load.normal_n", "normal load, within a factor of three", "N", "10 to 500"
    ),
    "diameter_mm": Quantity("specimen.diameter_mm", "diameter of the disc", "mm", "10 to 60"),
    "pixel_mm": Quantity(
        "camera.pixel_mm", "side of a pixel on the specimen", "mm", "0.002 to 0.05; isochrome "
        "calibrate scale measures it",
    ),
    "wavelength_nm": Quantity(
        "polariscope.wavelength_nm", "wavelength of the light", "nm", "589 for sodium, 546 for "
        "mercury's green",
    ),
}  # fmt: skip
"""What is asked for, by the name of its field in KnownValues."""

NEEDED = {
    "contact": (
        "young_gpa", "poisson", "thickness_mm", "fringe_value_n_per_mm", "radius_mm",
        "indenter_young_gpa", "indenter_poisson", "load_n",
    ),
    "disc": ("diameter_mm", "thickness_mm", "fringe_value_n_per_mm", "load_n"),
    "other": (),
}  # fmt: skip
"""What cannot be found in the frames, and nothing is found without it."""

WITH_OWN_SCALE = ("disc", "other")
"""Shapes whose frames need no pixel size beforehand."""


def known_values(known: KnownValues | Mapping[str, Any]) -> KnownValues:
    """KnownValues of a mapping; InputError for a name or shape that is none, or a frame below 0."""
    if not isinstance(known, KnownValues):
        names = [field.name for field in fields(KnownValues)]
        for name in known:
            if name not in names:
                raise InputError(f"{name}: is not known here; known are {', '.join(names)}")
        known = KnownValues(**known)
    for name, allowed in (
        ("shape", get_args(Shape)),
        ("field", (None, "dark", "bright")),
        ("channel", (None, *get_args(Channel))),
        ("rotate_deg", (None, 0, 90, 180, 270)),
        ("flip", (None, "horizontal", "vertical")),
    ):
        value = getattr(known, name)
        if value not in allowed:
            choice = ", ".join(str(a) for a in allowed if a is not None)
            raise InputError(f"{name} = {value}: is none of {choice}; name one of them")
    if known.frame is not None and known.frame < 0:
        raise InputError(f"frame = {known.frame}: frames count from 0; give 0 or more")
    return known


def refuse_missing(given: KnownValues) -> None:
    """Refuse to begin without what cannot be found in the frames. Raises InputError."""
    if given.missing:
        quantity = QUANTITIES[given.missing[0]]
        options = " and ".join(f"--{name.replace('_', '-')}" for name in given.missing)
        raise InputError(
            f"{quantity.key} is not known, and no frame tells it; give {options} "
            f"({quantity.question})"
        )
