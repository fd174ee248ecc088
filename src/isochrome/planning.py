"""`plan`: what an experiment will tell before it is made, and what would tell more.

A frame's derivatives J by its unknowns, its inputs and what usual benches have besides, over the
noise and less what the light explains, and what is known beforehand, P = diag(1/u²), bound every
estimate's covariance: C = (n JᵀJ + P)⁻¹ for n frames. Its parts are the frames' own, C n JᵀJ C, and
of each input (C_ik / u_k)². Sources: Kay (1993), Fundamentals of Statistical Signal Processing I,
3.7; Van Trees (1968), Detection, Estimation, and Modulation Theory I, 2.4.2, for the bound with
priors.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf, log, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import (
    FIRST_DEGREES,
    LIGHT_FALLS,
    NOISE,
    BudgetInput,
    FrameData,
    Unevenness,
    budgets_of,
    frame_light,
    is_determined,
    positive_part,
    prepare_frame,
    scaled_inverse,
)
from isochrome.figures import (
    LINE_COLOURS,
    LINE_PT,
    PaperPanels,
    Plot,
    budget_plot,
    panels_figure,
    style_axes,
)
from isochrome.fitting import (
    GAMMA,
    LEFT,
    LENS,
    PIXEL,
    TOP,
    Cause,
    FrameModel,
    candidates,
    fit_region,
    frame_scene,
    free_keys,
    hidden_px,
    inputs_of_rows,
    placed,
    scene_value,
    sizes_of,
    stated_inputs,
    taken_as_exact,
    thinning,
    with_numerics,
)
from isochrome.frames import Frame, NoiseModel, full_scale, to_linear
from isochrome.messages import message
from isochrome.output import (
    Result,
    columns_of,
    counted,
    provenance,
    staged,
    with_uncertainty,
    write_csv,
    write_figure,
    write_json,
    write_text,
)
from isochrome.progress import RunProgress, Tally
from isochrome.runs import environment, seal
from isochrome.scene import Scene, SceneLike, dump_scene, load_scene
from isochrome.simulation import (
    camera_frame,
    polariscope_light,
    required_model,
    scene_states,
    state_count,
    stress_map,
)
from isochrome.stress import pixel_grid
from isochrome.sweeps import SweepGrid, make_grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[Any]

_USUAL = ("load.normal_n", PIXEL, "specimen.thickness_mm")
"""What is varied where nothing is said: half of it, as it is, and twice."""


@dataclass(frozen=True, kw_only=True)
class PlannedValue:
    """A wanted `value`, the scene's, as it will be known: its `standard_uncertainty`, inf where the
    frames do not tell it, and the `budget`: what noise, each input and each usual cause add to it.
    """

    value: float
    standard_uncertainty: float
    budget: tuple[BudgetInput, ...]

    @property
    def relative(self) -> float:
        """The standard uncertainty over the value, or itself where that is nought."""
        return self.standard_uncertainty / (abs(self.value) or 1.0)


@dataclass(frozen=True, kw_only=True)
class PlanPoint:
    """One way to make the experiment: the varied keys' `settings`, the number of `frames` alike,
    whether there are `no_load` frames, which show the light; the wanted `values` by key, none where
    the point was refused, and the `reason` of that.
    """

    settings: Mapping[str, float]
    frames: int
    no_load: bool
    values: Mapping[str, PlannedValue]
    reason: str = ""

    @property
    def score(self) -> float:
        """The mean logarithm of the relative uncertainties: the least is the best."""
        return sum(log(one.relative) for one in self.values.values()) / (len(self.values) or 1)

    @property
    def text(self) -> str:
        """The settings in words."""
        parts = [f"{key} = {value:.4g}" for key, value in self.settings.items()]
        parts.append(counted(self.frames, "frame"))
        return ", ".join([*parts, f"{'with' if self.no_load else 'no'} no-load frames"])


@dataclass(frozen=True, kw_only=True)
class FrameInformation:
    """What one frame tells of `keys` (n,), the first `unknowns` of them unknown: its Fisher
    `information` (n, n), and as every other row of pixels has it, and the rows between; the
    `weight` 1/u² (n,) of what is known beforehand; which are `determined`."""

    keys: tuple[str, ...]
    values: Array
    unknowns: int
    information: Array
    halves: tuple[Array, Array]
    weight: Array
    determined: NDArray[np.bool_]

    def covariance(self, frames: int, information: Array | None = None) -> Array:
        """C = (n JᵀJ + P)⁻¹ (n, n) of so many frames."""
        told = self.information if information is None else information
        return scaled_inverse(frames * told + np.diag(self.weight))

    def budgets(self, frames: int) -> dict[str, PlannedValue]:
        """By wanted key its value, standard uncertainty, and budget, the largest part first."""
        covariance = self.covariance(frames)
        by_frames = np.sqrt(
            np.maximum(np.diag(frames * covariance @ self.information @ covariance), 0.0)
        )
        known = np.flatnonzero(self.weight)
        spread = self.weight[known] ** -0.5
        rows = tuple(
            (self.keys[k], float(self.values[k]), float(u))
            for k, u in zip(known, spread, strict=True)
        )
        budgets = budgets_of(by_frames, rows, covariance[:, known] * self.weight[known])
        return {
            self.keys[j]: PlannedValue(
                value=float(self.values[j]),
                standard_uncertainty=float(np.sqrt(covariance[j, j]))
                if self.determined[j]
                else inf,
                budget=budgets[j],
            )
            for j in self.wanted
        }

    def known_better(self, key: str, share: float) -> FrameInformation:
        """The same with an input that is known to a share of its standard uncertainty."""
        weight = self.weight.copy()
        weight[self.keys.index(key)] /= share**2
        return replace(self, weight=weight)

    @property
    def wanted(self) -> tuple[int, ...]:
        """Places of the unknowns that are no place in the picture, nor the camera's."""
        names = enumerate(self.keys[: self.unknowns])
        return tuple(j for j, key in names if key.partition(".")[0] not in ("camera", "frames"))

    @property
    def thinning_error(self) -> float:
        """How far half of the pixels move a standard uncertainty, as a share of it, at most."""
        at = [j for j in self.wanted if self.determined[j]]
        one, other = (np.sqrt(np.diag(self.covariance(1, half))[at]) for half in self.halves)
        return float(np.max(np.abs(one - other) / (one + other), initial=0.0))


def _told(rows: Array, keys: tuple[str, ...], values: Array) -> Array:
    """Fisher information (n, n) of derivatives (n, pixels) less what is no more than the error of
    differences. Priors alone tell apart what changes together with all stresses (a load and fringe
    value, or a thickness), with all depths (a radius, modulus and wear), or with all lengths (a
    load, radius and pixel about the specimen's place): of what each tells alone that leaves up to
    1e-5 by the error of differences; anything else leaves 4e-4 and more.
    """
    about = np.eye(len(keys))
    for key in (LEFT, TOP):
        if PIXEL in keys and key in keys:
            place, pixel = keys.index(key), keys.index(PIXEL)
            about[place, pixel] = values[place] / values[pixel]
    turned = about.T @ rows
    information = turned @ turned.T
    told = positive_part(information, np.sqrt(np.diag(information)), 5e-5)
    back = np.linalg.inv(about)
    return np.asarray(back.T @ told @ back)


def _noise(scene: Scene) -> NoiseModel:
    """The camera's noise as its scene has it: read noise, rounding, electrons."""
    camera = scene.camera
    assert camera is not None
    rounding = 0.0 if camera.bit_depth is None else 1.0 / 12.0
    offset = camera.noise_grey**2 + rounding
    well, full = camera.full_well_electrons, full_scale(camera.bit_depth)
    if offset == 0.0 and well is None:
        raise InputError("plan_needs_noise", name=scene.name)
    return NoiseModel(offset, 0.0 if well is None else full / well, offset)


def _frame_data(scene: Scene, no_load: bool, as_stated: bool) -> FrameData:
    """The noise-free frame of a one-state scene, with its noise, and what its light may be."""
    camera = scene.camera
    assert camera is not None
    quiet = camera.model_copy(update={"noise_grey": 0.0, "full_well_electrons": None})
    still = scene.model_copy(update={"camera": quiet})
    light = polariscope_light(scene, stress_map(scene, scene_states(scene)[-1]))
    depth, gamma = camera.bit_depth, scene.frames.first_gamma
    image, *ends = (
        camera_frame(still, signal).values
        for signal in (light, np.zeros(light.shape), np.ones(light.shape))
    )
    frame = Frame(0, image, None, scene.name)
    data = prepare_frame(frame, scene, bit_depth=depth, gamma_found=True, noise=_noise(scene))
    lamp = data.lamp
    if no_load:
        dark, bright = (
            to_linear(end, bit_depth=depth, gamma=gamma, allow_blank=True).image for end in ends
        )
        lamp = frame_light(data.shape, dark, bright)
    elif not as_stated:
        lamp = lamp.of(Unevenness(camera.brightness, LIGHT_FALLS[0], FIRST_DEGREES))
    return replace(data, lamp=lamp)


def frame_information(
    scene: Scene, given: Scene, *, no_load: bool = False, as_stated: bool = False
) -> FrameInformation:
    """What one frame of a one-state scene tells, `given` what that is made of. With `no_load`
    frames its light is theirs; `as_stated`, nothing is free but unknowns and stated inputs."""
    data = _frame_data(scene, no_load, as_stated)
    unknowns = free_keys(scene)
    if isinstance(scene.frames.gamma, str):
        unknowns = (*unknowns, GAMMA)
        scene = scene.with_values({GAMMA: scene.frames.first_gamma})
    stated = stated_inputs(scene, given)  # assumed ones of usual benches enter here
    held = stated.some(unknowns, free=False)
    causes = [c for c in candidates(scene, unknowns, held) if c.free and not c.stated]
    causes = [] if as_stated else causes
    apart = [c for c in causes if c.even or c.keys[0] in LENS]
    rows = [
        row
        for cause in causes
        if cause not in apart
        for row in zip(cause.keys, cause.starts, sizes_of(cause, scene), strict=True)
    ]
    keys = (*unknowns, *held.keys, *(key for key, _, _ in rows))
    begun = {key: scene.get(key) or start for key, start, _ in rows}
    here = with_numerics(placed(scene.with_values(begun), data.shape))
    known = inputs_of_rows([*stated.rows, *((k, float(begun[k]), u) for k, _, u in rows)])
    values = np.array([float(here.get(key)) for key in keys])
    stride = thinning(data.light.size, 8_000)
    region = fit_region(here, data.shape, stride, hidden_px(here))
    model = FrameModel(data, here, keys, region, stride=stride, prior=known.prior(keys))
    part = model.keep_clear(values)
    if part is None:
        raise PhysicsError("scene_cannot_solved_where", name=scene.name)
    local = model.linearise(values, part)
    for row, change in zip(local.rows, _wide_steps(here, keys), strict=True):
        if change.any():
            row[:] = _slope(model, keys, values, change) * part.amplitude / np.float32(change.max())
            part.project(row[None])
    effects = np.array([_effect(model, values, part.signal, cause) for cause in apart], np.float32)
    effects = effects.reshape(-1, part.signal.size) * part.amplitude
    squares = np.r_[local.squares, np.square(effects).sum(axis=1)]
    part.project(effects)
    every = np.concatenate((local.rows, effects)).astype(float)
    count, odd = float(stride**2), np.nonzero(model.pixels.keep)[0] % 2 == 1
    names = (*keys, *(cause.keys[0] for cause in apart))
    middles = np.r_[values, np.zeros(len(apart))]
    information, *halves = (
        count * _told(some, names, middles)
        for some in (every, sqrt(2.0) * every[:, odd], sqrt(2.0) * every[:, ~odd])
    )
    weight = np.r_[model.prior.weight, np.ones(len(apart))]
    return FrameInformation(
        keys=names, values=middles, unknowns=len(unknowns), information=information,
        halves=(halves[0], halves[1]), weight=weight,
        determined=is_determined(information, count * squares) | (weight > 0.0),
    )  # fmt: skip


def _wide_steps(scene: Scene, keys: tuple[str, ...]) -> Array:
    """Steps (n, n) of the picture's place and scale, each alone, a tenth of a pixel: behind a lens
    pictures are interpolated, and a smaller one is lost in the error of that. Else none."""
    assert scene.camera is not None and scene.camera.pixel_mm is not None
    steps = np.zeros((len(keys), len(keys)))
    if any(scene.get(key) for key in LENS):
        pixel = scene.camera.pixel_mm
        wide = {LEFT: 0.1 * pixel, TOP: 0.1 * pixel, PIXEL: 3e-4 * pixel}
        for k, key in enumerate(keys):
            steps[k, k] = wide.get(key, 0.0)
    return steps


def _slope(model: FrameModel, keys: tuple[str, ...], values: Array, step: Array) -> Array:
    """Half of what a step of some keys' values, ahead and back, changes of the signal (n,)."""
    ahead, behind = (model.signal(values + way * step, keys=keys) for way in (1.0, -1.0))
    if ahead is None or behind is None:
        k = int(np.argmax(step))
        raise PhysicsError("scene_cannot_solved_beside", key=keys[k], value=values[k])
    return np.asarray(0.5 * (ahead - behind))


def _effect(model: FrameModel, values: Array, here: Array, cause: Cause) -> Array:
    """What a cause of its usual size does to the signal (n,): an even one as it is, a lens by its
    slope, both ways, for what it is seen by is made otherwise than without.
    """
    keys, now = (*model.keys, *cause.keys), float(model.scene.get(cause.keys[0]) or 0.0)
    if not cause.even:
        step = np.append(np.zeros(len(values)), 0.01 * cause.sizes[0])
        return _slope(model, keys, np.append(values, now), step) / np.float32(0.01)
    there = model.signal(np.r_[values, cause.starts], keys=keys)
    if there is None:
        raise PhysicsError("scene_cannot_solved_beside", key=cause.keys[0], value=now)
    return there - here


@dataclass(frozen=True, repr=False, kw_only=True)
class Plan(Result):
    """What an experiment will tell.

    Parameters
    ----------
    scene : Scene
        The scene of the planned state.
    state : str
        Which of the scene's states it is.
    now : PlanPoint
        The experiment as the scene states it.
    points : tuple of PlanPoint
        All others of the grid.
    sharper : mapping of str to float
        By wanted key its standard uncertainty with the input that limits it known twice as well.
    thinning_error : float
        How far half of the pixels that were asked move a standard uncertainty, as a share of it:
        more than those that were not asked do.
    taken_as_exact : tuple of str
        Measured numbers that state no uncertainty, which are in no ±.
    """

    scene: Scene
    state: str
    now: PlanPoint
    points: tuple[PlanPoint, ...]
    sharper: Mapping[str, float]
    thinning_error: float
    taken_as_exact: tuple[str, ...]

    @property
    def good(self) -> list[PlanPoint]:
        """The points that were not refused, the experiment as it is stated first."""
        return [self.now, *(point for point in self.points if point.values)]

    @property
    def best(self) -> PlanPoint:
        """The point that tells most, of the least mean logarithm of the relative uncertainties;
        what tells no tenth more is no reason to leave the experiment as it is stated.
        """
        return min(self.good, key=lambda point: round(point.score, 1))

    @property
    def columns(self) -> dict[str, list[Any]]:
        """Those of plan.csv: a row for each value of each point, the stated one first."""
        return columns_of(
            row for point in (self.now, *self.points) for row in _table_rows(point, self.now)
        )

    @property
    def sentences(self) -> tuple[str, ...]:
        """What a laboratory needs of it, in words."""
        texts = [self._known(key, one) for key, one in self.now.values.items()]
        texts += [self._changed(key) for key in self.now.values if self._alone()]
        if len(self.good) > 1:
            best = "; ".join(f"{k} ± {_share(v.relative)}" for k, v in self.best.values.items())
            texts.append(
                message("plan_best", count=len(self.good), point=self.best.text, best=best)
            )
        return tuple(texts)

    def _known(self, key: str, one: PlannedValue) -> str:
        """What one value will be known to, what limits that, and what it would be then."""
        shown = with_uncertainty(one.value, one.standard_uncertainty)
        if key not in self.sharper:
            return message("plan_value_by_noise", key=key, shown=shown, share=_share(one.relative))
        first = one.budget[0]
        return message(
            "plan_value_by_input", key=key, shown=shown, share=_share(one.relative),
            input=first.input, part=first.share, half=0.5 * first.standard_uncertainty,
            then=_share(one.relative * self.sharper[key] / one.standard_uncertainty),
        )  # fmt: skip

    def _changed(self, key: str) -> str:
        """What a value would be known to with one thing changed, where that is a tenth of its ±."""
        now = self.now.values[key].relative
        found = [(point.values[key].relative, words) for words, point in self._alone()]
        changes = [f"{w} ± {_share(r)}" for r, w in sorted(found) if not 0.9 < r / now < 1.1]
        if not changes:
            return message("plan_value_unchanged", key=key)
        return message("plan_value_changed", key=key, changes="; ".join(changes))

    def _alone(self) -> list[tuple[str, PlanPoint]]:
        """The points that differ from the stated one in one thing, and in what."""
        result = []
        for point in self.good[1:]:
            words = [
                f"{k} = {v:.4g}" for k, v in point.settings.items() if v != self.now.settings[k]
            ]
            words += [counted(point.frames, "frame")] * (point.frames != self.now.frames)
            words += [f"{'with' if point.no_load else 'without'} no-load frames"] * (
                point.no_load != self.now.no_load
            )
            if len(words) == 1:
                result.append((words[0], point))
        return result

    @property
    def warnings(self) -> tuple[str, ...]:
        """Points that were refused, noise that is not stated, and what counts as exact."""
        refused = [point for point in self.points if not point.values]
        texts = []
        if refused:
            count, total = len(refused), len(self.points)
            texts.append(
                message("plan_refused", count=count, total=total, reason=refused[0].reason)
            )
        camera = self.scene.camera
        if camera and not camera.noise_grey and camera.full_well_electrons is None:
            texts.append(message("plan_rounding_alone"))
        if self.taken_as_exact:
            texts.append(message("plan_exact", keys=", ".join(self.taken_as_exact)))
        return tuple(texts)

    @property
    def title(self) -> str:
        """What is planned."""
        count = counted(len(self.points) + 1, "point")
        return f"Plan of {self.scene.name} ({self.state}): {count}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """The wanted values as they will be known."""
        for key, one in self.now.values.items():
            yield key, with_uncertainty(one.value, one.standard_uncertainty)

    def to_json(self) -> dict[str, Any]:
        """What plan.json holds."""
        return {
            "state": self.state,
            "values": {
                key: {
                    "value": one.value,
                    "standard_uncertainty": one.standard_uncertainty,
                    "budget": [part.to_json() for part in one.budget],
                }
                for key, one in self.now.values.items()
            },
            "best": {
                **self.best.settings,
                "frames": self.best.frames,
                "no_load": self.best.no_load,
            },
            "thinning_error": self.thinning_error,
            "taken_as_exact": list(self.taken_as_exact),
            "sentences": list(self.sentences),
            "warnings": list(self.warnings),
            "points": self.columns,
        }

    def figure(self) -> Figure:
        """The budget of each value, and its ± over each thing that is varied alone."""
        budgets = [
            budget_plot(
                f"{key}: what its ± is made of",
                {part.input: 100.0 * part.contribution / abs(one.value or 1.0)
                 for part in one.budget if part.share > 0.005},
                unit="%",
            )
            for key, one in self.now.values.items()
        ]  # fmt: skip
        wanted = list(self.now.values)
        varied = [key for key in self.now.settings if len(self._along(key)) > 1]
        lines = [
            Plot(title=f"over {key}", draw=partial(self._draw, name=key))
            for key in (*varied, *["frames"] * (len(self._along("frames")) > 1))
        ]
        panels = PaperPanels(plots=[*lines, *budgets], legend=wanted if lines else ())
        return panels_figure(panels, self.title)

    def _along(self, name: str) -> list[tuple[float, PlanPoint]]:
        """The points that differ in one thing alone, or in nothing, over its value."""
        here = [self.now, *(point for _, point in self._alone())]
        places = {
            float(point.frames if name == "frames" else point.settings[name]): point
            for point in reversed(here)
            if point.no_load == self.now.no_load
            and all(v == self.now.settings[k] for k, v in point.settings.items() if k != name)
            and (name == "frames" or point.frames == self.now.frames)
        }
        return sorted(places.items())

    def _draw(self, axes: Axes, name: str) -> None:
        places, points = zip(*self._along(name), strict=True)
        for k, (key, now) in enumerate(self.now.values.items()):
            shares = [point.values[key].relative / now.relative for point in points]
            look: Any = {"color": LINE_COLOURS[k % 6], "marker": "os^vD*"[k % 6]}
            axes.semilogx(places, shares, lw=LINE_PT, ms=4, label=key, **look)
        axes.set_xticks(places, [f"{place:.4g}" for place in places])
        axes.minorticks_off()
        axes.set_ylim(0.0, 1.1 * axes.get_ylim()[1])
        style_axes(axes, x_label=name, z_label="relative ±, as stated = 1")


def _share(relative: float) -> str:
    return f"{100.0 * relative:.2g} %"


def _table_rows(point: PlanPoint, now: PlanPoint) -> Iterator[dict[str, Any]]:
    """The rows of a point, one without a value where it was refused."""
    head = {**point.settings, "frames": point.frames, "no_load": point.no_load}
    for key in now.values:
        one = point.values.get(key)
        first = one.budget[0] if one is not None and one.budget else None
        yield head | {
            "key": key,
            "value": one and one.value,
            "standard_uncertainty": one and one.standard_uncertainty,
            "relative_uncertainty": one and one.relative,
            "limited_by": first.input if first else "",
            "limiting_share": first and first.share,
            "status": "ok" if one else "failed",
            "reason": point.reason,
        }


def _scene_at(grid: SweepGrid, index: int) -> Scene:
    """The scene at a point; a finer pixel shows the same view with more of them, and its scale is
    as well known."""
    scene, point = grid.scene, grid.point(index)
    values: dict[str, Any] = dict(point)
    if PIXEL in point:
        now, spread = pixel_grid(scene), scene.uncertainties.get(PIXEL)
        ratio = now.pixel_mm / point[PIXEL]
        for key, count in (("camera.width_px", now.cols), ("camera.height_px", now.rows)):
            values.setdefault(key, round(ratio * count))
        if spread is not None:
            values[PIXEL] = {"value": point[PIXEL], "standard_uncertainty": spread / ratio}
    result = scene.with_values(values)
    return result.model_copy(update={"folder": scene.folder, "name": scene.name})


def plan(
    scene: SceneLike,
    vary: Sequence[str] | Mapping[str, Sequence[float]] | None = None,
    *,
    state: int | None = None,
    frames: Sequence[int] = (1, 10),
    as_stated: bool = False,
    out: str | Path | None = None,
    progress: RunProgress | None = None,
) -> Plan:
    """Say what an experiment will tell before it is made, and what would make it tell more.

    The Cramér-Rao bound of each unknown of one state's frames, C = (n JᵀJ + P)⁻¹, with the
    derivatives J by the unknowns, the inputs that state an uncertainty, and what usual benches have
    besides (roll, lens, modulus, layer, smooth stress, uneven light, ...), over the noise and less
    what the light explains; P = diag(1/u²) is what is known of them beforehand. No estimate from
    such frames does better, and `fit` and `process` come close to it.

    Parameters
    ----------
    scene : str, Path, Scene or mapping
        A TOML file, the name of a scene of the package, a Scene, or its tables, with a model and
        [camera] with `noise_grey`.
    vary : sequence of str, or mapping of str to sequence of float, optional
        The grid, as of `sweep`: 'KEY=first:last:number' or 'KEY=value,value,...', or a mapping of
        keys to values. By default half, once and twice the load, the pixel and the thickness. With
        another `camera.pixel_mm` the picture shows as much as before.
    state : int, optional
        Number of the scene's state, from 0; by default the last.
    frames : sequence of int, default (1, 10)
        Numbers of frames alike; the first is the experiment's. So many frames, or their mean, have
        the noise of an exposure that is so many times as long.
    as_stated : bool, default False
        Whether only the unknowns and the inputs that state an uncertainty are free.
    out : str or Path, optional
        Folder for plan.csv, plan.json, plan.png, scene.toml and provenance.json.
    progress : callable, optional
        Called with a Tally of the points.

    Returns
    -------
    Plan
        The values as they will be known, each with its budget; the grid; `sentences`.

    Raises
    ------
    InputError
        Where the scene has no model, no camera or no noise, or has phase steps or colours.
    PhysicsError
        Where the scene is refused, as with fringes that are finer than the pixels.

    Notes
    -----
    Derivatives are taken once a point, on some 8,000 pixels; `thinning_error` says what the others
    would change. Sources: Kay (1993), Fundamentals of Statistical Signal Processing I, section 3.7;
    Van Trees (1968), Detection, Estimation, and Modulation Theory I, section 2.4.

    Examples
    --------
    >>> import isochrome
    >>> ring = isochrome.load_scene("ring").with_values({
    ...     "camera.noise_grey": 2.0,
    ...     "specimen.fringe_value_n_per_mm": {"value": 14.6, "standard_uncertainty": 0.07}})
    >>> planned = isochrome.plan(ring, {"load.normal_n": [100.0, 200.0]})
    >>> one = planned.now.values["load.normal_n"]
    >>> f"{100 * one.relative:.1f} %", one.budget[0].input
    ('0.5 %', 'specimen.fringe_value_n_per_mm')
    """
    given = load_scene(scene)
    required_model(given)
    polariscope, camera = given.polariscope, given.camera
    pixel_grid(given)
    assert camera is not None
    if polariscope.step or camera.colour or polariscope.several_wavelengths:
        raise InputError("plan_grey_frames", name=given.name)
    if any(count < 1 for count in frames) or not frames:
        raise InputError("plan_frames_counts", frames=list(frames))
    count = state_count(given)
    if state is not None and not 0 <= state < count:
        raise InputError("plan_state", name=given.name, state=state, last=count - 1)
    number = count - 1 if state is None else state
    one = frame_scene(given, number).model_copy(update={"name": given.name, "folder": given.folder})
    usual = {
        key: [share * value for share in (0.5, 1.0, 2.0)]
        for key in _USUAL
        if isinstance(value := scene_value(one, key), float) and value > 0.0
    }
    grid = make_grid(one, vary or usual)
    told = partial(frame_information, given=given, as_stated=as_stated)
    has_no_load = given.frames.no_load_bright is not None
    total = int(np.prod(list(grid.counts.values())))
    here = told(one, no_load=has_no_load)
    stated = {key: float(one.get(key)) for key in grid.values}
    now = PlanPoint(
        settings=stated, frames=frames[0], no_load=has_no_load, values=here.budgets(frames[0])
    )
    points: list[PlanPoint] = []
    for index in range(total):
        if progress is not None:
            progress(Tally(index, total, 0, sum(not point.values for point in points)))
        for no_load in (False, True):
            values: list[dict[str, PlannedValue]] = [{} for _ in frames]
            reason = ""
            try:
                information = told(_scene_at(grid, index), no_load=no_load)
                values = [information.budgets(number) for number in frames]
            except PhysicsError as error:
                reason = str(error)
            points += [
                PlanPoint(
                    settings=grid.point(index), frames=n, no_load=no_load, values=v, reason=reason
                )
                for n, v in zip(frames, values, strict=True)
            ]
    if progress is not None:
        progress(Tally(total, total, 0, sum(not point.values for point in points)))
    alike = (stated, now.frames, now.no_load)
    sharper = {
        key: here.known_better(first.input, 0.5).budgets(now.frames)[key].standard_uncertainty
        for key, planned in now.values.items()
        if planned.budget and (first := planned.budget[0]).input != NOISE
    }
    exact = taken_as_exact(one, here.keys)
    result = Plan(
        scene=one, state=scene_states(one)[-1].label, now=now, sharper=sharper,
        points=tuple(p for p in points if (p.settings, p.frames, p.no_load) != alike),
        thinning_error=here.thinning_error, taken_as_exact=exact,
    )  # fmt: skip
    if out is not None:
        with staged(out) as folder:
            write_csv(folder / "plan.csv", result.columns)
            write_json(folder / "plan.json", result.to_json())
            write_text(folder / "scene.toml", dump_scene(given))
            write_figure(folder / "plan.png", result.figure())
            inputs = given.files(of_frames=False)
            seal(folder, provenance(dump_scene(given), inputs) | environment())
    return result
