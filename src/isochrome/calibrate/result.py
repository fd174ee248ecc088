"""What a calibration found: the value, how sure it is, from what, and what is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """What a figure shows of an image: intensities (rows, cols) and a cut through the orders.

    `residual` is image - model, NaN where it was left out; `cut_position_mm` and `cut_order`
    (m,) are the order along the height or the horizontal diameter, `cut_intensity` and
    `cut_model` the intensities there. `pixel_mm` is (row, col) spacing of the maps.
    """

    image: Array
    model: Array
    residual: Array
    sigma: float
    pixel_mm: tuple[float, float]
    cut_position_mm: Array
    cut_order: Array
    cut_intensity: Array
    cut_model: Array


@dataclass(frozen=True)
class ImageFit:
    """One image's part: its order (at a beam's edge, at a disc's centre) and what is left.

    `standard_uncertainty` of the order is the noise's, `misfit` what comes on top of it where the
    model does not describe the image; `predicted_order` comes from the other loads' line (None
    below three loads); `geometry` holds the fitted places in pixels and angles in degrees by name.
    """

    file: str
    load_n: float
    order: float
    standard_uncertainty: float
    chi: float
    predicted_order: float | None = None
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


@dataclass(frozen=True)
class Calibration:
    """A material fringe value with its standard uncertainty, goodness, residual order and budget.

    `chi` is the root mean square over the images, `worst_chi` the largest one's;
    `order_at_zero_load` is None where one load only was given; `slope_per_n` is fringes per N;
    `residual` describes a residual stress that was fitted as a field (None where none was);
    `channels` holds each channel's value of colour images (None where only one was read).
    """

    specimen: str
    fringe_value_n_per_mm: float
    standard_uncertainty: float
    chi: float
    worst_chi: float
    order_at_zero_load: float | None
    order_at_zero_load_uncertainty: float | None
    slope_per_n: float
    images: tuple[ImageFit, ...]
    budget: tuple[BudgetItem, ...]
    warnings: tuple[str, ...]
    residual: dict[str, Any] | None = None
    channels: dict[str, Any] | None = None

    def to_json(self) -> dict[str, Any]:
        """The result as plain numbers, texts and lists for `calibration.json`.

        Returns a dictionary with `fringe_value_n_per_mm`, `standard_uncertainty`, `chi`,
        `order_at_zero_load` (None where unknown), `order_at_zero_load_uncertainty`, `residual`,
        `channels`, `images`, `budget` and `warnings`.
        """
        return {
            "fringe_value_n_per_mm": self.fringe_value_n_per_mm,
            "standard_uncertainty": self.standard_uncertainty,
            "chi": self.chi,
            "order_at_zero_load": self.order_at_zero_load,
            "order_at_zero_load_uncertainty": self.order_at_zero_load_uncertainty,
            "residual": self.residual,
            "channels": self.channels,
            "images": [
                {
                    "file": i.file,
                    "load_n": i.load_n,
                    "order": i.order,
                    "standard_uncertainty": i.standard_uncertainty,
                    "chi": i.chi,
                    "predicted_order": i.predicted_order,
                    **i.geometry,
                }
                for i in self.images
            ],
            "budget": [vars(item) for item in self.budget],
            "warnings": list(self.warnings),
        }
