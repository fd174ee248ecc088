"""What the command line shows: progress on standard error, tables and JSON on standard output."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

import typer

from isochrome.progress import Tally

_SHOWN = 60
"""Rows of a fit's table that are shown."""


@contextmanager
def run_bar(what: str, items: str = "frames") -> Iterator[Callable[[Tally], None]]:
    """Items done, a second, flagged, and the time left, on standard error; nothing in a pipe."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(
        *_run_columns(), console=console, transient=True, disable=not console.is_terminal
    ) as progress:
        yield _shower(progress, what, items)


@contextmanager
def campaign_bar() -> Iterator[Callable[[Tally, Tally | None], None]]:
    """Two bars: the recordings, and the frames of the one in work; nothing in a pipe."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(
        *_run_columns(), console=console, transient=True, disable=not console.is_terminal
    ) as progress:
        recordings = _shower(progress, "recordings", "recordings")
        within: list[Callable[[Tally | None], None]] = []

        def show(tally: Tally, frames: Tally | None) -> None:
            recordings(tally)
            if frames is None:
                for one in within:
                    one(None)
                within.clear()
                return
            if not within:
                within.append(_shower(progress, "frames", "frames"))
            within[0](frames)

        yield show


def _run_columns() -> tuple[Any, ...]:
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn

    return (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f}"),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[flagged]} flagged"),
    )


def _shower(progress: Any, what: str, items: str) -> Callable[[Tally | None], None]:
    """A bar of its own, that shows a Tally, and goes at None."""
    task = progress.add_task(what, total=0, rate="", flagged=0)
    began = monotonic()

    def show(tally: Tally | None) -> None:
        if tally is None:
            progress.remove_task(task)
            return
        own, seconds = tally.done - tally.before, monotonic() - began
        rate = f"{own / seconds:.3g} {items}/s" if own and seconds > 0.0 else ""
        progress.update(
            task,
            completed=tally.done,
            total=tally.count,
            rate=rate,
            flagged=tally.flagged,
        )

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
    from isochrome.output import json_pieces

    for piece in json_pieces(values):
        typer.echo(piece, nl=False)
    typer.echo()


def print_warnings(warnings: list[str]) -> None:
    """Warnings on standard error, a line each."""
    for warning in warnings:
        line = " ".join(warning.splitlines())  # names of files may hold a new line
        typer.echo(f"warning: {line}", err=True)


def print_calibration(result: Any) -> None:
    """A fringe value with its uncertainty and goodness; its warnings on standard error."""
    value, spread = result.fringe_value_n_per_mm, result.standard_uncertainty
    typer.echo(f"fringe_value_n_per_mm = {value:.5g} ± {spread:.2g} (standard uncertainty)")
    typer.echo(f"chi = {result.chi:.3f}")
    if result.order_at_zero_load is not None:
        typer.echo(f"order at zero load = {round(result.order_at_zero_load, 3) + 0.0:.3f} fringes")
    if result.residual is not None:
        form, size = result.residual["form"], result.residual["largest_order"]
        typer.echo(f"residual stress: {form}, up to {size:.3f} fringes")
    print_warnings(list(result.warnings))


def print_fit(result: Any) -> None:
    """Fitted values with their uncertainties and bounds, chi, and what is said of the wear law."""
    table = result.table()
    names = ("frame", "key", "value", "standard_uncertainty", "cramer_rao_bound")
    rows = [
        (frame, key, f"{_to_last_digit(value, spread)} ± {spread:.2g}", f"{bound:.2g}")
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


def _to_last_digit(value: float, spread: float) -> str:
    """A value with the digits that its uncertainty, shown with two, leaves it."""
    if not (math.isfinite(spread) and spread > 0.0 and value):
        return f"{value:.6g}"
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(spread)) + 2
    return f"{value:#.{min(max(digits, 2), 15)}g}"


def print_columns(table: dict[str, list[Any]], names: Any = None) -> None:
    """Some columns of a table, a row a frame; all of them where none are named."""
    names = list(table) if names is None else names
    rows = list(zip(*(table[name] for name in names), strict=True))
    print_rows(tuple(names), [tuple(_cell(value) for value in row) for row in rows])


def _cell(value: Any) -> str:
    if value is None or value != value:
        return "-"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def print_place(out: Path, *, already: bool) -> None:
    """Where the results are; `already`, that an earlier run had left them all."""
    done = " (complete already; --restart computes them anew)" if already else ""
    typer.echo(f"results: {out}{done}")


def print_rows(names: tuple[str, ...], rows: list[Any]) -> None:
    """A plain table in columns, which needs no terminal."""
    lines = [tuple(names), *rows]
    widths = [max(len(str(line[i])) for line in lines) for i in range(len(names))]
    for line in lines:
        cells = (str(cell).ljust(width) for cell, width in zip(line, widths, strict=True))
        typer.echo("  ".join(cells).rstrip())
