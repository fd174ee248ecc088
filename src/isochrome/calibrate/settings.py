"""The calibration set: one small TOML that says what was loaded, how, and in which images."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from isochrome.errors import InputError
from isochrome.scene.mistakes import check_reach
from isochrome.scene.parts import Camera, Frames, NonNegative, Part, Polariscope, Positive
from isochrome.scene.toml import parse_toml, read_text, validate


class Beam(Part):
    """A beam in four-point bending: the moment between the inner rollers is P (Lo - Li)/4."""

    thickness_mm: Positive | None = None
    height_mm: Positive
    inner_span_mm: Positive
    outer_span_mm: Positive

    @model_validator(mode="after")
    def _spans_in_order(self) -> Beam:
        if self.inner_span_mm >= self.outer_span_mm:
            raise ValueError(
                f"inner_span_mm = {self.inner_span_mm:g} must be less than outer_span_mm = "
                f"{self.outer_span_mm:g}; are they swapped?"
            )
        if self.height_mm >= self.outer_span_mm:
            raise ValueError(
                f"height_mm = {self.height_mm:g} is not less than outer_span_mm = "
                f"{self.outer_span_mm:g}, which no bending beam is; check the units (mm)"
            )
        return self


class Disc(Part):
    """A disc pressed along a diameter by two opposite point loads."""

    thickness_mm: Positive | None = None
    diameter_mm: Positive


class LoadedImage(Part):
    """One captured frame and the whole load on the specimen; load_n = 0 is a residual frame."""

    file: Annotated[str, Field(min_length=1)]
    load_n: NonNegative


class Uncertainty(Part):
    """Standard uncertainties of the inputs; a load's is in per cent, common to all images."""

    load_percent: NonNegative | None = None
    thickness_mm: NonNegative | None = None
    height_mm: NonNegative | None = None
    diameter_mm: NonNegative | None = None
    span_mm: NonNegative | None = None
    pixel_mm: NonNegative | None = None


class CalibrationSet(Part):
    """A calibration set: a beam or a disc, its camera, its images and what is known of them."""

    beam: Beam | None = None
    disc: Disc | None = None
    camera: Camera = Camera()
    polariscope: Polariscope = Polariscope()
    frames: Frames = Frames()
    image: Annotated[tuple[LoadedImage, ...], Field(min_length=1)]
    uncertainty: Uncertainty | None = None
    folder: Path | None = Field(default=None, exclude=True, repr=False)
    name: str = Field(default="set", exclude=True, repr=False)

    @model_validator(mode="after")
    def _complete(self) -> CalibrationSet:
        if (self.beam is None) == (self.disc is None):
            raise ValueError("give one specimen, either [beam] or [disc]")
        if self.beam is not None and self.camera.pixel_mm is None:
            raise ValueError("the key 'camera.pixel_mm' is missing, and a beam needs it; add it")
        broad = self.polariscope.light is not None or self.polariscope.spectrum is not None
        if self.polariscope.field == "plane" or broad:
            raise ValueError(
                "a calibration is read from the circular dark or bright field at one wavelength; "
                "set polariscope.field = 'dark' or 'bright', and no light or spectrum (separate "
                "lines only for a colour camera, a line a channel)"
            )
        if not any(image.load_n > 0 for image in self.image):
            raise ValueError("no [[image]] has load_n above 0; a calibration needs a loaded one")
        return self

    @property
    def gamma(self) -> float:
        """The exponent from linear light to the files' grey levels, I_file = I^(1/gamma)."""
        given = "gamma" in self.frames.model_fields_set
        return self.frames.stated_gamma if given else self.camera.gamma

    def path(self, file: str) -> Path:
        """A path named in the set, relative to the set's own file."""
        return (self.folder or Path()) / file


def load_set(source: str | Path | CalibrationSet, *, specimen: str | None = None) -> CalibrationSet:
    """Read a calibration set.

    Parameters: `source`, the TOML file's path, or a CalibrationSet (returned as it is);
    `specimen`, 'beam' or 'disc' where only one will do.
    Returns the CalibrationSet. Raises InputError that names the file, key, value and fix.
    """
    if isinstance(source, CalibrationSet):
        found = source
    else:
        path = Path(source)
        data = parse_toml(read_text(path), str(path))
        found = validate(CalibrationSet, data, str(path), reserved=("folder", "name"))
        check_reach(found.model_dump(exclude_unset=True), str(path))
        found = found.model_copy(update={"folder": path.parent, "name": str(path)})
    if specimen is not None and getattr(found, specimen) is None:
        other = "disc" if specimen == "beam" else "beam"
        command = "disc" if specimen == "beam" else "bending"
        raise InputError(
            f"{found.name}: [{specimen}] is missing, and the set has a [{other}]; add it, or run "
            f"'isochrome calibrate {command}'"
        )
    return found
