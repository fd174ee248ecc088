"""The pages of the guide by their topics, and what its page of messages says of one."""

import difflib
import re
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources

from isochrome.errors import InputError
from isochrome.messages import message

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
        place = text.find(part, at)
        if place < 0:
            return False
        at = place + len(part)
    return True


@cache
def _messages() -> tuple[tuple[tuple[str, ...], Explanation], ...]:
    """The fixed parts of each message of the page, with its entry."""
    patterns = []
    for section in guide_page("messages").split("\n### ")[1:]:
        title, _, body = section.partition("\n")
        words = [_words_of(name, body) for name in ("Meaning", "Cause", "Remedy")]
        entry = Explanation(_plain(title), *words)
        for text in re.findall(r"^- “(.*)”$", body, re.MULTILINE):
            pattern = _any_digits(_plain(text))
            parts = tuple(part for part in pattern.split(GAP) if part.strip())
            if sum(map(len, parts)) >= _SHORTEST:
                patterns.append((parts, entry))
    return tuple(patterns)


def _words_of(name: str, section: str) -> str:
    """What stands behind a bold word, until the next one or the end of the paragraph."""
    match = re.search(rf"\*\*{name}\.\*\* (.*?)(?=\n\*\*|\n\n|\Z)", section, re.DOTALL)
    return _plain(" ".join(match.group(1).split())) if match else ""


def _any_digits(text: str) -> str:
    return re.sub(r"[0-9]+", "0", text)


def _plain(text: str) -> str:
    """A text without Markdown's marks."""
    return re.sub(r"\\([\[\]*_<>`|])", r"\1", text)


TOPICS = {
    "first-video": "your first own video, step by step",
    "without-model": "orders of a specimen that has no model, from points that you know",
    "phase-steps": "phase-stepped sets, isoclinics and residual stress",
    "colour": "white light: orders by their colours",
    "calibration": "the fringe value, the camera's scale, and the uncertainty budget",
    "fitting": "what the fringes know: unknowns of the scene, causes, wear laws, tractions",
    "arrays": "frames, scenes and results as arrays in Python",
    "long-recordings": "long recordings, campaigns of many, and a cluster",
    "paper-figures": "figures for a paper",
    "conventions": "units, axes, and a glossary",
    "trust": "how far to trust a result: chi, causes, budget; what was tested against what",
    "theory": "the way from load to light, and the pages of its parts",
    "theory-contact": "pressure, friction, wear",
    "theory-stress": "stress below the surface, and in block, disc, ring and beam",
    "theory-optics": "from stress to light: polariscope, bands, camera",
    "theory-fringes": "from light to order: with a model, without one, steps, colours",
    "theory-fitting": "least squares, causes, evidence, tractions",
    "theory-calibration": "beam, disc, scale, and their budgets",
    "scene-keys": "every key of a scene and of a calibration set",
    "files": "every file and column that a command leaves",
    "messages": "every warning and refusal: meaning, cause, remedy",
    "developers": "the rooms of the code, the way of a frame, recipes",
}
"""What each page is about, in the order in which they are best read."""


def guide_page(topic: str | None = None) -> str:
    """A page of the guide, Markdown; without a topic, the list of all; InputError for none such."""
    if topic is None:
        rows = "\n".join(f"| `{name}` | {about} |" for name, about in TOPICS.items())
        return (
            "# The guide\n\n`isochrome guide TOPIC` shows a page.\n\n"
            f"| topic | what it is about |\n|---|---|\n{rows}\n"
        )
    if topic not in TOPICS:
        near = difflib.get_close_matches(topic, TOPICS, n=1, cutoff=0.5)
        hint = f"did you mean '{near[0]}'?" if near else f"pages: {', '.join(TOPICS)}"
        raise InputError(message("guide_has_no_such", topic=topic, hint=hint))
    return (resources.files("isochrome.guide") / f"{topic}.md").read_text("utf-8")
