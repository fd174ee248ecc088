"""The command line: arguments in, one library call, results out. Heavy imports wait for it."""

import shlex
import sys
import warnings
from pathlib import Path
from typing import Annotated, Any

import typer

from isochrome.cli.commands import (
    calibrate_app,
    export_command,
    init_command,
    process_command,
    report_command,
    sweep_command,
    verify_command,
)
from isochrome.cli.options import (
    AS_STATED,
    FIGURE,
    RUN,
    TABLES,
    Commands,
    FramesArgument,
    Join,
    Json,
    Out,
    SceneArgument,
    SceneOption,
    examples_of,
    fail,
    take_extras,
    with_options,
)
from isochrome.console import (
    print_columns,
    print_figures,
    print_fit,
    print_json,
    print_markdown,
    print_result,
    print_rows,
    print_summary,
    print_warnings,
    run_bar,
    steps,
)
from isochrome.errors import IsochromeError
from isochrome.messages import message

app = typer.Typer(
    name="isochrome",
    help="Photoelastic fringes of worn, sliding contacts: process, simulate, compare, calibrate.",
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
app.add_typer(calibrate_app, name="calibrate")
app.command("init", epilog=examples_of("init"))(init_command)
app.command("process", epilog=examples_of("process"))(process_command)
app.command("sweep", epilog=examples_of("sweep"))(sweep_command)
app.command("export", epilog=examples_of("export"))(export_command)
app.command("report", epilog=examples_of("report"))(report_command)
app.command("verify", epilog=examples_of("verify"))(verify_command)

STOPPED = 130
"""Exit code after Ctrl-C, as shells have it."""


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


@app.command("simulate", epilog=examples_of("simulate"))
@with_options(RUN | FIGURE | TABLES)
def simulate_command(
    scene: SceneArgument,
    out: Out = Path("isochrome-simulate"),
    components: Annotated[
        bool, typer.Option("--components", help="Also the principal stresses, apart, in MPa.")
    ] = False,
    *,
    as_json: Json = False,
    **options: Any,
) -> None:
    """Simulate a scene: contact, wear, stress, and the frames that the camera would see."""
    from isochrome.simulation import simulate as run

    write_extras = take_extras(options)
    with run_bar("simulating", "states") as progress:
        result = run(scene, out, components=components, progress=progress, **options)
    figures = write_extras(result, out)
    names = ["label", "p_max_mpa", "contact_width_mm", "wear_depth_um", "n_max", "n_max_x_mm",
             "n_max_z_mm"]  # fmt: skip
    names += ["shear_max_mpa", "shear_max_x_mm", "shear_max_z_mm"] if components else []
    print_result(
        result, out, as_json, lambda found: print_columns(found.history, names),
        figures,
    )  # fmt: skip


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


@app.command("fit", epilog=examples_of("fit"))
@with_options(RUN | TABLES | {"as_stated": AS_STATED})
def fit_command(
    frames: FramesArgument,
    scene: SceneOption,
    join: Join = False,
    free: Annotated[
        list[str] | None, typer.Option("--free", help="Key that all frames share; repeatable.")
    ] = None,
    per_frame: Annotated[
        list[str] | None, typer.Option("--per-frame", help="Key of each frame; repeatable.")
    ] = None,
    follow: Annotated[
        bool, typer.Option("--follow", help="Look for each frame where the last one was.")
    ] = False,
    track: Annotated[
        bool,
        typer.Option(
            "--track", help="Follow the --per-frame keys through a video, frame by frame."
        ),
    ] = False,
    tractions: Annotated[
        bool,
        typer.Option("--tractions", help="Also the pressure and shear on the surface, model-free."),
    ] = False,
    out: Out = Path("isochrome-fit"),
    *,
    as_json: Json = False,
    **options: Any,
) -> None:
    """Fit unknowns of the scene, such as load.normal_n; run the same command again to resume."""
    from isochrome.fitting import fit as run
    from isochrome.fitting import refuse_shared
    from isochrome.fitting import track as follow_keys
    from isochrome.frames import one_recording

    recording, keys = one_recording(frames, join=join), tuple(per_frame or ())
    write_extras = take_extras(options)
    result: Any
    if track:
        refuse_shared(tuple(free or ()))
        with run_bar("tracking") as progress:
            result = follow_keys(recording, scene, keys, out=out, progress=progress, **options)
    else:
        with run_bar("fitting") as progress:
            result = run(
                recording, scene, free or [], per_frame=keys, follow=follow, tractions=tractions,
                out=out, progress=progress, **options,
            )  # fmt: skip
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


@app.command("setup", epilog=examples_of("setup"))
def setup_command(
    frames: FramesArgument,
    scene: Annotated[
        str | None,
        typer.Option(
            "--scene",
            help="Scene or set, there or not yet; by default scene.toml, or set.toml, beside the "
            "frames.",
        ),
    ] = None,
    calibration: Annotated[
        str | None,
        typer.Option(
            "--calibration", help="beam (in bending) or disc: a calibration set of it is made."
        ),
    ] = None,
    join: Join = False,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")
    ] = True,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Port; by default a free one.")
    ] = 0,
    as_json: Json = False,
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
    saved = run(
        recording, scene, calibration=calibration, browser=browser, port=port, announce=announce
    )
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
