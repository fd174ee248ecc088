"""What the page works on: the frames, and the text of a scene or calibration set with its history.
Rows and columns are px with pixel centres at whole numbers. Those of the page are of the whole
picture; a scene's known orders and its mask are counted in its region of interest."""

import os
import re
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration import (
    Beam,
    Calibration,
    CalibrationSet,
    Disc,
    calibrate_bending,
    calibrate_disc,
    cause_sentence,
    find_rim,
    load_set,
)
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import observe
from isochrome.fitting import SceneRenderer, with_numerics
from isochrome.frames import (
    Frame,
    FrameReader,
    is_unloaded,
    likely_no_load,
    named_files,
    open_frames,
    reading_options,
    with_file_scale,
)
from isochrome.messages import message
from isochrome.output import with_uncertainty, write_text
from isochrome.processing import own_scene
from isochrome.runs import single_threaded
from isochrome.scene import (
    FramesLike,
    Roi,
    Scene,
    load_scene,
    parse_scene,
    parse_toml,
    toml_text,
    validate,
    with_list_value,
    with_table_list,
)
from isochrome.specimens import specimen_model
from isochrome.stress import PixelGrid, pixel_grid


def moved(points: Sequence[Sequence[float]], down: float, right: float) -> list[list[float]]:
    """Points (row, col) moved by px, rounded to a hundredth."""
    return [[round(row + down, 2), round(col + right, 2)] for row, col in points]


def round_by_spread(value: float, spread: float) -> float:
    """Round a value two digits beyond the first of its standard uncertainty."""
    if not (np.isfinite(spread) and spread > 0.0):
        return value
    return float(np.round(value, max(0, 2 - int(np.floor(np.log10(spread))))))


class LiveModel:
    """The fringes of a scene of one state on the pixels (rows, cols) of its region, as values move.
    Less exact than a fit's, and much faster: the mean over a pixel's area is left out, some
    hundredths of the full light."""

    def __init__(self, scene: Scene, shape: tuple[int, int]) -> None:
        if not scene.has_model:
            reason = scene.no_model_reason
            raise InputError("so_there_no_fringes", name=scene.name, no_model_reason=reason)
        if scene.polariscope.several_wavelengths:
            raise InputError("fringes_over_picture_those", name=scene.name)
        self.scene, self.shape = scene, shape
        self._start(scene)

    def _start(self, scene: Scene) -> None:
        self._base = with_numerics(scene)  # with the nodes on the surface: they stay
        self._renderer = SceneRenderer(self._base, self.shape, rough=True)

    def signal(self, values: Mapping[str, float]) -> NDArray[np.floating]:
        """The signal (rows, cols) for values by key, 1 for full light, 0 where no specimen is.
        InputError where a value is not allowed, PhysicsError where the contact cannot be solved."""
        parts = vars(self.scene)
        known = {k: v for k, v in values.items() if parts.get(k.partition(".")[0]) is not None}
        scene, sharp = self._base.with_values(known), np.ones((), np.float32)
        try:
            signal = self._renderer.signal(scene, visibility=sharp)
        except PhysicsError:  # the contact outgrew its window
            self._start(self.scene.with_values(known))
            scene = self._base
            signal = self._renderer.signal(scene, visibility=sharp)
        inside = specimen_model(scene).inside(pixel_grid(scene, self.shape))
        return np.where(inside, np.nan_to_num(signal), 0.0)


_NAMING = (
    "file", "profile", "response", "mask", "no_load_dark", "no_load_bright", "no_load_steps",
    "colour_table",
)  # fmt: skip
"""Keys of a scene that name a file."""

_PICTURES = (".tif", ".tiff", ".png", ".jpg", ".jpeg", ".bmp", ".csv")
"""Files beside the frames that a scene may be made to name on the page."""

_OUTERMOST = 0.1, 99.9
"""Per cent of a frame's grey levels below which it is shown black, and above white."""


class SetupSession:
    """A scene that is set up on its frames, and written to `scene_file`; no browser is needed.
    `text` is empty for a scene that is still to be made; `saved`: the file holds it already."""

    def __init__(self, frames: FramesLike, scene_file: Path, text: str, *, saved: bool) -> None:
        self.frames, self.scene_file, self.text = frames, scene_file, text
        self.subject: str | None = None  # a kind of calibration set, where it is one
        self.revision = 0
        self.saves = 0
        self._saved_text = text if saved else None
        self._file_bytes = self._read_file()
        self._undo: list[str] = []
        self._lock = threading.RLock()
        self._model: tuple[tuple[int, int], LiveModel, tuple[float, float]] | None = None
        self._named = set(_named_files(text))
        self._readers: dict[Any, FrameReader] = {}
        self.reader_files = tuple(Path(str(file)) for file in self.reader(None).files)
        if self.count(None) == 0:
            raise InputError("holds_no_frame_check", path=frames)

    @property
    def folder(self) -> Path:
        """The folder to which the scene's paths are relative."""
        return self.scene_file.parent

    @property
    def is_saved(self) -> bool:
        """Whether the file holds the scene as it is."""
        return self.text == self._saved_text

    def beside(self) -> list[str]:
        """List the files beside the frames that a scene may name: their names, nothing of them."""
        frames = {file.resolve() for file in self.reader_files}
        return [
            name
            for name in self._pictures()
            if is_unloaded(name) or (self.folder / name).resolve() not in frames
        ]

    def _pictures(self) -> list[str]:
        files = (f for f in self.folder.iterdir() if f.suffix.lower() in _PICTURES)
        return sorted(f.name for f in files if f.is_file() and not f.name.startswith("."))

    def left_out(self, scene: Scene | None) -> tuple[Path, ...]:
        """Files of a folder that `scene` names; without one, no-load frames by their names."""
        if not (isinstance(self.frames, str | Path) and Path(self.frames).is_dir()):
            return ()
        if scene is not None:
            return tuple(named_files(scene))
        names = {*_named_files(self.text), *likely_no_load(self._pictures()).values()}
        return tuple(self.folder / name for name in sorted(names))

    def count(self, scene: Scene | None) -> int:
        """How many frames there are, see `left_out`."""
        return self.reader(scene).count(decode=False)

    def scene(self, text: str | None = None) -> Scene:
        """The scene of a text, by default the page's own; InputError: a file not beside it."""
        text = self.text if text is None else text
        if not text.strip():
            raise InputError("there_no_scene_yet")
        self.refuse_strange_files(text)
        file = self.scene_file
        return parse_scene(text, name=file.stem, folder=self.folder, label=file.name)

    def check_complete(self) -> None:
        """Refuse a text that cannot be used as it is."""
        self.scene()

    def refuse_strange_files(self, text: str, known: Iterable[str] = ()) -> None:
        """Refuse a text that names a file which is neither beside the scene nor `known`."""
        label = self.scene_file.name
        strange = _named_files(text) - self._named - set(self.beside()) - set(known)
        if strange:
            raise InputError("names_which_not_beside", label=label, strange=sorted(strange)[0])

    def change(self, edit: Callable[[str], str]) -> None:
        """Change the text by `edit`, where the result is a scene; else it stays as it was."""
        with self._lock:
            text = edit(self.text)
            if text == self.text:
                return
            self.count(self.scene(text))  # of a folder, a scene may name its only picture
            self._undo.append(self.text)
            self.text = text
            self.revision += 1

    def undo(self) -> None:
        """Take the last change back."""
        with self._lock:
            if not self._undo:
                raise InputError("there_nothing_take_back")
            self.text = self._undo.pop()
            self.revision += 1

    def _read_file(self) -> bytes | None:
        """What the scene's file holds now; None where there is none that can be read."""
        with suppress(OSError):
            return self.scene_file.read_bytes()
        return None

    def read_again(self) -> None:
        """Take the file's scene where another program has changed it, if it is one."""
        with self._lock:
            data = self._read_file()
            if data is None or data == self._file_bytes:
                return
            with suppress(InputError, UnicodeDecodeError):
                text = data.decode("utf-8-sig")  # line ends stay as they are
                self._named |= _named_files(text)
                self.change(lambda _: text)
                self._file_bytes, self._saved_text = data, text

    def save(self) -> None:
        """Write the scene whole; InputError where the file is not the one read or saved last."""
        with self._lock:
            self.check_complete()
            if self._read_file() not in (None, self._file_bytes):
                name, noun = self.scene_file.name, "scene" if self.subject is None else "set"
                raise InputError("changed_another_program_since", name=name, noun=noun)
            write_text(self.scene_file.resolve(), self.text)
            self._file_bytes, self._saved_text = self._read_file(), self.text
            self._named |= _named_files(self.text)
            self.saves += 1

    def reader(self, scene: Scene | None) -> FrameReader:
        """The whole frames, turned as a scene says."""
        options = reading_options(scene) if scene is not None else {}
        options["leave_out"] = self.left_out(scene)
        key = tuple(options.values())
        with self._lock:
            if key not in self._readers:
                opened = open_frames(self.frames, **options)
                for one in self._readers.values():
                    one.close()
                self._readers = {key: opened}
            return self._readers[key]

    def scene_or_none(self) -> Scene | None:
        """The scene, None where the text is none yet."""
        with suppress(InputError):
            return self.scene()
        return None

    def frame(self, index: int, scene: Scene | None) -> Frame:
        """A whole frame. Raises InputError where there is none of this number."""
        count = self.count(scene)
        if not 0 <= index < count:
            raise InputError("frame_there_counted_from_2", index=index, count=count)
        return self.reader(scene).frame(index)

    def region(self, scene: Scene | None) -> Roi:
        """The region of interest, the whole picture where there is none."""
        rows, cols = self.reader(scene).shape
        return (scene and scene.frames.roi) or Roi(height_px=rows, width_px=cols)

    def pixels(self, scene: Scene) -> PixelGrid:
        """The region's pixels. Raises InputError where the scale is not known."""
        region = self.region(scene)
        scaled = with_file_scale(scene, self.reader(scene))
        if scaled.camera is None or scaled.camera.pixel_mm is None:
            raise InputError("scale_not_known_yet")
        return pixel_grid(scaled, (region.height_px, region.width_px))

    def live(self, index: int, values: Mapping[str, float]) -> tuple[NDArray[np.uint8], Roi]:
        """The model's fringes, as bright as the frame, as grey levels of the region, and it."""
        with self._lock:
            scene, key = self.scene(), (self.revision, index)
            region = self.region(scene)
            if self._model is None or self._model[0] != key:
                frame = self.frame(index, scene)
                self.pixels(scene)  # its scale
                state = own_scene(with_file_scale(scene, self.reader(scene)), frame)
                model = LiveModel(state, (region.height_px, region.width_px))
                shown = _cut(shown_frame(frame.image), region)
                dark, bright = np.percentile(shown[::4, ::4], _OUTERMOST).tolist()
                self._model = key, model, (dark, max(bright, dark + 1.0))
            _, model, (dark, bright) = self._model
            light = np.clip(model.signal(values), 0.0, 1.0)
            stored = light ** np.float32(1.0 / scene.frames.first_gamma)
            return np.asarray(np.rint(dark + (bright - dark) * stored), dtype=np.uint8), region


def shown_frame(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Raw grey levels in 8 bits: the darkest thousandth and NaN black, the brightest one white."""
    values = np.nan_to_num(image.astype(np.float32))
    step = max(1, int(np.sqrt(values.size / 250_000)))
    low, high = np.percentile(values[::step, ::step], _OUTERMOST)
    share = (values - low) / max(high - low, 1e-9)
    return np.asarray(255.0 * np.clip(share, 0.0, 1.0) + 0.5, dtype=np.uint8)


def _named_files(text: str) -> set[str]:
    named: set[str] = set()
    with suppress(InputError):
        within: list[tuple[str, Any]] = [("", parse_toml(text, "scene"))]
        for key, value in within:  # which grows
            if isinstance(value, Mapping):
                within += value.items()
            elif isinstance(value, list):
                within += [(key, inner) for inner in value]
            elif isinstance(value, str) and key in _NAMING:
                named.add(value)
    return named


TABLES = {"bending": "beam", "diametral": "disc"}
"""The specimen's table of a set, by the page's kind."""

_BODIES: Mapping[str, type[Beam] | type[Disc]] = {"beam": Beam, "disc": Disc}

_PICTURED = ("camera", "polariscope", "frames")
"""Tables that a set and a scene have in common: how the picture is taken and read."""

_LOAD_IN_NAME = re.compile(r"(?<![0-9A-Za-z.,])([0-9]+(?:[.,][0-9]+)?)[ _-]?N(?![A-Za-z])")
"""The load that an image's name may tell, such as disc-560N.png."""

_GAMMA = "frames.gamma"


class SetSession(SetupSession):
    """A calibration set on its images; its text need not be whole before it is saved."""

    def __init__(
        self, frames: FramesLike, scene_file: Path, text: str, *, saved: bool, subject: str
    ) -> None:
        super().__init__(frames, scene_file, text, saved=saved)
        self.subject = subject
        # what was fitted to each image, at a revision
        self.geometry: tuple[int, dict[str, dict[str, float]]] = (-1, {})

    def left_out(self, scene: Scene | None) -> tuple[Path, ...]:
        """None: each image is offered as one of the set."""
        return ()

    @property
    def image_names(self) -> list[str]:
        """The images' files as the set names them: relative to its folder."""
        folder, files = self.folder.resolve(), (file.resolve() for file in self.reader_files)
        return [Path(os.path.relpath(file, folder)).as_posix() for file in files]

    def scene(self, text: str | None = None) -> Scene:
        """How the pictures are taken and read, as a scene without a model."""
        text = self.text if text is None else text
        label = self.scene_file.name
        if not text.strip():
            raise InputError("there_no_set_yet")
        self.refuse_strange_files(text, self.image_names)
        tables, name = parse_toml(text, label), TABLES[self.subject or ""]
        for table in tables:
            if table not in (*_PICTURED, name, "image", "uncertainty"):
                raise InputError(
                    "none_set_tables_image", label=label, table=table, name=name,
                    pictured=", ".join(_PICTURED),
                )  # fmt: skip
        validate(_BODIES[name], plain_table(tables.get(name, {})), f"{label}: [{name}]")
        pictured = {t: tables[t] for t in _PICTURED if t in tables}
        scene = load_scene({"specimen": {"shape": "other"}, **pictured})
        return scene.model_copy(update={"folder": self.folder, "name": self.scene_file.stem})

    def calibration_set(self) -> CalibrationSet:
        """The set as it is on the page."""
        label = self.scene_file.name
        tables = parse_toml(self.text, label)
        given = validate(CalibrationSet, tables, label, reserved=("folder", "name"))
        given = given.model_copy(update={"folder": self.folder, "name": label})
        return load_set(given, specimen=TABLES[self.subject or ""])

    def check_complete(self) -> None:
        """Refuse a text that is no whole set, or names other files."""
        super().check_complete()
        self.calibration_set()

    def loads(self) -> list[float | None]:
        """The load of each image, N: the set's, before it is made that of the file's name."""
        if not self.text.strip():
            numbers = [_LOAD_IN_NAME.findall(Path(name).stem) for name in self.image_names]
            return [float(n[0].replace(",", ".")) if len(n) == 1 else None for n in numbers]
        loads = _loads_in(parse_toml(self.text, self.scene_file.name).get("image", []))
        return [loads.get(name) for name in self.image_names]

    def outlines(self, index: int) -> list[list[list[float]]]:
        """A disc's rim, or a calibrated beam's edges, as lines of (row, col); none if not found."""
        scene = self.scene()
        region, image = self.region(scene), self.frame(index, scene).image
        revision, geometry = self.geometry
        fitted = geometry.get(self.image_names[index]) if revision == self.revision else None
        lines: list[NDArray[np.float64]] = []
        if self.subject == "diametral":
            circle = None
            if fitted:
                circle = [fitted[k] for k in ("centre_row_px", "centre_col_px", "radius_px")]
            else:
                picture, depth = _cut(image, region), self.reader(scene).bit_depth
                with suppress(InputError, PhysicsError):  # no rim is to be seen
                    rim = find_rim(observe(picture, name="the image", bit_depth=depth, gamma=1.0))
                    circle = [rim.row, rim.col, rim.radius]
            if circle:
                turn = np.radians(np.arange(0.0, 361.0, 5.0))
                lines = [circle[2] * np.stack([np.sin(turn), np.cos(turn)], 1) + circle[:2]]
        elif fitted:
            # both edges from the left to the right of the region, by neutral axis and tilt
            beam, col = self.calibration_set().beam, np.array([0.0, region.width_px - 1.0])
            assert beam is not None
            slope = -np.tan(np.radians(fitted["tilt_deg"]))
            row = fitted["neutral_axis_row_px"] + slope * (col - 0.5 * col[1])
            away = 0.5 * beam.height_mm / self.pixels(scene).pixel_mm * np.hypot(1.0, slope)
            lines = [np.stack([row + side, col], axis=1) for side in (-away, away)]
        return [moved(line.tolist(), region.top_px, region.left_px) for line in lines]


def _cut(image: NDArray[Any], region: Roi) -> NDArray[Any]:
    rows = slice(region.top_px, region.top_px + region.height_px)
    return image[rows, region.left_px : region.left_px + region.width_px]


def plain_table(table: Any) -> Any:
    """A table without what is not known of its values; what is no table as it is."""
    if not isinstance(table, Mapping):
        return table
    return {
        key: value["value"] if isinstance(value, Mapping) and "value" in value else value
        for key, value in table.items()
    }


def _loads_in(images: Iterable[Mapping[str, Any]]) -> Any:
    """The loads of a set's images by their files, without what is not known of them."""
    return plain_table({image.get("file"): image.get("load_n") for image in images})


def with_loads(text: str, names: Sequence[str], loads: Sequence[float | None]) -> str:
    """A set's text with its images' loads, N; None: not of the set; comments stay."""
    wanted = {n: load for n, load in zip(names, loads, strict=True) if load is not None}
    images_before = parse_toml(text, "set").get("image", [])
    loads_before = _loads_in(images_before)
    for place, one in enumerate(images_before):
        load = wanted.get(one.get("file"))
        if load is not None and load != loads_before[one["file"]]:
            text = with_list_value(text, "image", place, "load_n", float(load), name="set")
    images_before = parse_toml(text, "set").get("image", [])
    shown = set(wanted) | {one.get("file") for one in images_before} - set(names)
    images = [one for one in images_before if one.get("file") in shown]
    images += [{"file": n, "load_n": float(v)} for n, v in wanted.items() if n not in loads_before]
    return text if images == images_before else with_table_list(text, "image", images, name="set")


def calibration_answer(session: SetSession) -> dict[str, Any]:
    """Calibrate: values, images, causes with the key and value that state them, warnings."""
    given, revision = session.calibration_set(), session.revision
    run = calibrate_bending if session.subject == "bending" else calibrate_disc
    with single_threaded():
        result = run(given)
    session.geometry = revision, {image.file: image.geometry for image in result.images}
    values = [{"words": words, "text": text} for words, text in result.main_values()]
    names = "file", "load_n", "order", "chi"
    images = [{name: getattr(image, name) for name in names} for image in result.images]
    causes = list(_cause_rows(given.gamma, result))
    warnings = [w for w in result.warnings if w not in map(cause_sentence, result.causes)]
    answer = {"revision": revision, "values": values, "images": images}
    return answer | {"causes": causes, "warnings": warnings}


_UNITS = {
    None: "of the wavelength, full width at half height",
    "camera.distortion": "of the corner's distance",
    "camera.keystone_x": "change of scale, middle to edge",
    "camera.keystone_z": "change of scale, middle to edge",
    "camera.blur_px": "px",
    "polariscope.bandwidth_nm": "nm, full width at half height",
    _GAMMA: "of the light, in place of the set's gamma",
}
"""What the value of a cause is counted in, by its key."""


def _cause_rows(gamma: float, result: Calibration) -> Iterator[dict[str, Any]]:
    """What the images asked for besides the set, in plain words, and where the set states it."""
    for cause in result.causes:
        key, words, unit = cause["key"], cause["cause"], _UNITS.get(cause["key"], "")
        # what was found of a gamma is a factor to the set's
        factor = gamma if key == _GAMMA else 1.0
        pair = factor * cause["value"], factor * cause["standard_uncertainty"]
        note, stated, line = f"{unit[:1].upper()}{unit[1:]}." if unit else "", None, None
        if key is None:
            note += " " + message("set_states_nm_fill")
        else:
            stated = round_by_spread(*pair)
            line = f"{key.partition('.')[2]} = {toml_text(stated)}"
        yield {
            "words": words[:1].upper() + words[1:], "text": with_uncertainty(*pair), "key": key,
            "value": stated, "note": note, "line": line,
        }  # fmt: skip
    if result.residual is not None:
        yield {
            "words": "Residual stress in the specimen", "key": None, "value": None, "line": None,
            "text": f"up to {result.residual['largest_order']:.3f} fringes",
            "note": message("fitted_field_taken_off"),
        }  # fmt: skip
