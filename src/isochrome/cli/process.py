"""The process command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from isochrome.cli.figure_options import (
    save_paper_figure,
    take_style,
    takes_excel,
    write_excel_tables,
)
from isochrome.cli.options import (
    PROCESS,
    FramesArgument,
    Join,
    Json,
    Out,
    SceneOption,
    with_options,
)
from isochrome.console import (
    campaign_bar,
    print_columns,
    print_figures,
    print_json,
    print_result,
    print_summary,
    run_bar,
)

if TYPE_CHECKING:
    from isochrome.figures import FigureStyle
    from isochrome.frames import FramesPath
    from isochrome.processing import Processed

_SHOWN = ("frame", "label", "chi", "kept_share", "n_max", "n_max_from", "order_uncertainty",
          "load.normal_n", "friction.coefficient", "fringe_lines")  # fmt: skip
_SHOWN_OF_CAMPAIGN = ("recording", "status", "frames", "failed_frames", "flagged_frames",
                      "chi_median", "load.normal_n mean", "friction.coefficient mean",
                      "kept_share")  # fmt: skip


@with_options(PROCESS)
def process_command(
    frames: FramesArgument,
    scene: SceneOption,
    out: Out = Path("isochrome-process"),
    join: Join = False,
    *,
    as_json: Json = False,
    **options: Any,
) -> None:
    """Find the fringe order of every captured frame; run the same command again to resume.

    Several videos or TIFF stacks are a campaign: each is a recording with a folder of its own in
    --out, beside a summary of all; images, one to a file, are a recording together.
    """
    from isochrome.frames import recordings_of

    style, excel = take_style(options), takes_excel(options)
    recordings = recordings_of(frames, join=join)
    if len(recordings) > 1:
        _process_campaign(recordings, scene, out, options, as_json, excel, style)
        return
    from isochrome.processing import process as run

    with run_bar("processing") as progress:
        result = run(recordings[0], scene, out, progress=progress, **options)
    files = save_paper_figure(result, out, style)
    write_excel_tables(out, excel)
    print_result(result, out, as_json, _print_processed, files)
    if result.failed:
        typer.echo(
            f"isochrome: {frames[0]}: {result.failed} of {len(result.columns['frame'])} frames "
            f"could not be processed, as their warnings say; the others are in {out}",
            err=True,
        )
        raise typer.Exit(2)


def _print_processed(result: Processed) -> None:
    """What was found in each frame, or what the thousands of a tracked video come to."""
    from isochrome.output import counted

    table = result.columns
    if result.tracked:
        pictures = sum(at is not None for at in table["picture"])
        typer.echo(f"{counted(len(table['frame']), 'frame')}, {counted(pictures, 'key frame')}")
        print_summary(result)
    else:
        print_columns(table, [name for name in _SHOWN if name in table])
        typer.echo(result.summary_text)


def _process_campaign(
    recordings: tuple[FramesPath, ...],
    scene: str,
    out: Path,
    options: dict[str, Any],
    as_json: bool,
    excel: bool,
    style: FigureStyle | None,
) -> None:
    """Many recordings, each into a folder of its own."""
    from isochrome.campaigns import process_campaign

    with campaign_bar() as progress:
        result = process_campaign(recordings, scene, out, progress=progress, **options)
    figures = save_paper_figure(result, out, style)
    write_excel_tables(out, excel)
    table = result.columns
    if as_json:
        places = {"out": str(out), "figures": figures} if figures else {"out": str(out)}
        print_json(places | result.to_json())
    else:
        print_columns(table, [name for name in _SHOWN_OF_CAMPAIGN if name in table])
        for name, error in zip(table["recording"], table["error"], strict=True):
            if error:
                named = error if error.startswith(name) else f"{name}: {error}"
                typer.echo(f"failed: {named}", err=True)
        typer.echo(f"results: {out}; table of all: {out / 'summary.csv'}")
        print_figures(figures)
    if result.exit_code:
        some = ", ".join(result.failed[:5])
        more = f" and {len(result.failed) - 5} more" if len(result.failed) > 5 else ""
        typer.echo(
            f"isochrome: {len(result.failed)} of {len(recordings)} recordings could not be wholly "
            f"processed ({some}{more}), as {out / 'summary.csv'} says; the others are in {out}",
            err=True,
        )
        raise typer.Exit(result.exit_code)
