"""`calibrate_wear`: the coefficient by each law V = k x(s), its ±, picture and contradictions.

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
from itertools import cycle, pairwise, product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, stdtrit

from isochrome.calibration.result import CONTRADICTED, MOST_SHOWN, UNLIKELY
from isochrome.calibration.wear_set import (
    TraceScar,
    TraceScatter,
    WearSet,
    WornVolume,
    levelled_of,
    trace_scars,
    worn_volumes,
)
from isochrome.contact import contact_states, wear_rate
from isochrome.errors import InputError, IsochromeError, PhysicsError
from isochrome.estimation import STEP, BudgetInput, BudgetRow, budget_items
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
from isochrome.fitting import CLEAR, nearest_point
from isochrome.messages import message, warnings_json
from isochrome.output import Result, columns_of, counted, with_uncertainty
from isochrome.scars import student_factor_of
from isochrome.scene import Wear, check_reach, load_scene, scene_names

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[Any]
Volumes = Sequence[WornVolume]


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
    """The laws by falling evidence; `spread` (n,): the volumes' own errors, mm³. Laws with friction
    are asked where all volumes state one, running_in where there are three distances.
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
        return (values - fitted(unknown).coefficient_mm2_per_n * work(unknown)) / spread

    steps, unit = np.full(2, STEP), np.eye(len(values))
    places = [
        nearest_point(curve, np.array(start), np.zeros(2), steps, unit, np.ones(2))
        for start in product((-0.7, 0.7), repeat=2)  # there may be several valleys
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
        fields = dict(vars(self))
        volume = fields.pop("volume")
        areas = levelled_of(volume.scars)
        return {
            **{name: getattr(volume, name) for name in ("distance_m", "normal_n", "friction")},
            "traces": len(areas),
            "worn_area_mm2": float(np.mean([a.worn_area_mm2 for a in areas])) if areas else None,
            "scar_width_mm": float(np.mean([a.width_mm for a in areas])) if areas else None,
            "volume_mm3": volume.volume_mm3,
            **fields,
        }


def trace_json(scar: TraceScar) -> dict[str, Any]:
    """What `calibration.json` states of a trace."""
    one = scar.levelled
    place = {"file": scar.test.file, "distance_m": scar.test.distance_m, "is_clear": bool(one)}
    return place if one is None else place | {
        "left_mm": one.edges_mm[0],
        "left_uncertainty_mm": one.edge_uncertainty_mm[0],
        "right_mm": one.edges_mm[1],
        "right_uncertainty_mm": one.edge_uncertainty_mm[1],
        "depth_um": one.deepest_um,
        "roughness_rq_um": one.roughness.rq_um,
        "worn_area_mm2": one.worn_area_mm2,
        "standard_uncertainty_mm2": one.worn_area_uncertainty_mm2,
        "spikes": one.spikes,
    }  # fmt: skip


@dataclass(frozen=True, repr=False, kw_only=True)
class WearCalibration(Result):
    """A wear coefficient by Archard's law with its uncertainty, budget, and what the laws say.

    Parameters
    ----------
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
        yield "coefficient_mm2_per_n", _in_unit(self)
        low, high = (f"{edge / WEAR_UNIT:.4g}" for edge in self.interval_95)
        yield "interval_95", f"{low} to {high} e-9"
        if self.chi is not None:
            yield "chi", f"{self.chi:.2f}"
        yield "law", self.law
        for row in self.by_distance:
            yield row.volume.place, _in_unit(row)

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
        places = self.distances_m[:MOST_SHOWN]
        panels = self.panels(tuple(range(len(places))))
        plots: list[Plot] = []
        for place, levelled in zip(places, panels.plots, strict=False):
            raw = partial(_draw_raw, self, place)
            plots += [Plot(title=f"{place:g} m: as measured", draw=raw), levelled]
        plots += panels.plots[len(places) :]
        panels = replace(panels, plots=plots, plots_across=2, notes=())
        return panels_figure(panels, "    ".join(_values(self)))

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give scars, coefficients and budget for a paper; see `paper_figure`.

        `frames`: numbers of the distances that are shown. Raises InputError where one is not there.
        """
        places = self.distances_m
        few = range(min(len(places), MOST_SHOWN))
        chosen = chosen_frames(frames, len(places), few, items="distances")
        inner = chosen[1:-1] if frames is None else []  # the ends tell the most
        plots = [
            Plot(
                title=f"{places[k]:g} m", draw=partial(_draw_levelled, self, places[k]),
                spare=int(k in inner),
            )
            for k in chosen
        ]  # fmt: skip
        parts = {item.input: item.contribution / WEAR_UNIT for item in self.budget}
        plots += [
            Plot(title="V/(P s)", draw=partial(_draw_coefficients, self)),
            budget_plot("uncertainty budget", parts, unit="1e-9 mm²/N"),
        ]
        notes = ["; ".join(_values(self)) + ".", f"Bands: ± {BAND:g} standard uncertainties."]
        return PaperPanels(plots=plots, notes=notes)

    def to_json(self) -> dict[str, Any]:
        """The result as plain numbers, texts and lists for `calibration.json`."""
        names = ("coefficient_mm2_per_n", "standard_uncertainty", "degrees_of_freedom",
                 "interval_95", "chi", "law")  # fmt: skip
        freedom = self.degrees_of_freedom if np.isfinite(self.degrees_of_freedom) else None
        return {
            **{name: getattr(self, name) for name in names},
            "degrees_of_freedom": freedom,
            "interval_95": list(self.interval_95),
            "laws": [fit.to_json() for fit in self.laws],
            "by_distance": [row.to_json() for row in self.by_distance],
            "traces": [trace_json(scar) for scar in self.traces],
            "budget": [item.to_json() for item in self.budget],
            **warnings_json(self.warnings),
        }


WEAR_UNIT = 1e-9
"""mm²/N: wear coefficients of dry contacts are some of these, and are drawn and told in it."""


def _in_unit(result: WearCalibration | WornDistance) -> str:
    pair = result.coefficient_mm2_per_n / WEAR_UNIT, result.standard_uncertainty / WEAR_UNIT
    return f"{with_uncertainty(*pair)} e-9"


def _values(calibration: WearCalibration) -> tuple[str, str, str]:
    """The coefficient, its interval and its law, in words."""
    value = f"k = {_in_unit(calibration)} mm²/N by Archard's law"
    low, high = (edge / WEAR_UNIT for edge in calibration.interval_95)
    return value, f"95 %: {low:.4g} to {high:.4g}", f"law by evidence: {calibration.law}"


def _draw_raw(calibration: WearCalibration, place: float, axes: Axes) -> None:
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


def _draw_levelled(calibration: WearCalibration, place: float, axes: Axes) -> None:
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


def _draw_coefficients(calibration: WearCalibration, axes: Any) -> None:
    """Each distance's k with two standard uncertainties, and the band of all together."""
    rows = calibration.by_distance
    s = np.array([row.volume.distance_m for row in rows])
    k = np.array([row.coefficient_mm2_per_n for row in rows]) / WEAR_UNIT
    u = np.array([row.standard_uncertainty for row in rows]) / WEAR_UNIT
    ends = np.array([0.0, 1.08 * s.max()])
    value, spread = calibration.coefficient_mm2_per_n, calibration.standard_uncertainty
    band = np.full(2, value / WEAR_UNIT), np.full(2, spread / WEAR_UNIT)
    draw_band(axes, ends, *band, label=data_name("all distances"))
    look: dict[str, Any] = {"fmt": "o", "color": LINE_COLOURS[1], "lw": LINE_PT, "capsize": 3}
    axes.errorbar(s, k, yerr=BAND * u, label=data_name("each distance"), **look)
    axes.set_xlim(*ends)
    title = "V/(P s) at each distance, ± 2 u, and of all"
    style_axes(axes, x_label="sliding distance (m)", z_label="k (1e-9 mm²/N)", title=title)


_ALIKE = 0.02
"""Difference of a load or a width from the scene's that is none."""

_OWN_WIDTH = 0.03
"""Relative standard uncertainty of a simulated scar's width: where its depth runs out is seen
otherwise in a trace than in the model."""


def _of_traces(scars: Sequence[TraceScar], scatter: TraceScatter) -> Iterator[str]:
    for trace in levelled_of(scars):
        yield from trace.messages
    unclear = [scar.test for scar in scars if scar.levelled is None]
    if unclear:
        places = ", ".join(f"{d:g} m" for d in dict.fromkeys(test.distance_m for test in unclear))
        names = ", ".join(test.file for test in unclear)
        yield message("no_scar_stands_out", names=names, places=places)
    square, freedom = scatter.chi_square, scatter.freedom
    if freedom > 0 and chdtrc(freedom, square) < UNLIKELY:
        yield message("traces_distance_differ_times", ratio=np.sqrt(square / freedom))


def _of_order(volumes: Volumes, spread: Array) -> Iterator[str]:
    """Less worn, or narrower, where more was slid under as much load."""
    for i, j in pairwise(np.argsort([volume.work_n_mm for volume in volumes], kind="stable")):
        one, other = volumes[i], volumes[j]
        if other.work_n_mm <= one.work_n_mm or other.normal_n < one.normal_n:
            continue
        before, after = one.volume_mm3, other.volume_mm3
        if before - after > CONTRADICTED * float(np.hypot(spread[i], spread[j])):
            yield message(
                "mm_worn_after_less", volume_mm3=after, place=other.place, volume_mm3_2=before,
                place_2=one.place,
            )  # fmt: skip
        if not (one.scars and other.scars):
            continue
        (wide, u_wide), (narrow, u_narrow) = _width(one), _width(other)
        if wide - narrow > CONTRADICTED * float(np.hypot(u_wide, u_narrow)):
            yield message(
                "scar_after_mm_wide", place=other.place, narrow=narrow, wide=wide, place_2=one.place
            )


def _width(volume: WornVolume) -> tuple[float, float]:
    """Mean width of a volume's scars and its uncertainty, mm."""
    traces = levelled_of(volume.scars)
    edges = np.array([trace.edge_uncertainty_mm for trace in traces])
    width = float(np.mean([trace.width_mm for trace in traces]))
    return width, float(np.sqrt(np.sum(edges**2))) / len(traces)


def _of_laws(volumes: Volumes, laws: Sequence[WearLawFit], law: str) -> Iterator[str]:
    archard = archard_of(laws)
    k = archard.coefficient_mm2_per_n
    if law != "archard":
        best, more, evidence = laws[0], "", -archard.log_evidence
        if best.first_over_last is not None and best.running_in_distance_m is not None:
            more = message(
                "which_begins_last_coefficient", first_over_last=best.first_over_last,
                running_in_distance_m=best.running_in_distance_m,
            )  # fmt: skip
        yield message(
            "volumes_prefer_ln_clear", law=best.law, more=more, log_evidence=evidence, sure=CLEAR
        )
    if archard.is_unlikely:
        spread = [v.own_uncertainty_mm3 for v in volumes]
        size = spread if np.isfinite(spread).all() else np.ones(len(volumes))
        away = np.array([v.volume_mm3 - k * v.work_n_mm for v in volumes])
        worst = volumes[int(np.argmax(np.abs(away) / size))]
        ratio = worst.volume_mm3 / (k * worst.work_n_mm)
        chi = np.sqrt(archard.chi_square / archard.freedom)
        yield message("distances_do_not_agree", chi=chi, place=worst.place, ratio=ratio)


def _of_inputs(settings: WearSet, volumes: Volumes) -> Iterator[str]:
    known = settings.uncertainty
    stated = {"load": known.load_percent, "distance": known.distance_percent}
    if any(volume.scars for volume in volumes):
        stated["width"] = known.width_mm
        stated["the profilometer's heights"] = known.height_percent
        stated["its lateral scale"] = known.lateral_percent
    missing = [name for name, value in stated.items() if value is None]
    if missing:
        yield message("no_uncertainty_given_what_scars", missing=", ".join(missing))
    if len(volumes) == 1 and not np.isfinite(volumes[0].own_uncertainty_mm3):
        yield message("one_volume_without_uncertainty")


def _of_scene(settings: WearSet, volumes: Volumes, k: float) -> Iterator[str]:
    """Scars against those of a scene's contact, worn with the coefficient that was found."""
    if settings.scar is None or settings.scar.scene is None:
        return
    name = settings.scar.scene
    scene = load_scene(name if name in scene_names() else settings.path(name))
    if scene.indenter is None or scene.load is None or scene.wear is None:
        raise InputError("scar_scene_has_no", name=settings.name, name_2=name)
    thickness, width = scene.specimen.thickness_mm, settings.scar.width_mm
    if thickness is not None and abs(width / thickness - 1.0) > _ALIKE:
        yield message("scar_width_mm_scene_specimen", width_mm=width, thickness=thickness)
    for volume in sorted(volumes, key=lambda v: v.distance_m):
        if not volume.scars:
            continue
        place, load, normal = volume.place, scene.load_at(volume.distance_m), volume.normal_n
        if abs(normal / load - 1.0) > _ALIKE:
            yield message("normal_n_scene_load_normal_n", normal_n=normal, place=place, load=load)
        worn_scene = scene.with_values({
            "load.normal_n": normal,
            "wear.coefficient_mm2_per_n": k,
            "wear.law": "archard",
            "wear.distances_m": (volume.distance_m,),
        })  # fmt: skip
        try:
            state = list(contact_states(worn_scene))[-1]
        except IsochromeError as error:
            yield message("scene_own_scar_cannot", place=place, error=error)
            continue
        worn = state.grid.x_mm[state.wear_depth_mm > 0.0]
        (scar, spread), wide = _width(volume), float(worn[-1] - worn[0])
        if abs(scar - wide) > CONTRADICTED * float(np.hypot(spread, _OWN_WIDTH * wide)):
            yield message(
                "scar_mm_wide_mm", place=place, measured=scar, width=wide, normal_n=normal
            )


_PLAUSIBLE = 1e-15, 1e-1
"""Coefficients (mm²/N) from diamond to chalk, with room on both sides."""


def calibrate_wear(settings: str | Path | WearSet) -> WearCalibration:
    """Calibrate the wear coefficient from measured scars.

    k = V/(P s), equation 11 of the paper, at each distance and for all of them by their weights; V
    of traces is the mean worn area times the scar's width. What other laws give, and which of them
    the volumes speak for, stands beside.

    Parameters
    ----------
    settings : str, Path or WearSet
        The calibration set, a TOML file: [scar], [[trace]] or [[volume]], [uncertainty].

    Returns
    -------
    WearCalibration
        The coefficient with its uncertainty, budget, laws, distances and warnings.

    Raises
    ------
    InputError
        Where the set or a trace is wrong; it names the file, the key or line, and the fix.
    PhysicsError
        Where no trace shows a scar, or nothing was worn.

    Notes
    -----
    Source: Archard (1953), J. Appl. Phys. 24, 981; JCGM 100:2008 (GUM), 5.1 and G.4, for the
    uncertainty and its degrees of freedom.

    Examples
    --------
    >>> import isochrome
    >>> from isochrome.calibration import WearSet
    >>> volume = {"distance_m": 155.0, "normal_n": 44.0, "value_mm3": 0.01364}
    >>> found = isochrome.calibrate_wear(WearSet(volume=[volume]))
    >>> round(found.coefficient_mm2_per_n / 1e-9, 6)
    2.0
    """
    given = WearSet.read(settings)
    if given is not settings:
        check_reach(given.model_dump(exclude_unset=True), given.name)
    scars = trace_scars(given)
    volumes, scatter = worn_volumes(given, scars)
    if not volumes:
        why = next(scar.why_not for scar in scars if scar.why_not)
        raise PhysicsError("no_distance_has_traces", name=given.name, scars=why)
    spread, scattered = _spread(volumes)
    laws = fit_laws(volumes, spread)
    archard = archard_of(laws)
    k = archard.coefficient_mm2_per_n
    least, most = _PLAUSIBLE
    if not least <= k <= most:
        raise InputError(
            "scars_give_mm_where", name=given.name, k=k, plausible=least, plausible_2=most
        )
    values = np.array([volume.volume_mm3 for volume in volumes])
    work = np.array([volume.work_n_mm for volume in volumes])
    weights = work / spread**2 / np.sum((work / spread) ** 2)  # dk/dV, 1/(N mm)
    traced = np.array([bool(volume.scars) for volume in volumes])
    rows = _own_rows(volumes, spread, weights, archard, scattered=scattered)
    rows += _common_inputs(given, volumes[0], k, float(weights[traced] @ values[traced]))
    total = _joined([u * c for _, _, u, c in rows])
    if scattered:
        part, freedom = archard.own_uncertainty, float(max(archard.freedom, 1))
    else:
        part, freedom = _joined((weights * spread)[traced]), scatter.degrees_of_freedom
    freedom, scale = _effective(freedom, part, total)
    # of volumes that are known by their scatter alone the ± is the scale (JCGM 100:2008, 4.2.3)
    reach = float(stdtrit(freedom, 0.975) * (total if scattered else scale))
    # the square scatter over its degrees of freedom, in what the shoulders promise
    square = archard.chi_square * scatter.factor + scatter.chi_square
    count = 0 if scattered else archard.freedom + scatter.freedom
    law = "archard" if archard.log_evidence > -CLEAR else laws[0].law
    return WearCalibration(
        coefficient_mm2_per_n=k,
        standard_uncertainty=total,
        degrees_of_freedom=freedom,
        interval_95=(k - reach, k + reach),
        chi=float(np.sqrt(square / count)) if count > 0 else None,
        law=law,
        laws=laws,
        by_distance=_by_distance(given, volumes, spread),
        traces=scars,
        budget=budget_items(rows),
        warnings=(
            *_of_traces(scars, scatter),
            *_of_order(volumes, spread),
            *_of_laws(volumes, laws, law),
            *_of_inputs(given, volumes),
            *_of_scene(given, volumes, k),
        ),
    )


def _spread(volumes: Volumes) -> tuple[Array, bool]:
    """Standard uncertainties of the volumes' own errors (n,), mm³; without one, all alike, by their
    scatter about V = k P s, which roughness and levelling make at any distance alike.
    """
    spread = np.array([volume.own_uncertainty_mm3 for volume in volumes])
    values = np.array([volume.volume_mm3 for volume in volumes])
    scattered = not np.isfinite(spread).all()
    if scattered:
        work = np.array([volume.work_n_mm for volume in volumes])
        away = values - work * (work @ values) / (work @ work)
        spread = np.full(len(values), np.sqrt(away @ away / max(len(values) - 1, 1)))
    return np.maximum(spread, 1e-12 * values.max()), scattered


def _effective(freedom: float, part: float, total: float) -> tuple[float, float]:
    """Degrees of freedom of a total of which a part has these, by Welch and Satterthwaite (JCGM
    100:2008, G.4), and Student's scale of it, the standard deviation over (ν/(ν - 2))^(1/2).
    """
    joint = freedom * (total / part) ** 4 if part > 0.0 and np.isfinite(freedom) else np.inf
    return joint, total / float(np.sqrt(student_factor_of(joint)))


def _own_rows(
    volumes: Volumes, spread: Array, weights: Array, archard: WearLawFit, *, scattered: bool
) -> list[BudgetRow]:
    """What the volumes' own errors add to k."""
    traced = np.array([bool(volume.scars) for volume in volumes])
    roughness = np.array([volume.roughness_mm3 for volume in volumes])
    level = np.array([volume.levelling_mm3 for volume in volumes])
    promised = np.hypot(roughness, level)
    # less scatter than was promised makes both parts less, more of it is a part of its own
    share = np.minimum(1.0, np.divide(spread, promised, out=np.ones_like(spread), where=traced))
    parts: dict[str, Array] = {}
    if traced.any():
        more = np.sqrt(np.maximum(spread**2 - promised**2, 0.0)) * traced
        parts = {"roughness": roughness * share, "levelling": level * share}
        parts["scatter of the traces"] = more
    if not traced.all():
        parts["scatter of the volumes" if scattered else "volumes"] = spread * ~traced
    rows: list[BudgetRow] = [(n, None, _joined(weights * part), 1.0) for n, part in parts.items()]
    if archard.is_unlikely and not scattered:
        wider = archard.own_uncertainty * np.sqrt(archard.chi_square / archard.freedom - 1.0)
        rows.append(("scatter of the distances", None, float(wider), 1.0))
    return rows


def _joined(parts: Any) -> float:
    return float(np.sqrt(np.sum(np.square(parts))))


def _common_inputs(
    settings: WearSet, first: WornVolume, k: float, of_traces: float
) -> list[BudgetRow]:
    """What common inputs add to k: as 1/P, 1/s, and by traces as width and the two scales."""
    known, load, slid = settings.uncertainty, first.normal_n, first.distance_m
    inputs: list[tuple[str, float, float | None, float]] = [
        ("normal_n", load, known.load_percent, -k),
        ("distance_m", slid, known.distance_percent, -k),
    ]
    if settings.scar is not None and of_traces:
        width = settings.scar.width_mm
        of_width = None if known.width_mm is None else 100.0 * known.width_mm / width
        inputs += [
            ("scar.width_mm", width, of_width, of_traces),
            ("profilometer's height scale", 1.0, known.height_percent, of_traces),
            ("profilometer's lateral scale", 1.0, known.lateral_percent, of_traces),
        ]
    return [
        (name, value, value * percent / 100.0, change / value)
        for name, value, percent, change in inputs
        if percent
    ]


def _by_distance(settings: WearSet, volumes: Volumes, spread: Array) -> tuple[WornDistance, ...]:
    """Each distance's coefficient, with what all share in its uncertainty."""
    rows = []
    for volume, noise in zip(volumes, spread, strict=True):
        work = volume.work_n_mm
        k = volume.volume_mm3 / work
        shared = {
            name: u * c
            for name, _, u, c in _common_inputs(settings, volume, k, k if volume.scars else 0.0)
        }
        u_k = _joined([noise / work, *shared.values()])
        of_volume = [u for name, u in shared.items() if name not in ("normal_n", "distance_m")]
        rows.append(WornDistance(volume, work * _joined([noise / work, *of_volume]), k, u_k))
    return tuple(sorted(rows, key=lambda row: row.volume.distance_m))
