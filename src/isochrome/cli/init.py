"""The init command: what is not given is asked for on a terminal."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import typer

from isochrome.cli.options import FramesArgument, Join, Json, Out, with_options
from isochrome.console import print_result, steps


def _number(name: str, text: str) -> tuple[Any, Any]:
    return float | None, typer.Option(name, help=text, show_default=False)


KNOWN = {
    "shape": (
        str | None,
        typer.Option("--shape", help="contact (a cylinder on a block), disc, or other."),
    ),
    "young_gpa": _number("--young-gpa", "Young's modulus of the specimen, GPa."),
    "poisson": _number("--poisson", "Poisson's ratio of the specimen."),
    "thickness_mm": _number("--thickness-mm", "Its thickness along the light, mm."),
    "fringe_value_n_per_mm": _number(
        "--fringe-value-n-per-mm", "Its material fringe value, N/mm per fringe."
    ),
    "radius_mm": _number("--radius-mm", "Radius of the cylinder, mm."),
    "indenter_young_gpa": _number("--indenter-young-gpa", "Its Young's modulus, GPa; steel 210."),
    "indenter_poisson": _number("--indenter-poisson", "Its Poisson's ratio; steel 0.3."),
    "load_n": _number("--load-n", "Load, N; within a factor of three."),
    "diameter_mm": _number("--diameter-mm", "Diameter of a disc, mm."),
    "pixel_mm": _number("--pixel-mm", "Side of a pixel, mm, where the file does not name it."),
    "bit_depth": (
        int | None,
        typer.Option("--bit-depth", help="Bits of the sensor, where the file has more."),
    ),
    "wavelength_nm": _number("--wavelength-nm", "Wavelength of the light, nm."),
    "channel": (
        str | None,
        typer.Option("--channel", help="Of colour frames: red, green, blue or mean."),
    ),
    "field": (str | None, typer.Option("--field", help="dark or bright; else searched for.")),
    "gamma": _number("--gamma", "The camera stores light^(1/gamma); else searched for."),
    "rotate_deg": (
        int | None,
        typer.Option("--rotate-deg", help="Quarter turns until the load is above; else searched."),
    ),
    "flip": (
        str | None,
        typer.Option("--flip", help="horizontal or vertical, where a mirror was in the way."),
    ),
    "frame": (
        int | None,
        typer.Option("--frame", help="Frame to look at, from 0; else the first with fringes."),
    ),
    "replace": (bool, typer.Option("--replace", help="Replace the scene that is there.")),
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
    for name, value in draft.main_values():
        typer.echo(f"{name} = {value}")
    for key in draft.open:
        typer.echo(f"to fill in: {key.key}: {key.hint}")
    typer.echo("look at scene.png, fill in scene.toml; isochrome check says whether both fit")
