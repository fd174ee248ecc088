"""Scenes in and out of TOML, with errors that name the file, the key, the value and the fix."""

import re
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.scene.validation import DATED, NO_KEYS, as_text, check_reach, nearest, validate
from isochrome.scene.whole import Scene

LIBRARY = resources.files("isochrome.scene") / "library"
"""The scenes that ship inside the package."""

PICTURES = (
    b"II*\0", b"MM\0*", b"II+\0", b"MM\0+", b"\x89PNG", b"\xff\xd8\xff", b"BM", b"RIFF", b"GIF8",
    b"\x1aE\xdf\xa3",
)  # fmt: skip
"""How files of pictures and videos begin."""

MAX_BYTES = 1_000_000
"""A settings file of over a megabyte is not one."""


SceneLike = str | Path | Scene | Mapping[str, Any]
"""A scene as a caller may give it: a file, a name, a Scene, or its tables."""


def load_scene(scene: SceneLike) -> Scene:
    """Read a scene: a TOML file's path, the name of one inside the package, or its tables.

    Every key is checked, with its unit and its range; unknown keys are refused.

    Parameters
    ----------
    scene : str, Path, Scene or mapping
        A path, a name such as 'line-contact-wear', a Scene, which is returned as it is, or the
        tables of a scene's file as dictionaries. In these, numbers may be numpy's, and images (the
        no-load frames and the mask) arrays; paths are relative to the working folder.

    Returns
    -------
    Scene
        The validated scene.

    Raises
    ------
    InputError
        Where the file cannot be read or a value is wrong; it names the file, key, value and fix.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("line-contact-wear")
    >>> scene.model, scene.load.normal_n
    ('contact', 44.0)
    >>> import numpy
    >>> scene = isochrome.load_scene({
    ...     "specimen": {"thickness_mm": 4.0},
    ...     "frames": {"no_load_bright": numpy.full((494, 659), 200, dtype="uint8")},
    ... })
    >>> scene.frames.no_load_bright
    <array of 494 x 659 uint8>
    """
    if isinstance(scene, Scene):
        return scene
    if isinstance(scene, Mapping):
        scene_of_tables = validate(Scene, as_tables(scene), "scene", reserved=NO_KEYS)
        check_reach(scene_of_tables.model_dump(exclude_unset=True), "scene")
        return scene_of_tables
    path = Path(scene)
    if str(scene) in scene_names():
        return parse_scene((LIBRARY / f"{scene}.toml").read_text("utf-8"), name=str(scene))
    if path.is_dir():
        raise InputError("folder_not_scene_file", scene=scene)
    if not path.is_file():
        near = nearest(str(scene), scene_names())
        hint = f"did you mean '{near}'?" if near else "scenes by name: " + ", ".join(scene_names())
        raise InputError("no_such_scene_file", scene=scene, hint=hint)
    scene_of_tables = parse_scene(
        read_text(path), name=path.stem, folder=path.parent, label=str(path)
    )
    check_reach(scene_of_tables.model_dump(exclude_unset=True), str(path))
    return scene_of_tables


def parse_scene(
    text: str, *, name: str = "scene", folder: Path | None = None, label: str | None = None
) -> Scene:
    r"""Make a scene from TOML text.

    The keys are those of a scene's file, and are checked alike.

    Parameters
    ----------
    text : str
        TOML text.
    name : str, default 'scene'
        Name of the scene, in titles and messages.
    folder : Path, optional
        Folder to which the paths in the scene are relative; by default the working one.
    label : str, optional
        What errors call the text; by default `name`.

    Returns
    -------
    Scene
        The validated scene.

    Raises
    ------
    InputError
        Where the text is no TOML or a value is wrong; it names the key, value and fix.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.parse_scene("[specimen]\nthickness_mm = 4.0")
    >>> scene.specimen.thickness_mm
    4.0
    """
    data = parse_toml(text, label or name)
    scene = validate(Scene, data, label or name, reserved=NO_KEYS, folder=folder)
    return scene.model_copy(update={"name": name, "folder": folder})


def dump_scene(scene: Scene) -> str:
    """Write a scene as TOML text.

    Only what was set is written; reading the text back by the same name gives an equal scene.

    Parameters
    ----------
    scene : Scene
        The scene to write.

    Returns
    -------
    str
        TOML text.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("ring")
    >>> text = isochrome.dump_scene(scene)
    >>> isochrome.parse_scene(text, name=scene.name) == scene
    True
    """
    import tomli_w

    data = scene.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    stated = {}
    for key, spread in scene.uncertainties.items():
        part, _, name = key.partition(".")
        value = data.get(part, {}).get(name)
        if isinstance(value, int | float):
            # a key's own place, for the writer makes a table of its own of a dictionary
            data[part][name] = f"{{{key}}}"
            date = scene.fringe_value_date if key == DATED else None
            stated[f'{name} = "{{{key}}}"\n'] = f"{name} = {as_text(value, spread, date)}\n"
    text = tomli_w.dumps(data)
    for place, line in stated.items():
        text = text.replace(place, line)
    return text


def scene_names() -> list[str]:
    """List the names of the scenes that ship inside the package.

    Each of them may stand wherever a scene is asked for.

    Returns
    -------
    list of str
        The names, in alphabetical order.

    Examples
    --------
    >>> import isochrome
    >>> isochrome.scene_names()
    ['line-contact-wear', 'ring']
    """
    names = (file.name for file in LIBRARY.iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def read_text(path: Path) -> str:
    """Text of a settings file, without the mark that some editors begin UTF-8 with.

    InputError where it is missing, too large or not UTF-8.
    """
    try:
        with open(path, "rb") as file:
            head = file.read(16)
        if head.startswith(PICTURES) or head[4:8] == b"ftyp":
            raise InputError("picture_video_not_settings", path=path)
        if path.stat().st_size > MAX_BYTES:
            raise InputError("larger_bytes_settings_file", path=path, max_bytes=MAX_BYTES)
        if head.startswith((b"\xff\xfe", b"\xfe\xff")):
            raise InputError("utf_text_byte_order", path=path)
        return path.read_text("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError("not_utf_text_save", path=path) from error
    except OSError as error:
        raise InputError("cannot_read_check_name_2", path=path, error=error.strerror) from error


def as_tables(data: Mapping[str, Any]) -> dict[str, Any]:
    """Plain dictionaries of mappings that are tables of a settings file, with the values as they
    are.
    """
    return {
        str(key): as_tables(value) if isinstance(value, Mapping) else value
        for key, value in data.items()
    }


def parse_toml(text: str, label: str) -> dict[str, Any]:
    """Tables of TOML text; InputError, with the line, where it is not TOML."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also of numbers of thousands of digits
        cause = _slip_in_line(text, str(error))
        raise InputError(
            "not_valid_toml", label=label, error=error, cause=cause or "correct that line"
        ) from (error)


def _slip_in_line(text: str, reason: str) -> str:
    """What is wrong with the line that a message of the TOML reader names, where that is known."""
    match = re.search(r"at line (\d+)", reason)
    lines = text.split("\n")
    line = lines[min(int(match[1]), len(lines)) - 1] if match else ""
    comma = re.search(r"=\s*([-+]?\d+),(\d+)", line)
    if comma:
        return message("decimal_comma_write_point", comma=comma[1], comma_2=comma[2])
    if re.search(r'"[^"]*\\', line):
        return message("backslash_double_quotes_write")
    return ""
