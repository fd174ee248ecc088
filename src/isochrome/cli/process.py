"""The process command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from isochrome.cli.options import (
    Cluster,
    FramesArgument,
    Join,
    Json,
    Out,
    Restart,
    SceneOption,
    Workers,
)
from isochrome.console import (
    campaign_bar,
    print_columns,
    print_json,
    print_place,
    print_warnings,
    run_bar,
)

if TYPE_CHECKING:
    from isochrome.frames import FramesPath
    from isochrome.process import Processed


def process(
    frames: FramesArgument,
    scene: SceneOption,
    out: Out = Path("isochrome-process"),
    join: Join = False,
    rois: Annotated[
        bool, typer.Option("--rois", help="Also the fringe lines as ImageJ ROIs, skeleton.zip.")
    ] = False,
    track: Annotated[
        bool,
        typer.Option(
            "--track",
            help="For a contact's video: the orders of key frames only, and load, friction, wear "
            "and place followed through the others; their orders come without --track.",
        ),
    ] = False,
    every: Annotated[
        int | None,
        typer.Option("--every", help="With --track: frames from key frame to key frame, 200."),
    ] = None,
    workers: Workers = None,
    cluster: Cluster = None,
    restart: Restart = False,
    keep_going: Annotated[
        bool,
        typer.Option("--keep-going", help="Leave out frames that fail; the exit code is then 2."),
    ] = False,
    as_json: Json = False,
) -> None:
    """Find the fringe order of every captured frame; killed, the same command goes on.

    Several videos or TIFF stacks are a campaign: each is a recording with a folder of its own in
    --out, beside a summary of all; images, one to a file, are a recording together.
    """
    from isochrome.frames import recordings_of

    found = recordings_of(frames, join=join)
    options: dict[str, Any] = {
        "rois": rois,
        "track": track,
        "every": every,
        "workers": workers,
        "cluster": cluster,
        "restart": restart,
        "keep_going": keep_going,
    }
    if len(found) > 1:
        _process_campaign(found, scene, out, options, as_json)
        return
    from isochrome.process import process as run

    with run_bar("processing") as progress:
        result = run(found[0], scene, out, progress=progress, **options)
    if as_json:
        _print_as_json(result, out)
    else:
        _print_processed(result, out)
    if result.failed:
        typer.echo(
            f"isochrome: {frames[0]}: {result.failed} of {len(result.table['frame'])} frames could "
            f"not be processed, as their warnings say; the others are in {out}",
            err=True,
        )
        raise typer.Exit(2)


def _print_as_json(result: Processed, out: Path) -> None:
    """The table of all frames, of a tracked video with what they come to, as one JSON object."""
    said = {"out": str(out), "model": result.model, "frames": result.table}
    said |= {"summary": result.summary()} if result.tracked else {}
    print_json(said | {"warnings": list(result.warnings)})


def _print_processed(result: Processed, out: Path) -> None:
    """What was found in each frame, or what the thousands of a tracked video come to."""
    if result.tracked:
        _print_summary(result)
    else:
        names = [n for n in ("frame", "label", "chi", "kept_share", "n_max", "load.normal_n",
                 "friction.coefficient", "fringe_lines") if n in result.table]  # fmt: skip
        print_columns(result.table, names)
    print_warnings(list(result.warnings))
    print_place(out, already=result.already)


def _print_summary(result: Processed) -> None:
    """How many frames there are, and what each key comes to over them."""
    whole = sum(at is not None for at in result.table["picture"])
    typer.echo(f"{len(result.table['frame'])} frames, {whole} of them key frames")
    print_columns(result.summary())


def _process_campaign(
    recordings: tuple[FramesPath, ...],
    scene: str,
    out: Path,
    options: dict[str, Any],
    as_json: bool,
) -> None:
    """Many recordings, each into a folder of its own."""
    from isochrome.campaign import process_campaign

    with campaign_bar() as progress:
        result = process_campaign(recordings, scene, out, progress=progress, **options)
    table = result.table
    if as_json:
        print_json({"out": str(out), **result.to_json()})
    else:
        names = [n for n in ("recording", "status", "frames", "failed_frames", "flagged_frames",
                 "chi_median", "load.normal_n mean", "friction.coefficient mean", "kept_share")
                 if n in table]  # fmt: skip
        print_columns(table, names)
        for name, error in zip(table["recording"], table["error"], strict=True):
            if error:
                named = error if error.startswith(name) else f"{name}: {error}"
                typer.echo(f"failed: {named}", err=True)
        typer.echo(f"results: {out}; table of all: {out / 'summary.csv'}")
    if result.exit_code:
        some = ", ".join(result.failed[:5])
        more = f" and {len(result.failed) - 5} more" if len(result.failed) > 5 else ""
        typer.echo(
            f"isochrome: {len(result.failed)} of {len(recordings)} recordings could not be wholly "
            f"processed ({some}{more}), as {out / 'summary.csv'} says; the others are in {out}",
            err=True,
        )
        raise typer.Exit(result.exit_code)
