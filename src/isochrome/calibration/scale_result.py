"""What a picture of a target or of two edges tells of the camera, and its picture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.result import MOST_SHOWN
from isochrome.estimation import BudgetInput
from isochrome.figures import (
    FRAME_MAP,
    LINE_COLOURS,
    OVERLAY_COLOUR,
    PaperPanels,
    PictureKind,
    budget_plot,
    chosen_frames,
    panels_figure,
    plain_name,
    show_image,
)
from isochrome.messages import warnings_json
from isochrome.output import Result, columns_of, counted, with_uncertainty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

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

    @property
    def rms_px(self) -> float:
        """Root mean square of the residual of a coordinate, px."""
        return float(np.sqrt(np.mean(self.residual_px**2)))

    def to_json(self) -> dict[str, Any]:
        """Its file, how many points it shows, their residual and the target's roll."""
        return {
            "file": self.file,
            "corners": len(self.places),
            "residual_px": self.rms_px,
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
        return columns_of([{"key": key, **vars(value)} for key, value in self.values.items()])

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
        for name, measured in self.values.items():
            yield name, with_uncertainty(measured.value, measured.standard_uncertainty)
        yield "residual", f"{self.residual_px:.3f} px over {counted(self.corners, 'point')}"

    def figure(self) -> Figure:
        """Each picture with its points and their residuals magnified, and the budget."""
        texts = _texts(self)
        head = ["    ".join(texts[:1] + texts[4:]), "    ".join(texts[1:4])]
        panels = self.panels(tuple(range(len(self.images[:MOST_SHOWN]))))
        return panels_figure(
            replace(panels, notes=panels.notes[1:]), "\n".join(line for line in head if line)
        )

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give pictures with their points, and the budget, for a paper; see `paper_figure`.

        `frames`: numbers of the pictures that are shown. Raises InputError where one is not there.
        """
        images = self.images
        few = range(min(len(images), _FOR_PAPER))
        shown = [images[k] for k in chosen_frames(frames, len(images), few, items="pictures")]
        factor = _factor(self, shown)

        def draw(axes: Axes, k: int) -> AxesImage:
            return _draw_points(axes, shown[k], factor)

        parts = {item.input: item.contribution for item in self.budget}
        drawn = f"px, drawn {factor:g} times as long."
        notes = [f"{plain_name(one.file)}: residual {one.rms_px:.3f} {drawn}" for one in shown]
        return PaperPanels(
            kinds=[PictureKind(name="points", draw=draw)],
            labels=[plain_name(picture.file, 24) for picture in shown],
            plots=[budget_plot("budget of pixel_mm", parts, unit="mm")],
            notes=["; ".join(_texts(self)) + ".", *notes],
        )

    @property
    def scene_values(self) -> dict[str, tuple[float, float]]:
        """What `--into` may set: key, value and standard uncertainty.

        The roll is the target's, which need not lie as the specimen does, and is none of them.
        """
        return {
            f"camera.{name}": (measured.value, measured.standard_uncertainty)
            for name, measured in self.values.items()
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
        names = dict.fromkeys(("pixel_mm", *LENS, "roll_deg"))
        return {
            "target": self.target,
            "width_px": self.shape[1],
            "height_px": self.shape[0],
            **names | {name: vars(measured) for name, measured in self.values.items()},
            "residual_px": self.residual_px,
            "corners": self.corners,
            "images": [image.to_json() for image in self.images],
            "budget": [item.to_json() for item in self.budget],
            "taken_as_exact": list(self.taken_as_exact),
            **warnings_json(self.warnings),
        }


_FOR_PAPER = 2
"""Those of a figure for a paper where nobody names them."""

MOST_POINTS = 150
"""Points of a picture that are drawn."""

_LONGEST_ARROW = 0.06
"""Length of the longest arrows, over the picture's width."""


def _factor(calibration: ScaleCalibration, shown: Sequence[ScalePicture]) -> float:
    """How many times as long the residuals are drawn as they are."""
    largest = max(float(np.percentile(np.hypot(*p.residual_px.T), 95)) for p in shown)
    factor = _LONGEST_ARROW * calibration.shape[1] / max(largest, 1e-9)
    decade = 10.0 ** np.floor(np.log10(factor))
    # a round number: 1, 2 or 5 times a power of ten, not above it
    return float(max(step for step in (1.0, 2.0, 5.0) if step * decade <= factor * 1.0001) * decade)


def _texts(calibration: ScaleCalibration) -> list[str]:
    """Each value with its uncertainty."""
    return [
        f"{name} = {with_uncertainty(measured.value, measured.standard_uncertainty)}"
        for name, measured in calibration.values.items()
    ]


def _draw_points(axes: Axes, picture: ScalePicture, factor: float) -> AxesImage:
    low, high = (float(v) for v in np.percentile(picture.image, [0.5, 99.5]))
    drawn = show_image(axes, picture.image, cmap=FRAME_MAP, vmin=low, vmax=high)
    pick = slice(None, None, -(-len(picture.places) // MOST_POINTS))
    (x, z), (u, v) = picture.places[pick].T, factor * picture.residual_px[pick].T
    axes.plot(x, z, "o", mfc="none", mec=LINE_COLOURS[4], ms=5)
    axes.quiver(
        x, z, u, v, color=OVERLAY_COLOUR, angles="xy", scale_units="xy", scale=1.0, width=0.003
    )
    rows, cols = picture.image.shape
    axes.set_xlim(-0.5, cols - 0.5)
    axes.set_ylim(rows - 0.5, -0.5)
    return drawn
