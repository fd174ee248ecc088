"""What a wear calibration found: the coefficient, how sure it is, and each scar's part."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.calibration.wear.coefficient import WearLawFit
from isochrome.calibration.wear.worn_volumes import TraceScar, WornVolume
from isochrome.estimation import BudgetInput
from isochrome.figures import PaperPanels
from isochrome.output import Result, columns_of, counted, with_uncertainty

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class WornDistance:
    """A distance's own coefficient, k = V/(P s).

    Parameters
    ----------
    volume : WornVolume
        The volume and what made it.
    standard_uncertainty_mm3 : float
        Standard uncertainty of the volume with the inputs that it has part in, mm³.
    coefficient_mm2_per_n : float
        The distance's own k, mm²/N.
    standard_uncertainty : float
        Standard uncertainty of that with all inputs, mm²/N.
    """

    volume: WornVolume
    standard_uncertainty_mm3: float
    coefficient_mm2_per_n: float
    standard_uncertainty: float

    def to_json(self) -> dict[str, Any]:
        """Its numbers by name."""
        volume = self.volume
        areas = [s.levelled for s in volume.scars if s.levelled is not None]
        widths = [area.width_mm for area in areas]
        return {
            "distance_m": volume.distance_m,
            "normal_n": volume.normal_n,
            "friction": volume.friction,
            "traces": len(areas),
            "worn_area_mm2": float(np.mean([a.worn_area_mm2 for a in areas])) if areas else None,
            "scar_width_mm": float(np.mean(widths)) if areas else None,
            "volume_mm3": volume.volume_mm3,
            "standard_uncertainty_mm3": self.standard_uncertainty_mm3,
            "coefficient_mm2_per_n": self.coefficient_mm2_per_n,
            "standard_uncertainty": self.standard_uncertainty,
        }


def trace_json(scar: TraceScar) -> dict[str, Any]:
    """What `calibration.json` states of a trace."""
    found: dict[str, Any] = {"file": scar.test.file, "distance_m": scar.test.distance_m}
    one = scar.levelled
    if one is None:
        return found | {"is_clear": False}
    return found | {
        "is_clear": True,
        "left_mm": one.edges_mm[0],
        "left_uncertainty_mm": one.edge_uncertainty_mm[0],
        "right_mm": one.edges_mm[1],
        "right_uncertainty_mm": one.edge_uncertainty_mm[1],
        "depth_um": one.deepest_um,
        "roughness_rq_um": one.roughness.rq_um,
        "worn_area_mm2": one.worn_area_mm2,
        "standard_uncertainty_mm2": one.worn_area_uncertainty_mm2,
        "spikes": one.spikes,
    }


@dataclass(frozen=True, repr=False, kw_only=True)
class WearCalibration(Result):
    """A wear coefficient by Archard's law with its uncertainty, budget, and what the laws say.

    Parameters
    ----------
    draw : callable, optional
        Makes the figure, of results that need more for it than they hold; not of this one.
    coefficient_mm2_per_n : float
        The coefficient k = V/(P s) over all distances, mm²/N.
    standard_uncertainty : float
        Its standard uncertainty, mm²/N.
    degrees_of_freedom : float
        Effective ones of that.
    interval_95 : tuple of float
        The interval that holds the coefficient with a probability of 95 %, mm²/N.
    chi : float or None
        Scatter over what is expected, of traces about their means and of distances about the law;
        None where nothing can scatter.
    law : str
        The law that the evidence prefers clearly, 'archard' where none is.
    laws : tuple of WearLawFit
        The laws by falling evidence.
    by_distance : tuple of WornDistance
        Each distance's own coefficient.
    traces : tuple of TraceScar
        The traces.
    budget : tuple of BudgetInput
        What the uncertainty consists of, the largest share first.
    warnings : tuple of str
        What the user should know.
    """

    coefficient_mm2_per_n: float
    standard_uncertainty: float
    degrees_of_freedom: float
    interval_95: tuple[float, float]
    chi: float | None
    law: str
    laws: tuple[WearLawFit, ...]
    by_distance: tuple[WornDistance, ...]
    traces: tuple[TraceScar, ...]
    budget: tuple[BudgetInput, ...]
    warnings: tuple[str, ...]

    @property
    def columns(self) -> dict[str, list[Any]]:
        """A row a distance."""
        return columns_of([row.to_json() for row in self.by_distance])

    @property
    def budget_columns(self) -> dict[str, list[Any]]:
        """Those of budget.csv: a row an input, the largest share first."""
        return columns_of(
            [item.to_json() | {"contribution_mm2_per_n": item.contribution} for item in self.budget]
        )

    @property
    def title(self) -> str:
        """How many distances and traces there are."""
        text = f"Wear coefficient from {counted(len(self.by_distance), 'worn volume')}"
        return f"{text}, {counted(len(self.traces), 'trace')}" if self.traces else text

    def main_values(self) -> Iterator[tuple[str, str]]:
        """The coefficient, its interval, chi, the law, and each distance's own."""
        unit = 1e-9
        value = with_uncertainty(
            self.coefficient_mm2_per_n / unit, self.standard_uncertainty / unit
        )
        yield "coefficient_mm2_per_n", f"{value} e-9"
        low, high = (f"{edge / unit:.4g}" for edge in self.interval_95)
        yield "interval_95", f"{low} to {high} e-9"
        if self.chi is not None:
            yield "chi", f"{self.chi:.2f}"
        yield "law", self.law
        for row in self.by_distance:
            own = row.coefficient_mm2_per_n / unit, row.standard_uncertainty / unit
            yield row.volume.place, f"{with_uncertainty(*own)} e-9"

    @property
    def scene_values(self) -> dict[str, tuple[float, float]]:
        """What `--into` sets: key, value and standard uncertainty, by Archard's law."""
        key = "wear.coefficient_mm2_per_n"
        return {key: (self.coefficient_mm2_per_n, self.standard_uncertainty)}

    def coefficient_by(self, law: str) -> tuple[float, float] | None:
        """The coefficient by a law of one parameter, and its uncertainty; None if not asked.

        The common inputs' relative uncertainty is that by Archard's law. Parameters: `law`.
        """
        found = next((fit for fit in self.laws if fit.law == law), None)
        if found is None:
            return None
        archard = next(fit for fit in self.laws if fit.law == "archard")
        own = archard.own_uncertainty
        common = max(self.standard_uncertainty**2 - own**2, 0.0) / self.coefficient_mm2_per_n**2
        value = found.coefficient_mm2_per_n
        return value, float(np.sqrt(found.own_uncertainty**2 + common * value**2))

    @property
    def scene_comment(self) -> str:
        """What a scene's comment states of the value."""
        return "k = V/(P s)" if self.chi is None else f"chi {self.chi:.2f}"

    def figure(self) -> Figure:
        """See `wear_figure`."""
        from isochrome.calibration.wear.figure import wear_figure

        return wear_figure(self)

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give scars, coefficients and budget for a paper; see `paper_figure`.

        `frames`: numbers of the distances that are shown. Raises InputError where one is not there.
        """
        from isochrome.calibration.wear.figure import wear_panels

        return wear_panels(self, frames)

    def to_json(self) -> dict[str, Any]:
        """The result as plain numbers, texts and lists for `calibration.json`."""
        return {
            "coefficient_mm2_per_n": self.coefficient_mm2_per_n,
            "standard_uncertainty": self.standard_uncertainty,
            "degrees_of_freedom": finite_or_none(self.degrees_of_freedom),
            "interval_95": list(self.interval_95),
            "chi": self.chi,
            "law": self.law,
            "laws": [fit.to_json() for fit in self.laws],
            "by_distance": [row.to_json() for row in self.by_distance],
            "traces": [trace_json(scar) for scar in self.traces],
            "budget": [item.to_json() for item in self.budget],
            "warnings": list(self.warnings),
        }


def finite_or_none(value: float) -> float | None:
    """A number, None where it is not finite, for JSON."""
    return value if np.isfinite(value) else None
