"""The set of a colour calibration: one small TOML that names colour images and what is known."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from isochrome.calibration.settings import Beam, ImageSet
from isochrome.scene import Camera, Frames, ImageFile, NonNegative, Polariscope, Positive, ScenePart


class ColourBeam(Beam):
    """A beam in four-point bending whose fringe value is known: its orders are known too.

    Parameters
    ----------
    fringe_value_n_per_mm : float
        Material fringe value at the polariscope's wavelength, N/mm per fringe.
    """

    fringe_value_n_per_mm: Positive


class ColourImage(ScenePart):
    """One colour image of a loaded specimen; of a beam with the whole load on it.

    Parameters
    ----------
    file : str or array
        The image's file, relative to the set's; in Python an array too.
    load_n : float, optional
        The whole load on a beam, N; other specimens need none.
    """

    file: ImageFile
    load_n: NonNegative | None = None


class ColourSet(ImageSet):
    """A colour calibration's set. Without a beam the table comes from the images' own colours.

    Parameters
    ----------
    folder : Path, optional
        Folder of the set's file.
    name : str, optional
        The set's name in messages.
    beam : ColourBeam, optional
        The beam, its sizes and fringe value.
    camera : Camera, optional
        The camera.
    polariscope : Polariscope
        The polariscope, with the wavelength that the orders count at.
    frames : Frames, optional
        How the images are read, and the no-load frames.
    highest_order : float, optional
        Up to where colours are looked for, fringes.
    image : tuple of ColourImage
        The images.
    """

    beam: ColourBeam | None = None
    camera: Camera = Camera()
    polariscope: Polariscope
    frames: Frames = Frames()
    highest_order: Annotated[float, Field(ge=1.0, le=8.0)] = 3.5
    image: Annotated[tuple[ColourImage, ...], Field(min_length=1)]

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


ColourSetLike = str | Path | ColourSet | Mapping[str, Any]
"""A colour calibration's set as a caller may give it: a file, a ColourSet, or its tables."""


def load_colour_set(source: ColourSetLike) -> ColourSet:
    """Read the set of a colour calibration.

    Parameters: `source`, the TOML file's path, its tables, or a ColourSet (returned as it is).
    Returns the ColourSet. Raises InputError that names the file, key, value and fix.
    """
    return source if isinstance(source, ColourSet) else ColourSet.read(source)
