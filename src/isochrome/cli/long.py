"""Commands of long runs: grids of simulations, reports, and results for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from isochrome.cli.options import RUN, Json, Out, SceneArgument, with_options
from isochrome.console import print_json, print_warnings, run_bar


@with_options(RUN)
def sweep_command(
    scene: SceneArgument,
    vary: Annotated[
        list[str],
        typer.Option("--vary", help="KEY=first:last:number, or KEY=value,value; repeatable."),
    ],
    out: Out = Path("isochrome-sweep"),
    *,
    as_json: Json = False,
    **options: Any,
) -> None:
    """Simulate a scene over a grid of values into one dataset.

    Run the same command again to resume.
    """
    from isochrome.output import counted
    from isochrome.sweeps import sweep as run

    with run_bar("sweeping", "points") as progress:
        result = run(scene, vary, out, progress=progress, **options)
    if as_json:
        print_json({"out": str(out), **result.to_json()})
    else:
        print_warnings(list(result.reasons))
        for key in dict.fromkeys(text.partition("=")[0].strip() for text in vary):
            values = ", ".join(f"{value:g}" for value in dict.fromkeys(result.columns[key]))
            typer.echo(f"{key} = {values}")
        typer.echo(f"{counted(result.points, 'point')}; results: {out}")
    if result.failed:
        typer.echo(
            f"isochrome: {result.failed} of {result.points} points were refused by their physics, "
            f"as sweep.csv says; the others are in {out}",
            err=True,
        )
        raise typer.Exit(3)


def export_command(
    run: Annotated[str, typer.Argument(help="Result folder of process or sweep.")],
    to: Annotated[str, typer.Option("--to", help="netcdf (MATLAB), tiff (ImageJ), csv or excel.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the files; by default the run's own.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a run's results for MATLAB, ImageJ or a spreadsheet."""
    from isochrome.runs import export as write

    files = [str(file) for file in write(run, to, out)]
    if as_json:
        print_json({"files": files})
        return
    for file in files:
        typer.echo(file)


def verify_command(
    folder: Annotated[
        str, typer.Argument(metavar="FOLDER", help="What a command left; of a campaign all of it.")
    ],
    as_json: Json = False,
) -> None:
    """Read all files of a results folder and say which are not what was left there."""
    from isochrome.runs import verify

    with run_bar("reading", "files") as progress:
        found = verify(folder, progress=progress)
    if as_json:
        print_json(found.to_json())
    else:
        for name, fault in found.damaged.items():
            typer.echo(f"{name}: {fault}")
        print_warnings(list(found.warnings))
        typer.echo(found.title)
    if not found.ok:
        typer.echo(
            f"isochrome: {found.title}; run the command that left it again, which makes anew what "
            "is damaged",
            err=True,
        )
        raise typer.Exit(2)


def report_command(
    run: Annotated[
        str,
        typer.Argument(metavar="FOLDER", help="What process, fit, simulate or calibrate left."),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for report.html; by default the run's own.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a run's report: one HTML file that opens offline on any machine."""
    from isochrome.folder_report import report as write

    file = write(run, out)
    if as_json:
        print_json({"report": str(file)})
    else:
        typer.echo(file)
