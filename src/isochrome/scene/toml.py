"""Scenes in and out of TOML, with errors that name the file, the key, the value and the fix.

Of an edited text all else stays, to the byte: it is read anew after an edit, and has to say what it
said before, but for the one key. tomlkit is imported where a text is edited or written.
"""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.scene import validation
from isochrome.scene.validation import DATE, DATED, NO_KEYS, SPREAD, VALUE, nearest, validate
from isochrome.scene.whole import Scene

if TYPE_CHECKING:
    from tomlkit import TOMLDocument
    from tomlkit.items import Item, Key

    "What stands in a table, in its order: values by key, comments and blank lines without."
    Body = list[tuple[Key | None, Item]]

LIBRARY = resources.files("isochrome.scene") / "library"
"""The scenes that ship inside the package."""

PICTURES = (
    b"II*\0", b"MM\0*", b"II+\0", b"MM\0+", b"\x89PNG", b"\xff\xd8\xff", b"BM", b"RIFF", b"GIF8",
    b"\x1aE\xdf\xa3",
)  # fmt: skip
"""How files of pictures and videos begin."""

MAX_BYTES = 1_000_000
"""A settings file, or a request to the set-up page, of over a megabyte is not one."""


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
        label, loaded = "scene", validate(Scene, as_tables(scene), "scene", reserved=NO_KEYS)
    elif str(scene) in (names := scene_names()):
        return parse_scene((LIBRARY / f"{scene}.toml").read_text("utf-8"), name=str(scene))
    else:
        path, label = Path(scene), str(Path(scene))
        if path.is_dir():
            raise InputError("folder_not_scene_file", scene=scene)
        if not path.is_file():
            near = nearest(str(scene), names)
            hint = f"did you mean '{near}'?" if near else "scenes by name: " + ", ".join(names)
            raise InputError("no_such_scene_file", scene=scene, hint=hint)
        loaded = parse_scene(read_text(path), name=path.stem, folder=path.parent, label=label)
    validation.check_reach(loaded.model_dump(exclude_unset=True), label)
    return loaded


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
    import tomlkit

    data = scene.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    for key, spread in scene.uncertainties.items():
        part, _, name = key.partition(".")
        value = data.get(part, {}).get(name)
        if isinstance(value, int | float):
            date = {DATE: scene.fringe_value_date} if key == DATED else {}
            pair = {VALUE: value, SPREAD: spread} | {k: v for k, v in date.items() if v}
            data[part][name] = tomlkit.value(toml_text(pair))  # on the key's own line
    return tomlkit.dumps(data)


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
    """Text of a settings file without a byte order mark; InputError: too large, no UTF-8."""
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
    """Plain dictionaries of mappings that are tables of a settings file, values as they are."""
    return {
        str(key): as_tables(value) if isinstance(value, Mapping) else value
        for key, value in data.items()
    }


def parse_toml(text: str, label: str) -> dict[str, Any]:
    """Tables of TOML text; InputError, with the line, where it is not TOML."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also of numbers of thousands of digits
        line_number = re.search(r"at line (\d+)", str(error))
        lines, cause = text.split("\n"), "correct that line"
        line = lines[min(int(line_number[1]), len(lines)) - 1] if line_number else ""
        comma = re.search(r"=\s*([-+]?\d+),(\d+)", line)
        if comma:
            cause = message("decimal_comma_write_point", comma=comma[1], comma_2=comma[2])
        elif re.search(r'"[^"]*\\', line):
            cause = message("backslash_double_quotes_write")
        raise InputError("not_valid_toml", label=label, error=error, cause=cause) from error


def with_value(
    text: str, key: str, written: str, *, comment: str = "", mark: str = "", name: str = "scene"
) -> str:
    """TOML text with a key set to a value `written`; InputError where no edit does only that.
    `comment`, without #, goes on its line, in place of an earlier one that begins with `mark`."""
    wanted = parse_toml(text, name)
    table, _, entry = key.partition(".")
    entries = wanted.setdefault(table, {})
    by_hand = message("layout_cannot_edited_set", name=name, key=key, written=written)
    if not isinstance(entries, dict):
        raise InputError(by_hand)
    entries[entry] = tomllib.loads(f"value = {written}")["value"]
    return _edited(
        text, lambda doc: _set(doc, (table, entry), written, comment, mark), by_hand, wanted
    )


def without_value(text: str, key: str, *, name: str = "scene") -> str:
    """TOML text without a key or table and its line's comment; InputError: no edit does that."""
    wanted = parse_toml(text, name)
    table, _, entry = key.partition(".")
    holder = wanted.get(table, {}) if entry else wanted
    if (entry or table) not in holder:
        return text
    del holder[entry or table]
    emptied = copy.deepcopy(wanted)
    if entry and not holder:
        del emptied[table]  # a table that held nothing else may go with it
    by_hand = message("layout_cannot_edited_take", name=name, key=key)
    return _edited(text, lambda doc: _take_out(doc, key.split(".")), by_hand, wanted, emptied)


def with_table_list(
    text: str, key: str, entries: Sequence[Mapping[str, Any]], *, name: str = "scene"
) -> str:
    """TOML text with a list of tables, such as [[frames.known_order]]; no entries take it out.
    Tables that stay keep place and comments; InputError where no edit does only that."""
    if not entries:
        return without_value(text, key, name=name)
    wanted = parse_toml(text, name)
    table, _, entry_name = key.partition(".")
    holder = wanted.setdefault(table, {}) if entry_name else wanted
    tables_now = holder.get(entry_name or table, [])
    holder[entry_name or table] = tables = [dict(entry) for entry in entries]
    stay = [entry for entry in tables_now if entry in tables]
    stay = stay if tables[: len(stay)] == stay else []
    by_hand = message("layout_cannot_edited_write", name=name, key=key)
    return _edited(text, lambda doc: _set_list(doc, key.split("."), stay, tables), by_hand, wanted)


def with_list_value(
    text: str, key: str, place: int, entry: str, value: Any, *, name: str = "scene"
) -> str:
    """TOML text with one value of a list's tables set; InputError where no edit does only that."""
    wanted = parse_toml(text, name)
    wanted[key][place][entry] = value

    def edit(document: TOMLDocument) -> None:
        document[key][place][entry] = value

    what = f"{entry} = {value} of {key} {place + 1}"
    by_hand = message("layout_cannot_edited_set_hand", name=name, what=what)
    return _edited(text, edit, by_hand, wanted)


def toml_text(value: Any) -> str:
    """A plain value as TOML, in one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        # a basic string of TOML is one of JSON, but for the letter DEL
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{k} = {toml_text(v)}" for k, v in value.items()) + " }"
    return "[" + ", ".join(map(toml_text, value)) + "]"


def _edited(
    text: str, edit: Callable[[TOMLDocument], str | None], by_hand: str, *wanted: Mapping[str, Any]
) -> str:
    """An edited document's text, and what `edit` returns; InputError: it says none of `wanted`."""
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    windows = 0 < text.count("\r\n") == text.count("\n")
    plain = text.replace("\r\n", "\n") if windows else text
    added = "\n" if plain and not plain.endswith("\n") else ""
    try:
        document = tomlkit.parse(plain + added)
        if "".join(document.as_string().split()) != "".join(plain.split()):
            raise InputError(by_hand)
        behind = edit(document) or ""
        edited = document.as_string()
    except (TOMLKitError, RecursionError) as error:
        raise InputError(by_hand) from error
    edited = edited if behind else edited.removesuffix(added)
    edited += "\n" + behind if behind and edited.strip() else behind
    edited = edited.replace("\n", "\r\n") if windows else edited
    with suppress(InputError):
        if parse_toml(edited, "scene") in wanted:
            return edited
    raise InputError(by_hand)


def _set(
    document: TOMLDocument, path: tuple[str, str], written: str, comment: str, mark: str
) -> str:
    """Set a value where its key stands, or on top of its table; returns a table to be added."""
    import tomlkit
    from tomlkit.items import AoT, InlineTable, Table

    places = list(_places(document.body, path))
    if len(places) == 1 and not isinstance(places[0][0][places[0][1]][1], AoT | Table):
        body, at, line = places[0]
        key, old = body[at]
        new = tomlkit.value(written)
        vars(new.trivia).update(vars(old.trivia))
        body[at] = key, new
        _note(line or new, comment, mark)
        return ""
    _take_out(document, path)
    entry = f"{path[1]} = {written}"
    ending = f"  # {comment}\n" if comment else "\n"
    for body, at, _ in _places(document.body, path[:1]):
        key, table = body[at]
        if isinstance(table, InlineTable):
            table.append(path[1], tomlkit.value(written))
            _note(table, comment, mark)
            return ""
        dotted = key is not None and key.is_dotted()
        if isinstance(table, Table) and (dotted or not table.is_super_table()):
            table.value.body[:0] = tomlkit.parse(entry + ending).body
            return ""
    return f"[{path[0]}]\n{entry}{ending}"


def _set_list(
    document: TOMLDocument,
    path: Sequence[str],
    stay: Sequence[Mapping[str, Any]],
    entries: Sequence[Mapping[str, Any]],
) -> str:
    """Set a list's tables, of which the first may stay as they are; returns tables to be added."""
    import tomlkit
    from tomlkit.items import AoT, Whitespace

    new = "\n".join(
        f"[[{'.'.join(path)}]]\n" + "".join(f"{k} = {toml_text(v)}\n" for k, v in entry.items())
        for entry in entries[len(stay) :]
    )
    places = [body[at][1] for body, at, _ in _places(document.body, path)]
    if not stay or len(places) != 1 or not isinstance(places[0], AoT):
        _take_out(document, path)
        return new
    nearest = places[0]
    tables, behind = [], ""
    for table in nearest.body:
        before, behind = behind, _cut(table)
        if table.unwrap() in stay:
            table.trivia.indent = before + table.trivia.indent
            tables.append(table)
        else:
            behind = before + behind
    if new:
        ((body, at, _),) = _places(tomlkit.parse(new).body, path)
        added = cast(AoT, body[at][1]).body
        added[0].trivia.indent = "\n"
        tables += added
    tables[-1].value.body.append((None, Whitespace(behind)))
    nearest.body[:] = tables
    return ""


def _take_out(document: TOMLDocument, path: Sequence[str]) -> None:
    """Take a value out, or the tables of its name; comments behind them stay."""
    from tomlkit.items import AoT, Null, Table, Whitespace

    for body, at, _ in list(_places(document.body, path)):
        item = body[at][1]
        behind = re.sub(r"(?m)^[ \t]*\n", "", _cut(item))
        body[at] = None, Whitespace(behind) if isinstance(item, AoT | Table) else Null()


def _places(
    body: Body, path: Sequence[str], line: Item | None = None
) -> Iterator[tuple[Body, int, Item | None]]:
    """Where a name stands: its body, the place there, and the inline table on whose line."""
    from tomlkit.items import InlineTable, Table

    for at, (key, item) in enumerate(body):
        if key is None or key.key != path[0]:
            continue
        if len(path) == 1:
            yield body, at, line
        elif isinstance(item, Table | InlineTable):
            inline = item if isinstance(item, InlineTable) else None
            yield from _places(item.value.body, path[1:], line or inline)


def _note(item: Item, comment: str, mark: str) -> None:
    """Put a comment on a value's line, in place of one that begins with a mark."""
    if not comment:
        return
    trivia = item.trivia
    remaining = re.sub(rf";?[ \t]*{mark}[^;]*", "", trivia.comment) if mark else trivia.comment
    remaining = remaining.replace("#;", "#").rstrip()
    trivia.comment_ws = trivia.comment_ws or "  "
    trivia.comment = ("# " if remaining in ("", "#") else f"{remaining}; ") + comment


def _cut(table: Item) -> str:
    """Cut off the comments and blank lines that end a table: they may belong to what comes next."""
    from tomlkit.items import AoT, Table

    if isinstance(table, AoT):
        return _cut(table.body[-1])
    if not isinstance(table, Table):
        return ""
    body, behind = table.value.body, ""
    while body and body[-1][0] is None:
        behind = body.pop()[1].as_string() + behind
    return (_cut(body[-1][1]) if body else "") + behind
