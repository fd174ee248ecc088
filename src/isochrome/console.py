"""What the command line shows: progress on standard error, tables and JSON on standard output."""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from time import monotonic
from typing import Any

import typer

from isochrome.progress import Tally

_SHOWN = 60
"""Rows of a fit's table that are shown."""
LINE_EVERY_S = 60.0
"""Seconds from line to line of a log, where no terminal shows a bar."""


@contextmanager
def run_bar(what: str, items: str = "frames") -> Iterator[Callable[[Tally], None]]:
    """Items done, a second, flagged, and the time left, on standard error; a line a minute in a
    log."""
    with _bars() as bars:
        yield _shower(bars, what, items)


@contextmanager
def campaign_bar() -> Iterator[Callable[[Tally, Tally | None], None]]:
    """Two bars: the recordings, and the frames of the one in work; a line a minute in a log."""
    with _bars() as bars:
        recordings = _shower(bars, "recordings", "recordings")
        within: Callable[[Tally | None], None] | None = None

        def show(tally: Tally, frames: Tally | None) -> None:
            nonlocal within
            recordings(tally)
            if within is None and frames is not None:
                within = _shower(bars, "frames", "frames")
            if within is not None:
                within(frames)
            if frames is None:
                within = None

        yield show


@contextmanager
def _bars() -> Iterator[Any]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    console.quiet = not console.is_terminal  # a bar that is disabled still ends with a line
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f}"),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[flagged]} flagged"),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bars:
        yield bars


def _shower(bars: Any, what: str, items: str) -> Callable[[Tally | None], None]:
    """A bar of its own, that shows a Tally, and goes at None."""
    task = bars.add_task(what, total=0, rate="", flagged=0)
    began = last = monotonic()
    waiting = ""

    def show(tally: Tally | None) -> None:
        nonlocal began, last, waiting
        if tally is None:
            bars.remove_task(task)
            return
        now = monotonic()
        began = now if tally.stage else began  # of the items themselves
        done, seconds = tally.done - tally.before, now - began
        waiting = waiting or tally.said
        if waiting and (done > 0 or not bars.disable):
            # a log gets it with what is finished first: a run that is refused says that alone
            typer.echo(f"{what}: {waiting}", err=True)
            waiting = ""
        rate = f"{done / seconds:.3g} {items}/s" if done and seconds > 0.0 else ""
        if bars.disable and now - last >= LINE_EVERY_S:
            last, parts = now, [tally.stage, f"{tally.done} of {tally.count} {items}"]
            if not tally.stage:
                parts += [rate, f"{tally.flagged} flagged"]
            if rate:
                parts.append(f"{(tally.count - tally.done) * seconds / done / 60.0:.0f} min left")
            typer.echo(f"{what}: {', '.join(filter(None, parts))}", err=True)
        counts = {"completed": tally.done, "total": tally.count, "flagged": tally.flagged}
        bars.update(task, description=tally.stage or what, rate=rate, **counts)

    return show


@contextmanager
def steps(quiet: bool) -> Iterator[Callable[[str], None]]:
    """A spinner with the step's name on a terminal, plain lines on standard error in a pipe."""
    from rich.console import Console

    console = Console(stderr=True)
    with console.status("starting") as status:

        def say(step: str) -> None:
            status.update(step)
            if not console.is_terminal and not quiet:
                typer.echo(f"{step} ...", err=True)

        yield say


def print_json(values: Any) -> None:
    """One JSON object on standard output; NaN as null."""
    from isochrome.output import plain

    typer.echo(json.dumps(plain(values), allow_nan=False))


def print_summary(result: Any) -> None:
    """What thousands of frames come to, as a table and as a sentence."""
    from isochrome.output import to_last_digit, with_uncertainty

    unknown = float("nan")
    rows = []
    for key, *values, spread in zip(*result.summary().values(), strict=True):
        mean, *ends = (unknown if v is None else v for v in values)
        ends = [to_last_digit(end, spread) for end in ends]
        rows.append((key, with_uncertainty(mean, unknown if spread is None else spread), *ends))
    print_rows(("key", "mean ± standard uncertainty", "least", "most"), rows)
    typer.echo(result.summary_text)


def print_markdown(text: str) -> None:
    """A page of Markdown as a terminal shows it; as it is written in a pipe."""
    from rich.console import Console
    from rich.markdown import Markdown

    console = Console()
    if console.is_terminal:
        console.print(Markdown(text))
    else:
        typer.echo(text, nl=False)


def print_warnings(warnings: list[str]) -> None:
    """Warnings on standard error, a line each."""
    for warning in warnings:
        line = " ".join(warning.splitlines())  # names of files may hold a new line
        typer.echo(f"warning: {line}", err=True)


def print_values(result: Any) -> None:
    """The main values of a result, and what was taken as exact."""
    for name, value in result.main_values():
        typer.echo(f"{name} = {value}")
    for key in getattr(result, "taken_as_exact", ()):
        typer.echo(f"taken as exact: {key}")


def print_fit(result: Any) -> None:
    """Fitted values with their uncertainties and bounds, chi, and which wear law is preferred."""
    from isochrome.output import with_uncertainty

    table = result.columns
    names = ("frame", "key", "value", "standard_uncertainty", "cramer_rao_bound")
    rows = [
        (frame, key, with_uncertainty(value, spread), f"{bound:.2g}")
        for frame, key, value, spread, bound in zip(*(table[n] for n in names), strict=True)
    ]
    more = len(rows) - _SHOWN
    rows = rows[:_SHOWN] + ([(f"and {more} more in fit.csv", "", "", "")] if more > 0 else [])
    print_rows(("frame", "key", "value ± standard uncertainty", "Cramér-Rao bound"), rows)
    typer.echo(f"chi = {result.chi:.3f}")
    if result.wear_laws is not None:
        typer.echo(f"wear law: {result.wear_laws.sentence()}")
    for i, one in enumerate(result.tractions):
        typer.echo(f"frame {i}, without a contact model: {one.sentence()}")
    typer.echo(result.summary_text)


def print_columns(table: dict[str, list[Any]], names: Sequence[str]) -> None:
    """Some columns of a table, a row a frame."""
    columns = ([_cell(value, name) for value in table[name]] for name in names)
    print_rows(tuple(names), list(zip(*columns, strict=True)))


def _cell(value: Any, name: str) -> str:
    if value is None or value != value:
        return "-"
    digits = 2 if name.endswith("uncertainty") else 5
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)


def print_rows(names: tuple[str, ...], rows: list[Any]) -> None:
    """A plain table in columns, which needs no terminal."""
    lines = [tuple(names), *rows]
    widths = [max(len(str(line[i])) for line in lines) for i in range(len(names))]
    for line in lines:
        cells = (str(cell).ljust(width) for cell, width in zip(line, widths, strict=True))
        typer.echo("  ".join(cells).rstrip())
