"""Sentences for people as data: each has a code and values, and `messages.json` its words."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any


class Message(str):
    """A sentence with the `code` of its words and the `values` in them, whatever stands around
    it."""

    code: str
    values: dict[str, Any]

    def __new__(cls, text: str, code: str, values: dict[str, Any]) -> Message:
        """Take the text as it is: `message` makes it from code and values."""
        self = super().__new__(cls, text)
        self.code, self.values = code, values
        return self

    def __add__(self, other: str) -> Message:
        """Itself with a text behind it, and the values of a message there."""
        return Message(f"{self}{other}", self.code, getattr(other, "values", {}) | self.values)

    def __radd__(self, other: str) -> Message:
        """Itself with a text before it."""
        return Message(f"{other}{self}", self.code, self.values)

    def __reduce__(self) -> tuple[type[Message], tuple[str, str, dict[str, Any]]]:
        """What another process makes it from."""
        return Message, (str(self), self.code, self.values)


def message(code: str, **values: Any) -> str:
    """The Message of a code: its words in `messages.json`, with values in their places."""
    return Message(_by_code()[code].texts[code].format(**values), code, values)


def as_message(text: str, values: Mapping[str, Any]) -> str:
    """The Message of a code and its values; any other text as it is."""
    return message(text, **values) if values or text in _by_code() else text


def reworded(text: str, words: str) -> str:
    """A message in other words, with its code and values."""
    return Message(words, text.code, text.values) if isinstance(text, Message) else words


@dataclass(frozen=True)
class Entry:
    """What one or several messages mean, whose words by code are `texts`; of a `room`."""

    room: str
    title: str
    meaning: str
    cause: str
    remedy: str
    texts: dict[str, str]


@cache
def entries() -> tuple[Entry, ...]:
    """All messages of the package, by what they mean."""
    table = Path(__file__).with_name("messages.json").read_text("utf-8")
    return tuple(Entry(**entry) for entry in json.loads(table))


@cache
def _by_code() -> dict[str, Entry]:
    return {code: entry for entry in entries() for code in entry.texts}


def entry_of(text: str) -> Entry | None:
    """What a message means; None of a text that is none."""
    return _by_code().get(getattr(text, "code", ""))


def messages_data(texts: Iterable[str]) -> list[dict[str, Any]]:
    """Messages as JSON has them: code ("" of a text that has none), values, text."""
    data = []
    for text in texts:
        values = {}
        for name, value in getattr(text, "values", {}).items():
            value = value.item() if hasattr(value, "item") else value  # a number of numpy's
            values[name] = value if isinstance(value, int | float | None) else str(value)
        data.append({"code": getattr(text, "code", ""), "values": values, "text": str(text)})
    return data


def warnings_json(texts: Iterable[str]) -> dict[str, Any]:
    """Warnings as a result's JSON has them: as texts, and as messages with code and values."""
    texts = list(texts)
    return {"warnings": texts, "messages": messages_data(texts)}


def read_messages(data: Iterable[Mapping[str, Any]]) -> tuple[str, ...]:
    """Messages from their JSON."""
    return tuple(
        Message(one["text"], one["code"], one["values"]) if one["code"] else one["text"]
        for one in data
    )


def read_warnings(content: Mapping[str, Any]) -> tuple[str, ...]:
    """The warnings of a result's JSON; older ones have their texts alone."""
    data = content.get("messages")
    return tuple(content["warnings"]) if data is None else read_messages(data)


def frame_messages(texts: Iterable[str]) -> str:
    """The messages of a frame as JSON in a cell, empty where there are none."""
    data = messages_data(texts)
    return json.dumps(data) if data else ""


def read_frame_messages(cell: str | None) -> tuple[str, ...]:
    """The messages of a frame from its cell."""
    return read_messages(json.loads(cell)) if cell else ()
