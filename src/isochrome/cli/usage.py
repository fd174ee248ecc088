"""How commands are to be used: two examples for each help, and usage errors in one line."""

import json
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any, NoReturn

import typer
from typer.core import TyperGroup

from isochrome.messages import message, messages_data

EXAMPLES = """\
isochrome demo
isochrome demo --out trial --json
isochrome init captured.tif --pixel-mm 0.00607 --out bench
isochrome init disc.png --shape disc --diameter-mm 50 --load-n 560
isochrome simulate line-contact-wear --out simulation
isochrome simulate scene.toml --components --out stresses
isochrome process captured.tif --scene scene.toml --out experiment
isochrome process contact.avi --scene scene.toml --maps key --out followed
isochrome compare experiment simulation --out comparison
isochrome compare captured.tif frames.tif --json
isochrome fit captured.tif --scene scene.toml --free load.normal_n
isochrome fit a.tif --scene s.toml --per-frame friction.coefficient
isochrome check captured.tif --scene scene.toml
isochrome check 'runs/*.avi' --scene scene.toml --json
isochrome setup captured.tif
isochrome setup bending --calibration beam
isochrome bench
isochrome bench fringes --out measured
isochrome sweep line-contact-wear --vary load.normal_n=30:60:4
isochrome sweep s.toml --vary friction.coefficient=0.1,0.2 --out grid
isochrome export experiment --to netcdf
isochrome export experiment --to tiff --out for-imagej
isochrome report experiment
isochrome report experiment --out for-a-colleague
isochrome verify experiment
isochrome verify campaign --json
isochrome guide
isochrome guide first-video
isochrome calibrate bending set.toml
isochrome calibrate bending set.toml --into scene.toml
isochrome calibrate disc set.toml --out disc
isochrome calibrate disc set.toml --into scene.toml --json
isochrome calibrate colour colours.toml
isochrome calibrate colour colours.toml --out colours --json
isochrome calibrate wear set.toml
isochrome calibrate wear set.toml --into scene.toml --out wear
isochrome calibrate scale bar.tif --edges-mm 4.003 --into scene.toml
isochrome calibrate scale bar.tif --edges-mm 4 --edges-uncertainty-mm 0.002
"""
"""Two command lines for each command, as its help shows them."""


def examples_of(command: str) -> str:
    """What stands below a command's help."""
    of_command = (e for e in EXAMPLES.splitlines() if f"{e} ".startswith(f"isochrome {command} "))
    return "\n\n".join(("Examples:", *of_command))


class Commands(TyperGroup):
    """The commands; what is wrong with a command line is one line, not a box."""

    def make_context(self, *given: Any, **more: Any) -> Any:
        """Read the options that stand before the command."""
        with _usage_in_a_line():
            return super().make_context(*given, **more)

    def invoke(self, ctx: Any) -> Any:
        """Read the command's own arguments, and run it."""
        with _usage_in_a_line():
            return super().invoke(ctx)


@contextmanager
def _usage_in_a_line() -> Iterator[None]:
    """Turn a usage error into a line, and exit code 2; help that was not asked for stays help."""
    try:
        yield
    except Exception as error:
        say = getattr(error, "format_message", None)  # only usage errors have one
        if say is None or type(error).__name__ == "NoArgsIsHelpError":
            raise
        context = getattr(error, "ctx", None)
        command = context.command_path if context else "isochrome"
        words = command.removeprefix("isochrome").strip()
        text = f"{words}{': ' if words else ''}{say().rstrip('. ')}"
        fail(_decimal_comma(text) or message("see_help", text=text, command=command), 2)


def _decimal_comma(text: str) -> str | None:
    """The sentence for an option whose number has a comma; None where that is not what is wrong."""
    named = re.search(r"Invalid value for '(--[a-z-]+)'", text)
    words = [part for word in sys.argv for part in word.split("=", 1)]
    for option, value in pairwise(words):
        if named and option == named.group(1) and re.fullmatch(r"[-+]?\d+,\d+", value):
            if "integer" in text:  # a point would not mend it
                return f"{text}; {value} is no whole number"
            right = value.replace(",", ".")
            return f"{text}; {value} has a decimal comma: write {right}, with a point"
    return None


def fail(text: str, code: int) -> NoReturn:
    """Say why, once, on standard error, and as JSON on standard output where JSON was asked for."""
    line = " ".join(text.split())
    if "--json" in sys.argv:
        (said,) = messages_data([text])
        typer.echo(json.dumps({"error": line, "exit_code": code, "message": said}))
    typer.echo(f"isochrome: {line}", err=True)
    sys.exit(code)
