"""One value or list of tables set in TOML text: all else in it stays, to the byte.

TOML allows one key in many layouts. Every plausible place in the text is tried, and the first
edit is taken after which the text says what it said before, but for the one key.
"""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from isochrome.errors import InputError
from isochrome.scene.toml import parse_toml

_CLOSED_BY = {"[": "]", "{": "}"}
_QUOTES = ('"""', "'''", '"', "'")


def with_value(
    text: str, key: str, written: str, *, comment: str = "", mark: str = "", name: str = "scene"
) -> str:
    """TOML text with a key, such as 'load.normal_n', set to a value `written` as TOML.

    `comment`, without #, goes on its line; where it begins with `mark`, an earlier one is replaced.
    `name` is the text's in messages. InputError where no edit does only that.
    """
    wanted = parse_toml(text, name)
    table, _, entry = key.partition(".")
    own = wanted.setdefault(table, {})
    if isinstance(own, dict):
        own[entry] = tomllib.loads(f"value = {written}")["value"]
        note = _Note(comment, mark)
        for candidate in _settings(text, (table, entry), written, note):
            if _says(candidate, wanted):
                return candidate
    raise InputError(f"{name}: its layout cannot be edited; set {key} = {written} in it by hand")


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
    tries = _removals(text, table, entry) if entry else iter([_without_tables(text, _path(key))])
    emptied = copy.deepcopy(wanted)
    if entry and not holder:
        del emptied[table]  # a table that held nothing else may go with it
    for candidate in tries:
        if _says(candidate, wanted) or _says(candidate, emptied):
            return candidate
    raise InputError(f"{name}: its layout cannot be edited; take {key} out of it by hand")


def with_table_list(
    text: str, key: str, entries: Sequence[Mapping[str, Any]], *, name: str = "scene"
) -> str:
    """TOML text with a list of tables, such as [[frames.known_order]]; a name alone is [[image]].

    Tables that stay keep their place and comments, new ones come behind them; no entries take the
    list out. InputError where no edit does only that.
    """
    wanted = parse_toml(text, name)
    table, _, entry_name = key.partition(".")
    holder = wanted.setdefault(table, {}) if entry_name else wanted
    there = holder.get(entry_name or table, [])
    if not entries:
        return without_value(text, key, name=name)
    holder[entry_name or table] = [dict(entry) for entry in entries]
    changed = _changed_list(text, key, there, entries)
    if changed is not None and _says(changed, wanted):
        return changed
    found = _with_tables(without_value(text, key, name=name), key, entries)
    if not _says(found, wanted):
        raise InputError(f"{name}: its layout cannot be edited; write [[{key}]] in it by hand")
    return found


def _with_tables(text: str, key: str, entries: Sequence[Mapping[str, Any]]) -> str:
    """Text with a list's tables behind it."""
    end = _line_end(text)
    blocks = (
        f"[[{key}]]{end}" + "".join(f"{k} = {toml_text(v)}{end}" for k, v in entry.items())
        for entry in entries
    )
    gap = end if text.strip() else ""
    start = text if not text or text.endswith("\n") else text + end
    return start + gap + end.join(blocks)


def _changed_list(
    text: str, key: str, there: Sequence[Any], entries: Sequence[Mapping[str, Any]]
) -> str | None:
    """Text whose list's tables stay as they are written where they are still wanted.

    Those that are not go with what stands in them, and new ones come behind the last; None where
    none stays, or the list is written otherwise.
    """
    lines = text.splitlines(keepends=True)
    blocks = list(_blocks(lines, _path(key)))
    stay = [dict(entry) in map(dict, entries) for entry in there]
    if len(blocks) != len(there) or not any(stay):
        return None
    new = [entry for entry in entries if dict(entry) not in there]
    at = max(end for (_, end), kept in zip(blocks, stay, strict=True) if kept)
    if not any(re.match(r"[ \t]*\[", line) for line in lines[at:]):
        at = len(lines)  # what stands behind the last one is of the list too
    gone = {i for span, kept in zip(blocks, stay, strict=True) if not kept for i in range(*span)}
    before, after = (
        "".join(lines[i] for i in places if i not in gone)
        for places in (range(at), range(at, len(lines)))
    )
    return _with_tables(before, key, new) + after if new else before + after


def _blocks(lines: Sequence[str], path: str) -> Iterator[tuple[int, int]]:
    """First line of each of a list's tables, and the one behind the last that is no comment."""
    heads = [i for i, line in enumerate(lines) if re.match(r"[ \t]*\[", line)]
    own = re.compile(rf"[ \t]*\[\[[ \t]*{path}[ \t]*\]\]")
    for start, end in zip(heads, [*heads[1:], len(lines)], strict=True):
        if own.match(lines[start]):
            filled = [
                i for i in range(start, end) if lines[i].strip() and lines[i].strip()[0] != "#"
            ]
            yield start, filled[-1] + 1


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


class _Note:
    """A comment for a line, and what an earlier one of its kind begins with."""

    def __init__(self, comment: str, mark: str) -> None:
        self.comment, self.mark = comment, mark

    @property
    def ending(self) -> str:
        """What stands behind a new line's value."""
        return f"  # {self.comment}" if self.comment else ""

    def placed(self, before: str, after: str) -> Iterator[str]:
        """The text with the comment on this line, beside one that is there, and without it."""
        rest = re.match(r"""(?P<code>[^\r\n#"']*)(?P<comment>#[^\r\n]*)?""", after)
        if self.comment and rest is not None:
            code, kept = rest["code"].rstrip(" \t"), rest["comment"] or ""
            gap = rest["code"][len(code) :] or "  "
            own = re.sub(rf";?[ \t]*{self.mark}[^;]*", "", kept) if self.mark else kept
            own = own.replace("#;", "#").rstrip()
            joint = "# " if own in ("", "#") else f"{own}; "
            yield f"{before}{code}{gap}{joint}{self.comment}{after[rest.end() :]}"
        yield before + after


def _settings(text: str, key: tuple[str, str], value: str, note: _Note) -> Iterator[str]:
    """Edits that may be the right one: the value where the key stands, else the key put in."""
    table, entry = map(_quoted, key)
    for start, end in _values(text, entry):
        yield from note.placed(text[:start] + value, text[end:])
    line_end = _line_end(text)
    line = f"{key[1]} = {value}"
    head = rf"^[ \t]*\[[ \t]*{table}[ \t]*\][^\r\n]*\r?\n?"
    for found in re.finditer(head, text, re.M):
        before = text[: found.end()]
        before += "" if before.endswith("\n") else line_end
        yield f"{before}{line}{note.ending}{line_end}{text[found.end() :]}"
    inline = rf"{table}[ \t]*=[ \t]*\{{[ \t]*(?P<rest>\}}?)"
    for found in re.finditer(inline, text):
        start = found.start("rest")
        comma = " " if found["rest"] else ", "
        yield from note.placed(text[:start] + line + comma, text[start:])
    for found in re.finditer(rf"^[ \t]*{table}[ \t]*\.", text, re.M):
        before, after = text[: found.start()], text[found.start() :]
        yield f"{before}{key[0]}.{line}{note.ending}{line_end}{after}"
    gap = "" if not text or text.endswith("\n") else line_end
    yield f"{text}{gap}{line_end}[{key[0]}]{line_end}{line}{note.ending}{line_end}"
    rest = _without_tables(text, _path(".".join(key)))  # where it is a table of its own
    if rest != text:
        yield from _settings(rest, key, value, note)


def _removals(text: str, table: str, entry: str) -> Iterator[str]:
    """Edits that may be the right one, of a key that goes: its line, its part, its own tables."""
    yield _without_tables(text, _path(f"{table}.{entry}"))
    whole = rf"(?:{_quoted(table)}[ \t]*\.[ \t]*)?{_quoted(entry)}"
    for start, end in _values(text, whole):
        line = text.rfind("\n", 0, start) + 1
        stop = text.find("\n", end)
        yield text[:line] + (text[stop + 1 :] if stop >= 0 else "")
        named = next(re.finditer(rf"{whole}[ \t]*=[ \t]*$", text[:start]), None)
        if named is None:
            continue
        before, after = text[: named.start()], text[end:]
        yield before + re.sub(r"^[ \t]*,[ \t]*", "", after)
        yield re.sub(r"[ \t]*,[ \t]*$", "", before) + after


def _without_tables(text: str, path: str) -> str:
    """Text without the blocks whose head is a table, or a list's table, of a path or below it."""
    lines, kept, inside = text.splitlines(keepends=True), [], False
    head = re.compile(rf"[ \t]*\[\[?[ \t]*{path}[ \t]*[\].]")
    for line in lines:
        if re.match(r"[ \t]*\[", line):
            inside = bool(head.match(line))
        elif inside and line.lstrip().startswith("#"):
            kept.append(line)  # a comment may belong to what comes next
            continue
        if not inside:
            kept.append(line)
    return "".join(kept)


def _values(text: str, entry: str) -> Iterator[tuple[int, int]]:
    """Where values of a key may stand: start and end of each."""
    for found in re.finditer(rf"{entry}[ \t]*=[ \t]*", text):
        end = _value_end(text, found.end())
        if end is not None:
            yield found.end(), end


def _value_end(text: str, start: int) -> int | None:
    """Where a value of TOML ends that begins at a place; None where it does not end."""
    depth: list[str] = []
    at = start
    while at < len(text):
        quote = next((q for q in _QUOTES if text.startswith(q, at)), None)
        if quote is not None:
            at = _string_end(text, at + len(quote), quote)
            if at < 0:
                return None
            if not depth:
                return at
            continue
        letter = text[at]
        if letter in _CLOSED_BY:
            depth.append(_CLOSED_BY[letter])
        elif depth and letter == depth[-1]:
            depth.pop()
            if not depth:
                return at + 1
        elif depth and letter == "#":
            at = text.find("\n", at)
            if at < 0:
                return None
        elif not depth and letter in ",]}#\r\n \t":
            return at if at > start else None
        at += 1
    return None if depth or at == start else at


def _string_end(text: str, at: int, quote: str) -> int:
    """Where a string ends behind its first quote; -1 where it does not."""
    while at < len(text):
        if quote.startswith('"') and text[at] == "\\":
            at += 2
        elif text.startswith(quote, at):
            return at + len(quote)
        else:
            at += 1
    return -1


def _path(key: str) -> str:
    """A pattern for a dotted name."""
    return r"[ \t]*\.[ \t]*".join(map(_quoted, key.split(".")))


def _quoted(name: str) -> str:
    """A pattern for a name of TOML, plain or in quotes."""
    return rf"""(?:"{name}"|'{name}'|(?<![\w-]){name}(?![\w-]))"""


def _line_end(text: str) -> str:
    return "\r\n" if "\r\n" in text else "\n"


def _says(text: str, wanted: Mapping[str, Any]) -> bool:
    try:
        return parse_toml(text, "scene") == wanted
    except InputError:
        return False
