"""The calibrate commands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer

from isochrome.cli.options import Into, Json, Out, SetArgument
from isochrome.console import print_calibration, print_json, print_warnings, steps

calibrate_app = typer.Typer(
    help="Calibrate the material fringe value, or a colour table.",
    no_args_is_help=True,
    add_completion=False,
)


@calibrate_app.command("bending")
def calibrate_bending(
    settings: SetArgument,
    out: Out = Path("isochrome-calibrate"),
    into: Into = None,
    as_json: Json = False,
) -> None:
    """Calibrate from images of a beam in four-point bending."""
    from isochrome.calibrate import calibrate_bending as run

    _calibrate(run, settings, out, into, as_json)


@calibrate_app.command("disc")
def calibrate_disc(
    settings: SetArgument,
    out: Out = Path("isochrome-calibrate"),
    into: Into = None,
    as_json: Json = False,
) -> None:
    """Calibrate from images of a disc under diametral compression."""
    from isochrome.calibrate import calibrate_disc as run

    _calibrate(run, settings, out, into, as_json)


@calibrate_app.command("colour")
def calibrate_colour(
    settings: SetArgument,
    out: Out = Path("isochrome-calibrate"),
    as_json: Json = False,
) -> None:
    """Calibrate a colour table, from a beam's images or from any images' own colours."""
    from isochrome.calibrate.colour import calibrate_colour as run
    from isochrome.calibrate.colour_save import save_colour_calibration

    with steps(quiet=True) as say:
        say("calibrating")
        result = run(settings)
        save_colour_calibration(result, out, source=settings)
    if as_json:
        print_json({"out": str(out), **result.to_json()})
        return
    typer.echo(f"colour table to N = {result.table.highest:.2f} from {result.way}")
    typer.echo(f"gamma = {result.gamma:.3f}: set frames.gamma to it where the table is used")
    typer.echo(f"residual = {result.residual:.3f} of full light")
    print_warnings(list(result.warnings))
    typer.echo(f"results: {out}")


def _calibrate(
    run: Callable[[str], Any], settings: str, out: Path, into: Path | None, as_json: bool
) -> None:
    from isochrome.calibrate import check_scene_file, save_calibration, write_into_scene

    with steps(quiet=True) as say:
        say("calibrating")
        if into is not None:
            check_scene_file(into)  # before the work, not after it
        result = run(settings)
        save_calibration(result, out, source=settings)
        if into is not None:
            write_into_scene(result, into, source=settings)
    if as_json:
        places = {"out": out} if into is None else {"out": out, "into": into}
        print_json({**places, **result.to_json()})
        return
    print_calibration(result)
    typer.echo(f"results: {out}" if into is None else f"results: {out}; value set in {into}")
