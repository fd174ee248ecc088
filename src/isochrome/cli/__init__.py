"""The command line: arguments in, one library call, results out. Heavy imports wait for it."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from isochrome.cli.calibrate import calibrate_app
from isochrome.cli.long import export, sweep
from isochrome.cli.options import (
    Cluster,
    FramesArgument,
    Join,
    Json,
    Out,
    Restart,
    SceneOption,
    Tractions,
    Workers,
)
from isochrome.cli.process import process
from isochrome.console import (
    print_columns,
    print_fit,
    print_json,
    print_place,
    print_rows,
    print_warnings,
    run_bar,
    steps,
)
from isochrome.errors import IsochromeError

if TYPE_CHECKING:
    from isochrome.frames import FramesPath

app = typer.Typer(
    name="isochrome",
    help="Photoelastic fringes of worn, sliding contacts: process, simulate, compare, calibrate.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(calibrate_app, name="calibrate")
app.command()(process)
app.command()(sweep)
app.command()(export)

STOPPED = 130
"""Exit code after Ctrl-C, as shells have it."""


@app.command()
def demo(out: Out = Path("isochrome-demo"), as_json: Json = False) -> None:
    """Run the paper's case and the sample images end to end, offline, in under a minute."""
    from isochrome.demo import demo as run

    with steps(as_json) as say:
        result = run(out, progress=say)
    if as_json:
        print_json(result.summary)
        return
    print_rows(("quantity", "found", "expected"), result.rows)
    typer.echo(f"experiment beside simulation: {result.folder / 'comparison' / 'comparison.png'}")


@app.command()
def simulate(
    scene: Annotated[str, typer.Argument(help="Scene file (TOML), or line-contact-wear.")],
    out: Out = Path("isochrome-simulate"),
    components: Annotated[
        bool, typer.Option("--components", help="Also the principal stresses, apart, in MPa.")
    ] = False,
    workers: Workers = None,
    cluster: Cluster = None,
    restart: Restart = False,
    as_json: Json = False,
) -> None:
    """Simulate a scene: contact, wear, stress, and the frames that the camera would see."""
    from isochrome.simulate import simulate as run

    with run_bar("simulating", "states") as progress:
        result = run(
            scene, out, components=components, workers=workers, cluster=cluster, restart=restart,
            progress=progress,
        )  # fmt: skip
    if as_json:
        print_json({"out": str(out), "history": result.history})
        return
    names = ["label", "p_max_mpa", "contact_width_mm", "wear_depth_um", "n_max", "n_max_x_mm",
             "n_max_z_mm"]  # fmt: skip
    names += ["shear_max_mpa", "shear_max_x_mm", "shear_max_z_mm"] if components else []
    print_columns(result.history, names)
    print_place(out, already=result.already)


@app.command()
def compare(
    experiment: Annotated[str, typer.Argument(help="Result folder of process, or frames.")],
    simulation: Annotated[str, typer.Argument(help="Result folder of simulate, or frames.")],
    out: Out = Path("isochrome-compare"),
    as_json: Json = False,
) -> None:
    """Compare experiment and simulation: metrics and the side-by-side figure."""
    from isochrome.compare.run import compare as run

    with steps(quiet=True) as say:
        say("comparing")
        result = run(experiment, simulation, out)
    if as_json:
        print_json({"out": str(out), "metrics": result.table})
        return
    names = ("label", "order_rms_fringe", "order_p95_fringe", "wrong_branch_share",
             "skeleton_distance_px", "ncc", "rmse_over_noise", "ssim")  # fmt: skip
    print_columns(result.table, names)
    typer.echo(f"results: {out}")


@app.command()
def fit(
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
    tractions: Tractions = False,
    out: Out = Path("isochrome-fit"),
    workers: Workers = None,
    cluster: Cluster = None,
    restart: Restart = False,
    as_json: Json = False,
) -> None:
    """Fit unknowns of the scene, such as load.normal_n; killed, the same command goes on."""
    from isochrome.fit.run import fit as run
    from isochrome.frames import one_recording

    recording = one_recording(frames, join=join)
    means: dict[str, Any] = {"workers": workers, "cluster": cluster, "restart": restart}
    if track:
        _track(recording, scene, tuple(free or ()), tuple(per_frame or ()), out, means, as_json)
        return
    with run_bar("fitting") as progress:
        result = run(
            recording, scene, free or [], per_frame=per_frame or [], follow=follow,
            tractions=tractions, out=out, progress=progress, **means,
        )  # fmt: skip
    if as_json:
        print_json({"out": str(out), **result.to_json()})
        return
    print_fit(result)
    print_warnings(list(result.warnings))
    print_place(out, already=result.already)


def _track(
    frames: FramesPath,
    scene: str,
    free: tuple[str, ...],
    keys: tuple[str, ...],
    out: Path,
    means: dict[str, Any],
    as_json: bool,
) -> None:
    """`fit --track`."""
    from isochrome.fit.track_run import refuse_shared, track

    refuse_shared(free)
    with run_bar("tracking") as progress:
        result = track(frames, scene, keys, out=out, progress=progress, **means)
    if as_json:
        print_json({"out": str(out), **result.to_json()})
        return
    print_columns(result.summary())
    print_warnings(list(result.warnings))
    print_place(out, already=result.already)


@app.command()
def check(
    frames: FramesArgument, scene: SceneOption, join: Join = False, as_json: Json = False
) -> None:
    """Say in plain words what is wrong with frames, before a long run."""
    from isochrome.frames import check_frames, recordings_of
    from isochrome.scene import load_scene

    described, recordings = load_scene(scene), recordings_of(frames, join=join)
    told = []
    for recording in recordings:
        result = check_frames(recording, described)
        findings = [{"level": f.level, "frame": f.frame, "text": f.text} for f in result.findings]
        told.append({"ok": result.ok, "frames": result.count, "findings": findings})
        if as_json:
            continue
        if len(recordings) > 1:
            typer.echo(f"{recording}:")
        for finding in result.findings:
            typer.echo(f"{finding.level}: {finding.text}")
        verdict = "no error found" if result.ok else "errors found; see above"
        typer.echo(f"{result.count} frames read: {verdict}")
    ok = all(one["ok"] for one in told)
    if as_json and len(told) == 1:
        print_json(told[0])
    elif as_json:
        named = [{"recording": str(r)} | one for r, one in zip(recordings, told, strict=True)]
        print_json({"ok": ok, "recordings": named})
    if not ok:
        raise typer.Exit(2)


@app.command()
def bench(
    suite: Annotated[
        str,
        typer.Argument(
            help="speed; fringes, every way to the order; fit; track; memory; or tolerance."
        ),
    ] = "speed",
    out: Out = Path("isochrome-bench"),
    as_json: Json = False,
) -> None:
    """Measure speed against error, side by side with the paper's own procedure."""
    from isochrome.bench import bench as run

    with steps(as_json) as say:
        result = run(out, suite=suite, progress=say)
    if as_json:
        print_json({"out": str(out), "rows": result.rows})
        return
    typer.echo(result.text)
    typer.echo(f"results: {out}")


def main() -> None:
    """Run the command line; refusals become one line and the exit codes 2 and 3."""
    try:
        app()
    except IsochromeError as error:
        _fail(str(error), error.exit_code)
    except SystemExit as end:
        if end.code == STOPPED:
            _fail(_stopped(end), STOPPED)
        usage = getattr(end.__context__, "format_message", None)  # a usage error, shown already
        if usage is not None and "--json" in sys.argv:
            typer.echo(json.dumps({"error": usage(), "exit_code": end.code}))
        raise
    except OSError as error:  # a drive that is gone, or full, where nobody else has said it
        what = error.filename or "a file"
        _fail(f"{what}: cannot be read or written ({error.strerror or error}); see its drive", 2)
    except MemoryError:
        _fail("not enough memory; use a smaller region of interest or fewer frames", 3)


def _stopped(end: BaseException) -> str:
    """What was said when the user stopped the command, and how to go on with it."""
    cause: BaseException | None = end
    while cause is not None and not isinstance(cause, KeyboardInterrupt):
        cause = cause.__cause__ or cause.__context__
    said = str(cause or "") or "stopped; nothing was left half-written"
    same = shlex.join(part for part in sys.argv[1:] if part != "--restart")
    return f"{said}: isochrome {same}" if said.endswith("goes on") else said


def _fail(text: str, code: int) -> None:
    """Say why, once, on standard error, and as JSON on standard output where JSON was asked for."""
    line = " ".join(text.split())
    if "--json" in sys.argv:
        typer.echo(json.dumps({"error": line, "exit_code": code}))
    typer.echo(f"isochrome: {line}", err=True)
    sys.exit(code)


if __name__ == "__main__":
    main()
