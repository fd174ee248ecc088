"""The sets of calibrations: small TOMLs that say what was loaded, how, and in which images."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self, overload

import numpy as np
from pydantic import BaseModel, Field, model_validator

from isochrome.calibration.result import CUTS
from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.scene import (
    ArrayFrames,
    Camera,
    Frames,
    ImageFile,
    NonNegative,
    Polariscope,
    Positive,
    ScenePart,
    as_tables,
    check_reach,
    parse_toml,
    plain_value,
    read_text,
    split_uncertainties,
    validate,
)

_INPUTS = (
    "beam.thickness_mm", "beam.height_mm", "disc.thickness_mm", "disc.diameter_mm",
    "camera.pixel_mm",
)  # fmt: skip
"""Keys of a set whose names mean the same in [uncertainty]."""

_SPANS = ("beam.inner_span_mm", "beam.outer_span_mm")


def common_percent(relative: list[float]) -> float:
    """The root mean square of relative uncertainties, per cent: they are taken as one."""
    return 100.0 * float(np.sqrt(np.mean(np.square(relative))))


def under_uncertainty(plain: dict[str, Any], spreads: dict[str, Any]) -> dict[str, Any]:
    """A set's tables with uncertainties under [uncertainty]; ValueError for one stated twice."""
    if not spreads:
        return plain
    given = plain.get("uncertainty") or {}
    if isinstance(given, BaseModel):
        given = given.model_dump(exclude_none=True)
    if not isinstance(given, dict):
        return plain  # which is refused
    for key in spreads:
        if key in given:
            raise ValueError(message("uncertainty_stated_beside_value", key=key))
    return plain | {"uncertainty": given | spreads}


def plain_rows(
    plain: dict[str, Any], kinds: tuple[str, ...], names: tuple[str, ...], absolute: str = ""
) -> tuple[dict[str, Any], dict[str, list[float]]]:
    """Tables with plain values in the rows of `kinds`, and their relative uncertainties by name."""
    spreads: dict[str, list[float]] = {}
    for kind in kinds:
        rows = plain.get(kind)
        if not isinstance(rows, list | tuple):
            continue
        rows = list(rows)
        for number, row in enumerate(rows, start=1):
            for name in names if isinstance(row, dict) else ():
                if isinstance(row.get(name), dict):
                    value, spread = plain_value(f"{kind}[{number}].{name}", row[name])
                    row = rows[number - 1] = row | {name: value}
                    if isinstance(value, int | float) and value > 0:
                        size = 1.0 if name == absolute else value
                        spreads.setdefault(name, []).append(spread / size)
        plain = plain | {kind: rows}
    return plain, spreads


class Beam(ScenePart):
    """A beam in four-point bending: the moment between the inner rollers is P (Lo - Li)/4.

    Parameters
    ----------
    thickness_mm : float, optional
        Thickness d, mm.
    height_mm : float
        Height h, mm.
    inner_span_mm, outer_span_mm : float
        Spans Li and Lo of the inner and the outer rollers, mm.
    """

    thickness_mm: Positive | None = None
    height_mm: Positive
    inner_span_mm: Positive
    outer_span_mm: Positive

    @model_validator(mode="after")
    def _spans_in_order(self) -> Beam:
        inner, outer, height = self.inner_span_mm, self.outer_span_mm, self.height_mm
        if inner >= outer:
            text = message(
                "inner_span_mm_must_less_outer_span_mm", inner_span_mm=inner, outer_span_mm=outer
            )
            raise ValueError(text)
        if height >= outer:
            raise ValueError(
                message("height_mm_not_less_outer_span_mm", height_mm=height, outer_span_mm=outer)
            )
        return self


class Disc(ScenePart):
    """A disc pressed along a diameter by two opposite point loads.

    Parameters
    ----------
    thickness_mm : float, optional
        Thickness d, mm.
    diameter_mm : float
        Diameter D, mm.
    """

    thickness_mm: Positive | None = None
    diameter_mm: Positive


class LoadedImage(ScenePart):
    """One captured frame and the whole load on the specimen.

    Parameters
    ----------
    file : str or array_like
        The frame's file, relative to the set's; in Python the frame itself may stand here.
    load_n : float
        The load, N; 0 is a residual frame.
    """

    file: ImageFile
    load_n: NonNegative


class Uncertainty(ScenePart):
    """Standard uncertainties of the inputs, here or beside their values.

    Parameters
    ----------
    load_percent : float, optional
        That of the load, per cent, common to all images.
    thickness_mm, height_mm, diameter_mm : float, optional
        Those of the specimen's sizes, mm.
    span_mm : float, optional
        That of the spans, mm.
    pixel_mm : float, optional
        That of a pixel's size, mm.
    """

    load_percent: NonNegative | None = None
    thickness_mm: NonNegative | None = None
    height_mm: NonNegative | None = None
    diameter_mm: NonNegative | None = None
    span_mm: NonNegative | None = None
    pixel_mm: NonNegative | None = None


class ImageSet(ScenePart):
    """A set of images, read from a file beside which they lie, or given as its tables."""

    folder: Path | None = Field(default=None, exclude=True, repr=False)
    name: str = Field(default="set", exclude=True, repr=False)

    @model_validator(mode="before")
    @classmethod
    def _named_arrays(cls, data: Any) -> Any:
        """The images that are arrays with a name for messages."""
        items = data.get("image") if isinstance(data, dict) else None
        if not isinstance(items, list | tuple):
            return data
        named = []
        for number, item in enumerate(items, start=1):
            file = item.get("file") if isinstance(item, Mapping) else None
            if file is not None and not isinstance(file, str | Path | ArrayFrames):
                item = {**item, "file": ArrayFrames(file, f"image {number}")}
            named.append(item)
        return data | {"image": named}

    @overload
    def path(self, file: str) -> Path:
        """Where a file is."""

    @overload
    def path(self, file: ArrayFrames) -> ArrayFrames:
        """An array as it is."""

    def path(self, file: str | ArrayFrames) -> Path | ArrayFrames:
        """A path named in the set, relative to the set's own file; an array as it is."""
        return file if isinstance(file, ArrayFrames) else (self.folder or Path()) / file

    @classmethod
    def read(cls, source: str | Path | Mapping[str, Any] | Self) -> Self:
        """The set of a TOML file, or of its tables, whose images may be arrays, or itself.

        Raises InputError that names the file, key, value and fix.
        """
        if isinstance(source, Mapping):
            return validate(cls, as_tables(source), "set", reserved=("folder", "name"))
        if not isinstance(source, str | Path):
            return source
        path = Path(source)
        data = parse_toml(read_text(path), str(path))
        loaded = validate(cls, data, str(path), reserved=("folder", "name"))
        return loaded.model_copy(update={"folder": path.parent, "name": str(path)})


class CalibrationSet(ImageSet):
    """A calibration set: a beam or a disc, its camera, its images and what is known of them.

    Parameters
    ----------
    folder : Path, optional
        Folder of the set's file.
    name : str, optional
        The set's name in messages.
    beam : Beam, optional
        The beam.
    disc : Disc, optional
        The disc; one of both is given.
    camera : Camera, optional
        The camera; a beam needs its pixel_mm.
    polariscope : Polariscope, optional
        The circular polariscope, at one wavelength, or at one a channel.
    frames : Frames, optional
        How the images are read, and the no-load frames.
    image : tuple of LoadedImage
        The images and their loads, one above 0 at least.
    uncertainty : Uncertainty, optional
        Standard uncertainties of the inputs. A size, a span, `pixel_mm` or `load_n` may be
        { value = 20.0, standard_uncertainty = 0.02 } instead; loads' are taken as common to all.
    """

    beam: Beam | None = None
    disc: Disc | None = None
    camera: Camera = Camera()
    polariscope: Polariscope = Polariscope()
    frames: Frames = Frames()
    image: Annotated[tuple[LoadedImage, ...], Field(min_length=1)]
    uncertainty: Uncertainty = Uncertainty()

    @model_validator(mode="before")
    @classmethod
    def _plain_values(cls, data: Any) -> Any:
        """A set's tables with plain values, and what stood beside them under [uncertainty].
        ValueError for what is stated twice, and for a key that is no input of the budget.
        """
        if not isinstance(data, dict):
            return data
        plain, stated = split_uncertainties(cls, data)
        plain, of_images = plain_rows(plain, ("image",), ("load_n",))
        for key in stated:
            if key not in _INPUTS and key not in _SPANS:
                raise ValueError(
                    message(
                        "no_input_calibration_budget", key=key, inputs=", ".join(_INPUTS),
                        spans=", ".join(_SPANS), load="image.load_n",
                    )
                )  # fmt: skip
        spreads = {key.partition(".")[2]: stated[key] for key in stated if key in _INPUTS}
        spans = [stated[key] for key in _SPANS if key in stated]
        if spans:
            # of each span, such that both together are as uncertain as stated
            spreads["span_mm"] = float(np.sqrt(np.sum(np.square(spans)) / len(_SPANS)))
        if "load_n" in of_images:
            spreads["load_percent"] = common_percent(of_images["load_n"])
        return under_uncertainty(plain, spreads)

    @model_validator(mode="after")
    def _complete(self) -> CalibrationSet:
        if (self.beam is None) == (self.disc is None):
            raise ValueError(message("give_one_specimen_either"))
        if self.beam is not None and self.camera.pixel_mm is None:
            raise ValueError(message("key_camera_pixel_mm_missing"))
        broad = self.polariscope.light is not None or self.polariscope.spectrum is not None
        if self.polariscope.field == "plane" or broad:
            raise ValueError(message("calibration_read_from_circular"))
        if not any(image.load_n > 0 for image in self.image):
            raise ValueError(message("no_image_has_load_n"))
        return self

    @property
    def gamma(self) -> float:
        """The exponent from linear light to the files' grey levels, I_file = I^(1/gamma)."""
        given = "gamma" in self.frames.model_fields_set
        return self.frames.stated_gamma if given else self.camera.gamma


SetLike = str | Path | CalibrationSet | Mapping[str, Any]
"""A calibration set as a caller may give it: a file, a CalibrationSet, or its tables."""


def load_set(source: SetLike, *, specimen: str | None = None) -> CalibrationSet:
    """A set from its file or tables, or itself; `specimen`: 'beam' or 'disc' if one must be."""
    loaded = CalibrationSet.read(source)
    if loaded is not source:
        check_reach(loaded.model_dump(exclude_unset=True), loaded.name)
    if specimen is not None and getattr(loaded, specimen) is None:
        (other,) = CUTS.keys() - {specimen}
        name, command = loaded.name, CUTS[other].command
        raise InputError(
            "missing_set_has_add", name=name, specimen=specimen, other=other, command=command
        )
    return loaded


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
            raise ValueError(message("polariscope_wavelength_nm_missing_wavelength"))
        if self.polariscope.field == "plane" or self.polariscope.step:
            raise ValueError(message("colours_read_circular_dark"))
        if self.frames.channel is not None:
            raise ValueError(message("frames_channel_leaves_one"))
        if self.beam is not None:
            if self.camera.pixel_mm is None:
                raise ValueError(message("camera_pixel_mm_missing_beam"))
            if not all(image.load_n for image in self.image):
                raise ValueError(message("every_image_beam_needs"))
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
