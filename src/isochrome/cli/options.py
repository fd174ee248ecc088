"""Arguments and options that several commands share."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

Command = TypeVar("Command", bound=Callable[..., None])

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

RUN = {
    "workers": (
        int | None,
        typer.Option(
            "--workers", help="Processes; by default as many as are useful.", show_default=False
        ),
    ),
    "cluster": (
        str | None,
        typer.Option("--cluster", help="Address of a Dask scheduler, tcp://host:8786."),
    ),
    "restart": (
        bool,
        typer.Option("--restart", help="Begin anew, whatever an earlier run has left."),
    ),
}
"""How a long run is computed: type and option of each, by the name that the function takes."""

AS_STATED = (
    bool,
    typer.Option(
        "--as-stated",
        help="Hold all that the scene states; else what the frames ask for (the camera's roll, "
        "uneven light, a band, ...) is fitted too, and said.",
    ),
)
"""For commands that fit: the option of the same name."""

TABLES = {
    "tables": (
        str | None,
        typer.Option(
            "--csv",
            help="excel: also NAME_excel.csv of each table, with semicolons and decimal commas.",
        ),
    ),
}
"""For commands that leave tables."""

FIGURE = {
    "width": (
        str | None,
        typer.Option("--width", help="Also a figure for a paper, this wide: 85mm, 174mm, 3.4in."),
    ),
    "shown": (
        str | None,
        typer.Option("--frames", help="Its frames (states, images), from 0: 0,2,4."),
    ),
    "formats": (
        str | None,
        typer.Option("--format", help="Its files: png, pdf, svg, tiff; pdf,png by default."),
    ),
    "dpi": (int | None, typer.Option("--dpi", help="Its dots per inch: 600 by default.")),
    "numbers": (bool, typer.Option("--numbers", help="Its panels' numbers, below them.")),
}
"""A figure for a paper, for commands that leave a picture; any of these asks for it."""

PROCESS = {
    "rois": (
        bool,
        typer.Option("--rois", help="Also the fringe lines as ImageJ ROIs, skeleton.zip."),
    ),
    "track": (
        bool,
        typer.Option(
            "--track",
            help="Follow a contact, or known orders, through a stack or folder too, frame by frame "
            "from key frames, as through a video.",
        ),
    ),
    "each": (
        bool,
        typer.Option("--each", help="Process every frame of a video as if it were alone."),
    ),
    "every": (
        int | None,
        typer.Option("--every", help="Frames from key frame to key frame of a video, 200."),
    ),
    "maps": (
        str | None,
        typer.Option(
            "--maps",
            help="Of a video, the maps of which frames: all, key, none; all up to 20 GB.",
        ),
    ),
    "preview": (
        bool,
        typer.Option(
            "--preview",
            help="Write the last frame's orders to OUT.partial/preview.png every few seconds.",
        ),
    ),
    "as_stated": AS_STATED,
    **RUN,
    "keep_going": (
        bool,
        typer.Option("--keep-going", help="Leave out frames that fail; the exit code is then 2."),
    ),
    **FIGURE,
    **TABLES,
}
"""What `process` takes besides its frames and scene, in the order of its help."""


def with_options(options: dict[str, tuple[Any, Any]]) -> Callable[[Command], Command]:
    """Give a command the options of a table, in front of --json: its `**options` takes them.

    A flag is off and all else is None where it is not given. Parameters: `options`, type and option
    of each by its name.
    """

    def declare(command: Command) -> Command:
        given = inspect.signature(command, eval_str=True)
        own = [p for p in given.parameters.values() if p.kind is not p.VAR_KEYWORD]
        shared = [
            inspect.Parameter(
                name,
                inspect.Parameter.KEYWORD_ONLY,
                default=False if kind is bool else None,
                annotation=Annotated[kind, option],
            )
            for name, (kind, option) in options.items()
        ]
        parameters = [*own[:-1], *shared, own[-1]]
        command.__signature__ = given.replace(parameters=parameters)  # type: ignore[attr-defined]
        return command

    return declare
