"""A wear calibration's result: the coefficient by each law V = k x(s), its ±, its picture.

    archard            x = P s                       (equation 11 of the paper: k = V/(P s))
    sarkar             x = P s sqrt(1 + 3 mu²)
    dissipated_energy  x = P s |mu|
    running_in         x = P (s + (r-1) (s - s²/(2 s0))), s <= s0;   P (s + (r-1) s0/2) beyond

the last Archard's with a coefficient that goes linearly from r k to k over s0. With variances u² of
the volumes k = Σ xV/u² / Σ x²/u², and with χ² what it leaves, a flat prior of ln k gives
ln Z = -χ²/2 - 1/2 ln(k² Σ x²/u²) + const, for running_in with its prior: ln r and ln s0 Gaussian,
of a factor of e about 1 and about the distances' geometric mean. Sources: Archard (1953),
J. Appl. Phys. 24, 981; Sarkar (1980), Friction and Wear; Fouvry et al. (1997), Wear 203-204, 390;
MacKay (2003), Information Theory, Inference, and Learning Algorithms, chapter 28.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import cycle, product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from isochrome.calibration.result import MOST_SHOWN, UNLIKELY
from isochrome.calibration.wear_set import TraceScar, WornVolume, levelled_of
from isochrome.contact import wear_rate
from isochrome.estimation import STEP, BudgetInput
from isochrome.figures import (
    BAND,
    GREY,
    INK,
    LINE_COLOURS,
    LINE_PT,
    PALE,
    PaperPanels,
    Plot,
    add_legend,
    budget_plot,
    chosen_frames,
    data_name,
    draw_band,
    panels_figure,
    plain_name,
    style_axes,
)
from isochrome.fitting import nearest_point
from isochrome.messages import warnings_json
from isochrome.output import Result, columns_of, counted, with_uncertainty
from isochrome.scene import Wear

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[Any]


@dataclass(frozen=True, kw_only=True)
class WearLawFit:
    """A law through volumes.

    Parameters
    ----------
    law : str
        'archard', 'sarkar', 'dissipated_energy' or 'running_in'.
    coefficient_mm2_per_n : float
        Its k, mm²/N; of running_in the one that stays.
    own_uncertainty : float
        Standard uncertainty by the volumes' own errors, mm²/N.
    chi_square : float
        Square residuals over the variances.
    freedom : int
        Volumes less the law's parameters.
    log_evidence : float
        Evidence ln Z, less that of the preferred law.
    first_over_last, running_in_distance_m : float, optional
        Of running_in: r and s0, m.
    """

    law: str
    coefficient_mm2_per_n: float
    own_uncertainty: float
    chi_square: float
    freedom: int
    log_evidence: float
    first_over_last: float | None = None
    running_in_distance_m: float | None = None

    @property
    def is_unlikely(self) -> bool:
        """Whether the volumes leave the law by more than chance."""
        return self.freedom > 0 and float(chdtrc(self.freedom, self.chi_square)) < UNLIKELY

    def to_json(self) -> dict[str, Any]:
        """Its numbers by name."""
        names = {"own_uncertainty": "own_uncertainty_mm2_per_n"}
        fields = {names.get(name, name): value for name, value in vars(self).items()}
        if self.law != "running_in":
            del fields["first_over_last"], fields["running_in_distance_m"]
        return fields


def archard_of(laws: Sequence[WearLawFit]) -> WearLawFit:
    """The fit of Archard's law, which is always among them."""
    return next(fit for fit in laws if fit.law == "archard")


def fit_laws(volumes: Sequence[WornVolume], spread: Array) -> tuple[WearLawFit, ...]:
    """The laws by falling evidence; `spread` (n,): the volumes' own errors, mm³.

    Laws with friction are asked where all volumes state one, running_in where there are three
    distances.
    """
    values = np.array([volume.volume_mm3 for volume in volumes])
    laws = ["archard"]
    if all(volume.friction for volume in volumes):
        laws += ["sarkar", "dissipated_energy"]
    fits = []
    for law in laws:
        wear = Wear(coefficient_mm2_per_n=1.0, law=law, distances_m=(1.0,))
        rates = [float(wear_rate(wear, v.friction or 0.0, v.distance_m)) for v in volumes]
        work = np.array([v.work_n_mm * rate for v, rate in zip(volumes, rates, strict=True)])
        fits.append(_fit_law(law, work, values, spread))
    if len({volume.distance_m for volume in volumes}) > 2:
        fits.append(_running_in(volumes, values, spread))
    best = max(fit.log_evidence for fit in fits)
    fits = [replace(fit, log_evidence=fit.log_evidence - best) for fit in fits]
    return tuple(sorted(fits, key=lambda fit: -fit.log_evidence))


def _fit_law(law: str, work: Array, values: Array, spread: Array) -> WearLawFit:
    """A law of one parameter, by its works (n,)."""
    information = np.sum((work / spread) ** 2)
    k = float(np.sum(work * values / spread**2) / information)
    square = float(np.sum(((values - k * work) / spread) ** 2))
    # where k is no larger than its uncertainty, ln k has no narrower place than a factor of e
    log_z = -0.5 * square - np.log(np.maximum(k * np.sqrt(information), 1.0))
    return WearLawFit(
        law=law, coefficient_mm2_per_n=k, own_uncertainty=float(1.0 / np.sqrt(information)),
        chi_square=square, freedom=len(values) - 1, log_evidence=float(log_z),
    )  # fmt: skip


def _running_in(volumes: Sequence[WornVolume], values: Array, spread: Array) -> WearLawFit:
    """Running-in by Laplace's approximation about its most probable ratio and distance."""
    slid = np.array([volume.distance_m for volume in volumes])
    load = np.array([volume.normal_n for volume in volumes])
    typical = float(np.exp(np.mean(np.log(np.unique(slid)))))

    def work(unknown: Array) -> Array:
        ratio, turn = np.exp(unknown[0]), typical * np.exp(unknown[1])
        until = np.minimum(slid, turn)
        extra = until - until**2 / (2.0 * turn)  # ∫ (1 - s/s0) ds
        return np.asarray(1e3 * load * (slid + (ratio - 1.0) * extra))

    def fitted(unknown: Array) -> WearLawFit:
        return _fit_law("running_in", work(unknown), values, spread)

    def curve(unknown: Array) -> Array:
        k = fitted(unknown).coefficient_mm2_per_n
        return np.asarray((values - k * work(unknown)) / spread)

    steps, unit = np.full(2, STEP), np.eye(len(values))
    starts = product((-0.7, 0.7), repeat=2)  # there may be several valleys
    places = [
        nearest_point(curve, np.array(start), np.zeros(2), steps, unit, np.ones(2))
        for start in starts
    ]
    best = min(places, key=lambda place: place.cost)
    fit = fitted(best.unknown)
    ahead = [fitted(best.unknown + step).coefficient_mm2_per_n for step in np.diag(steps)]
    slope = (np.array(ahead) - fit.coefficient_mm2_per_n) / STEP
    ratio, turn = np.exp(best.unknown).tolist()
    variance = fit.own_uncertainty**2 + slope @ np.linalg.solve(best.normal, slope)
    occam = 0.5 * (best.unknown @ best.unknown + np.linalg.slogdet(best.normal)[1])
    return replace(
        fit, own_uncertainty=float(np.sqrt(variance)), freedom=len(values) - 3,
        log_evidence=fit.log_evidence - float(occam), first_over_last=ratio,
        running_in_distance_m=typical * turn,
    )  # fmt: skip


@dataclass(frozen=True)
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
        areas = levelled_of(volume.scars)
        return {
            **{name: getattr(volume, name) for name in ("distance_m", "normal_n", "friction")},
            "traces": len(areas),
            "worn_area_mm2": float(np.mean([a.worn_area_mm2 for a in areas])) if areas else None,
            "scar_width_mm": float(np.mean([a.width_mm for a in areas])) if areas else None,
            "volume_mm3": volume.volume_mm3,
            "standard_uncertainty_mm3": self.standard_uncertainty_mm3,
            "coefficient_mm2_per_n": self.coefficient_mm2_per_n,
            "standard_uncertainty": self.standard_uncertainty,
        }


def trace_json(scar: TraceScar) -> dict[str, Any]:
    """What `calibration.json` states of a trace."""
    fields: dict[str, Any] = {"file": scar.test.file, "distance_m": scar.test.distance_m}
    one = scar.levelled
    if one is None:
        return fields | {"is_clear": False}
    return fields | {
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
    def distances_m(self) -> list[float]:
        """The traces' distances, each once, m."""
        return list(dict.fromkeys(scar.test.distance_m for scar in self.traces))

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
        pair = self.coefficient_mm2_per_n / WEAR_UNIT, self.standard_uncertainty / WEAR_UNIT
        yield "coefficient_mm2_per_n", f"{with_uncertainty(*pair)} e-9"
        low, high = (f"{edge / WEAR_UNIT:.4g}" for edge in self.interval_95)
        yield "interval_95", f"{low} to {high} e-9"
        if self.chi is not None:
            yield "chi", f"{self.chi:.2f}"
        yield "law", self.law
        for row in self.by_distance:
            pair = row.coefficient_mm2_per_n / WEAR_UNIT, row.standard_uncertainty / WEAR_UNIT
            yield row.volume.place, f"{with_uncertainty(*pair)} e-9"

    @property
    def scene_values(self) -> dict[str, tuple[float, float]]:
        """What `--into` sets: key, value and standard uncertainty, by Archard's law."""
        key = "wear.coefficient_mm2_per_n"
        return {key: (self.coefficient_mm2_per_n, self.standard_uncertainty)}

    def coefficient_by(self, law: str) -> tuple[float, float] | None:
        """The coefficient by a law of one parameter, and its uncertainty; None if not asked.

        The common inputs' relative uncertainty is that by Archard's law.
        """
        chosen = next((fit for fit in self.laws if fit.law == law), None)
        if chosen is None:
            return None
        noise = archard_of(self.laws).own_uncertainty
        common = max(self.standard_uncertainty**2 - noise**2, 0.0) / self.coefficient_mm2_per_n**2
        value = chosen.coefficient_mm2_per_n
        return value, float(np.sqrt(chosen.own_uncertainty**2 + common * value**2))

    @property
    def scene_comment(self) -> str:
        """What a scene's comment states of the value."""
        return "k = V/(P s)" if self.chi is None else f"chi {self.chi:.2f}"

    def figure(self) -> Figure:
        """The traces as measured and levelled, a row a distance, and k over the distance."""
        shown = range(min(len(self.distances_m), MOST_SHOWN))
        panels = self.panels(tuple(shown))
        levelled = panels.plots[: len(shown)]
        raw = [
            Plot(
                title=f"{place:g} m: as measured",
                draw=partial(_draw_raw, calibration=self, place=place),
            )
            for place in self.distances_m[: len(shown)]
        ]
        pairs = [plot for pair in zip(raw, levelled, strict=True) for plot in pair]
        plots = [*pairs, *panels.plots[len(shown) :]]
        panels = replace(panels, plots=plots, plots_across=2, notes=())
        return panels_figure(panels, "    ".join(_values(self)))

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give scars, coefficients and budget for a paper; see `paper_figure`.

        `frames`: numbers of the distances that are shown. Raises InputError where one is not there.
        """
        few = range(min(len(self.distances_m), MOST_SHOWN))
        chosen = chosen_frames(frames, len(self.distances_m), few, items="distances")
        shown = [self.distances_m[k] for k in chosen]

        plots = [
            Plot(
                title=f"{place:g} m",
                draw=partial(_draw_levelled, calibration=self, place=place),
                spare=int(frames is None and 0 < k < len(shown) - 1),  # the ends tell the most
            )
            for k, place in enumerate(shown)
        ]
        parts = {item.input: item.contribution / WEAR_UNIT for item in self.budget}
        plots += [
            Plot(title="V/(P s)", draw=partial(_draw_coefficients, calibration=self)),
            budget_plot("uncertainty budget", parts, unit="1e-9 mm²/N"),
        ]
        notes = ["; ".join(_values(self)) + ".", f"Bands: ± {BAND:g} standard uncertainties."]
        return PaperPanels(plots=plots, notes=notes)

    def to_json(self) -> dict[str, Any]:
        """The result as plain numbers, texts and lists for `calibration.json`."""
        freedom = self.degrees_of_freedom
        return {
            "coefficient_mm2_per_n": self.coefficient_mm2_per_n,
            "standard_uncertainty": self.standard_uncertainty,
            "degrees_of_freedom": freedom if np.isfinite(freedom) else None,
            "interval_95": list(self.interval_95),
            "chi": self.chi,
            "law": self.law,
            "laws": [fit.to_json() for fit in self.laws],
            "by_distance": [row.to_json() for row in self.by_distance],
            "traces": [trace_json(scar) for scar in self.traces],
            "budget": [item.to_json() for item in self.budget],
            **warnings_json(self.warnings),
        }


WEAR_UNIT = 1e-9
"""mm²/N: wear coefficients of dry contacts are some of these, and are drawn and told in it."""


def _values(calibration: WearCalibration) -> tuple[str, str, str]:
    """The coefficient, its interval and its law, in words."""
    pair = calibration.coefficient_mm2_per_n, calibration.standard_uncertainty
    k, u = (number / WEAR_UNIT for number in pair)
    low, high = (edge / WEAR_UNIT for edge in calibration.interval_95)
    value = f"k = {with_uncertainty(k, u)} e-9 mm²/N by Archard's law"
    return value, f"95 %: {low:.4g} to {high:.4g}", f"law by evidence: {calibration.law}"


def _draw_raw(axes: Axes, calibration: WearCalibration, place: float) -> None:
    """The traces of a distance less the line through their ends, and what they are levelled by."""
    scars = [s for s in calibration.traces if s.test.distance_m == place and s.levelled]
    for scar, colour in zip(scars, cycle(LINE_COLOURS), strict=False):
        (one,) = levelled_of([scar])
        z = one.level_um - one.depth_um
        line = np.interp(one.x_mm, one.x_mm[[0, -1]], z[[0, -1]])
        axes.plot(one.x_mm, z - line, color=colour, lw=LINE_PT, label=plain_name(scar.test.file))
        axes.plot(one.x_mm, one.level_um - line, color=INK, lw=LINE_PT, ls=":")
    style_axes(axes, x_label="x (mm)", z_label="height (µm)")
    if scars:
        add_legend(axes)


def _draw_levelled(axes: Axes, calibration: WearCalibration, place: float) -> None:
    """Depths from the scars' middles, downward, with the worn areas and the edges."""
    scars = [s for s in calibration.traces if s.test.distance_m == place]
    traces = levelled_of(scars)
    names = [plain_name(scar.test.file, 24) for scar in scars if scar.levelled is not None]
    for one, name, colour in zip(traces, names, cycle(LINE_COLOURS), strict=False):
        x = one.x_mm - one.centre_mm
        axes.plot(x, -one.depth_um, color=colour, lw=LINE_PT, label=name)
        for edge, u in zip(one.edges_mm, one.edge_uncertainty_mm, strict=True):
            at = edge - one.centre_mm
            axes.axvspan(at - BAND * u, at + BAND * u, color=colour, alpha=0.12, lw=0)
    if traces:
        first = traces[0]
        inside = (first.x_mm >= first.window_mm[0]) & (first.x_mm <= first.window_mm[1])
        x = first.x_mm - first.centre_mm
        axes.fill_between(x, -first.depth_um, 0.0, where=inside, color=PALE, lw=0, zorder=0)
        axes.set_xlim(-1.5 * first.width_mm, 1.5 * first.width_mm)
    axes.axhline(0.0, color=GREY, lw=LINE_PT)
    areas = [
        with_uncertainty(1e3 * one.worn_area_mm2, 1e3 * one.worn_area_uncertainty_mm2)
        for one in traces
    ]
    text = "worn area (1e-3 mm²): " + ", ".join(areas) if areas else "no clear scar"
    style_axes(axes, x_label="x (mm)", z_label="height over the level (µm)", title=text)


def _draw_coefficients(axes: Any, calibration: WearCalibration) -> None:
    """Each distance's k with two standard uncertainties, and the band of all together."""
    rows = calibration.by_distance
    s = np.array([row.volume.distance_m for row in rows])
    k = np.array([row.coefficient_mm2_per_n for row in rows]) / WEAR_UNIT
    u = np.array([row.standard_uncertainty for row in rows]) / WEAR_UNIT
    ends = np.array([0.0, 1.08 * s.max()])
    value, spread = calibration.coefficient_mm2_per_n, calibration.standard_uncertainty
    together = data_name("all distances")
    draw_band(
        axes, ends, np.full(2, value / WEAR_UNIT), np.full(2, spread / WEAR_UNIT), label=together
    )
    look: dict[str, Any] = {"fmt": "o", "color": LINE_COLOURS[1], "lw": LINE_PT, "capsize": 3}
    axes.errorbar(s, k, yerr=BAND * u, label=data_name("each distance"), **look)
    axes.set_xlim(*ends)
    title = "V/(P s) at each distance, ± 2 u, and of all"
    style_axes(axes, x_label="sliding distance (m)", z_label="k (1e-9 mm²/N)", title=title)
