"""The command line: arguments in, one library call, results out. Heavy imports wait for it."""

from __future__ import annotations

import inspect
import shlex
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from isochrome.cli.options import (
    OPTIONS,
    Commands,
    FramesArgument,
    Join,
    Options,
    SceneArgument,
    SceneOption,
    SetArgument,
    examples_of,
    fail,
    parameters,
    take_extras,
)
from isochrome.console import (
    campaign_bar,
    print_columns,
    print_fit,
    print_json,
    print_markdown,
    print_rows,
    print_summary,
    print_values,
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

calibrate_app = typer.Typer(
    help="Calibrate the material fringe value, a colour table, the camera's scale, or the wear.",
    no_args_is_help=True,
    add_completion=False,
)
app.add_typer(calibrate_app, name="calibrate")


@dataclass(frozen=True)
class Finished:
    """What a command has done: a Result that it left in its folder, or a dict, printed as JSON."""

    result: Any
    show: Callable[[Any], None]  # prints it for people
    # prints its warnings and its place too; else these follow
    shows_all: bool = False
    failure: tuple[str, int] | None = None  # what of it is missing, and the exit code
    extras: Path | None = None  # folder of a figure for a paper, where it is not the results'
    into: tuple[str, Path] | None = None  # what of it was set in which scene


def command(
    name: str, *tables: str | Options, text: str | None = None
) -> Callable[[Callable[..., Finished]], Callable[..., Finished]]:
    """Add a function's command, with --out, the options of tables, --json; print what it gives."""
    group, _, word = name.rpartition(" ")

    def add(function: Callable[..., Finished]) -> Callable[..., Finished]:
        given = inspect.signature(function, eval_str=True).parameters
        writes = "out" in given and given["out"].kind is inspect.Parameter.KEYWORD_ONLY
        folder = Path(f"isochrome-{name.split()[0]}") if writes else None

        def run(*, as_json: bool, **values: Any) -> None:
            write_extras = take_extras(values)
            if "as_json" in given:
                values["as_json"] = as_json
            outcome = function(**values)
            out = values["out"] if writes else Path()
            files = write_extras(outcome.result, outcome.extras or out)
            if as_json:
                places = {"out": out, "into": outcome.into and outcome.into[1], "figures": files}
                places = {name: place for name, place in places.items() if place}
                result = outcome.result
                print_json(result if isinstance(result, dict) else places | result.to_json())
            else:
                _print(outcome, out, files)
            if outcome.failure is not None:
                why, code = outcome.failure
                if why:
                    typer.echo(f"isochrome: {why}", err=True)
                raise typer.Exit(code)

        signature = inspect.Signature(parameters(given.values(), folder, tables))
        run.__signature__ = signature  # type: ignore[attr-defined]
        words = text or inspect.getdoc(function)
        (calibrate_app if group else app).command(word, help=words, epilog=examples_of(name))(run)
        return function

    return add


def _print(outcome: Finished, out: Path, files: Sequence[str]) -> None:
    result = outcome.result
    outcome.show(result)
    if not outcome.shows_all:
        print_warnings(list(result.warnings))
        done = getattr(result, "already", False)  # an earlier run had left it all
        again = " (complete already; --restart computes them anew)" if done else ""
        also = "; {} set in {}".format(*outcome.into) if outcome.into else ""
        typer.echo(f"results: {out}{again}{also}")
    if files:
        typer.echo(f"figure for a paper: {', '.join(files)}")


_SHOWN = ("frame", "label", "chi", "kept_share", "n_max", "n_max_from", "order_uncertainty",
          "load.normal_n", "friction.coefficient", "fringe_lines")  # fmt: skip
_SHOWN_OF_CAMPAIGN = ("recording", "status", "frames", "failed_frames", "flagged_frames",
                      "chi_median", "load.normal_n mean", "friction.coefficient mean",
                      "kept_share")  # fmt: skip


QUANTITIES_GIVEN: Options = {
    name: (float | None, f"{one.question}.") for name, one in QUANTITIES.items()
}
"""Numbers that are known, by the names that KnownValues has."""


@command("init", "shape", QUANTITIES_GIVEN, "known")
def init_command(
    frames: FramesArgument, join: Join = False, *, out: Path, as_json: bool, **options: Any
) -> Finished:
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

    def show(draft: Any) -> None:
        print_values(draft)
        for key in draft.open:
            typer.echo(f"to fill in: {key.key}: {key.hint}")
        typer.echo("look at scene.png, fill in scene.toml; isochrome check says whether both fit")

    with steps(quiet=True) as say:
        say("looking for the specimen in the frames")
        return Finished(drafting.init(recording, known, out, replace=replace), show)


@command("process", "process", "as_stated", "run", "keep_going", "figure", "tables")
def process_command(
    frames: FramesArgument, scene: SceneOption, join: Join = False, *, out: Path, **options: Any
) -> Finished:
    """Find the fringe order of every captured frame; run the same command again to resume.

    Several videos or TIFF stacks are a campaign: each is a recording with a folder of its own in
    --out, beside a summary of all; images, one to a file, are a recording together.
    """
    from isochrome.frames import recordings_of

    recordings = recordings_of(frames, join=join)
    if len(recordings) > 1:
        return _process_campaign(recordings, scene, out, options)
    from isochrome.processing import process as run

    with run_bar("processing") as progress:
        result = run(recordings[0], scene, out, progress=progress, **options)
    missing = (
        f"{frames[0]}: {result.failed} of {len(result.columns['frame'])} frames "
        f"could not be processed, as their warnings say; the others are in {out}"
    )
    return Finished(result, _print_processed, failure=(missing, 2) if result.failed else None)


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
    recordings: tuple[FramesPath, ...], scene: str, out: Path, options: dict[str, Any]
) -> Finished:
    from isochrome.campaigns import process_campaign

    with campaign_bar() as progress:
        result = process_campaign(recordings, scene, out, progress=progress, **options)
    summary = out / "summary.csv"

    def show(result: Any) -> None:
        table = result.columns
        print_columns(table, [name for name in _SHOWN_OF_CAMPAIGN if name in table])
        for name, error in zip(table["recording"], table["error"], strict=True):
            if error:
                named = error if error.startswith(name) else f"{name}: {error}"
                typer.echo(f"failed: {named}", err=True)
        typer.echo(f"results: {out}; table of all: {summary}")

    some = ", ".join(result.failed[:5])
    more = f" and {len(result.failed) - 5} more" if len(result.failed) > 5 else ""
    missing = (
        f"{len(result.failed)} of {len(recordings)} recordings could not be wholly "
        f"processed ({some}{more}), as {summary} says; the others are in {out}"
    )
    failure = (missing, result.exit_code) if result.exit_code else None
    return Finished(result, show, shows_all=True, failure=failure)


def _calibrate(
    what: str,
    show: Callable[[Any], None],
    source: SetArgument,
    *,
    out: Path,
    into: Path | None = None,
    **options: Any,
) -> Finished:
    from isochrome import calibration

    given: Any = source  # of a scale its images
    with steps(quiet=True) as say:
        say("calibrating")
        if into is not None:
            calibration.check_scene_file(into)  # before the work, not after it
        result = getattr(calibration, f"calibrate_{what}")(given, **options)
        calibration.save_calibration(result, out, source=given)
        if into is not None:
            first = given[0] if isinstance(given, list) else given
            calibration.write_into_scene(result, into, source=first)
    values = "values" if what == "scale" else "value"
    return Finished(result, show, into=(values, into) if into else None)


def _print_colours(result: Any) -> None:
    """How far the table goes, and the gamma that belongs to it."""
    typer.echo(f"colour table to N = {result.colour_table.highest:.2f} from {result.way}")
    typer.echo(f"gamma = {result.gamma:.3f}: set frames.gamma to it where the table is used")
    typer.echo(f"residual = {result.residual:.3f} of full light")


for what, text, show, given in (
    ("bending", "Calibrate from images of a beam in four-point bending.", print_values, "into"),
    ("disc", "Calibrate from images of a disc under diametral compression.", print_values,
     "into"),
    ("colour", "Calibrate a colour table, from a beam's images or from any images' own colours.",
     _print_colours, {}),
    ("wear", "Calibrate the wear coefficient from traces over worn scars, or from worn volumes.",
     print_values, "into"),
):  # fmt: skip
    run = partial(_calibrate, what, show)
    command(f"calibrate {what}", given, "figure", "tables", text=text)(run)


@command("calibrate scale", "into", "scale", "figure", "tables")
def scale_command(
    images: Annotated[
        list[str],
        typer.Argument(metavar="IMAGE...", help="Pictures of a target or two edges, of one size."),
    ],
    *,
    out: Path,
    **options: Any,
) -> Finished:
    """Find mm a pixel and the lens, from a chessboard, dots or two edges a known distance apart."""
    sources: Any = images
    return _calibrate("scale", print_values, sources, out=out, **options)


@command("sweep", "run")
def sweep_command(
    scene: SceneArgument,
    vary: Annotated[
        list[str],
        typer.Option("--vary", help="KEY=first:last:number, or KEY=value,value; repeatable."),
    ],
    *,
    out: Path,
    **options: Any,
) -> Finished:
    """Simulate a scene over a grid of values into one dataset.

    Run the same command again to resume.
    """
    from isochrome.output import counted
    from isochrome.sweeps import sweep as run

    with run_bar("sweeping", "points") as progress:
        result = run(scene, vary, out, progress=progress, **options)

    def show(result: Any) -> None:
        print_warnings(list(result.warnings))
        for key in dict.fromkeys(text.partition("=")[0].strip() for text in vary):
            values = ", ".join(f"{value:g}" for value in dict.fromkeys(result.columns[key]))
            typer.echo(f"{key} = {values}")
        typer.echo(f"{counted(result.points, 'point')}; results: {out}")

    missing = (
        f"{result.failed} of {result.points} points were refused by their physics, "
        f"as sweep.csv says; the others are in {out}"
    )
    return Finished(result, show, shows_all=True, failure=(missing, 3) if result.failed else None)


@command("plan", "as_stated")
def plan_command(
    scene: SceneArgument,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", help="KEY=first:last:number, or KEY=value,value; repeatable."),
    ] = None,
    frames: Annotated[
        list[int] | None,
        typer.Option("--frames", help="How many frames alike; repeatable; 1 and 10 by default."),
    ] = None,
    state: Annotated[
        int | None, typer.Option("--state", help="Of the scene's states, from 0; else the last.")
    ] = None,
    *,
    out: Path,
    **options: Any,
) -> Finished:
    """Say what an experiment will tell before it is made, what limits it, and what would help."""
    from isochrome.planning import plan as run

    with run_bar("planning", "points") as progress:
        result = run(
            scene, vary, frames=frames or (1, 10), state=state, out=out, progress=progress,
            **options,
        )  # fmt: skip
    return Finished(result, lambda result: typer.echo("\n".join(result.sentences)))


def _plain(values: dict[str, Any], *lines: Any) -> Finished:
    """Values that are no result, and the lines that say them."""
    return Finished(values, lambda _: typer.echo("\n".join(map(str, lines))), shows_all=True)


@command("export")
def export_command(
    run: Annotated[str, typer.Argument(help="Result folder of process or sweep.")],
    to: Annotated[str, typer.Option("--to", help="netcdf (MATLAB), tiff (ImageJ), csv or excel.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the files; by default the run's own.")
    ] = None,
) -> Finished:
    """Write a run's results for MATLAB, ImageJ or a spreadsheet."""
    from isochrome.runs import export as write

    files = [str(file) for file in write(run, to, out)]
    return _plain({"files": files}, *files)


@command("report")
def report_command(
    run: Annotated[
        str, typer.Argument(metavar="FOLDER", help="What process, fit, simulate or calibrate left.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for report.html; by default the run's own.")
    ] = None,
) -> Finished:
    """Write a run's report: one HTML file that opens offline on any machine."""
    from isochrome.folder_report import report as write

    file = str(write(run, out))
    return _plain({"report": file}, file)


@command("verify")
def verify_command(
    folder: Annotated[
        str, typer.Argument(metavar="FOLDER", help="What a command left; of a campaign all of it.")
    ],
) -> Finished:
    """Read all files of a results folder and say which are not what was left there."""
    from isochrome.runs import verify

    with run_bar("reading", "files") as progress:
        result = verify(folder, progress=progress)

    def show(_: Any) -> None:
        for name, fault in result.damaged.items():
            typer.echo(f"{name}: {fault}")
        print_warnings(list(result.warnings))
        typer.echo(result.title)

    again = "run the command that left it again, which makes anew what is damaged"
    failure = None if result.ok else (f"{result.title}; {again}", 2)
    return Finished(result.to_json(), show, shows_all=True, failure=failure)


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


@command("guide")
def guide_command(
    topic: Annotated[
        str | None, typer.Argument(metavar="TOPIC", help="The page; without it, the list of all.")
    ] = None,
) -> Finished:
    """Show a page of the guide, or the list of its pages."""
    from isochrome.guide import guide_page

    text = guide_page(topic)
    return Finished({"topic": topic, "markdown": text}, lambda _: print_markdown(text), True)


@command("demo", "figure")
def demo_command(*, out: Path, as_json: bool, **_: Any) -> Finished:
    """Run the paper's case and the sample images end to end, offline, in under a minute.

    A figure for a paper is that of the comparison.
    """
    from isochrome.demonstration import demo as run

    with steps(as_json) as say:
        result = run(out, progress=say)
    compared = result.folder / "comparison"

    def show(result: Any) -> None:
        print_rows(("quantity", "found", "expected"), result.rows)
        typer.echo(f"experiment beside simulation: {compared / 'comparison.png'}")

    return Finished(result, show, shows_all=True, extras=compared)


@command("simulate", "simulate", "run", "figure", "tables")
def simulate_command(scene: SceneArgument, *, out: Path, **options: Any) -> Finished:
    """Simulate a scene: contact, wear, stress, and the frames that the camera would see."""
    from isochrome.simulation import simulate as run

    with run_bar("simulating", "states") as progress:
        result = run(scene, out, progress=progress, **options)
    names = ["label", "p_max_mpa", "contact_width_mm", "wear_depth_um", "n_max", "n_max_x_mm",
             "n_max_z_mm"]  # fmt: skip
    if options["components"]:
        names += ["shear_max_mpa", "shear_max_x_mm", "shear_max_z_mm"]
    return Finished(result, lambda found: print_columns(found.history, names))


@command("compare", "figure", "tables")
def compare_command(
    experiment: Annotated[
        str,
        typer.Argument(
            help="Result folder of process, or frames; or traces: a scene or a wear set."
        ),
    ],
    simulation: Annotated[str, typer.Argument(help="Result folder of simulate, or frames.")],
    *,
    out: Path,
    **_: Any,
) -> Finished:
    """Compare experiment and simulation, frames or scars: metrics and the side-by-side figure."""
    from isochrome.comparison import compare as run

    with steps(quiet=True) as say:
        say("comparing")
        result = run(experiment, simulation, out)
    return Finished(result, lambda found: print_columns(found.columns, found.main_columns))


@command("fit", "fit", "run", "tables", "as_stated")
def fit_command(
    frames: FramesArgument, scene: SceneOption, join: Join = False, *, out: Path, **options: Any
) -> Finished:
    """Fit unknowns of the scene, such as load.normal_n; run the same command again to resume."""
    from isochrome.fitting import fit as run
    from isochrome.fitting import track as follow_keys
    from isochrome.frames import one_recording

    recording = one_recording(frames, join=join)
    free, keys, follow, track, tractions = (options.pop(name) for name in OPTIONS["fit"])
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
    return Finished(result, print_summary if track else print_fit)


@command("check")
def check_command(
    frames: FramesArgument, scene: SceneOption, join: Join = False, *, as_json: bool
) -> Finished:
    """Say in plain words what is wrong with frames, before a long run."""
    from isochrome.frames import recordings_of
    from isochrome.output import counted
    from isochrome.processing import check
    from isochrome.scene import load_scene

    described, recordings = load_scene(scene), recordings_of(frames, join=join)
    reports = []
    for recording in recordings:
        result = check(recording, described)
        reports.append({"recording": str(recording)} | result.to_json())
        if as_json:
            continue
        if len(recordings) > 1:
            typer.echo(f"{recording}:")
        for finding in result.findings:
            typer.echo(f"{finding.level}: {finding.text}")
        verdict = "no error found" if result.ok else "errors found; see above"
        typer.echo(f"{counted(result.count, 'frame')} read: {verdict}")
    ok = all(one["ok"] for one in reports)
    values: dict[str, Any] = {"ok": ok, "recordings": reports}
    if len(reports) == 1:
        (values,) = reports
        del values["recording"]
    return Finished(values, lambda _: None, shows_all=True, failure=None if ok else ("", 2))


@command("setup", "setup")
def setup_command(
    frames: FramesArgument,
    join: Join = False,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")
    ] = True,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Port; by default a free one.")
    ] = 0,
    **options: Any,
) -> Finished:
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
    if saved is None:
        return _plain({"scene": None}, "nothing was saved")
    return _plain({"scene": str(saved)}, f"saved: {saved}")


@command("bench")
def bench_command(
    suite: Annotated[
        str,
        typer.Argument(
            help="speed; fringes, every way to the order; fit; defects; inputs; track; memory; "
            "tolerance."
        ),
    ] = "speed",
    *,
    out: Path,
    as_json: bool,
) -> Finished:
    """Measure speed against error, side by side with the paper's own procedure."""
    from isochrome.benchmarks import bench as run

    with steps(as_json) as say:
        result = run(out, suite=suite, progress=say)
    return Finished(result, lambda found: typer.echo(found.text))


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
