"""The calibrate commands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from isochrome.cli.options import Json, Out, SetArgument
from isochrome.console import print_calibration, print_json, print_result, steps

calibrate_app = typer.Typer(
    help="Calibrate the material fringe value, or a colour table.",
    no_args_is_help=True,
    add_completion=False,
)


def _fringe_value_command(specimen: str) -> Callable[..., None]:
    """The command that finds the fringe value from images of a specimen."""

    def command(
        settings: SetArgument,
        out: Out = Path("isochrome-calibrate"),
        into: Annotated[
            Path | None, typer.Option("--into", help="Scene file (TOML) to set the value in.")
        ] = None,
        as_json: Json = False,
    ) -> None:
        from isochrome import calibration

        with steps(quiet=True) as say:
            say("calibrating")
            if into is not None:
                calibration.check_scene_file(into)  # before the work, not after it
            result = getattr(calibration, f"calibrate_{specimen}")(settings)
            calibration.save_calibration(result, out, source=settings)
            if into is not None:
                calibration.write_into_scene(result, into, source=settings)
        if as_json:
            places = {"out": out} if into is None else {"out": out, "into": into}
            print_json({**places, **result.to_json()})
            return
        print_calibration(result)
        typer.echo(f"results: {out}" if into is None else f"results: {out}; value set in {into}")

    return command


for _specimen, _images in {
    "bending": "a beam in four-point bending",
    "disc": "a disc under diametral compression",
}.items():
    calibrate_app.command(_specimen, help=f"Calibrate from images of {_images}.")(
        _fringe_value_command(_specimen)
    )


@calibrate_app.command("colour")
def colour_command(
    settings: SetArgument,
    out: Out = Path("isochrome-calibrate"),
    as_json: Json = False,
) -> None:
    """Calibrate a colour table, from a beam's images or from any images' own colours."""
    from isochrome.calibration import calibrate_colour as run
    from isochrome.calibration import save_calibration

    with steps(quiet=True) as say:
        say("calibrating")
        result = run(settings)
        save_calibration(result, out, source=settings)
    print_result(result, out, as_json, _print_colours)


def _print_colours(result: Any) -> None:
    """How far the table goes, and the gamma that belongs to it."""
    typer.echo(f"colour table to N = {result.colour_table.highest:.2f} from {result.way}")
    typer.echo(f"gamma = {result.gamma:.3f}: set frames.gamma to it where the table is used")
    typer.echo(f"residual = {result.residual:.3f} of full light")
