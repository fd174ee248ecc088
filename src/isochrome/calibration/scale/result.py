"""What a picture of a target or of two edges tells of the camera, each with its uncertainty."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.estimation import BudgetInput
from isochrome.figures import PaperPanels
from isochrome.output import Result, columns_of, counted, with_uncertainty

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

LENS = ("distortion", "keystone_x", "keystone_z")
"""What bends the picture; each is a key of a scene's [camera], as is pixel_mm."""


@dataclass(frozen=True)
class MeasuredValue:
    """A value and its standard uncertainty.

    Parameters
    ----------
    value : float
        The value.
    standard_uncertainty : float
        Its standard uncertainty, in the same unit.
    """

    value: float
    standard_uncertainty: float


@dataclass(frozen=True, kw_only=True)
class ScalePicture:
    """One picture's part of a scale.

    Parameters
    ----------
    file : str
        Its name.
    image : (rows, cols) array
        Its grey levels.
    places : (n, 2) array
        Column and row of the points that were found, px.
    residual_px : (n, 2) array
        What the model leaves of them, px.
    roll : MeasuredValue, optional
        How it is turned against the target, degrees; None by edges.
    """

    file: str
    image: Array
    places: Array
    residual_px: Array
    roll: MeasuredValue | None = None

    def to_json(self) -> dict[str, Any]:
        """Its file, how many points it shows, their residual and the target's roll."""
        rms = float(np.sqrt(np.mean(self.residual_px**2)))
        return {
            "file": self.file,
            "corners": len(self.places),
            "residual_px": rms,
            "roll_deg": None if self.roll is None else vars(self.roll),
        }


@dataclass(frozen=True, repr=False, kw_only=True)
class ScaleCalibration(Result):
    """The size of a pixel and the lens's distortion and keystone, with standard uncertainties.

    Parameters
    ----------
    draw : callable, optional
        Makes the figure, of results that need more for it than they hold; not of this one.
    target : str
        'chessboard', 'dots' or 'edges'.
    shape : tuple of int
        Rows and columns of the pictures.
    pixel_mm : MeasuredValue
        Side of a pixel at the picture's middle, mm.
    distortion, keystone_x, keystone_z : MeasuredValue or None
        As a scene's camera has them; None by edges, which do not tell them.
    roll_deg : MeasuredValue or None
        How the first picture is turned against the target, counter-clockwise, degrees.
    residual_px : float
        Root mean square of what the model leaves of a coordinate, px.
    corners : int
        Corners or dots in all pictures, or points along edges.
    images : tuple of ScalePicture
        The pictures' parts.
    budget : tuple of BudgetInput
        What the uncertainty of `pixel_mm` consists of.
    taken_as_exact : tuple of str
        Inputs that no uncertainty was given of.
    warnings : tuple of str
        What the user should know.
    """

    target: str
    shape: tuple[int, int]
    pixel_mm: MeasuredValue
    distortion: MeasuredValue | None
    keystone_x: MeasuredValue | None
    keystone_z: MeasuredValue | None
    roll_deg: MeasuredValue | None
    residual_px: float
    corners: int
    images: tuple[ScalePicture, ...]
    budget: tuple[BudgetInput, ...]
    taken_as_exact: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def values(self) -> dict[str, MeasuredValue]:
        """Those that were found, by their names."""
        names = ("pixel_mm", *LENS, "roll_deg")
        return {name: value for name in names if (value := getattr(self, name)) is not None}

    @property
    def columns(self) -> dict[str, list[Any]]:
        """A row a value."""
        rows = self.values
        return {
            "key": list(rows),
            "value": [row.value for row in rows.values()],
            "standard_uncertainty": [row.standard_uncertainty for row in rows.values()],
        }

    @property
    def budget_columns(self) -> dict[str, list[Any]]:
        """Those of budget.csv: a row an input, the largest share first."""
        return columns_of(
            [item.to_json() | {"contribution_mm": item.contribution} for item in self.budget]
        )

    @property
    def title(self) -> str:
        """What was seen, and in how many pictures."""
        what = "two edges" if self.target == "edges" else self.target
        return f"Scale from {what} in {counted(len(self.images), 'image')}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """Each value with its uncertainty, and the residual."""
        for name, found in self.values.items():
            yield name, with_uncertainty(found.value, found.standard_uncertainty)
        yield "residual", f"{self.residual_px:.3f} px over {counted(self.corners, 'point')}"

    def figure(self) -> Figure:
        """See `scale_figure`."""
        from isochrome.calibration.scale.figure import scale_figure

        return scale_figure(self)

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give pictures with their points, and the budget, for a paper; see `paper_figure`.

        `frames`: numbers of the pictures that are shown. Raises InputError where one is not there.
        """
        from isochrome.calibration.scale.figure import scale_panels

        return scale_panels(self, frames)

    @property
    def scene_values(self) -> dict[str, tuple[float, float]]:
        """What `--into` may set: key, value and standard uncertainty.

        The roll is the target's, which need not lie as the specimen does, and is none of them.
        """
        return {
            f"camera.{name}": (found.value, found.standard_uncertainty)
            for name, found in self.values.items()
            if name != "roll_deg"
        }

    @property
    def scene_comment(self) -> str:
        """What a scene's comment states of the values."""
        return f"residual {self.residual_px:.3f} px"

    def to_json(self) -> dict[str, Any]:
        """The result as plain numbers, texts and lists for `scale.json`.

        `pixel_mm`, `distortion`, `keystone_x`, `keystone_z` and `roll_deg` are each {value,
        standard_uncertainty}, or None where the edges do not tell them.
        """
        found = self.values
        names = ("pixel_mm", *LENS, "roll_deg")
        return {
            "target": self.target,
            "width_px": self.shape[1],
            "height_px": self.shape[0],
            **{name: vars(found[name]) if name in found else None for name in names},
            "residual_px": self.residual_px,
            "corners": self.corners,
            "images": [image.to_json() for image in self.images],
            "budget": [item.to_json() for item in self.budget],
            "taken_as_exact": list(self.taken_as_exact),
            "warnings": list(self.warnings),
        }
