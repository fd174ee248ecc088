"""The sentences that the package can say, read from its code; and the page of what they mean."""

import ast
import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from package_code import HOUSE, modules, nodes

WORDS = Path(__file__).with_name("messages.toml")
GAP = "…"
"""What stands for a value that is put into a sentence."""
FEWEST_WORDS = 5
"""Of a text that is no exception's, to be a sentence to somebody."""

SILENT = ("figures", "reporting", "benchmarks.py", "samples", "cli", "guide", "demonstration.py")
"""Rooms whose texts are labels and help, but for what they raise; so are those of `LABELS`."""
LABELS = ("figure.py", "run_report.py")

HEAD = """# Every warning and refusal

A refusal ends a command with one line, and exit code 2 (the input, the scene or the usage is wrong)
or 3 (the physics was refused, or nothing could be read). A warning stands in the results, and on
standard error. Here … stands for a value or a name. Search for some words of the message.

"""


@dataclass(frozen=True)
class Entry:
    """What one or several messages mean: of a `room`, found by their fixed `words`."""

    room: str
    title: str
    words: tuple[str, ...]
    meaning: str
    cause: str
    remedy: str


@cache
def entries() -> list[Entry]:
    """The entries, as they are written by hand."""
    found = tomllib.loads(WORDS.read_text("utf-8"))["entry"]
    return [Entry(**one | {"words": tuple(one["words"])}) for one in found]


@cache
def no_messages() -> list[str]:
    """Words of texts that are no message by themselves: labels, and ends of other sentences."""
    return tomllib.loads(WORDS.read_text("utf-8"))["no_messages"]


@cache
def texts() -> dict[str, str]:
    """The texts of the code that may be said to a user, and the module of each."""
    found: dict[str, str] = {}
    for path in modules():
        place = path.relative_to(HOUSE).as_posix()
        silent = path.name in LABELS or place.startswith(SILENT)
        found |= dict.fromkeys(texts_of(nodes(path), raised_alone=silent), place)
    return found


def texts_of(walked: Sequence[ast.AST], *, raised_alone: bool = False) -> Iterator[str]:
    """What is raised, however short, and what else has some words; docstrings apart."""
    passed: set[int] = set()
    for node in walked:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            passed.add(id(node.value))
        elif isinstance(node, ast.Call) and _called(node.func).startswith("typer."):
            passed |= {id(inner) for inner in ast.walk(node)}
        elif isinstance(node, ast.JoinedStr):
            passed |= {id(inner) for inner in node.values}
    raised = {
        id(inner)
        for node in walked
        if isinstance(node, ast.Raise | ast.Call) and (call := _of_exception(node))
        for given in call.args
        for inner in ast.walk(given)
    }
    for node in walked:
        if id(node) in passed or not isinstance(node, ast.Constant | ast.JoinedStr):
            continue
        if raised_alone and id(node) not in raised:
            continue
        text = fixed(node)
        least = 2 if id(node) in raised else FEWEST_WORDS
        if len(re.findall(r"[A-Za-z]{2,}", text)) >= least and " " in text.strip(f" {GAP}:;,()"):
            yield text


def _of_exception(node: ast.Raise | ast.Call) -> ast.Call | None:
    """The call that makes an exception, or ends a command, with a text."""
    if isinstance(node, ast.Raise):
        return node.exc if isinstance(node.exc, ast.Call) else None
    return node if _called(node.func) in ("fail", "Finding") else None


def _called(function: ast.expr) -> str:
    """The dotted name of what is called; empty where it has none."""
    if isinstance(function, ast.Attribute):
        return f"{_called(function.value)}.{function.attr}"
    return function.id if isinstance(function, ast.Name) else ""


def fixed(node: ast.Constant | ast.JoinedStr) -> str:
    """A text with a gap for each value that is put into it."""
    if isinstance(node, ast.JoinedStr):
        parts = (fixed(v) if isinstance(v, ast.Constant) else GAP for v in node.values)
        return "".join(parts)
    if not isinstance(node.value, str):
        return ""
    return re.sub(r"\{[^{}]*\}", GAP, node.value) if "{" in node.value else node.value


def entry_of(text: str, known: list[Entry]) -> Entry | None:
    """The entry with the longest words that are in a text."""
    having = [(len(words), entry) for entry in known for words in entry.words if words in text]
    return max(having, key=lambda pair: pair[0])[1] if having else None


@cache
def explained() -> dict[str, Entry | None]:
    """Every text of the code with the entry that explains it."""
    return {text: entry_of(text, entries()) for text in texts()}


def page() -> str:
    """The page as Markdown: rooms, entries, and under each the messages that it explains."""
    known = entries()
    shown: dict[str, list[str]] = {entry.title: [] for entry in known}
    for text, entry in explained().items():
        if entry is not None:
            shown[entry.title].append(text)
    lines = [HEAD]
    for room in dict.fromkeys(entry.room for entry in known):
        lines.append(f"## {room}\n\n")
        for entry in (one for one in known if one.room == room):
            lines.append(f"### {entry.title}\n\n")
            lines += [f"- “{_inline(text)}”\n" for text in sorted(shown[entry.title])]
            lines.append(
                f"\n**Meaning.** {entry.meaning}\n**Cause.** {entry.cause}\n"
                f"**Remedy.** {entry.remedy}\n\n"
            )
    return "".join(lines).rstrip("\n") + "\n"


def _inline(text: str) -> str:
    """A message as Markdown shows it, letter by letter."""
    plain = " ".join(text.split()).strip(" ,;:") if text.startswith((" ", ",", ";", ":")) else text
    return re.sub(r"([\[\]*_<>`|])", r"\\\1", " ".join(plain.split()))
