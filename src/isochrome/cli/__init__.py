"""The command line: arguments in, one library call, results out. Heavy imports wait for it."""

from __future__ import annotations

import shlex
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from isochrome.cli.options import (
    AS_STATED,
    FIGURE,
    PROCESS,
    RUN,
    TABLES,
    Commands,
    FramesArgument,
    Join,
    Json,
    Options,
    Out,
    SceneArgument,
    SceneOption,
    SetArgument,
    examples_of,
    fail,
    take_extras,
    with_options,
)
from isochrome.console import (
    campaign_bar,
    print_calibration,
    print_columns,
    print_figures,
    print_fit,
    print_json,
    print_markdown,
    print_result,
    print_result_json,
    print_rows,
    print_summary,
    print_warnings,
    run_bar,
    steps,
)
from isochrome.drafting import QUANTITIES
from isochrome.errors import InputError, IsochromeError
from isochrome.messages import message

if TYPE_CHECKING:
    from isochrome.frames import FramesPath
    from isochrome.processing import Processed

app = typer.Typer(
    name="isochrome",
    help="Photoelastic fringes of worn, sliding contacts: process, simulate, compare, calibrate.",
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
STOPPED = 130
"""Exit code after Ctrl-C, as shells have it."""


_SHOWN = ("frame", "label", "chi", "kept_share", "n_max", "n_max_from", "order_uncertainty",
          "load.normal_n", "friction.coefficient", "fringe_lines")  # fmt: skip
_SHOWN_OF_CAMPAIGN = ("recording", "status", "frames", "failed_frames", "flagged_frames",
                      "chi_median", "load.normal_n mean", "friction.coefficient mean",
                      "kept_share")  # fmt: skip


KNOWN: Options = {
    "shape": (str | None, "contact (a cylinder on a block), disc, or other."),
    **{name: (float | None, f"{one.question}.") for name, one in QUANTITIES.items()},
    "bit_depth": (int | None, "Bits of the sensor, where the file has more."),
    "channel": (str | None, "Of colour frames: red, green, blue or mean."),
    "field": (str | None, "dark or bright; else searched for."),
    "gamma": (float | None, "The camera stores light^(1/gamma); else searched for."),
    "rotate_deg": (int | None, "Quarter turns until the load is above; else searched."),
    "flip": (str | None, "horizontal or vertical, where a mirror was in the way."),
    "frame": (int | None, "Frame to look at, from 0; else the first with fringes."),
    "replace": (bool, "Replace the scene that is there."),
}
"""What is known: type and option of each, by the name that KnownValues has."""


@app.command("init", epilog=examples_of("init"))
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
    from isochrome import drafting
    from isochrome.frames import one_recording, open_frames

    replace, recording = options.pop("replace"), one_recording(frames, join=join)
    known = {name: value for name, value in options.items() if value is not None}
    if not as_json and sys.stdin.isatty():
        with open_frames(recording, leave_out=drafting.not_among_frames(recording)) as reader:
            names = drafting.open_questions(reader, drafting.known_values(known))
        for name in names:
            known[name] = typer.prompt(drafting.QUANTITIES[name].question, type=float, err=True)
    with steps(quiet=True) as say:
        say("looking for the specimen in the frames")
        draft = drafting.init(recording, known, out, replace=replace)
    print_result(draft, out, as_json, _print_draft)


def _print_draft(draft: Any) -> None:
    """What was found, what is open, and what to do next."""
    _print_values(draft)
    for key in draft.open:
        typer.echo(f"to fill in: {key.key}: {key.hint}")
    typer.echo("look at scene.png, fill in scene.toml; isochrome check says whether both fit")


@app.command("process", epilog=examples_of("process"))
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


calibrate_app = typer.Typer(
    help="Calibrate the material fringe value, a colour table, the camera's scale, or the wear.",
    no_args_is_help=True,
    add_completion=False,
)
app.add_typer(calibrate_app, name="calibrate")

INTO: Options = {"into": (Path | None, "Scene file (TOML) to set the value in.")}

SCALE: Options = INTO | {
    "target": (str | None, "What the images show: chessboard or dots."),
    "columns": (int | None, "Inner corners (or dots) in a row of the target."),
    "rows": (int | None, "The same in a column."),
    "spacing_mm": (float | None, "From corner to corner or from dot to dot, mm."),
    "spacing_uncertainty_mm": (float | None, "Standard uncertainty of that, mm."),
    "edges_mm": (float | None, "Instead of a target: the distance of two parallel edges, mm."),
    "edges_uncertainty_mm": (float | None, "Standard uncertainty of that, mm."),
}
"""What a scale is taken from: type and option of each, by the name that the function takes."""


def _add_calibration(what: str, text: str, show: Callable[[Any], None], given: Options) -> None:
    """Add the command that calibrates by a set: its help, and the options that it has of its
    own.
    """

    @calibrate_app.command(what, help=text, epilog=examples_of(f"calibrate {what}"))
    @with_options(given | FIGURE | TABLES)
    def command(
        settings: SetArgument,
        out: Out = Path("isochrome-calibrate"),
        *,
        as_json: Json = False,
        **options: Any,
    ) -> None:
        _calibrate(what, settings, out, as_json, options, show)


def _print_colours(result: Any) -> None:
    """How far the table goes, and the gamma that belongs to it."""
    typer.echo(f"colour table to N = {result.colour_table.highest:.2f} from {result.way}")
    typer.echo(f"gamma = {result.gamma:.3f}: set frames.gamma to it where the table is used")
    typer.echo(f"residual = {result.residual:.3f} of full light")


_add_calibration(
    "bending", "Calibrate from images of a beam in four-point bending.", print_calibration, INTO
)
_add_calibration(
    "disc", "Calibrate from images of a disc under diametral compression.", print_calibration, INTO
)
_add_calibration(
    "colour", "Calibrate a colour table, from a beam's images or from any images' own colours.",
    _print_colours, {},
)  # fmt: skip


@calibrate_app.command("scale", epilog=examples_of("calibrate scale"))
@with_options(SCALE | FIGURE | TABLES)
def scale_command(
    images: Annotated[
        list[str],
        typer.Argument(metavar="IMAGE...", help="Pictures of a target or two edges, of one size."),
    ],
    out: Out = Path("isochrome-calibrate"),
    *,
    as_json: Json = False,
    **options: Any,
) -> None:
    """Find mm a pixel and the lens, from a chessboard, dots or two edges a known distance apart."""
    _calibrate("scale", images, out, as_json, options, _print_values)


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
    INTO,
)


def _calibrate(
    what: str,
    source: str | list[str],
    out: Path,
    as_json: bool,
    options: dict[str, Any],
    show: Callable[[Any], None],
) -> None:
    """Calibrate from a `source`, leave the result in `out` and its values in a scene, and tell it.

    The options that are not of a calibration itself are taken out.
    """
    from isochrome import calibration

    write_extras, into = take_extras(options), options.pop("into", None)
    with steps(quiet=True) as say:
        say("calibrating")
        if into is not None:
            calibration.check_scene_file(into)  # before the work, not after it
        result = getattr(calibration, f"calibrate_{what}")(source, **options)
        calibration.save_calibration(result, out, source=source)
        if into is not None:
            first = source[0] if isinstance(source, list) else source
            calibration.write_into_scene(result, into, source=first)
        files = write_extras(result, out)
    values = "values" if what == "scale" else "value"
    print_result(result, out, as_json, show, files, into=into, what=values)


@app.command("sweep", epilog=examples_of("sweep"))
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


@app.command("export", epilog=examples_of("export"))
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
    for file in () if as_json else files:
        typer.echo(file)


@app.command("report", epilog=examples_of("report"))
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


@app.command("verify", epilog=examples_of("verify"))
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


def _show_version(wanted: bool) -> None:
    if wanted:
        from isochrome import __version__

        typer.echo(f"isochrome {__version__}")
        raise typer.Exit


@app.callback()
def _before_all(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Say which version this is.", callback=_show_version, is_eager=True
        ),
    ] = False,
) -> None:
    """What may stand before a command."""


@app.command("guide", epilog=examples_of("guide"))
def guide_command(
    topic: Annotated[
        str | None, typer.Argument(metavar="TOPIC", help="The page; without it, the list of all.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Show a page of the guide, or the list of its pages."""
    from isochrome.guide import guide_page

    text = guide_page(topic)
    if as_json:
        print_json({"topic": topic, "markdown": text})
    else:
        print_markdown(text)


@app.command("demo", epilog=examples_of("demo"))
@with_options(FIGURE)
def demo_command(
    out: Out = Path("isochrome-demo"), *, as_json: Json = False, **options: Any
) -> None:
    """Run the paper's case and the sample images end to end, offline, in under a minute.

    A figure for a paper is that of the comparison.
    """
    from isochrome.demonstration import demo as run

    write_extras = take_extras(options)
    with steps(as_json) as say:
        result = run(out, progress=say)
    figures = write_extras(result, result.folder / "comparison")
    if as_json:
        print_json(result.to_json() | ({"figures": figures} if figures else {}))
        return
    print_rows(("quantity", "found", "expected"), result.rows)
    typer.echo(f"experiment beside simulation: {result.folder / 'comparison' / 'comparison.png'}")
    print_figures(figures)


COMPONENTS: Options = {"components": (bool, "Also the principal stresses, apart, in MPa.")}


@app.command("simulate", epilog=examples_of("simulate"))
@with_options(COMPONENTS | RUN | FIGURE | TABLES)
def simulate_command(
    scene: SceneArgument,
    out: Out = Path("isochrome-simulate"),
    *,
    as_json: Json = False,
    **options: Any,
) -> None:
    """Simulate a scene: contact, wear, stress, and the frames that the camera would see."""
    from isochrome.simulation import simulate as run

    write_extras = take_extras(options)
    with run_bar("simulating", "states") as progress:
        result = run(scene, out, progress=progress, **options)
    figures = write_extras(result, out)
    names = ["label", "p_max_mpa", "contact_width_mm", "wear_depth_um", "n_max", "n_max_x_mm",
             "n_max_z_mm"]  # fmt: skip
    if options["components"]:
        names += ["shear_max_mpa", "shear_max_x_mm", "shear_max_z_mm"]
    print_result(result, out, as_json, lambda one: print_columns(one.history, names), figures)


@app.command("compare", epilog=examples_of("compare"))
@with_options(FIGURE | TABLES)
def compare_command(
    experiment: Annotated[
        str,
        typer.Argument(
            help="Result folder of process, or frames; or traces: a scene or a wear set."
        ),
    ],
    simulation: Annotated[str, typer.Argument(help="Result folder of simulate, or frames.")],
    out: Out = Path("isochrome-compare"),
    *,
    as_json: Json = False,
    **options: Any,
) -> None:
    """Compare experiment and simulation, frames or scars: metrics and the side-by-side figure."""
    from isochrome.comparison import compare as run

    write_extras = take_extras(options)
    with steps(quiet=True) as say:
        say("comparing")
        result = run(experiment, simulation, out)
        files = write_extras(result, out)
    print_result(
        result, out, as_json, lambda found: print_columns(found.columns, found.main_columns), files
    )


FIT: Options = {
    "free": (list[str] | None, "Key that all frames share; repeatable."),
    "per_frame": (list[str] | None, "Key of each frame; repeatable."),
    "follow": (bool, "Look for each frame where the last one was."),
    "track": (bool, "Follow the --per-frame keys through a video, frame by frame."),
    "tractions": (bool, "Also the pressure and shear on the surface, model-free."),
}
"""What is fitted, and how frames are gone through."""


@app.command("fit", epilog=examples_of("fit"))
@with_options(RUN | TABLES | {"as_stated": AS_STATED})
@with_options(FIT, before="out")
def fit_command(
    frames: FramesArgument,
    scene: SceneOption,
    join: Join = False,
    out: Out = Path("isochrome-fit"),
    *,
    as_json: Json = False,
    **options: Any,
) -> None:
    """Fit unknowns of the scene, such as load.normal_n; run the same command again to resume."""
    from isochrome.fitting import fit as run
    from isochrome.fitting import track as follow_keys
    from isochrome.frames import one_recording

    recording, write_extras = one_recording(frames, join=join), take_extras(options)
    free, keys, follow, track, tractions = (options.pop(name) for name in FIT)
    result: Any
    with run_bar("tracking" if track else "fitting") as progress:
        options |= {"out": out, "progress": progress}
        if track:
            if free:  # a frame is tracked before the others are seen
                raise InputError("free_together_track_tracked", keys=free[0])
            result = follow_keys(recording, scene, tuple(keys or ()), **options)
        else:
            options |= {"per_frame": tuple(keys or ()), "follow": follow, "tractions": tractions}
            result = run(recording, scene, free or [], **options)
    write_extras(result, out)
    print_result(result, out, as_json, print_summary if track else print_fit)


@app.command("check", epilog=examples_of("check"))
def check_command(
    frames: FramesArgument, scene: SceneOption, join: Join = False, as_json: Json = False
) -> None:
    """Say in plain words what is wrong with frames, before a long run."""
    from isochrome.frames import recordings_of
    from isochrome.output import counted
    from isochrome.processing import check
    from isochrome.scene import load_scene

    described, recordings = load_scene(scene), recordings_of(frames, join=join)
    reports = []
    for recording in recordings:
        result = check(recording, described)
        reports.append(result.to_json())
        if as_json:
            continue
        if len(recordings) > 1:
            typer.echo(f"{recording}:")
        for finding in result.findings:
            typer.echo(f"{finding.level}: {finding.text}")
        verdict = "no error found" if result.ok else "errors found; see above"
        typer.echo(f"{counted(result.count, 'frame')} read: {verdict}")
    ok = all(one["ok"] for one in reports)
    if as_json and len(reports) == 1:
        print_json(reports[0])
    elif as_json:
        named = [{"recording": str(r)} | one for r, one in zip(recordings, reports, strict=True)]
        print_json({"ok": ok, "recordings": named})
    if not ok:
        raise typer.Exit(2)


SETUP: Options = {
    "scene": (
        str | None,
        "Scene or set, there or not yet; by default scene.toml, or set.toml, beside the frames.",
    ),
    "calibration": (str | None, "beam (in bending) or disc: a calibration set of it is made."),
}
"""What is set up."""


@app.command("setup", epilog=examples_of("setup"))
@with_options(SETUP, before="join")
def setup_command(
    frames: FramesArgument,
    join: Join = False,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")
    ] = True,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Port; by default a free one.")
    ] = 0,
    as_json: Json = False,
    **options: Any,
) -> None:
    """Set up a scene or a calibration set on a page in the browser of this machine alone.

    In place of the frames a calibration set's file names its images.
    """
    from isochrome.frames import one_recording
    from isochrome.setup_page import setup as run

    def announce(url: str) -> None:
        typer.echo(f"the page is open at {url} until you close it (or press Ctrl-C here)", err=True)

    is_set = len(frames) == 1 and frames[0].lower().endswith(".toml")
    recording = frames[0] if is_set else one_recording(frames, join=join)
    saved = run(recording, browser=browser, port=port, announce=announce, **options)
    if as_json:
        print_json({"scene": None if saved is None else str(saved)})
    else:
        typer.echo("nothing was saved" if saved is None else f"saved: {saved}")


@app.command("bench", epilog=examples_of("bench"))
def bench_command(
    suite: Annotated[
        str,
        typer.Argument(
            help="speed; fringes, every way to the order; fit; defects; inputs; track; memory; "
            "tolerance."
        ),
    ] = "speed",
    out: Out = Path("isochrome-bench"),
    as_json: Json = False,
) -> None:
    """Measure speed against error, side by side with the paper's own procedure."""
    from isochrome.benchmarks import bench as run

    with steps(as_json) as say:
        result = run(out, suite=suite, progress=say)
    print_result(result, out, as_json, lambda found: typer.echo(found.text))


def main() -> None:
    """Run the command line; refusals become one line and the exit codes 2 and 3."""
    warnings.showwarning = lambda message, *_, **__: print_warnings([str(message)])
    try:
        app(prog_name="isochrome")  # also as `python -m isochrome`
    except IsochromeError as error:
        fail(error.message, error.exit_code)
    except SystemExit as end:
        if end.code == STOPPED:
            fail(_stopped(end), STOPPED)
        raise
    except OSError as error:  # a drive that is gone, or full, where nobody else has said it
        what = error.filename or "a file"
        fail(message("cannot_read_written_see", what=what, strerror=error.strerror or error), 2)
    except MemoryError:
        fail(message("not_enough_memory_use_smaller"), 3)


def _stopped(end: BaseException) -> str:
    """What was said when the user stopped the command, and how to go on with it."""
    cause: BaseException | None = end
    while cause is not None and not isinstance(cause, KeyboardInterrupt):
        cause = cause.__cause__ or cause.__context__
    reason = str(cause or "") or "stopped; nothing was left half-written"
    same = shlex.join(part for part in sys.argv[1:] if part != "--restart")
    return f"{reason}: isochrome {same}" if reason.endswith("to resume") else reason


if __name__ == "__main__":
    main()
