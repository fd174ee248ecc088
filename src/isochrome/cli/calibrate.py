"""The calibrate commands."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from isochrome.cli.figure_options import (
    save_paper_figure,
    take_style,
    takes_excel,
    write_excel_tables,
)
from isochrome.cli.options import FIGURE, TABLES, Json, Out, SetArgument, with_options
from isochrome.cli.usage import examples_of
from isochrome.console import (
    print_calibration,
    print_figures,
    print_json,
    print_result,
    print_warnings,
    steps,
)

if TYPE_CHECKING:
    from isochrome.figures import FigureStyle

calibrate_app = typer.Typer(
    help="Calibrate the material fringe value, a colour table, the camera's scale, or the wear.",
    no_args_is_help=True,
    add_completion=False,
)

Into = Annotated[Path | None, typer.Option("--into", help="Scene file (TOML) to set the value in.")]


def _length(name: str, text: str) -> tuple[Any, Any]:
    return float | None, typer.Option(name, help=text, show_default=False)


SCALE = {
    "target": (
        str | None,
        typer.Option("--target", help="What the images show: chessboard or dots."),
    ),
    "columns": (
        int | None,
        typer.Option("--columns", help="Inner corners (or dots) in a row of the target."),
    ),
    "rows": (int | None, typer.Option("--rows", help="The same in a column.")),
    "spacing_mm": _length("--spacing-mm", "From corner to corner or from dot to dot, mm."),
    "spacing_uncertainty_mm": _length(
        "--spacing-uncertainty-mm", "Standard uncertainty of that, mm."
    ),
    "edges_mm": _length(
        "--edges-mm", "Instead of a target: the distance of two parallel edges, mm."
    ),
    "edges_uncertainty_mm": _length("--edges-uncertainty-mm", "Standard uncertainty of that, mm."),
}
"""What a scale is taken from: type and option of each, by the name that the function takes."""


def _fringe_value_command(specimen: str) -> Callable[..., None]:
    """The command that finds the fringe value from images of a specimen."""

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

        style, excel = take_style(options), takes_excel(options)
        run = partial(getattr(calibration, f"calibrate_{specimen}"), settings)
        result, files = _calibrated(run, settings, out, into, as_json, style, excel)
        if not as_json:
            print_calibration(result)
            typer.echo(_left(out, into, "value"))
            print_figures(files)

    return command


for _specimen, _images in {
    "bending": "a beam in four-point bending",
    "disc": "a disc under diametral compression",
}.items():
    calibrate_app.command(
        _specimen,
        help=f"Calibrate from images of {_images}.",
        epilog=examples_of(f"calibrate {_specimen}"),
    )(_fringe_value_command(_specimen))


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
    from isochrome.calibration import save_calibration

    style, excel = take_style(options), takes_excel(options)
    with steps(quiet=True) as say:
        say("calibrating")
        result = run(settings)
        save_calibration(result, out, source=settings)
        files = save_paper_figure(result, out, style)
        write_excel_tables(out, excel)
    print_result(result, out, as_json, _print_colours, files)


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
    from isochrome import calibration

    style, excel = take_style(options), takes_excel(options)
    run = partial(calibration.calibrate_scale, images, **options)
    result, files = _calibrated(run, images, out, into, as_json, style, excel)
    if as_json:
        return
    for name, value in result.main_values():
        typer.echo(f"{name} = {value}")
    for key in result.taken_as_exact:
        typer.echo(f"taken as exact: {key}")
    print_warnings(list(result.warnings))
    typer.echo(_left(out, into, "values"))
    print_figures(files)


@calibrate_app.command("wear", epilog=examples_of("calibrate wear"))
@with_options(FIGURE | TABLES)
def wear_command(
    settings: SetArgument,
    out: Out = Path("isochrome-calibrate"),
    into: Into = None,
    *,
    as_json: Json = False,
    **options: Any,
) -> None:
    """Calibrate the wear coefficient from traces over worn scars, or from worn volumes."""
    from isochrome import calibration

    style, excel = take_style(options), takes_excel(options)
    run = partial(calibration.calibrate_wear, settings)
    result, files = _calibrated(run, settings, out, into, as_json, style, excel)
    if as_json:
        return
    for name, value in result.main_values():
        typer.echo(f"{name} = {value}")
    print_warnings(list(result.warnings))
    typer.echo(_left(out, into, "value"))
    print_figures(files)


def _calibrated(
    run: Callable[[], Any],
    source: str | list[str],
    out: Path,
    into: Path | None,
    as_json: bool,
    style: FigureStyle | None,
    excel: bool,
) -> tuple[Any, list[str]]:
    """What a calibration of a `source` gives, left in `out` and in a scene, and printed as JSON.

    Also the files of its figure for a paper.
    """
    from isochrome import calibration

    with steps(quiet=True) as say:
        say("calibrating")
        if into is not None:
            calibration.check_scene_file(into)  # before the work, not after it
        result = run()
        calibration.save_calibration(result, out, source=source)
        if into is not None:
            first = source[0] if isinstance(source, list) else source
            calibration.write_into_scene(result, into, source=first)
        files = save_paper_figure(result, out, style)
        write_excel_tables(out, excel)
    if as_json:
        places: dict[str, Any] = {"out": out} if into is None else {"out": out, "into": into}
        places |= {"figures": files} if files else {}
        print_json({**places, **result.to_json()})
    return result, files


def _left(out: Path, into: Path | None, what: str) -> str:
    """Where the results are, and in which scene `what` was set."""
    return f"results: {out}" if into is None else f"results: {out}; {what} set in {into}"
