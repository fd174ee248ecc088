"""The normal equations of a frame, which are added up: memory holds one frame of many.

Each frame's linear parts are eliminated on their own; J^T J and J^T r add up. A frame of a run
shows load, friction and worn area: it is rendered once more for each, and the chain rule through
`local_values` carries them to whatever unknowns the course is made of.

Measured scars as observations of a fit, beside the frames: the worn area at a distance.

A contact that is in equilibrium wears W(s) = ∫ P' dK whatever its shape, so a scar's area tells of
load, friction and wear coefficient without a contact being solved:

    cost += Σ ((A - W(s))/u)²

with A a trace's worn area and u its standard uncertainty, of roughness and levelling. How well the
traces' spectra are known widens u by Student's factor, of all traces' degrees of freedom together.
Source: Archard (1953), J. Appl. Phys. 24, 981.
"""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from isochrome.errors import InputError
from isochrome.estimation import STEP, FrameData, LinearPart, Pixels, Prior, gradient_covariance
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.frame_model import gamma_slope, solve_with_gamma, trusted_pixels
from isochrome.fitting.frame.renderer import SceneRenderer, safe_signal
from isochrome.fitting.frame.unknowns import FRICTION, LOAD, WEAR, scales
from isochrome.fitting.joint.frame_sequence import COURSE, MeasuredArea, Sequence, local_values
from isochrome.messages import message
from isochrome.output import with_uncertainty
from isochrome.scars import levelled, read_trace, student_factor_of
from isochrome.scene import DistanceTable, Scene


@dataclass(frozen=True, kw_only=True)
class NormalEquations:
    """Sums over frames at one set of values: `normal` J^T J (p, p), `gradient` J^T r (p,);
    `middle`, Σ r² j j^T with the residuals' correlation; `squares` (p,), of rows with the linear
    parts; `cost`, over noise, with the `prior_cost`; `freedom`, pixels less linear unknowns;
    `positive` light and `chi` of each frame.
    """

    normal: Array
    middle: Array
    gradient: Array
    squares: Array
    cost: float
    freedom: int
    positive: tuple[bool, ...]
    chi: tuple[float, ...]
    prior_cost: float = 0.0

    def __add__(self, other: NormalEquations) -> NormalEquations:
        """Those of more frames."""
        sums = {name: part + getattr(other, name) for name, part in vars(self).items()}
        return NormalEquations(**sums)

    def known(self, prior: Prior, values: Array) -> NormalEquations:
        """Those with a prior of the unknowns, at their values (p,)."""
        if not prior.any:
            return self
        cost = prior.cost(values)
        return replace(
            self,
            normal=self.normal + prior.normal,
            gradient=self.gradient + prior.gradient(values),
            cost=self.cost + cost,
            prior_cost=cost,
        )

    def along(self, columns: Array) -> NormalEquations:
        """Those of unknowns that move the directions by `columns` (directions, p)."""
        return replace(
            self,
            normal=columns.T @ self.normal @ columns,
            middle=columns.T @ self.middle @ columns,
            gradient=columns.T @ self.gradient,
            squares=np.einsum("ij,ik,kj->j", columns, self.squares, columns),
        )


def frame_equations(gamma_fit: LinearPart, rows: Array, *, exact: bool = False) -> NormalEquations:
    """One frame's equations along `rows` (d, n), which change; `squares` of each two."""
    squares = rows @ rows.T
    gamma_fit.project(rows)
    precise = rows.astype(float) if exact else rows
    freedom = gamma_fit.residual.size - gamma_fit.count
    return NormalEquations(
        normal=(precise @ precise.T).astype(float),
        middle=gradient_covariance(rows, gamma_fit.residual, gamma_fit.problem.keep),
        gradient=(rows @ gamma_fit.residual).astype(float), squares=squares.astype(float),
        cost=gamma_fit.cost, freedom=freedom, positive=(gamma_fit.positive,),
        chi=(float(np.sqrt(gamma_fit.cost / max(1, freedom))),),
    )  # fmt: skip


def solved_along(
    data: FrameData,
    here: Scene,
    moved: list[tuple[Scene, ...]],
    *,
    renderer: SceneRenderer,
    region: Array,
) -> tuple[Pixels, LinearPart, Array] | None:
    """A frame's pixels, their light, and the weighted derivatives along its directions (d, n)."""
    gamma = here.frames.stated_gamma
    free = [ahead.frames.stated_gamma - gamma for ahead, *_ in moved]
    pixels = trusted_pixels(data.toned(gamma) if any(free) else data, region)
    signal = safe_signal(renderer, here)[pixels.keep].astype(np.float32)
    gamma_fit = solve_with_gamma(pixels, signal, gamma)
    if gamma_fit is None:
        return None
    rows = np.empty((len(moved), pixels.size), np.float32)
    for row, scenes, change in zip(rows, moved, free, strict=True):
        if change:
            row[:] = gamma_slope(gamma_fit, gamma) * np.float32(change)
            continue
        ahead, *behind = (safe_signal(renderer, scene)[pixels.keep] for scene in scenes)
        both = bool(behind) and bool(np.isfinite(behind[0].sum()))
        np.subtract(ahead, behind[0] if both else signal, out=row)
        row *= gamma_fit.amplitude / np.float32(1 + both)
    return (pixels, gamma_fit, rows) if np.isfinite(rows.sum()) else None


class DirectionMaps:
    """Directions that frames are rendered along, keys moved over all the course."""

    def __init__(self, sequence: Sequence, values: Array) -> None:
        self.sequence, self.values = sequence, values
        self.whole, distances = sequence.whole(values), sequence.distances_m
        keys = dict.fromkeys(u.key for u in sequence.unknowns)
        course = [key for key in COURSE if key in keys and sequence.in_course(key)]
        self._course = {*course, WEAR} if course else set()
        self._steps = {key: difference_step(self.whole, key) for key in {*keys, *self._course}}
        if course:
            self._local = local_values(self.whole, distances)
            self._along = {
                key: local_values(moved_values(self.whole, key, self._steps[key]), distances)
                - self._local
                for key in self._course
            }
            self._by_unknown = local_slopes(sequence, values, distances, self._local, course)

    def keys(self, index: int) -> list[str]:
        """The directions of a frame."""
        plain = [key for key in self.sequence.acting(index) if key not in self._course]
        if not self._course:
            return plain
        _, friction, worn = (self._local[index] != 0.0).tolist()
        sliding = self.sequence.distances_m[index] is not None
        shown = {LOAD: True, FRICTION: sliding or friction, WEAR: worn}
        return plain + [key for key in COURSE if shown[key] and key in self._course]

    def beside(self, index: int, *, both: bool = False) -> list[tuple[Scene, ...]]:
        """A frame's scenes a step along each key; for `both`, for priors, one back too."""
        here = self.sequence.frame(self.whole, self.values, index)
        slopes = []
        for key in self.keys(index):
            scenes = [self._beside(here, key, index, self._steps[key])]
            if both:
                with suppress(InputError):  # at the end of where it may be
                    scenes.append(self._beside(here, key, index, -self._steps[key]))
            slopes.append(tuple(scenes))
        return slopes

    def _beside(self, here: Scene, key: str, index: int, step: float) -> Scene:
        """A frame's scene moved by a step along a key, of a run's course with all its frames."""
        if key not in self._course:
            return moved_values(here, key, step)
        return self.sequence.frame(moved_values(self.whole, key, step), self.values, index)

    def columns(self, index: int) -> Array:
        """Steps along each direction that one unit of each unknown makes, (directions, p)."""
        keys = self.keys(index)
        matrix = np.zeros((len(keys), len(self.sequence.unknowns)))
        for column, unknown in enumerate(self.sequence.unknowns):
            if index in unknown.frames and unknown.key in keys and unknown.key not in self._course:
                matrix[keys.index(unknown.key), column] = 1.0 / self._steps[unknown.key]
        inside = [key for key in keys if key in self._course]
        if inside:
            which = [COURSE.index(key) for key in inside]
            square = np.array([self._along[key][index, which] for key in inside]).T
            rows = [keys.index(key) for key in inside]
            matrix[rows] += np.linalg.solve(square, self._by_unknown[:, index, which].T)
        return matrix


def difference_step(scene: Scene, key: str) -> float:
    """A difference step of a key, of the scale of its (first) value."""
    return STEP * float(scales(with_number(scene, key), (key,))[0])


def local_slopes(
    sequence: Sequence,
    values: Array,
    distances_m: tuple[float | None, ...],
    local: Array,
    keys: Collection[str],
) -> Array:
    """Change of `local_values` (distances, 3) by a unit of each unknown, 0 but for `keys`."""
    derivatives = np.zeros((len(values), *local.shape))
    common = sequence.whole(values)
    for row, unknown in enumerate(sequence.unknowns):
        if unknown.key in keys:
            ahead, step = values.copy(), difference_step(common, unknown.key)
            ahead[row] += step
            derivatives[row] = (local_values(sequence.whole(ahead), distances_m) - local) / step
    return derivatives


def moved_values(scene: Scene, key: str, step: float) -> Scene:
    """A scene with a key moved by a step, over all distances where it is a table."""
    value = scene.get(key)
    if isinstance(value, DistanceTable):
        return scene.with_values(
            {key: {"distance_m": value.distance_m, "value": [v + step for v in value.value]}}
        )
    return scene.with_values({key: value + step})


def with_number(scene: Scene, key: str) -> Scene:
    """A scene with a number at a key: the first of a table over distance."""
    value = scene.get(key)
    return scene.with_values({key: value.value[0]}) if isinstance(value, DistanceTable) else scene


_WEARING = ("specimen", "load", "friction", "wear")
"""Parts of a scene that the worn area goes with."""
_CONTRADICTS = 3.0
"""Standard uncertainties beyond which a scar contradicts the fit."""


def measured_areas(scene: Scene) -> tuple[MeasuredArea, ...]:
    """The worn areas of a scene's [[scar]]; InputError or PhysicsError for a trace without one."""
    traces = [levelled(read_trace(scene.path(scar.file))) for scar in scene.scar]
    if not traces:
        return ()
    # Student's factor is that of the traces' weighted mean, with 1 / Σ share² / ν degrees of
    # freedom: of each alone it would count the noise's scale over again. Source: Welch (1947),
    # Biometrika 34, 28; Satterthwaite (1946), Biometrics Bull. 2, 110
    variance = np.array([t.worn_area_uncertainty_mm2**2 / t.student_factor for t in traces])
    share = (1.0 / variance) / np.sum(1.0 / variance)
    freedom = 1.0 / np.sum(share**2 / np.array([t.degrees_of_freedom for t in traces]))
    spreads = np.sqrt(variance * student_factor_of(float(freedom))).tolist()
    return tuple(
        MeasuredArea(scar.file, scar.distance_m, trace.worn_area_mm2, spread, trace.messages)
        for scar, trace, spread in zip(scene.scar, traces, spreads, strict=True)
    )


def scar_equations(sequence: Sequence, values: Array) -> NormalEquations:
    """The normal equations of a sequence's measured areas at some values (p,) of its unknowns."""
    areas = sequence.areas
    distances = tuple(area.distance_m for area in areas)
    spread = np.array([area.standard_uncertainty_mm2 for area in areas])
    local = local_values(sequence.whole(values), distances)
    residual = (np.array([area.area_mm2 for area in areas]) - local[:, 2]) / spread
    wearing = {u.key for u in sequence.unknowns if u.key.split(".")[0] in _WEARING}
    rows = local_slopes(sequence, values, distances, local, wearing)[..., 2] / spread
    normal = rows @ rows.T
    return NormalEquations(
        normal=normal, middle=normal, gradient=rows @ residual, squares=np.diag(normal).copy(),
        cost=float(residual @ residual), freedom=residual.size, positive=(), chi=(),
    )  # fmt: skip


def scar_messages(areas: tuple[MeasuredArea, ...], scene: Scene) -> tuple[str, ...]:
    """What to say of measured areas beside those of a fitted scene."""
    if not areas:
        return ()
    worn = local_values(scene, tuple(area.distance_m for area in areas))[:, 2]
    messages = [text for area in areas for text in area.messages]
    for area, model in zip(areas, worn.tolist(), strict=True):
        away = abs(area.area_mm2 - model) / area.standard_uncertainty_mm2
        if away > _CONTRADICTS:
            measured = with_uncertainty(area.area_mm2, area.standard_uncertainty_mm2)
            messages.append(
                message(
                    "worn_area_mm_fitted", name=area.name, measured=measured, model=model, away=away
                )
            )
    return tuple(messages)
