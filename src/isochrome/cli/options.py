"""How commands are to be used: examples, usage errors in one line, options that several share."""

from __future__ import annotations

import inspect
import json
import re
import sys
import tomllib
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from isochrome.console import print_warnings
from isochrome.errors import InputError
from isochrome.messages import message, messages_data

if TYPE_CHECKING:
    from isochrome.figures import FigureStyle

EXAMPLES = Path(__file__).with_name("examples.txt").read_text("utf-8")
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
    for option, value in pairwise([part for word in sys.argv for part in word.split("=", 1)]):
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
        (entry,) = messages_data([text])
        typer.echo(json.dumps({"error": line, "exit_code": code, "message": entry}))
    typer.echo(f"isochrome: {line}", err=True)
    sys.exit(code)


Options = dict[str, tuple[Any, ...]]
"""Type, help and, where it is not made of the name, option of each argument by its name."""

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object, and nothing else.")]
SceneOption = Annotated[
    str, typer.Option("--scene", help="Scene file (TOML), or a name such as line-contact-wear.")
]
SceneArgument = Annotated[str, typer.Argument(help="Scene file (TOML), or line-contact-wear.")]
Out = Annotated[Path, typer.Option("--out", help="Folder for the results.")]
FramesArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="FRAMES...", help="Video, TIFF stack, images, or a folder or glob of them."
    ),
]
Join = Annotated[
    bool, typer.Option("--join", help="The files named are the parts of one recording.")
]
SetArgument = Annotated[str, typer.Argument(metavar="SET", help="Calibration set (TOML).")]

_TYPES: dict[str, Any] = {
    "bool": bool, "int": int | None, "float": float | None, "str": str | None,
    "list": list[str] | None, "path": Path | None,
}  # fmt: skip


_TABLES = tomllib.loads(Path(__file__).with_name("options.toml").read_text("utf-8"))
OPTIONS: dict[str, Options] = {
    table: {name: (_TYPES[kind], *words) for name, (kind, *words) in rows.items()}
    for table, rows in _TABLES.items()
}
"""Options that commands share, or that a function takes, by the name of their table."""


def parameters(
    given: Iterable[inspect.Parameter], out: Path | None, tables: Iterable[str | Options]
) -> list[inspect.Parameter]:
    """A function's own arguments, --out, the tables' options (off or None by default), --json."""
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    place = [] if out is None else [inspect.Parameter("out", kind, default=out, annotation=Out)]

    def option(name: str, of: Any, text: str, *spelt: str) -> inspect.Parameter:
        asked = typer.Option(*(spelt or [f"--{name.replace('_', '-')}"]), help=text)
        default = False if of is bool else None
        return inspect.Parameter(name, kind, default=default, annotation=Annotated[of, asked])

    rows = (OPTIONS[table] if isinstance(table, str) else table for table in tables)
    options = [option(name, *row) for table in rows for name, row in table.items()]
    as_json = inspect.Parameter("as_json", kind, default=False, annotation=Json)
    return [*(one for one in given if one.kind is kind), *place, *options, as_json]


_MM = {"cm": 10.0, "in": 25.4}
"""Of units of a width that are not mm."""


def take_extras(options: dict[str, Any]) -> Callable[[Any, Path], list[str]]:
    """Take a paper's figure and Excel's tables out of a command's options: what writes both."""
    style = take_style(options) if "width" in options else None
    has_tables, form = "tables" in options, options.pop("tables", None)
    if form not in (None, "excel"):
        raise InputError("csv_no_form_table", form=form)

    def write(result: Any, out: Path) -> list[str]:
        files = save_paper_figure(result, out, style)
        if form is not None:
            from isochrome.output import write_excel_copies

            write_excel_copies(out)
        elif has_tables:  # a calibration is written over an earlier one, whose copies go
            for copy in out.glob("*_excel.csv"):
                table = copy.with_name(copy.name.replace("_excel.csv", ".csv"))
                if table.is_file() and table.stat().st_mtime_ns > copy.stat().st_mtime_ns:
                    _remove(copy)
        return files

    return write


def take_style(options: dict[str, Any]) -> FigureStyle | None:
    """Take the options of a figure for a paper out of a command's, before its work begins."""
    given = {name: options.pop(name) for name in OPTIONS["figure"]}
    if not any(value not in (None, False) for value in given.values()):
        return None
    from isochrome.figures import FigureStyle

    named = {name: given[name] for name in ("numbers", "dpi")}
    known: dict[str, Any] = {name: value for name, value in named.items() if value is not None}
    if given["width"] is not None:
        match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(mm|cm|in|)\s*", given["width"])
        if match is None:
            raise InputError("width_give_width_unit", width=given["width"])
        known["width_mm"] = float(match.group(1)) * _MM.get(match.group(2), 1.0)
    if given["shown"] is not None:
        if not re.fullmatch(r"\s*\d+\s*(,\s*\d+\s*)*", given["shown"]):
            raise InputError("frames_give_whole_numbers", shown=given["shown"])
        known["frames"] = tuple(int(part) for part in given["shown"].split(","))
    if given["formats"] is not None:
        known["formats"] = tuple(part.strip() for part in given["formats"].lower().split(","))
    return FigureStyle(**known)


def save_paper_figure(result: Any, out: Path, style: FigureStyle | None) -> list[str]:
    """Write a result's figure for a paper into its folder, where it was asked for. What it warns of
    stands on standard error. Gives the files' names. In Python, where a figure has any name, none
    of an earlier one is removed: the file might be the user's own."""
    if style is None:
        return []
    from isochrome.figures import save_figure

    with warnings.catch_warnings(record=True) as noted:
        warnings.simplefilter("always", UserWarning)
        base = out / f"figure_{style.width_mm:g}mm"
        files = save_figure(result, base, style)
    # the data that an earlier figure of this width left of plots that are there no more; a copy for
    # Excel is of the earlier plot even where there is a new one of its letter
    stale = re.compile(rf"{re.escape(base.name)}_[a-z](_excel)?\.csv")
    for file in out.iterdir():
        if stale.fullmatch(file.name) and file not in files:
            _remove(file)
    print_warnings([str(one.message) for one in noted])
    return [str(file) for file in files]


def _remove(file: Path) -> None:
    try:
        file.unlink()
    except OSError as error:
        why = error.strerror
        raise InputError("cannot_written_make_folder", file=file, strerror=why) from error
