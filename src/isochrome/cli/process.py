"""The process command."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from isochrome.cli.options import (
    Cluster,
    FramesArgument,
    Json,
    Out,
    Restart,
    SceneOption,
    Workers,
)
from isochrome.console import print_columns, print_json, print_warnings, run_bar


def process(
    frames: FramesArgument,
    scene: SceneOption,
    out: Out = Path("isochrome-process"),
    rois: Annotated[
        bool, typer.Option("--rois", help="Also the fringe lines as ImageJ ROIs, skeleton.zip.")
    ] = False,
    workers: Workers = None,
    cluster: Cluster = None,
    restart: Restart = False,
    keep_going: Annotated[
        bool,
        typer.Option("--keep-going", help="Leave out frames that fail; the exit code is then 2."),
    ] = False,
    as_json: Json = False,
) -> None:
    """Find the fringe order of every captured frame; killed, the same command goes on."""
    from isochrome.process import process as run

    with run_bar("processing") as progress:
        result = run(
            frames,
            scene,
            out,
            rois=rois,
            workers=workers,
            cluster=cluster,
            restart=restart,
            keep_going=keep_going,
            progress=progress,
        )
    warnings = list(result.warnings)
    if as_json:
        print_json(
            {"out": str(out), "model": result.model, "frames": result.table, "warnings": warnings}
        )
    else:
        names = [n for n in ("frame", "label", "chi", "kept_share", "n_max", "load.normal_n",
                 "friction.coefficient", "fringe_lines") if n in result.table]  # fmt: skip
        print_columns(result.table, names)
        print_warnings(warnings)
        done = " (complete already; --restart computes them anew)" if result.already else ""
        typer.echo(f"results: {out}{done}")
    if result.failed:
        typer.echo(
            f"isochrome: {frames}: {result.failed} of {len(result.table['frame'])} frames could "
            f"not be processed, as their warnings say; the others are in {out}",
            err=True,
        )
        raise typer.Exit(2)
