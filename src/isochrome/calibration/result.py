"""What a calibration found: the value, how sure it is, from what, and its picture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.figures import (
    BOLD_PT,
    DIFFERENCE_MAP,
    FINE_PT,
    FRAME_MAP,
    GREY,
    INK,
    LINE_COLOURS,
    LINE_PT,
    PALE,
    PaperPanels,
    PictureKind,
    Plot,
    add_legend,
    budget_plot,
    chosen_frames,
    data_name,
    panels_figure,
    show_image,
    style_axes,
)
from isochrome.messages import message, warnings_json
from isochrome.output import (
    Result,
    columns_of,
    counted,
    evenly_spaced,
    to_last_digit,
    with_uncertainty,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cut:
    """Where a kind of specimen tells its order, on what cut, and what command calibrates by it."""

    place: str
    along: str
    command: str


CUTS = {
    "beam": Cut("edge", "across the height (mm)", "bending"),
    "disc": Cut("centre", "along the diameter (mm)", "disc"),
}
"""The specimens of a calibration, by their table in its set."""

CONTRADICTED = 3.0
"""Standard uncertainties that are a contradiction: by which a value must be off to be one."""

UNLIKELY = 1e-3
"""Chance of a scatter below which it is none of chance."""

MOST_SHOWN = 4
"""Images or distances that a calibration's figure shows."""

VALUES = (
    "fringe_value_n_per_mm", "standard_uncertainty", "chi", "order_at_zero_load",
    "order_at_zero_load_uncertainty", "residual", "channels", "causes",
)  # fmt: skip
"""What `calibration.json` holds of a calibration."""


@dataclass(frozen=True, kw_only=True)
class View:
    """A figure's maps (rows, cols), NaN where left out, their (row, col) spacing `pixel_mm`, and
    `cut`, the index of a row or column, with the places (m,) along it.
    """

    image: Array
    model: Array
    residual: Array
    order: Array
    sigma: float
    pixel_mm: tuple[float, float]
    cut: tuple[Any, ...]
    position_mm: Array


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
        That of the order, by the noise and by what else the images leave open, fringes.
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


@dataclass(frozen=True)
class BudgetItem:
    """One source of uncertainty, what it adds to f_sigma, and its share of the variance, 0..1."""

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
        """Up to four images beside fit, residual and a cut; below, the order over the load."""
        value, *others = _values(self)
        head = [f"f$_\\sigma$ = {value}", f"$\\chi$ = {self.chi:.2f}", *others]
        head.append(f"{self.slope_per_n:.6g} fringes per N")
        panels = self.panels(tuple(_spread(self.images)))
        panels = replace(panels, notes=panels.notes[1:])
        return panels_figure(panels, "    ".join(head), picture_mm=43.0)

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give images, fits, orders and budget for a paper; see `paper_figure`.

        `frames`: numbers of the images that are shown. Raises InputError where one is not there.
        """
        images = self.images
        largest = _spread(images)[-1:]
        shown = [images[k] for k in chosen_frames(frames, len(images), largest, items="images")]
        views = []
        for item in shown:
            if item.view is None:
                raise InputError("left_out_calibration_not", file=item.file)
            views.append(item.view)
        # the size of a residual that colours tell apart, in noise sigmas: 4 at the least
        sizes = [np.nanpercentile(np.abs(v.residual) / v.sigma, 98) for v in views]
        limit, where = float(max([4.0, *sizes])), CUTS[self.specimen]
        predicted = [item.predicted_order is not None for item in images]
        other = "predicted" if all(predicted) else "line"

        def draw(axes: Axes, k: int, column: int) -> AxesImage:
            view, look = views[k], (FRAME_MAP, FRAME_MAP, DIFFERENCE_MAP)[column]
            low, high = np.nanpercentile(view.image, [0.5, 99.8]).tolist()
            low, high = (-limit, limit) if look == DIFFERENCE_MAP else (low, high)
            image = (view.image, view.model, view.residual / view.sigma)[column]
            tall, wide = view.pixel_mm
            rows = max(1, round(wide / tall))  # with which pixels are square
            step = max(1, -(-max(image.shape[0] // rows, image.shape[1]) // LARGEST_PX))
            return show_image(
                axes, image[:: rows * step, ::step], pixel_mm=wide * step, cmap=look, vmin=low,
                vmax=high,
            )  # fmt: skip

        bars = {"captured": "", "fitted": "", "residual": "residual (noise sigmas)"}
        plots = [
            Plot(
                title=f"{item.load_n:.4g} N, along the cut",
                draw=partial(_cut, view=view, where=where),
                spare=1 if item is shown[-1] else 3,  # one cut tells how well the model fits
            )
            for item, view in zip(shown, views, strict=True)
        ]
        parts = {item.name: item.contribution_n_per_mm for item in self.budget}
        plots += [
            Plot(title="order over load", draw=partial(_line, calibration=self)),
            Plot(title=f"measured minus {other}", draw=partial(_misfit, calibration=self), spare=2),
            budget_plot("uncertainty budget", parts, unit="N/mm"),
        ]
        value, *others = _values(self)
        return PaperPanels(
            kinds=[
                PictureKind(name=name, draw=partial(draw, column=column), bar=bar)
                for column, (name, bar) in enumerate(bars.items())
            ],
            labels=[f"{item.load_n:.4g} N" for item in shown],
            plots=plots,
            notes=[
                ", ".join([f"Material fringe value {value}, χ = {self.chi:.2f}", *others]) + ".",
                *(f"{i.load_n:.4g} N: N = {to_last_digit(i.order, i.standard_uncertainty)} "
                  f"at the {where.place}, χ = {i.chi:.2f}." for i in shown),
                *["Predicted: by the line through the other loads."] * any(predicted),
            ],
        )  # fmt: skip

    def to_json(self) -> dict[str, Any]:
        """The result as plain numbers, texts and lists for `calibration.json`.

        Returns a dictionary with `fringe_value_n_per_mm`, `standard_uncertainty`, `chi`,
        `order_at_zero_load` (None where unknown), `order_at_zero_load_uncertainty`, `residual`,
        `channels`, `causes`, `images`, `budget` and `warnings`.
        """
        return {name: getattr(self, name) for name in VALUES} | {
            "images": [
                {k: v for k, v in vars(i).items() if k not in ("geometry", "view")} | i.geometry
                for i in self.images
            ],
            "budget": [vars(item) for item in self.budget],
            **warnings_json(self.warnings),
        }


LARGEST_PX = 400
"""Rows or columns of an image that are drawn."""


def _values(calibration: Calibration) -> list[str]:
    """The value, and what was found besides, in words."""
    value = with_uncertainty(calibration.fringe_value_n_per_mm, calibration.standard_uncertainty)
    parts, order = [f"{value} N/mm per fringe"], calibration.order_at_zero_load
    if order is not None:
        parts.append(f"order at zero load {round(order, 3) + 0.0:+.3f}")
    if calibration.residual is not None:
        largest = calibration.residual["largest_order"]
        parts.append(message("residual_stress_up_fringe_2", largest_order=largest))
    return parts


def _spread(images: Sequence[ImageFit]) -> list[int]:
    """Numbers of those with a view that are shown, by their loads."""
    drawable = [k for k, image in enumerate(images) if image.view is not None]
    return evenly_spaced(sorted(drawable, key=lambda k: images[k].load_n), MOST_SHOWN)


def _cut(cut: Axes, view: View, where: Cut) -> None:
    """Intensity and order along the cut."""
    lines = (view.position_mm, *(v[view.cut] for v in (view.image, view.model, view.order)))
    place, light, model, orders = (v[np.isfinite(view.residual[view.cut])] for v in lines)
    cut.plot(place, light, ".", ms=2, color=PALE, label="captured")
    cut.plot(place, model, "-", lw=LINE_PT, color=INK, label="fitted")
    twin = cut.twinx()
    twin.plot(place, orders, "-", lw=BOLD_PT, color=LINE_COLOURS[1])
    twin.set_ylim(bottom=0)
    style_axes(twin, z_label="order N")
    twin.yaxis.label.set_color(LINE_COLOURS[1])
    style_axes(cut, x_label=where.along, z_label="intensity")


def _line(axes: Any, calibration: Calibration) -> None:
    loads, orders = np.array([(i.load_n, i.order) for i in calibration.images]).T
    intercept = calibration.order_at_zero_load or 0.0
    reach = np.array([0.0, loads.max() * 1.05])
    line = calibration.slope_per_n * reach + intercept
    axes.plot(reach, line, color=GREY, lw=LINE_PT, label=data_name("line of all loads"))
    axes.plot(loads, orders, "o", color=LINE_COLOURS[0], ms=5, label="measured")
    known = [i for i in calibration.images if i.predicted_order is not None]
    if known:
        places = [i.load_n for i in known], [i.predicted_order for i in known]
        axes.plot(*places, "o", mfc="none", color=LINE_COLOURS[1], ms=10, label="predicted")
        add_legend(axes, loc="upper left")
    if calibration.order_at_zero_load is not None:
        axes.plot(0.0, intercept, "s", color=LINE_COLOURS[1], ms=5, label=data_name("at zero load"))
        text = f"{intercept:+.4f} at zero load"
        axes.annotate(text, (0.0, intercept), (8, -3), textcoords="offset points", va="top")
    axes.set_xlim(0.0 - 0.02 * reach[1], reach[1])
    axes.axhline(0.0, color=PALE, lw=FINE_PT, zorder=0)
    style_axes(axes, x_label="load (N)", z_label=f"order at the {CUTS[calibration.specimen].place}")
    axes.margins(y=0.25)  # so that what stands below the line's beginning has room


def _misfit(axes: Any, calibration: Calibration) -> None:
    """What is left of each order beside its prediction from the other loads, or the line."""
    intercept = calibration.order_at_zero_load or 0.0
    images = calibration.images
    loads, orders = np.array([(i.load_n, i.order) for i in images]).T
    predicted = np.array([i.predicted_order for i in images], dtype=float)  # NaN without one
    line = calibration.slope_per_n * loads + intercept
    away = orders - np.where(np.isnan(predicted), line, predicted)
    spread = np.array([i.standard_uncertainty for i in images])
    milli = float(np.max(np.abs(away) + spread)) < 0.02
    scale = 1000.0 if milli else 1.0
    axes.errorbar(loads, scale * away, scale * spread, fmt="o", ms=4, color=LINE_COLOURS[0])
    axes.axhline(0.0, color=PALE, lw=FINE_PT)
    axes.margins(x=0.15)
    style_axes(axes, x_label="load (N)", z_label="10⁻³ fringe" if milli else "fringes")
