"""The guide's page of messages, from the table of their words; and the codes that are used."""

import ast
import re
import string

from isochrome.messages import entries
from package_code import modules, nodes

TEXTS = {code: text for entry in entries() for code, text in entry.texts.items()}
"""The words of each message by its code."""

MAKERS = ("message", "InputError", "PhysicsError", "NoCluster", "WorkersLost", "UnclearScarError")
"""What takes a code and its values."""

GAP = "…"
"""What stands on the page for a value that is put into a sentence."""

HEAD = """# Every warning and refusal

A refusal ends a command with one line, and exit code 2 (the input, the scene or the usage is wrong)
or 3 (the physics was refused, or nothing could be read). A warning stands in the results, and on
standard error. Here … stands for a value or a name. Search for some words of the message. JSON has
each message with its code and values, too.

"""


def page() -> str:
    """The page as Markdown: rooms, entries, and under each the messages that it explains."""
    lines = [HEAD]
    for room in dict.fromkeys(entry.room for entry in entries()):
        lines.append(f"## {room}\n\n")
        for entry in (one for one in entries() if one.room == room):
            shown = sorted({_inline(without_values(text)) for text in entry.texts.values()})
            lines.append(f"### {entry.title}\n\n")
            lines += [f"- “{text}”\n" for text in shown]
            lines.append(
                f"\n**Meaning.** {entry.meaning}\n**Cause.** {entry.cause}\n"
                f"**Remedy.** {entry.remedy}\n\n"
            )
    return "".join(lines).rstrip("\n") + "\n"


def without_values(text: str) -> str:
    """The words of a message with a gap for each value."""
    parts = string.Formatter().parse(text)
    return "".join(fixed + (GAP if name is not None else "") for fixed, name, *_ in parts)


def _inline(text: str) -> str:
    """A message as Markdown shows it, letter by letter."""
    plain = text.strip(" ,;:") if text.startswith((" ", ",", ";", ":")) else text
    return re.sub(r"([\[\]*_<>`|])", r"\\\1", " ".join(plain.split()))


def named_codes() -> dict[str, list[tuple[str, set[str]]]]:
    """The codes that stand in the code, each with the places and values of its calls of `message`.

    A code may stand in a constant, or in a table of them.
    """
    codes: dict[str, list[tuple[str, set[str]]]] = {}
    constants: dict[str, set[str]] = {}
    calls: list[tuple[str, ast.Call]] = []
    for path in modules():
        for node in nodes(path):
            if isinstance(node, ast.Constant) and node.value in TEXTS:
                codes.setdefault(node.value, [])
            elif isinstance(node, ast.Assign) and getattr(node.value, "value", None) in TEXTS:
                for target in node.targets:
                    constants.setdefault(ast.unparse(target), set()).add(node.value.value)
            elif (
                isinstance(node, ast.Call) and getattr(node.func, "id", "") in MAKERS and node.args
            ):
                calls.append((f"{path.name}:{node.lineno}", node))
    for place, call in calls:
        code = call.args[0]
        if isinstance(code, ast.JoinedStr | ast.BinOp):
            continue  # a text that is put together
        literal = [code.value] if isinstance(code, ast.Constant) else []
        for name in literal or constants.get(ast.unparse(code), ()):
            codes.setdefault(name, []).append((place, {k.arg or "**" for k in call.keywords}))
    return codes
