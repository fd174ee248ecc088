"""Calibrated values set in a scene file, whose comments and layout stay as they are."""

from __future__ import annotations

import datetime
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from isochrome.calibration.result import Calibration
from isochrome.calibration.scale.result import LENS, ScaleCalibration
from isochrome.calibration.wear.result import WearCalibration
from isochrome.errors import InputError
from isochrome.output import replacing, rounded_texts
from isochrome.scene import (
    Scene,
    parse_scene,
    parse_toml,
    read_text,
    scene_names,
    with_value,
)

MARK = "calibrated: "
"""What a comment of ours begins with: a second calibration replaces it."""

BYTE_ORDER_MARK = "\ufeff"
"""What some editors begin a file with; it stays."""

FRINGE_VALUE = "specimen.fringe_value_n_per_mm"
"""It ages with the material, so its day is written beside it."""

CLEAR = 3.0
"""Standard uncertainties beyond which a value is no nothing: a lens's value below is not written,
unless the scene states another."""


def calibration_day() -> str:
    """Today's date, universal time, as ISO text."""
    return datetime.datetime.now(datetime.UTC).date().isoformat()


def check_scene_file(path: str | Path) -> str:
    """Text of a scene file that calibrated values may be written into, line ends as they are.

    InputError for the name of a scene inside the package, a missing file, and one that is no scene.
    """
    place = Path(path)
    if not place.is_file() and str(path) in scene_names():
        raise InputError(
            f"{path}: this scene ships inside the package and is not written to; name a scene "
            "file of your own"
        )
    plain = read_text(place)  # its refusals: missing, too large, not UTF-8
    text = place.read_bytes().decode("utf-8")
    parse_scene(plain, folder=place.parent, label=str(path))
    return text


def write_into_scene(
    calibration: Calibration | ScaleCalibration | WearCalibration,
    scene: str | Path,
    *,
    source: str | Path | None = None,
) -> float:
    """Set `specimen.fringe_value_n_per_mm` in a scene file to a calibration's value.

    Of a scale it is `camera.pixel_mm`, and `camera.distortion`, `camera.keystone_x` and
    `camera.keystone_z` where they are beyond three of their uncertainties, or the file states them.
    Of wear it is `wear.coefficient_mm2_per_n`, by the law that the scene states.

    It is written as { value = ..., standard_uncertainty = ... }, from which a fit has its prior, or
    an input of its budget; a fringe value has its `date` beside these, today's. The value is
    rounded two digits beyond the uncertainty's first. A comment beside it states chi, or a scale's
    residual; all else in the file stays, to the byte. The file is replaced as a whole or not at
    all.

    Parameters
    ----------
    calibration : Calibration, ScaleCalibration or WearCalibration
        What `calibrate_bending`, `calibrate_disc`, `calibrate_scale` or `calibrate_wear` found.
    scene : str or Path
        The TOML file.
    source : str or Path, optional
        The calibration set or image, which the comment names.

    Returns
    -------
    float
        The value written, N/mm per fringe; of a scale mm a pixel, of wear mm²/N.

    Raises
    ------
    InputError
        Where the scene is one of the package, or the file is missing, is no scene or cannot be
        written, or its layout cannot be edited; or where its frames are not the whole pictures
        that a scale is of, or has no wear by a law that was asked.

    Examples
    --------
    >>> import isochrome
    >>> from isochrome.samples import samples_path
    >>> set_file = samples_path() / "disc" / "set.toml"
    >>> found = isochrome.calibrate_disc(set_file)  # doctest: +SKIP
    >>> isochrome.write_into_scene(found, "scene.toml", source=set_file)  # doctest: +SKIP
    14.599
    """
    text = check_scene_file(scene)
    mark = text[: text.startswith(BYTE_ORDER_MARK)]
    text = text.removeprefix(mark)
    if isinstance(calibration, ScaleCalibration):
        _check_picture(calibration, parse_scene(text, folder=Path(scene).parent), str(scene))
    if isinstance(calibration, WearCalibration):
        calibration = _by_scene_law(calibration, text, str(scene))
    comment = _comment(calibration, source)
    entries = [(key, rounded_texts(*value)) for key, value in _to_write(calibration, text)]
    for key, entry in reversed(entries):  # each is put on top of its table
        date = calibration_day() if key == FRINGE_VALUE else None
        text = edited(text, *entry, comment, name=str(scene), key=key, date=date)
    target = Path(scene).resolve()  # a link stays a link
    with replacing(target) as beside:
        beside.write_bytes((mark + text).encode("utf-8"))
        shutil.copymode(target, beside)
    return float(entries[0][1][0])


def edited(
    text: str,
    value: str,
    spread: str,
    comment: str,
    *,
    name: str = "scene",
    key: str = FRINGE_VALUE,
    date: str | None = None,
) -> str:
    """A scene's TOML text with another value of a key.

    Parameters: `text`; `value` and its standard uncertainty `spread`, TOML numbers; `comment` for
    its line, without #; `name` of the file for messages; `key`, table and name; `date`, the day
    of the calibration. Returns the text. Raises InputError where no edit does only that.
    """
    dated = "" if date is None else f', date = "{date}"'
    written = f"{{ value = {value}, standard_uncertainty = {spread}{dated} }}"
    return with_value(text, key, written, comment=comment, mark=MARK, name=name)


def _by_scene_law(calibration: WearCalibration, text: str, name: str) -> WearCalibration:
    """The calibration with the coefficient of the law that a scene states."""
    wear = parse_scene(text).wear
    if wear is None:
        raise InputError(
            f"{name}: has no [wear] that a coefficient could stand in; add one with its distances_m"
        )
    found = calibration.coefficient_by(wear.law)
    if found is None:
        raise InputError(
            f"{name}: its wear.law is '{wear.law}', and the set states no friction, without which "
            "its coefficient is not known; add friction to every [[trace]] and [[volume]]"
        )
    return replace(calibration, coefficient_mm2_per_n=found[0], standard_uncertainty=found[1])


def _to_write(
    calibration: Calibration | ScaleCalibration | WearCalibration, text: str
) -> Iterator[tuple[str, tuple[float, float]]]:
    """The first value, and of the others those that are clear or that the scene states."""
    stated = parse_toml(text, "scene")
    for k, (key, (value, spread)) in enumerate(calibration.scene_values.items()):
        table, _, entry = key.partition(".")
        if k == 0 or abs(value) > CLEAR * spread or entry in stated.get(table, {}):
            yield key, (value, spread)


def _check_picture(calibration: ScaleCalibration, scene: Scene, name: str) -> None:
    """Refuse a scene whose frames are turned, cut or of another size than a scale's pictures."""
    camera, frames = scene.camera, scene.frames
    bent = any(
        abs(found.value) > CLEAR * found.standard_uncertainty
        for key, found in calibration.values.items()
        if key in LENS
    )
    moved = [key for key in ("roi", "rotate_deg", "flip") if getattr(frames, key)]
    if bent and moved:
        raise InputError(
            f"{name}: has frames.{moved[0]}, and the lens that was found counts from the middle of "
            "the whole picture as the camera gives it; calibrate with pictures that are turned and "
            "cut as the frames are, and leave it out of the scene"
        )
    size = (camera.height_px, camera.width_px) if camera and not moved else (None, None)
    if any(own not in (None, seen) for own, seen in zip(size, calibration.shape, strict=True)):
        raise InputError(
            f"{name}: its camera has {size[1]} x {size[0]} pixels, and the target's picture "
            f"{calibration.shape[1]} x {calibration.shape[0]}; calibrate with a picture of the "
            "same size"
        )


def _comment(
    calibration: Calibration | ScaleCalibration | WearCalibration, source: str | Path | None
) -> str:
    """What the comment says of the values."""
    origin = "" if source is None else f", {Path(source).name}"
    mark = f"{MARK}{calibration.scene_comment}{origin}"
    return "".join(c for c in mark if c.isprintable() and c != ";")  # which ends it
