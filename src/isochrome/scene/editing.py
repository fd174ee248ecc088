"""One value or list of tables set in TOML text by tomlkit: all else in it stays, to the byte.

After an edit the text is read anew: it has to say what it said before, but for the one key. tomlkit
is imported where a text is edited, which few commands do.
"""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, cast

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.scene.toml import parse_toml

if TYPE_CHECKING:
    from tomlkit import TOMLDocument
    from tomlkit.items import Item, Key

    Body = list[tuple[Key | None, Item]]
    """What stands in a table, in its order: values by key, comments and blank lines without."""


def with_value(
    text: str, key: str, written: str, *, comment: str = "", mark: str = "", name: str = "scene"
) -> str:
    """TOML text with a key, such as 'load.normal_n', set to a value `written` as TOML.

    `comment`, without #, goes on its line; where it begins with `mark`, an earlier one is replaced.
    `name` is the text's in messages. InputError where no edit does only that.
    """
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
    """TOML text without a key, such as 'load.bulk_mpa', and the comment on its line.

    A name alone is a whole table; a key that is not there leaves the text as it is. InputError
    where no edit does only that.
    """
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
    """TOML text with a list of tables, such as [[frames.known_order]]; a name alone is [[image]].

    Tables that stay keep their place and comments, new ones come behind them; no entries take the
    list out. InputError where no edit does only that.
    """
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
    """TOML text with an entry of one of a list's tables, such as load_n of the first [[image]].

    InputError where no edit does only that.
    """
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
    """Text whose document was edited, with what `edit` returns behind it.

    InputError `by_hand` where it then says none of `wanted`, or tomlkit, which joins a list's
    tables that stand apart, moves something. A blank within a line may go (behind a date in braces,
    as of 0.15).
    """
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
    """Set a value where its key stands, or else on top of its table; returns a table to be added.

    An inline table is one value, whose line the comment stands on.
    """
    import tomlkit
    from tomlkit.items import AoT, InlineTable, Table

    places = list(_places(document.body, path))
    if len(places) == 1 and not isinstance(places[0][0][places[0][1]][1], AoT | Table):
        body, at, line = places[0]
        written_line = _replace(body, at, written)
        _note(line or written_line, comment, mark)
        return ""
    _take_out(document, path)
    entry = f"{path[1]} = {written}"
    ending = f"  # {comment}\n" if comment else "\n"
    for body, at, _ in _places(document.body, path[:1]):
        key, table = cast("tuple[Key, Item]", body[at])
        if isinstance(table, InlineTable):
            inner = table.as_string()[1:].lstrip(" \t")
            written_line = _replace(body, at, f"{{ {entry}{' ' if inner == '}' else ', '}{inner}")
            _note(written_line, comment, mark)
            return ""
        if isinstance(table, Table) and (key.is_dotted() or not table.is_super_table()):
            table.value.body[:0] = tomlkit.parse(entry + ending).body
            return ""
    return f"[{path[0]}]\n{entry}{ending}"


def _set_list(
    document: TOMLDocument,
    path: Sequence[str],
    stay: Sequence[Mapping[str, Any]],
    entries: Sequence[Mapping[str, Any]],
) -> str:
    """Set a list's tables, of which the first may stay as they are written; if none does, all go.

    Returns tables to be added.
    """
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
    """Where a name stands, or each part of its table.

    As the body that holds it, the place in that, and the inline table whose line it is on.
    """
    from tomlkit.items import InlineTable, Table

    for at, (key, item) in enumerate(body):
        if key is None or key.key != path[0]:
            continue
        if len(path) == 1:
            yield body, at, line
        elif isinstance(item, Table | InlineTable):
            inline = item if isinstance(item, InlineTable) else None
            yield from _places(item.value.body, path[1:], line or inline)


def _replace(body: Body, at: int, written: str) -> Item:
    """Put a value in place of another, with what stands around that. Returns it."""
    import tomlkit

    key, old = body[at]
    new = tomlkit.value(written)
    vars(new.trivia).update(vars(old.trivia))
    body[at] = key, new
    return new


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
