"""What a message means, by the guide's own page of messages."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache, lru_cache

from isochrome.guide.pages import guide_page

GAP = "…"
"""What stands on the page for a value that is put into a sentence."""

_SHORTEST = 12
"""Letters of a message that are to be recognised: shorter ones are parts of many others."""


@dataclass(frozen=True)
class Explanation:
    """An entry of the page of messages; a sentence or some each."""

    title: str
    meaning: str
    cause: str
    remedy: str


def explain_message(text: str) -> Explanation | None:
    """Find a message, with its values, on the guide's page, by the words that are always the same.

    Digits count as any other digits: thousands of a run's messages differ by nothing else. Of
    several entries that fit the one decides of whose message most letters are recognised. None
    where the page does not have it.
    """
    return _explanation(_any_digits(" ".join(text.split())))


@lru_cache(maxsize=10_000)
def _explanation(text: str) -> Explanation | None:
    fitting = (
        (sum(map(len, parts)), entry) for parts, entry in _messages() if _stands_in(parts, text)
    )
    return max(fitting, key=lambda pair: pair[0], default=(0, None))[1]


def _stands_in(parts: tuple[str, ...], text: str) -> bool:
    """Whether parts stand in a text, one after the other."""
    at = 0
    for part in parts:
        found = text.find(part, at)
        if found < 0:
            return False
        at = found + len(part)
    return True


@cache
def _messages() -> tuple[tuple[tuple[str, ...], Explanation], ...]:
    """The fixed parts of each message of the page, with its entry."""
    found = []
    for section in guide_page("messages").split("\n### ")[1:]:
        title, _, rest = section.partition("\n")
        words = [_words_of(name, rest) for name in ("Meaning", "Cause", "Remedy")]
        entry = Explanation(_plain(title), *words)
        for message in re.findall(r"^- “(.*)”$", rest, re.MULTILINE):
            own = _any_digits(_plain(message))
            parts = tuple(part for part in own.split(GAP) if part.strip())
            if sum(map(len, parts)) >= _SHORTEST:
                found.append((parts, entry))
    return tuple(found)


def _words_of(name: str, section: str) -> str:
    """What stands behind a bold word, until the next one or the end of the paragraph."""
    found = re.search(rf"\*\*{name}\.\*\* (.*?)(?=\n\*\*|\n\n|\Z)", section, re.DOTALL)
    return _plain(" ".join(found.group(1).split())) if found else ""


def _any_digits(text: str) -> str:
    return re.sub(r"[0-9]+", "0", text)


def _plain(text: str) -> str:
    """A text without Markdown's marks."""
    return re.sub(r"\\([\[\]*_<>`|])", r"\1", text)
