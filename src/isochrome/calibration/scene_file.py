"""A calibrated fringe value set in a scene file, whose comments and layout stay as they are.

TOML allows one key in many layouts. Every plausible place in the text is tried, and the first
edit is taken after which the file says what it said before, but for this one value.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.calibration.result import Calibration
from isochrome.errors import InputError
from isochrome.output import replacing
from isochrome.scene import parse_scene, parse_toml, read_text, scene_names

KEY = "fringe_value_n_per_mm"
MARK = "calibrated: "
"""What a comment of ours begins with: a second calibration replaces it."""

_VALUE = re.compile(
    rf"""(?:"{KEY}"|'{KEY}'|{KEY})[ \t]*=[ \t]*(?P<value>[-+0-9._eE]+|\{{[^{{}}\r\n]*\}})"""
)
_TABLE = re.compile(
    r"""^[ \t]*\[[ \t]*(?:"specimen"|'specimen'|specimen)[ \t]*\][^\r\n]*\r?\n?""", re.M
)
_DOTTED = re.compile(r"""^[ \t]*(?:"specimen"|'specimen'|specimen)[ \t]*\.""", re.M)
_INLINE = re.compile(r"""(?:"specimen"|'specimen'|specimen)[ \t]*=[ \t]*\{[ \t]*(?P<rest>\}?)""")


def check_scene_file(path: str | Path) -> str:
    """Text of a scene file that a fringe value may be written into, line ends as they are.

    Parameters
    ----------
    path : str or Path
        The TOML file.

    Returns
    -------
    str
        Its text.

    Raises
    ------
    InputError
        For the name of a scene inside the package, a file that is missing, and one that is no
        scene.
    """
    place = Path(path)
    if not place.is_file() and str(path) in scene_names():
        raise InputError(
            f"{path}: this scene ships inside the package and is not written to; name a scene "
            "file of your own"
        )
    read_text(place)  # its refusals: missing, too large, not UTF-8
    text = place.read_bytes().decode("utf-8")
    parse_scene(text, folder=place.parent, label=str(path))
    return text


def write_into_scene(
    calibration: Calibration, scene: str | Path, *, source: str | Path | None = None
) -> float:
    """Set `specimen.fringe_value_n_per_mm` in a scene file to a calibration's value.

    It is written as { value = ..., standard_uncertainty = ... }, from which a fit has its prior, or
    an input of its budget. The value is rounded two digits beyond the uncertainty's first. A
    comment beside it states chi; all else in the file stays, to the byte. The file is replaced as a
    whole or not at all.

    Parameters
    ----------
    calibration : Calibration
        What `calibrate_bending` or `calibrate_disc` found.
    scene : str or Path
        The TOML file.
    source : str or Path, optional
        The calibration set, which the comment names.

    Returns
    -------
    float
        The value written, N/mm per fringe.

    Raises
    ------
    InputError
        Where the scene is one of the package, or the file is missing, is no scene or cannot be
        written, or its layout cannot be edited.

    Examples
    --------
    >>> import isochrome
    >>> from isochrome.samples import samples_path
    >>> set_file = samples_path() / "disc" / "set.toml"
    >>> found = isochrome.calibrate_disc(set_file)  # doctest: +SKIP
    >>> isochrome.write_into_scene(found, "scene.toml", source=set_file)  # doctest: +SKIP
    14.599
    """
    text = check_scene_file(scene)
    value, spread, comment = _entry(calibration, source)
    new = edited(text, value, spread, comment, name=str(scene))
    target = Path(scene).resolve()  # a link stays a link
    with replacing(target) as beside:
        beside.write_bytes(new.encode("utf-8"))
        shutil.copymode(target, beside)
    return float(value)


def edited(text: str, value: str, spread: str, comment: str, *, name: str = "scene") -> str:
    """A scene's TOML text with another fringe value.

    Parameters: `text`; `value` and its standard uncertainty `spread`, TOML numbers; `comment` for
    its line, without #; `name` of the file for messages. Returns the text. Raises InputError where
    no edit does only that.
    """
    wanted = parse_toml(text, name)
    known = {"value": float(value), "standard_uncertainty": float(spread)}
    wanted.setdefault("specimen", {})[KEY] = known
    written = f"{{ value = {value}, standard_uncertainty = {spread} }}"
    for candidate in _candidates(text, written, comment):
        if _says(candidate, wanted):
            return candidate
    raise InputError(
        f"{name}: its layout cannot be edited; set specimen.{KEY} = {written} in it by hand"
    )


def _entry(calibration: Calibration, source: str | Path | None) -> tuple[str, str, str]:
    """The value and its uncertainty as texts, and what the comment says of them."""
    value, spread = calibration.fringe_value_n_per_mm, calibration.standard_uncertainty
    digits = max(1, 2 - int(np.floor(np.log10(spread)))) if spread > 0 else 6
    origin = "" if source is None else f", {Path(source).name}"
    mark = "".join(c for c in f"{MARK}chi {calibration.chi:.2f}{origin}" if c.isprintable())
    return f"{value:.{digits}f}", f"{spread:.{digits}f}", mark


def _candidates(text: str, value: str, comment: str) -> Iterator[str]:
    """Edits that may be the right one: the value where the key stands, else the key put in."""
    for found in _VALUE.finditer(text):
        start, end = found.span("value")
        yield from _with_comment(text[:start] + value, text[end:], comment)
    line_end = "\r\n" if "\r\n" in text else "\n"
    line = f"{KEY} = {value}"
    for found in _TABLE.finditer(text):
        before = text[: found.end()]
        before += "" if before.endswith("\n") else line_end
        yield f"{before}{line}  # {comment}{line_end}{text[found.end() :]}"
    for found in _INLINE.finditer(text):
        start = found.start("rest")
        comma = " " if found["rest"] else ", "
        yield from _with_comment(text[:start] + line + comma, text[start:], comment)
    for found in _DOTTED.finditer(text):
        before, after = text[: found.start()], text[found.start() :]
        yield f"{before}specimen.{line}  # {comment}{line_end}{after}"
    gap = "" if not text or text.endswith("\n") else line_end
    yield f"{text}{gap}{line_end}[specimen]{line_end}{line}  # {comment}{line_end}"


def _with_comment(before: str, after: str, comment: str) -> Iterator[str]:
    """The text with the comment on this line, beside one that is there, and without it."""
    rest = re.match(r"""(?P<code>[^\r\n#"']*)(?P<comment>#[^\r\n]*)?""", after)
    if rest is not None:
        code, kept = rest["code"].rstrip(" \t"), rest["comment"] or ""
        gap = rest["code"][len(code) :] or "  "
        own = re.sub(rf";?[ \t]*{MARK}.*$", "", kept).rstrip()
        joint = "# " if own in ("", "#") else f"{own}; "
        yield f"{before}{code}{gap}{joint}{comment}{after[rest.end() :]}"
    yield before + after


def _says(text: str, wanted: dict[str, Any]) -> bool:
    try:
        return parse_toml(text, "scene") == wanted
    except InputError:
        return False
