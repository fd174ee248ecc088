"""The set of a colour calibration: one small TOML that names colour images and what is known."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from isochrome.calibrate.settings import Beam
from isochrome.scene.parts import Camera, Frames, NonNegative, Part, Polariscope, Positive
from isochrome.scene.toml import parse_toml, read_text, validate


class ColourBeam(Beam):
    """A beam in four-point bending whose fringe value is known: its orders are known too."""

    fringe_value_n_per_mm: Positive


class ColourImage(Part):
    """One colour image of a loaded specimen; of a beam with the whole load on it."""

    file: Annotated[str, Field(min_length=1)]
    load_n: NonNegative | None = None


class ColourSet(Part):
    """A colour calibration's set. Without a beam the table comes from the images' own colours.

    `highest_order`: up to where colours are looked for, in fringes.
    """

    beam: ColourBeam | None = None
    camera: Camera = Camera()
    polariscope: Polariscope
    frames: Frames = Frames()
    highest_order: Annotated[float, Field(ge=1.0, le=8.0)] = 3.5
    image: Annotated[tuple[ColourImage, ...], Field(min_length=1)]
    folder: Path | None = Field(default=None, exclude=True, repr=False)
    name: str = Field(default="set", exclude=True, repr=False)

    @model_validator(mode="after")
    def _complete(self) -> ColourSet:
        if self.polariscope.wavelength_nm is None:
            raise ValueError(
                "polariscope.wavelength_nm is missing: the wavelength that the orders count at "
                "(without a beam the middle of the green channel's band, about 540); add it"
            )
        if self.polariscope.field == "plane" or self.polariscope.step:
            raise ValueError(
                "colours are read in the circular dark or bright field; set polariscope.field = "
                "'dark' or 'bright', and no steps"
            )
        if self.frames.channel is not None:
            raise ValueError("frames.channel leaves one channel, and colours need all; remove it")
        if self.beam is not None:
            if self.camera.pixel_mm is None:
                raise ValueError("camera.pixel_mm is missing, and a beam needs it; add it")
            if not all(image.load_n for image in self.image):
                raise ValueError("every [[image]] of a beam needs load_n above 0; add it")
        return self

    @property
    def gamma(self) -> float | None:
        """The exponent from linear light to grey levels, None where the set does not say."""
        for part in (self.frames, self.camera):
            if "gamma" in part.model_fields_set and not isinstance(part.gamma, str):
                return part.gamma
        return None

    def path(self, file: str) -> Path:
        """A path named in the set, relative to the set's own file."""
        return (self.folder or Path()) / file


def load_colour_set(source: str | Path | ColourSet) -> ColourSet:
    """Read the set of a colour calibration.

    Parameters: `source`, the TOML file's path, or a ColourSet (returned as it is).
    Returns the ColourSet. Raises InputError that names the file, key, value and fix.
    """
    if isinstance(source, ColourSet):
        return source
    path = Path(source)
    data = parse_toml(read_text(path), str(path))
    found = validate(ColourSet, data, str(path), reserved=("folder", "name"))
    return found.model_copy(update={"folder": path.parent, "name": str(path)})
