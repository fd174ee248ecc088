"""Commands of long runs: grids of simulations, and their results for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from isochrome.cli.options import Cluster, Json, Out, Restart, Workers
from isochrome.console import print_json, print_warnings, run_bar


def sweep(
    scene: Annotated[str, typer.Argument(help="Scene file (TOML), or line-contact-wear.")],
    vary: Annotated[
        list[str],
        typer.Option("--vary", help="KEY=first:last:number, or KEY=value,value; repeatable."),
    ],
    out: Out = Path("isochrome-sweep"),
    workers: Workers = None,
    cluster: Cluster = None,
    restart: Restart = False,
    as_json: Json = False,
) -> None:
    """Simulate a scene over a grid of values into one dataset; killed, the same command goes on."""
    from isochrome.sweep import sweep as run

    with run_bar("sweeping", "points") as progress:
        result = run(
            scene, vary, out, workers=workers, cluster=cluster, restart=restart, progress=progress
        )
    if as_json:
        axes = {key: list(values) for key, values in result.axes.items()}
        print_json(
            {
                "out": str(out),
                "points": result.points,
                "failed": result.failed,
                "axes": axes,
                "reasons": list(result.reasons),
            }
        )
    else:
        print_warnings(list(result.reasons))
        typer.echo(f"{result.points} points; results: {out}")
    if result.failed:
        typer.echo(
            f"isochrome: {result.failed} of {result.points} points were refused by their physics, "
            f"as sweep.csv says; the others are in {out}",
            err=True,
        )
        raise typer.Exit(3)


def export(
    run: Annotated[str, typer.Argument(help="Result folder of process or sweep.")],
    to: Annotated[str, typer.Option("--to", help="netcdf (MATLAB), tiff (ImageJ) or csv.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the files; by default the run's own.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a run's results for MATLAB, ImageJ or a spreadsheet."""
    from isochrome.runs.export import export as write

    files = [str(file) for file in write(run, to, out)]
    if as_json:
        print_json({"files": files})
        return
    for file in files:
        typer.echo(file)
