"""The commands process, init, calibrate, sweep, export, verify and report."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from isochrome.cli.options import (
    FIGURE,
    PROCESS,
    RUN,
    TABLES,
    FramesArgument,
    Join,
    Json,
    Options,
    Out,
    SceneArgument,
    SceneOption,
    SetArgument,
    examples_of,
    take_extras,
    with_options,
)
from isochrome.console import (
    campaign_bar,
    print_calibration,
    print_columns,
    print_figures,
    print_json,
    print_result,
    print_result_json,
    print_summary,
    print_warnings,
    run_bar,
    steps,
)

if TYPE_CHECKING:
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

    write_extras = take_extras(options)
    recordings = recordings_of(frames, join=join)
    if len(recordings) > 1:
        _process_campaign(recordings, scene, out, options, as_json, write_extras)
        return
    from isochrome.processing import process as run

    with run_bar("processing") as progress:
        result = run(recordings[0], scene, out, progress=progress, **options)
    print_result(result, out, as_json, _print_processed, write_extras(result, out))
    if result.failed:
        _end(
            f"{frames[0]}: {result.failed} of {len(result.columns['frame'])} frames "
            f"could not be processed, as their warnings say; the others are in {out}",
            2,
        )


def _end(why: str, code: int) -> NoReturn:
    """End a command that has printed its result, of which something is missing."""
    typer.echo(f"isochrome: {why}", err=True)
    raise typer.Exit(code)


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
    write_extras: Callable[[Any, Path], list[str]],
) -> None:
    """Many recordings, each into a folder of its own."""
    from isochrome.campaigns import process_campaign

    with campaign_bar() as progress:
        result = process_campaign(recordings, scene, out, progress=progress, **options)
    figures = write_extras(result, out)
    table = result.columns
    if as_json:
        print_result_json(result, out, figures)
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
        _end(
            f"{len(result.failed)} of {len(recordings)} recordings could not be wholly "
            f"processed ({some}{more}), as {out / 'summary.csv'} says; the others are in {out}",
            result.exit_code,
        )


KNOWN: Options = {
    "shape": (str | None, "contact (a cylinder on a block), disc, or other."),
    "young_gpa": (float | None, "Young's modulus of the specimen, GPa."),
    "poisson": (float | None, "Poisson's ratio of the specimen."),
    "thickness_mm": (float | None, "Its thickness along the light, mm."),
    "fringe_value_n_per_mm": (float | None, "Its material fringe value, N/mm per fringe."),
    "radius_mm": (float | None, "Radius of the cylinder, mm."),
    "indenter_young_gpa": (float | None, "Its Young's modulus, GPa; steel 210."),
    "indenter_poisson": (float | None, "Its Poisson's ratio; steel 0.3."),
    "load_n": (float | None, "Load, N; within a factor of three."),
    "diameter_mm": (float | None, "Diameter of a disc, mm."),
    "pixel_mm": (float | None, "Side of a pixel, mm, where the file does not name it."),
    "bit_depth": (int | None, "Bits of the sensor, where the file has more."),
    "wavelength_nm": (float | None, "Wavelength of the light, nm."),
    "channel": (str | None, "Of colour frames: red, green, blue or mean."),
    "field": (str | None, "dark or bright; else searched for."),
    "gamma": (float | None, "The camera stores light^(1/gamma); else searched for."),
    "rotate_deg": (int | None, "Quarter turns until the load is above; else searched."),
    "flip": (str | None, "horizontal or vertical, where a mirror was in the way."),
    "frame": (int | None, "Frame to look at, from 0; else the first with fringes."),
    "replace": (bool, "Replace the scene that is there."),
}
"""What is known: type and option of each, by the name that KnownValues has."""


@with_options(KNOWN)
def init_command(
    frames: FramesArgument,
    join: Join = False,
    out: Out = Path("isochrome-init"),
    *,
    as_json: Json = False,
    **options: Any,
) -> None:
    """Write a commented scene from frames: place, load, friction, field, gamma and turn are found.

    What nobody can see in a frame is asked for on a terminal, or given as an option.
    """
    from isochrome.drafting import init as run
    from isochrome.frames import one_recording

    replace, recording = options.pop("replace"), one_recording(frames, join=join)
    known = {name: value for name, value in options.items() if value is not None}
    if not as_json and sys.stdin.isatty():
        known |= _asked(recording, known)
    with steps(quiet=True) as say:
        say("looking for the specimen in the frames")
        draft = run(recording, known, out, replace=replace)
    print_result(draft, out, as_json, _print_draft)


def _asked(recording: Any, known: dict[str, Any]) -> dict[str, float]:
    """What the user answers to the questions that are open."""
    from isochrome.drafting import QUANTITIES, known_values, not_among_frames, open_questions
    from isochrome.frames import open_frames

    with open_frames(recording, leave_out=not_among_frames(recording)) as frames:
        names = open_questions(frames, known_values(known))
    return {name: typer.prompt(QUANTITIES[name].question, type=float, err=True) for name in names}


def _print_draft(draft: Any) -> None:
    """What was found, what is open, and what to do next."""
    _print_values(draft)
    for key in draft.open:
        typer.echo(f"to fill in: {key.key}: {key.hint}")
    typer.echo("look at scene.png, fill in scene.toml; isochrome check says whether both fit")


calibrate_app = typer.Typer(
    help="Calibrate the material fringe value, a colour table, the camera's scale, or the wear.",
    no_args_is_help=True,
    add_completion=False,
)

Into = Annotated[Path | None, typer.Option("--into", help="Scene file (TOML) to set the value in.")]


SCALE: Options = {
    "target": (str | None, "What the images show: chessboard or dots."),
    "columns": (int | None, "Inner corners (or dots) in a row of the target."),
    "rows": (int | None, "The same in a column."),
    "spacing_mm": (float | None, "From corner to corner or from dot to dot, mm."),
    "spacing_uncertainty_mm": (float | None, "Standard uncertainty of that, mm."),
    "edges_mm": (float | None, "Instead of a target: the distance of two parallel edges, mm."),
    "edges_uncertainty_mm": (float | None, "Standard uncertainty of that, mm."),
}
"""What a scale is taken from: type and option of each, by the name that the function takes."""


def _add_calibration(what: str, text: str, show: Callable[[Any], None]) -> None:
    """Add the command that calibrates by a set and can leave the value in a scene; its help."""

    @calibrate_app.command(what, help=text, epilog=examples_of(f"calibrate {what}"))
    @with_options(FIGURE | TABLES)
    def command(
        settings: SetArgument,
        out: Out = Path("isochrome-calibrate"),
        into: Into = None,
        *,
        as_json: Json = False,
        **options: Any,
    ) -> None:
        from isochrome import calibration

        run = getattr(calibration, f"calibrate_{what}")
        _calibrate(run, settings, out, into, as_json, options, show)


_add_calibration(
    "bending", "Calibrate from images of a beam in four-point bending.", print_calibration
)
_add_calibration(
    "disc", "Calibrate from images of a disc under diametral compression.", print_calibration
)


@calibrate_app.command("colour", epilog=examples_of("calibrate colour"))
@with_options(FIGURE | TABLES)
def colour_command(
    settings: SetArgument,
    out: Out = Path("isochrome-calibrate"),
    *,
    as_json: Json = False,
    **options: Any,
) -> None:
    """Calibrate a colour table, from a beam's images or from any images' own colours."""
    from isochrome.calibration import calibrate_colour as run

    _calibrate(run, settings, out, None, as_json, options, _print_colours)


def _print_colours(result: Any) -> None:
    """How far the table goes, and the gamma that belongs to it."""
    typer.echo(f"colour table to N = {result.colour_table.highest:.2f} from {result.way}")
    typer.echo(f"gamma = {result.gamma:.3f}: set frames.gamma to it where the table is used")
    typer.echo(f"residual = {result.residual:.3f} of full light")


@calibrate_app.command("scale", epilog=examples_of("calibrate scale"))
@with_options(SCALE | FIGURE | TABLES)
def scale_command(
    images: Annotated[
        list[str],
        typer.Argument(metavar="IMAGE...", help="Pictures of a target or two edges, of one size."),
    ],
    out: Out = Path("isochrome-calibrate"),
    into: Into = None,
    *,
    as_json: Json = False,
    **options: Any,
) -> None:
    """Find mm a pixel and the lens, from a chessboard, dots or two edges a known distance apart."""
    from isochrome.calibration import calibrate_scale as run

    _calibrate(run, images, out, into, as_json, options, _print_values, what="values")


def _print_values(result: Any) -> None:
    """The main values of a result, and what was taken as exact."""
    for name, value in result.main_values():
        typer.echo(f"{name} = {value}")
    for key in getattr(result, "taken_as_exact", ()):
        typer.echo(f"taken as exact: {key}")


_add_calibration(
    "wear",
    "Calibrate the wear coefficient from traces over worn scars, or from worn volumes.",
    _print_values,
)


def _calibrate(
    run: Callable[..., Any],
    source: str | list[str],
    out: Path,
    into: Path | None,
    as_json: bool,
    options: dict[str, Any],
    show: Callable[[Any], None],
    *,
    what: str = "value",
) -> None:
    """Calibrate from a `source`, leave the result in `out` and `what` in a scene, and tell it.

    `options` of the figure and the tables are taken out; `run` gets the others.
    """
    from isochrome import calibration

    write_extras = take_extras(options)
    with steps(quiet=True) as say:
        say("calibrating")
        if into is not None:
            calibration.check_scene_file(into)  # before the work, not after it
        result = run(source, **options)
        calibration.save_calibration(result, out, source=source)
        if into is not None:
            first = source[0] if isinstance(source, list) else source
            calibration.write_into_scene(result, into, source=first)
        files = write_extras(result, out)
    print_result(result, out, as_json, show, files, into=into, what=what)


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
        print_result_json(result, out, ())
    else:
        print_warnings(list(result.reasons))
        for key in dict.fromkeys(text.partition("=")[0].strip() for text in vary):
            values = ", ".join(f"{value:g}" for value in dict.fromkeys(result.columns[key]))
            typer.echo(f"{key} = {values}")
        typer.echo(f"{counted(result.points, 'point')}; results: {out}")
    if result.failed:
        _end(
            f"{result.failed} of {result.points} points were refused by their physics, "
            f"as sweep.csv says; the others are in {out}",
            3,
        )


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
        result = verify(folder, progress=progress)
    if as_json:
        print_json(result.to_json())
    else:
        for name, fault in result.damaged.items():
            typer.echo(f"{name}: {fault}")
        print_warnings(list(result.warnings))
        typer.echo(result.title)
    if not result.ok:
        again = "run the command that left it again, which makes anew what is damaged"
        _end(f"{result.title}; {again}", 2)


def report_command(
    run: Annotated[
        str, typer.Argument(metavar="FOLDER", help="What process, fit, simulate or calibrate left.")
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
