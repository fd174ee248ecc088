"""A calibration set that is set up on its images: what the page does otherwise than for a scene."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration import (
    Beam,
    Calibration,
    CalibrationSet,
    Circle,
    Disc,
    calibrate_bending,
    calibrate_disc,
    cause_sentence,
    find_rim,
    load_set,
)
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import observe
from isochrome.output import with_uncertainty
from isochrome.runs import single_threaded
from isochrome.scene import (
    FramesLike,
    Scene,
    load_scene,
    parse_toml,
    toml_text,
    validate,
    with_list_value,
    with_table_list,
)
from isochrome.setup_page.places import moved, round_by_spread
from isochrome.setup_page.session import SetupSession

TABLES = {"bending": "beam", "diametral": "disc"}
"""The specimen's table of a set, by the page's kind."""

_BODIES: Mapping[str, type[Beam] | type[Disc]] = {"beam": Beam, "disc": Disc}

_PICTURED = ("camera", "polariscope", "frames")
"""Tables that a set and a scene have in common: how the picture is taken and read."""

_LOAD_IN_NAME = re.compile(r"(?<![0-9A-Za-z.,])([0-9]+(?:[.,][0-9]+)?)[ _-]?N(?![A-Za-z])")

_GAMMA = "frames.gamma"

_TURN = 73
"""Points of a circle as the page draws it."""


class SetSession(SetupSession):
    """A calibration set of a bending or diametral specimen that is being set up on its images.

    Its text need not be a whole set until it is saved or calibrated: sizes, scale and loads come
    one after the other.
    """

    def __init__(
        self, frames: FramesLike, scene_file: Path, text: str, *, saved: bool, subject: str
    ) -> None:
        super().__init__(frames, scene_file, text, saved=saved)
        self.subject = subject
        self._geometry: tuple[int, dict[str, dict[str, float]]] = (-1, {})

    def left_out(self, scene: Scene | None) -> tuple[Path, ...]:
        """None: each image is offered as one of the set. Parameters: `scene`, not looked at."""
        return ()

    @property
    def image_names(self) -> list[str]:
        """The images' files as the set names them: relative to its folder."""
        return [
            Path(os.path.relpath(file.resolve(), self.folder.resolve())).as_posix()
            for file in self.reader_files
        ]

    def scene(self, text: str | None = None) -> Scene:
        """Read how the pictures are taken and read, as a scene without a model.

        Parameters: `text`, TOML, by default the page's own. Returns a Scene. Raises InputError
        where a table of the set is wrong.
        """
        text = self.text if text is None else text
        label = self.scene_file.name
        if not text.strip():
            raise InputError("there is no set yet; fill in the form, and press Make the set")
        self.refuse_strange_files(text, self.image_names)
        tables = parse_toml(text, label)
        name = TABLES[self.subject or ""]
        for table in tables:
            if table not in (*_PICTURED, name, "image", "uncertainty"):
                raise InputError(
                    f"{label}: [{table}] is none of a set of a {name}; its tables are "
                    f"{name}, {', '.join(_PICTURED)}, image and uncertainty"
                )
        body: type[Beam] | type[Disc] = _BODIES[name]
        validate(body, _plain(tables.get(name, {})), f"{label}: [{name}]")
        pictured = {t: tables[t] for t in _PICTURED if t in tables}
        scene = load_scene({"specimen": {"shape": "other"}, **pictured})
        return scene.model_copy(update={"folder": self.folder, "name": self.scene_file.stem})

    def calibration_set(self) -> CalibrationSet:
        """The set as it is on the page. Raises InputError where it is not whole."""
        label = self.scene_file.name
        found = validate(
            CalibrationSet, parse_toml(self.text, label), label, reserved=("folder", "name")
        )
        given = found.model_copy(update={"folder": self.folder, "name": label})
        return load_set(given, specimen=TABLES[self.subject or ""])

    def check_complete(self) -> None:
        """Refuse a text that is no whole set, or names other files. Raises InputError."""
        self.scene()
        self.calibration_set()

    def loads(self) -> list[float | None]:
        """The load of each image, N: the set's, before it is made that of the file's name."""
        if not self.text.strip():
            return [_load_in(name) for name in self.image_names]
        stated = {
            image.get("file"): image.get("load_n")
            for image in parse_toml(self.text, self.scene_file.name).get("image", [])
        }
        plain = _plain(stated)
        return [plain.get(name) for name in self.image_names]

    def calibrate(self) -> Calibration:
        """Find the fringe value from the set as it is. Raises InputError, PhysicsError."""
        given, revision = self.calibration_set(), self.revision
        run = calibrate_bending if self.subject == "bending" else calibrate_disc
        with single_threaded():
            found = run(given)
        self._geometry = revision, {image.file: image.geometry for image in found.images}
        return found

    def outlines(self, index: int) -> list[list[list[float]]]:
        """Where the specimen is in an image: a disc's rim, a beam's edges once it is calibrated.

        Parameters: `index` of the image. Returns lines of (row, col) of the whole picture; none
        where the specimen is not found. Raises InputError where there is no such image.
        """
        scene = self.scene()
        region, image = self.region(scene), self.frame(index, scene).image
        rows = slice(region.top_px, region.top_px + region.height_px)
        cols = slice(region.left_px, region.left_px + region.width_px)
        revision, geometry = self._geometry
        own = geometry.get(self.image_names[index]) if revision == self.revision else None
        lines: Iterable[Sequence[Sequence[float]]] = ()
        if self.subject == "diametral":
            depth = self.reader(scene).bit_depth
            circle = _calibrated_rim(own) if own else _seen_rim(image[rows, cols], depth)
            lines = () if circle is None else (_ring(circle),)
        elif own:
            beam, pixel = self.calibration_set().beam, self.pixels(scene).pixel_mm
            assert beam is not None
            lines = _edges(own, beam.height_mm / pixel, region.width_px)
        return [moved(line, region.top_px, region.left_px) for line in lines]


def _calibrated_rim(own: Mapping[str, float]) -> Circle:
    """A disc's rim as the calibration has fitted it."""
    return Circle(own["centre_row_px"], own["centre_col_px"], own["radius_px"], 0.0)


def _seen_rim(image: NDArray[Any], bit_depth: int | None) -> Circle | None:
    """A disc's rim as it is seen in an image; None where there is none."""
    try:
        return find_rim(observe(image, name="the image", bit_depth=bit_depth, gamma=1.0))
    except (InputError, PhysicsError):
        return None


def _ring(circle: Circle) -> list[list[float]]:
    """A circle's points."""
    turn = np.linspace(0.0, 2.0 * np.pi, _TURN)
    away = circle.radius * np.stack([np.sin(turn), np.cos(turn)], 1)
    ring: list[list[float]] = (np.array([circle.row, circle.col]) + away).tolist()
    return ring


def _plain(table: Any) -> Any:
    """A table without what is not known of its values."""
    if not isinstance(table, Mapping):
        return table
    return {
        key: value["value"] if isinstance(value, Mapping) and "value" in value else value
        for key, value in table.items()
    }


def _edges(
    own: Mapping[str, float], height_px: float, width: int
) -> Iterator[list[tuple[float, float]]]:
    """A beam's two edges from the left to the right of its region, by its neutral axis and tilt."""
    slope, half = -np.tan(np.radians(own["tilt_deg"])), 0.5 * (width - 1)
    away = 0.5 * height_px * np.hypot(1.0, slope)
    for side in (-away, away):
        row = own["neutral_axis_row_px"] + side
        yield [(float(row - slope * half), 0.0), (float(row + slope * half), width - 1.0)]


def _load_in(name: str) -> float | None:
    """The load that an image's name tells, such as disc-560N.png; None where it tells none."""
    found = _LOAD_IN_NAME.findall(Path(name).stem)
    return float(found[0].replace(",", ".")) if len(found) == 1 else None


def with_loads(text: str, names: Sequence[str], loads: Sequence[float | None]) -> str:
    """A set's TOML text with its images' loads, N; comments stay where the images do.

    None: an image that is not of the set. InputError where the text's layout cannot be edited.
    """
    wanted = {n: load for n, load in zip(names, loads, strict=True) if load is not None}
    there = parse_toml(text, "set").get("image", [])
    own = _plain({one.get("file"): one.get("load_n") for one in there})
    for place, one in enumerate(there):
        load = wanted.get(one.get("file"))
        if load is not None and load != own[one["file"]]:
            text = with_list_value(text, "image", place, "load_n", float(load), name="set")
    there = parse_toml(text, "set").get("image", [])
    images = [one for one in there if one.get("file") in wanted or one.get("file") not in names]
    images += [{"file": n, "load_n": float(v)} for n, v in wanted.items() if n not in own]
    return text if images == there else with_table_list(text, "image", images, name="set")


def calibration_answer(session: SetSession) -> dict[str, Any]:
    """Calibrate, and say what was found.

    `values`: words and text; `images`: file, load, order, chi; `causes`: words and text of each
    that the images asked for, the key and value that state it, None for none, a `note`; `warnings`,
    and the `revision` of the set. InputError for a set, PhysicsError for images that do not tell
    it.
    """
    revision = session.revision
    found = session.calibrate()
    value = with_uncertainty(found.fringe_value_n_per_mm, found.standard_uncertainty)
    values = [("f_sigma (N/mm per fringe)", value)]
    values.append(("chi (1 = within the noise)", f"{found.chi:.2f}"))
    order, spread = found.order_at_zero_load, found.order_at_zero_load_uncertainty
    if order is not None and spread is not None:
        values.append(("Order at zero load (fringes)", with_uncertainty(order, spread)))
    return {
        "revision": revision,
        "values": [{"words": words, "text": text} for words, text in values],
        "images": [
            {"file": one.file, "load_n": one.load_n, "order": one.order, "chi": one.chi}
            for one in found.images
        ],
        "causes": list(_cause_rows(session, found)),
        "warnings": [w for w in found.warnings if w not in map(cause_sentence, found.causes)],
    }


_UNITS = {
    "camera.distortion": "of the corner's distance",
    "camera.keystone_x": "change of scale, middle to edge",
    "camera.keystone_z": "change of scale, middle to edge",
    "camera.blur_px": "px",
    "polariscope.bandwidth_nm": "nm, full width at half height",
    _GAMMA: "of the light, in place of the set's gamma",
}
"""What the value of a cause is counted in, by its key."""


def _cause_rows(session: SetSession, found: Calibration) -> Iterator[dict[str, Any]]:
    """What the images asked for besides the set, in plain words, and where the set states it."""
    for cause in found.causes:
        key, value, spread = cause["key"], cause["value"], cause["standard_uncertainty"]
        unit, why = _UNITS.get(key, ""), ""
        if key is None:
            unit = "of the wavelength, full width at half height"
            why = "The set states it in nm: fill in the wavelength in step 1, and calibrate again."
        elif key == _GAMMA:
            own = session.calibration_set().gamma  # what was found is a factor to it
            value, spread = own * value, own * spread
        stated = None if key is None else round_by_spread(value, spread)
        words = cause["cause"][:1].upper() + cause["cause"][1:]
        text = with_uncertainty(value, spread)
        note = f"{unit[:1].upper()}{unit[1:]}. {why}".strip() if unit else why
        yield {"words": words, "text": text} | {
            "key": key, "value": stated, "note": note,
            "line": None if key is None else f"{key.partition('.')[2]} = {toml_text(stated)}",
        }  # fmt: skip
    if found.residual is not None:
        most = f"up to {found.residual['largest_order']:.3f} fringes"
        yield {
            "words": "Residual stress in the specimen", "text": most, "key": None, "value": None,
            "line": None,
            "note": "It was fitted as a field, and taken off; no key of a set states a field.",
        }  # fmt: skip
