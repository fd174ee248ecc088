"""A drafted scene: what is known beforehand, its text, what each value comes from, what is open."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from isochrome.drafting.fields import KINDS, OPTIONS, QUANTITIES, STATED_SHAPES
from isochrome.errors import InputError
from isochrome.frames import Channel, Frame, FrameReader, check_scale, likely_no_load, named_files
from isochrome.messages import warnings_json
from isochrome.output import Result, counted, evenly_spaced, rounded_texts, with_uncertainty
from isochrome.scene import Camera, FramesLike, Scene, load_scene, parse_scene, toml_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Shape = Literal["contact", "disc", "other"]


@dataclass(frozen=True, kw_only=True)
class KnownValues:
    """What is known besides the frames, as captured; None = not known, or to be searched for."""

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


NEEDED = {
    shape: tuple(name for name, one in QUANTITIES.items() if one.needed and shape in one.kinds)
    for shape in get_args(Shape)
}
"""What cannot be found in the frames, and nothing is found without it."""


NEEDED_BESIDE = ("thickness_mm", "fringe_value_n_per_mm")
"""What a scene without a model states where it is known."""

TURN = "frames.rotate_deg"

WITH_OWN_SCALE = ("disc", "other")
"""Shapes whose frames need no pixel size beforehand."""


def known_values(known: KnownValues | Mapping[str, Any]) -> KnownValues:
    """KnownValues of a mapping; InputError for a name or shape that is none, or a frame below 0."""
    if not isinstance(known, KnownValues):
        names = [field.name for field in fields(KnownValues)]
        for name in known:
            if name not in names:
                raise InputError("not_known_here_known", name=name, names=", ".join(names))
        known = KnownValues(**known)
    for name, kind in get_type_hints(KnownValues).items():
        parts = (kind, *get_args(kind))
        allowed = [a for part in parts if get_origin(part) is Literal for a in get_args(part)]
        value = getattr(known, name)
        if allowed and value not in allowed and not (value is None and type(None) in parts):
            choice = ", ".join(map(str, allowed))
            raise InputError("none_name_one_them", name=name, value=value, choice=choice)
    if known.frame is not None and known.frame < 0:
        raise InputError("frame_frames_count_from", frame=known.frame)
    return known


_COMMENT_AT, _WIDTH = 34, 100
"""Column of the comments, and the length of a line."""

LIGHT = {name: one.key for name, one in OPTIONS.items() if {*KINDS} <= {*one.kinds}}
"""What is known of the light and the camera, whatever stands in front of it, and its key."""

_WORDS = {"file": "as the file has it", "given": "as given", "found": "found"}


def written_draft(
    reader: FrameReader,
    given: KnownValues,
    frame: int,
    sentences: Sequence[str],
    fitted: Sequence[DraftValue],
    draw: Callable[[], Figure],
    *,
    open_keys: Sequence[OpenKey] = (),
    warnings: Sequence[str] = (),
    chi: float | None = None,
) -> SceneDraft:
    """A scene of what is given, what the file tells, what was `fitted`; what is open; read back."""
    turn = next((value.value for value in fitted if value.key == TURN), given.rotate_deg)
    values = [*values_as_known(reader, given, turned=turn in (90, 270)), *fitted]
    # a frame may tell what was given, or what its file has, otherwise
    values = list({value.key: value for value in values}.values())
    present = {value.key for value in values}
    values += [
        DraftValue(key, light, "given")
        for name, key in LIGHT.items()
        if key not in present and (light := getattr(given, name))
    ]
    present = {value.key for value in values}
    rate = frame_rate(reader)
    open_keys = [*open_keys, *open_of_set(given, timed=rate is not None)]
    open_keys = [k for k in open_keys if k.key not in present]
    rows, cols = reader.shape
    depth = "fractions of full scale" if reader.bit_depth is None else f"{reader.bit_depth} bits"
    timed = "" if rate is None else f", {rate:.4g} a second by their times"
    frames = f"{Path(name_of(reader)).name}: {counted(reader.count(decode=False), 'frame')}"
    described_set = f"{frames} of {cols} x {rows} pixels, {depth}{timed}."
    head = [f"Drafted by isochrome init from {described_set}", *sentences]
    lines = [(value.key, *_written(value)) for value in values]
    text = scene_text(head, [*lines, *((k.key, "", f"fill in: {k.hint}") for k in open_keys)])
    return SceneDraft(
        text=text, scene=parse_scene(text, name="scene"), values=tuple(values),
        open=tuple(open_keys), warnings=tuple(warnings), frame=frame, chi=chi, draw=draw,
    )  # fmt: skip


def scene_text(head: Sequence[str], lines: Sequence[tuple[str, str, str]]) -> str:
    """A scene or set as TOML: sentences, then key, value, comment; no value: to be filled in."""
    parts = ["\n".join(line for sentence in head for line in _comment(sentence))]
    for table in ("beam", "disc", *Scene.model_fields, "uncertainty"):
        part = []
        for key, written, words in lines:
            if key.startswith(f"{table}."):
                name = key.partition(".")[2]
                line = f"{f'{name} = {written}'.ljust(_COMMENT_AT - 1)} # {words}"
                short = written and len(line) <= _WIDTH
                part += [line] if short else _comment(words)
                part += [] if short else [f"{name} = {written}" if written else f"# {name} ="]
        if part:
            parts.append("\n".join([f"[{table}]", *part]))
    return "\n\n".join(parts) + "\n"


def _written(value: DraftValue) -> tuple[str, str]:
    """A value as TOML, with as many digits as its ± allows, and where it is from."""
    if value.standard_uncertainty and not isinstance(value.value, str):
        number, spread = float(value.value), value.standard_uncertainty
        text = rounded_texts(number, spread)[0]
        shown = f", ± {with_uncertainty(number, spread).partition(' ± ')[2]}"
    else:
        text, shown = toml_text(value.value), ""
    return text, f"{_WORDS[value.origin]}{shown}{value.note and f'; {value.note}'}"


def _comment(text: str) -> list[str]:
    plain = "".join(c if c.isprintable() else " " for c in text)  # a file's name may hold anything
    return textwrap.wrap(
        plain, _WIDTH, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False
    )


Origin = Literal["file", "given", "found"]


@dataclass(frozen=True)
class DraftValue:
    """One value of a drafted scene.

    Parameters
    ----------
    key : str
        The scene's key, such as 'load.normal_n'.
    value : float, int or str
        The value, in the unit that the key names.
    origin : {'file', 'given', 'found'}
        Whether the frames' file tells it, the user, or the search found it.
    standard_uncertainty : float, optional
        In the same unit; None where it is not known, or the value is no measured number.
    note : str, default ''
        What the scene's comment adds.
    """

    key: str
    value: float | int | str
    origin: Origin
    standard_uncertainty: float | None = None
    note: str = ""

    @property
    def words(self) -> str:
        """The value with its uncertainty, for a report."""
        if self.standard_uncertainty is None or isinstance(self.value, str):
            return f"{self.value:g}" if isinstance(self.value, float) else str(self.value)
        return with_uncertainty(self.value, self.standard_uncertainty)


@dataclass(frozen=True)
class OpenKey:
    """A key that nobody knows yet: a line of the scene to fill in.

    Parameters
    ----------
    key : str
        The scene's key.
    hint : str
        What it is, its unit and what it usually is.
    """

    key: str
    hint: str


@dataclass(frozen=True, repr=False, kw_only=True)
class SceneDraft(Result):
    """A scene that was drafted from frames.

    Parameters
    ----------
    draw : callable, optional
        Makes the preview.
    text : str
        The scene as commented TOML.
    scene : Scene
        The same, read.
    values : tuple of DraftValue
        What stands in it, and where each value comes from.
    open : tuple of OpenKey
        What is left to fill in: comments of the text.
    warnings : tuple of str
        What to beware of, in sentences.
    frame : int
        The frame that was looked at.
    chi : float or None
        Residual over noise of the scene's fringes in that frame; None where none were fitted.
    """

    text: str
    scene: Scene
    values: tuple[DraftValue, ...]
    open: tuple[OpenKey, ...]
    warnings: tuple[str, ...]
    frame: int
    chi: float | None

    @property
    def found(self) -> tuple[DraftValue, ...]:
        """The values that were found in the frame."""
        return tuple(value for value in self.values if value.origin == "found")

    @property
    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row a value: its key, value, standard uncertainty and origin."""
        names = ("key", "value", "standard_uncertainty", "origin")
        return {name: [getattr(value, name) for value in self.values] for name in names}

    @property
    def title(self) -> str:
        """How much was found, and how much is open."""
        values, lines = counted(len(self.found), "value"), counted(len(self.open), "line")
        return f"Scene from frame {self.frame}: {values} found, {lines} to fill in"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """What was found, and chi."""
        yield from ((value.key, value.words) for value in self.found)
        if self.chi is not None:
            yield "chi", f"{self.chi:.3f}"

    def to_json(self) -> dict[str, Any]:
        """The frame, chi, the values with their origin, what is open, and the warnings."""
        return {
            "frame": self.frame,
            "chi": self.chi,
            "values": [asdict(value) for value in self.values],
            "open": [asdict(key) for key in self.open],
            **warnings_json(self.warnings),
        }


SCENE_FILE = "scene.toml"
"""What a scene is called that nobody has named."""

_LOOKED_AT = 5
"""Frames at the most in which a specimen is looked for, from the first to the last."""


def name_of(reader: FrameReader) -> str:
    """The frames' name, for messages."""
    first = reader.files[0]
    return str(first) if isinstance(first, Path) else "the frames"


def not_among_frames(frames: FramesLike) -> tuple[Path, ...]:
    """Files of a folder that its scene names; without one, no-load frames by their names."""
    if not (isinstance(frames, str | Path) and Path(frames).is_dir()):
        return ()
    folder = Path(frames)
    with suppress(InputError, OSError):
        return tuple(named_files(load_scene(folder / SCENE_FILE)))
    with suppress(OSError):  # said where the folder is opened
        named = likely_no_load(sorted(file.name for file in folder.iterdir() if file.is_file()))
        return tuple(folder / name for name in named.values())
    return ()


def open_questions(frames: FrameReader, given: KnownValues) -> tuple[str, ...]:
    """Fields of KnownValues that must be known besides; `QUANTITIES` has the words to ask."""
    names = [name for name in NEEDED[given.shape] if getattr(given, name) is None]
    if given.pixel_mm is None and frames.pixel_mm is None and given.shape not in WITH_OWN_SCALE:
        names.append("pixel_mm")
    if frames.channel is not None and given.channel is None and given.wavelength_nm is None:
        names.append("wavelength_nm")
    return tuple(names)


def refuse_unclear(reader: FrameReader, given: KnownValues) -> None:
    """Refuse to begin without what no frame tells, or where nobody tells its colours or scale."""
    name, unknown = name_of(reader), open_questions(reader, given)
    if missing := [name for name in unknown if name in NEEDED[given.shape]]:
        quantity = QUANTITIES[missing[0]]
        options = " and ".join(f"--{name.replace('_', '-')}" for name in missing)
        raise InputError(
            "not_known_no_frame", key=quantity.key, options=options, question=quantity.question
        )
    if "wavelength_nm" in unknown:
        raise InputError("has_red_green_blue", name=name, usual=QUANTITIES["wavelength_nm"].range)
    if "pixel_mm" in unknown:
        raise InputError("does_not_name_size", name=name, usual=QUANTITIES["pixel_mm"].range)
    if given.pixel_mm is not None:
        check_scale(reader, Camera(pixel_mm=given.pixel_mm))


def frames_to_look_at(reader: FrameReader, given: KnownValues) -> list[int]:
    """Numbers of the frames in which the specimen is looked for, in order."""
    count = reader.count(decode=False)
    if given.frame is None:
        return evenly_spaced(range(count), _LOOKED_AT)
    if given.frame >= count:
        raise InputError(
            "has_frame_asked_give", name_of=name_of(reader), counted=counted(count, "frame"),
            frame=given.frame, count=count - 1,
        )  # fmt: skip
    return [given.frame]


def frame_of(reader: FrameReader, index: int, given: KnownValues) -> Frame:
    """One frame, whose levels fit the sensor's bits."""
    frame = next(reader.iterate(index, index + 1))
    if given.bit_depth is None and reader.dtype.kind == "u" and (reader.bit_depth or 0) > 8:
        largest = int(frame.image.max())
        likely = next(bits for bits in range(8, 18, 2) if largest < 2**bits)
        if likely < (reader.bit_depth or 0):
            raise InputError(
                "largest_level_bits_file", name=frame.name, largest=largest, likely=likely,
                bit_depth=reader.bit_depth,
            )  # fmt: skip
    if reader.dtype.kind == "f" and given.bit_depth is None and float(np.nanmax(frame.image)) > 1.0:
        raise InputError("holds_fractions_up_full", name=frame.name, nanmax=np.nanmax(frame.image))
    return frame


def values_as_known(reader: FrameReader, given: KnownValues, *, turned: bool) -> list[DraftValue]:
    """The shape, what it needs as given, and the camera; `turned`: by a quarter turn."""
    shape, depth = given.shape, reader.bit_depth
    values = [DraftValue("specimen.shape", shape, "given")] * (shape in STATED_SHAPES)
    for name in NEEDED[shape] or NEEDED_BESIDE:
        if (value := getattr(given, name)) is not None:
            one = QUANTITIES[name]
            values.append(DraftValue(one.key, value, "given", note=one.unit))
    rows, cols = reader.shape[::-1] if turned else reader.shape
    turn = "after the turn by frames.rotate_deg" if turned else ""
    values.append(DraftValue("camera.width_px", cols, "file", note=turn))
    values.append(DraftValue("camera.height_px", rows, "file"))
    if depth is not None:
        origin: Origin = "file" if given.bit_depth is None else "given"
        values.append(DraftValue("camera.bit_depth", depth, origin))
    if given.pixel_mm is None and reader.pixel_mm is not None:
        values.append(DraftValue("camera.pixel_mm", reader.pixel_mm, "file"))
    return values


def open_of_set(given: KnownValues, *, timed: bool) -> list[OpenKey]:
    """What of the light and of the recording is still open, and of a scene without a model."""
    wavelength = QUANTITIES["wavelength_nm"]
    keys = [OpenKey(wavelength.key, wavelength.question)] * (given.wavelength_nm is None)
    for name, what in (("bright", "illumination"), ("dark", "background")):
        text = (
            f"a frame of the unloaded specimen in the {name} field, the {what}, such as "
            f'"no-load-{name}.tif"'
        )
        keys.append(OpenKey(f"frames.no_load_{name}", text))
    if timed:
        text = "sliding speed (mm/s), usually 1 to 500: gives the distance of each frame"
        keys.append(OpenKey("frames.sliding_speed_mm_per_s", text))
    if given.shape == "other":
        text = "orders that are known, such as [{ row_px = 480, col_px = 20, order = 0.0 }]"
        keys.append(OpenKey("frames.known_order", text))
    return keys


def frame_rate(reader: FrameReader) -> float | None:
    """Frames a second by the first ones' times; None where they carry none."""
    times = [frame.time_s for frame in islice(reader, _LOOKED_AT)]
    known = [time for time in times if time is not None]
    if len(known) < 2 or len(known) < len(times) or known[-1] <= known[0]:
        return None
    return (len(known) - 1) / (known[-1] - known[0])
