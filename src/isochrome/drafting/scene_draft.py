"""A drafted scene: its text, what each value comes from, and what is still open."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from isochrome.output import Result, counted, with_uncertainty
from isochrome.scene import Scene

Origin = Literal["file", "given", "found"]


@dataclass(frozen=True, kw_only=True)
class DraftValue:
    """One value of a drafted scene.

    Parameters
    ----------
    key : str
        The scene's key, such as 'load.normal_n'.
    value : float, int or str
        The value, in the unit that the key names.
    origin : {'file', 'given', 'found'}
        Whether the frames' file tells it, the user, or the search found it.
    standard_uncertainty : float, optional
        In the same unit; None where it is not known, or the value is no measured number.
    note : str, default ''
        What the scene's comment adds.
    """

    key: str
    value: float | int | str
    origin: Origin
    standard_uncertainty: float | None = None
    note: str = ""

    @property
    def words(self) -> str:
        """The value with its uncertainty, for a report."""
        if self.standard_uncertainty is None or isinstance(self.value, str):
            return f"{self.value:g}" if isinstance(self.value, float) else str(self.value)
        return with_uncertainty(self.value, self.standard_uncertainty)


@dataclass(frozen=True)
class OpenKey:
    """A key that nobody knows yet: a line of the scene to fill in.

    Parameters
    ----------
    key : str
        The scene's key.
    hint : str
        What it is, its unit and what it usually is.
    """

    key: str
    hint: str


@dataclass(frozen=True, repr=False, kw_only=True)
class SceneDraft(Result):
    """A scene that was drafted from frames.

    Parameters
    ----------
    draw : callable, optional
        Makes the preview.
    text : str
        The scene as commented TOML.
    scene : Scene
        The same, read.
    values : tuple of DraftValue
        What stands in it, and where each value comes from.
    open : tuple of OpenKey
        What is left to fill in: comments of the text.
    warnings : tuple of str
        What to beware of, in sentences.
    frame : int
        The frame that was looked at.
    chi : float or None
        Residual over noise of the scene's fringes in that frame; None where none were fitted.
    """

    text: str
    scene: Scene
    values: tuple[DraftValue, ...]
    open: tuple[OpenKey, ...]
    warnings: tuple[str, ...]
    frame: int
    chi: float | None

    @property
    def found(self) -> tuple[DraftValue, ...]:
        """The values that were found in the frame."""
        return tuple(value for value in self.values if value.origin == "found")

    @property
    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row a value: its key, value, standard uncertainty and origin."""
        names = ("key", "value", "standard_uncertainty", "origin")
        return {name: [getattr(value, name) for value in self.values] for name in names}

    @property
    def title(self) -> str:
        """How much was found, and how much is open."""
        return (
            f"Scene from frame {self.frame}: {counted(len(self.found), 'value')} found, "
            f"{counted(len(self.open), 'line')} to fill in"
        )

    def main_values(self) -> Iterator[tuple[str, str]]:
        """What was found, and chi."""
        yield from ((value.key, value.words) for value in self.found)
        if self.chi is not None:
            yield "chi", f"{self.chi:.3f}"

    def to_json(self) -> dict[str, Any]:
        """The frame, chi, the values with their origin, what is open, and the warnings."""
        return {
            "frame": self.frame,
            "chi": self.chi,
            "values": [asdict(value) for value in self.values],
            "open": [asdict(key) for key in self.open],
            "warnings": list(self.warnings),
        }
