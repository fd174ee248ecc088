"""What a calibration found: the value, how sure it is, from what, and what is wrong with it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.figures import PaperPanels
from isochrome.output import Result, columns_of, counted, with_uncertainty

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cut:
    """Where a kind of specimen tells its order: at this `place`, on a cut `along` it.

    `command` calibrates by it; a figure's row with its image is `row_inches` high.
    """

    place: str
    along: str
    command: str
    row_inches: float


CUTS = {
    "beam": Cut("edge", "across the height (mm)", "bending", 2.1),
    "disc": Cut("centre", "along the diameter (mm)", "disc", 2.6),
}
"""The specimens of a calibration, by their table in its set."""

VALUES = (
    "fringe_value_n_per_mm", "standard_uncertainty", "chi", "order_at_zero_load",
    "order_at_zero_load_uncertainty", "residual", "channels", "causes",
)  # fmt: skip
IMAGE_COLUMNS = (
    "file", "load_n", "order", "standard_uncertainty", "chi", "predicted_order",
    "predicted_uncertainty",
)  # fmt: skip
"""What `calibration.json` holds of a calibration, and of each image besides its geometry."""


@dataclass(frozen=True, kw_only=True)
class View:
    """What a figure shows of an image: maps (rows, cols) and a cut through them.

    `image`, `model` and `residual`, image - model, NaN where it was left out, are intensities, of
    the noise `sigma`; `order`, fringes; `pixel_mm`, the (row, col) spacing. `cut` is the index of a
    row or column, the height or the horizontal diameter, and `position_mm` (m,) the place along it.
    """

    image: Array
    model: Array
    residual: Array
    order: Array
    sigma: float
    pixel_mm: tuple[float, float]
    cut: tuple[Any, ...]
    position_mm: Array

    def along_cut(self, values: Array) -> Array:
        """A map, or `position_mm`, on the cut, where it was not left out."""
        line = values[self.cut] if values.ndim == 2 else values
        return np.asarray(line[np.isfinite(self.residual[self.cut])])


@dataclass(frozen=True, kw_only=True)
class ImageFit:
    """One image's part of a calibration.

    Parameters
    ----------
    file : str
        The image's file or name.
    load_n : float
        Its load, N.
    order : float
        Its order at a beam's edge, or at a disc's centre, fringes.
    standard_uncertainty : float
        That of the order by the noise, fringes.
    chi : float
        Root mean square of the residual over the noise.
    predicted_order : float, optional
        The order by the other loads' line, fringes; None below three loads.
    predicted_uncertainty : float, optional
        Standard uncertainty of the difference to that, by both and by the value's own, fringes.
    geometry : dict, optional
        The fitted places in pixels and angles in degrees, by name.
    view : View, optional
        What a figure shows of it.
    misfit : float, optional
        What comes on top of the uncertainty where the model does not describe the image, fringes.
    """

    file: str
    load_n: float
    order: float
    standard_uncertainty: float
    chi: float
    predicted_order: float | None = None
    predicted_uncertainty: float | None = None
    geometry: dict[str, float] = field(default_factory=dict)
    view: View | None = None
    misfit: float = 0.0


@dataclass(frozen=True)
class BudgetItem:
    """One source of uncertainty: its own `standard_uncertainty` in `unit`, what it adds to f_sigma.

    `contribution_n_per_mm` is a standard uncertainty, `share` its part of the variance, 0..1.
    """

    name: str
    standard_uncertainty: float
    unit: str
    contribution_n_per_mm: float
    share: float


@dataclass(frozen=True, repr=False, kw_only=True)
class Calibration(Result):
    """A material fringe value with its standard uncertainty, goodness, residual order and budget.

    Parameters
    ----------
    draw : callable, optional
        Makes the figure, of results that need more for it than they hold; not of this one.
    specimen : str
        'beam' or 'disc'.
    fringe_value_n_per_mm : float
        The material fringe value, N/mm per fringe.
    standard_uncertainty : float
        Its standard uncertainty, N/mm per fringe.
    chi : float
        Residual over noise, root mean square over the images.
    order_at_zero_load, order_at_zero_load_uncertainty : float or None
        Order that stays at zero load, fringes; None where one load only was given.
    slope_per_n : float
        Rise of the order with the load, fringes per N.
    images : tuple of ImageFit
        The images' parts.
    budget : tuple of BudgetItem
        The sources of uncertainty.
    warnings : tuple of str
        What the user should know.
    residual : dict, optional
        A residual stress that was fitted as a field, None where none was.
    channels : dict, optional
        Each channel's value of colour images, None where only one was read.
    causes : tuple of dict, optional
        What the images asked for besides: key, cause, value and standard_uncertainty of each.
    """

    specimen: str
    fringe_value_n_per_mm: float
    standard_uncertainty: float
    chi: float
    order_at_zero_load: float | None
    order_at_zero_load_uncertainty: float | None
    slope_per_n: float
    images: tuple[ImageFit, ...]
    budget: tuple[BudgetItem, ...]
    warnings: tuple[str, ...]
    residual: dict[str, Any] | None = None
    channels: dict[str, Any] | None = None
    causes: tuple[dict[str, Any], ...] = ()

    @property
    def columns(self) -> dict[str, list[Any]]:
        """A row an image: its load, its order and what it is worth, its fitted place."""
        return columns_of(self.to_json()["images"])

    @property
    def budget_columns(self) -> dict[str, list[Any]]:
        """Those of budget.csv: a row a source of uncertainty, the largest share first.

        `relative_standard_uncertainty` is the contribution as a part of the fringe value.
        """
        items = sorted(self.budget, key=lambda item: -item.share)
        parts = [item.contribution_n_per_mm for item in items]
        return {
            "input": [item.name for item in items],
            "standard_uncertainty": [item.standard_uncertainty for item in items],
            "unit": [item.unit for item in items],
            "contribution_n_per_mm": parts,
            "relative_standard_uncertainty": [part / self.fringe_value_n_per_mm for part in parts],
            "share": [item.share for item in items],
        }

    @property
    def title(self) -> str:
        """The specimen and how many images there were."""
        return f"Calibration from {counted(len(self.images), 'image')} of a {self.specimen}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """The material fringe value, chi, and the order that stays at zero load."""
        value = with_uncertainty(self.fringe_value_n_per_mm, self.standard_uncertainty)
        yield "fringe_value_n_per_mm", value
        yield "chi", f"{self.chi:.3f}"
        order, spread = self.order_at_zero_load, self.order_at_zero_load_uncertainty
        if order is not None and spread is not None:
            yield "order_at_zero_load", with_uncertainty(order, spread)
        if self.residual is not None:
            yield "residual stress", f"up to {self.residual['largest_order']:.3f} fringes"

    @property
    def scene_values(self) -> dict[str, tuple[float, float]]:
        """What `--into` sets: key, value and standard uncertainty."""
        key = "specimen.fringe_value_n_per_mm"
        return {key: (self.fringe_value_n_per_mm, self.standard_uncertainty)}

    @property
    def scene_comment(self) -> str:
        """What a scene's comment states of the value."""
        return f"chi {self.chi:.2f}"

    def figure(self) -> Figure:
        """See `calibration_figure`."""
        from isochrome.calibration.figure import calibration_figure

        return calibration_figure(self)

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give images, fits, orders and budget for a paper; see `paper_figure`.

        `frames`: numbers of the images that are shown. Raises InputError where one is not there.
        """
        from isochrome.calibration.figure import calibration_panels

        return calibration_panels(self, frames)

    def to_json(self) -> dict[str, Any]:
        """The result as plain numbers, texts and lists for `calibration.json`.

        Returns a dictionary with `fringe_value_n_per_mm`, `standard_uncertainty`, `chi`,
        `order_at_zero_load` (None where unknown), `order_at_zero_load_uncertainty`, `residual`,
        `channels`, `causes`, `images`, `budget` and `warnings`.
        """
        images = [{n: getattr(i, n) for n in IMAGE_COLUMNS} | i.geometry for i in self.images]
        return {name: getattr(self, name) for name in VALUES} | {
            "images": images,
            "budget": [vars(item) for item in self.budget],
            "warnings": list(self.warnings),
        }
