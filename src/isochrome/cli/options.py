"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object, and nothing else.")]
SceneOption = Annotated[
    str, typer.Option("--scene", help="Scene file (TOML), or a name such as line-contact-wear.")
]
Out = Annotated[Path, typer.Option("--out", help="Folder for the results.")]
Into = Annotated[Path | None, typer.Option("--into", help="Scene file (TOML) to set the value in.")]
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
Workers = Annotated[
    int | None,
    typer.Option("--workers", help="Processes; by default as many as pay.", show_default=False),
]
Cluster = Annotated[
    str | None, typer.Option("--cluster", help="Address of a Dask scheduler, tcp://host:8786.")
]
Restart = Annotated[
    bool, typer.Option("--restart", help="Begin anew, whatever an earlier run has left.")
]
Tractions = Annotated[
    bool,
    typer.Option("--tractions", help="Also the pressure and shear on the surface, model-free."),
]
