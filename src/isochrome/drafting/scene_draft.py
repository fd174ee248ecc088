"""A drafted scene: its text, what each value comes from, and what is still open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from isochrome.output import Result
from isochrome.scene import Scene

Origin = Literal["file", "given", "found"]


@dataclass(frozen=True)
class DraftValue:
    """One value of a drafted scene.

    Parameters
    ----------
    key : str
        The scene's key, such as 'load.normal_n'.
    value : float, int or str
        The value, in the unit that the key names.
    standard_uncertainty : float or None
        In the same unit; None where it is not known, or the value is no measured number.
    origin : {'file', 'given', 'found'}
        Whether the frames' file names it, the user, or the search found it.
    """

    key: str
    value: float | int | str
    standard_uncertainty: float | None
    origin: Origin


@dataclass(frozen=True)
class OpenKey:
    """A key that nobody knows yet: a commented line of the scene.

    Parameters
    ----------
    key : str
        The scene's key.
    usual : str
        The usual range, with its unit.
    why : str
        What it is for, in a few words.
    """

    key: str
    usual: str
    why: str


@dataclass(frozen=True, repr=False, kw_only=True)
class SceneDraft(Result):
    """A scene that was drafted from frames.

    Parameters
    ----------
    text : str
        The scene as commented TOML.
    scene : Scene
        The same, read.
    values : tuple of DraftValue
        What stands in it, and where each value comes from.
    open : tuple of OpenKey
        What is left to fill in.
    warnings : tuple of str
        What to beware of, in sentences.
    frame : int
        The frame that was looked at.
    chi : float or None
        Residual over noise of the scene's fringes in that frame; None where none were fitted.
    draw : callable, optional
        Makes the preview.
    """

    text: str
    scene: Scene
    values: tuple[DraftValue, ...]
    open: tuple[OpenKey, ...]
    warnings: tuple[str, ...]
    frame: int
    chi: float | None
