"""Which wear law the frames speak for, by its evidence.

All laws have dh = kappa(s) p ds. One fit with a wear coefficient between each two frames holds, by
its values and information N, all that the frames say, and each law is a curve through these. With Q
the least square distance of a law,

    ln Z = -Q/2 - 1/2 ln det(J^T N J + prior) + ln prior + const,

Laplace's approximation; what all laws share cancels.
Source: MacKay (2003), Information Theory, Inference, and Learning Algorithms, chapters 27 and 28.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import chdtrc

from isochrome.contact import wear_course
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.single_state import with_part
from isochrome.fitting.frame.unknowns import FRICTION, WEAR
from isochrome.fitting.joint.frame_sequence import Sequence, Unknown
from isochrome.fitting.joint.joint_fit import JointFit
from isochrome.messages import message
from isochrome.scene import Scene

CLEAR = 5.0
"""Difference of ln Z that is a clear margin: odds of 150 to 1 (Kass & Raftery 1995, JASA 90, 773:
very strong evidence)."""

_SEGMENTS = 12
_FAR, _LEAST = 4.0, 1e-2
"""Logarithms from its start that a running-in is looked for: beyond, its table has no meaning; and
the least last coefficient that it starts from, over the mean."""


@dataclass(frozen=True, kw_only=True)
class LawFit:
    """One law through what the frames say.

    `between`, the mean coefficient (mm²/N) that it gives between the frames (n,); `misfit` Q, in
    noise variances, of `freedom` degrees; `chi`, over all pixels; `log_evidence`, less the
    preferred law's.
    """

    law: str
    parameters: dict[str, dict[str, float]]
    between: tuple[float, ...]
    misfit: float
    freedom: int
    chi: float
    log_evidence: float


@dataclass(frozen=True)
class Law:
    """A family of courses: `wear`, its parameters (m,) to [wear] values; `names` and `start` (m,).
    Parameters are logarithms; `prior` (m,) their Gaussian prior's standard deviation about `start`,
    inf for a flat one.
    """

    name: str
    names: tuple[str, ...]
    start: Array
    prior: Array
    wear: Callable[[Array], dict[str, Any]]


def segments(sequence: Sequence) -> Sequence | None:
    """The same frames with a wear coefficient between each two, by Archard's law. Of many frames
    some neighbours share one. None where fewer than two frames are worn, or the coefficient is not
    free: then no law can be told.
    """
    frames = sorted(
        {i for u in sequence.unknowns if u.key == WEAR for i in u.frames},
        key=lambda i: sequence.distances_m[i] or 0.0,
    )
    ends = sorted({sequence.distances_m[i] or 0.0 for i in frames})
    if not sequence.run or len(ends) < 2:
        return None
    groups = np.array_split(np.array(ends), min(_SEGMENTS, len(ends)))
    unknowns = [u for u in sequence.unknowns if u.key != WEAR]
    for group in groups:
        inside = tuple(i for i in frames if (sequence.distances_m[i] or 0.0) in group)
        unknowns.append(Unknown(WEAR, inside, False))
    scene = sequence.scene.with_values({"wear.law": "archard"})
    return replace(sequence, scene=scene, unknowns=tuple(unknowns))


def mean_coefficients(scene: Scene, ends_m: Array) -> Array:
    """Mean of kappa (mm²/N) between rising distances (n,): what Archard's law would need there."""
    _, stops = wear_course(with_part(scene, "wear", distances_m=tuple(ends_m.tolist())))
    dose = np.array([0.0] + [stop.dose_mm_per_mpa for stop in stops])
    return np.diff(dose) / (1e3 * np.diff(ends_m, prepend=0.0))


def compare_laws(
    sequence: Sequence, values: Array, information: Array, *, cost: float, freedom: int
) -> tuple[LawFit, ...]:
    """The wear laws by falling evidence; 'running_in' is Archard's with a linear coefficient.
    `cost`, sum of squared residuals over noise, of `freedom` pixels. The prior of a running-in's
    ratio is a factor of e, that of its distance one about the worn distances' geometric mean.
    """
    fits = [
        _fit_law(law, sequence, values, information, cost=cost, freedom=freedom)
        for law in _laws(sequence, values)
    ]
    best = max(fit.log_evidence for fit in fits)
    laws = [replace(fit, log_evidence=fit.log_evidence - best) for fit in fits]
    return tuple(sorted(laws, key=lambda f: -f.log_evidence))


def _laws(sequence: Sequence, values: Array) -> list[Law]:
    """Laws of the friction alone; of several stretches also Archard's with a coefficient that is
    linear in the distance until it stays."""
    ends = segment_ends(sequence)
    coefficients = values[_unknowns_of(sequence, WEAR)]
    mean = float(coefficients @ np.diff(ends, prepend=0.0) / ends[-1])

    def plain(law: str) -> Law:
        scene = sequence.whole(values).with_values({"wear.law": law, WEAR: mean})
        ratio = float(np.sum(coefficients) / np.sum(mean_coefficients(scene, ends)))
        return Law(
            law, (WEAR,), np.array([np.log(mean * ratio)]), np.array([np.inf]),
            lambda t: {"wear.law": law, WEAR: float(np.exp(t[0]))},
        )  # fmt: skip

    laws = [plain("archard")]
    if sequence.scene.friction is not None:
        laws += [plain("sarkar"), plain("dissipated_energy")]
    if len(ends) <= 2:
        return laws
    # where it has ceased, it has no logarithm
    last = max(coefficients[-1], _LEAST * float(np.mean(coefficients)))
    start = np.log([last, 1.0, float(np.exp(np.mean(np.log(ends))))])

    def wear(t: Array) -> dict[str, Any]:
        last, ratio, distance = np.exp(np.clip(t, start - _FAR, start + _FAR)).tolist()
        table = {"distance_m": [0.0, distance], "value": [last * ratio, last]}
        return {"wear.law": "archard", WEAR: table}

    names = (WEAR, "first_over_last", "running_in_distance_m")
    return [*laws, Law("running_in", names, start, np.array([np.inf, 1.0, 1.0]), wear)]


def _unknowns_of(sequence: Sequence, key: str) -> list[int]:
    return [k for k, u in enumerate(sequence.unknowns) if u.key == key]


def segment_ends(sequence: Sequence) -> Array:
    """Distances at which the segments end (n,), m."""
    worn = [u.frames for u in sequence.unknowns if u.key == WEAR]
    return np.array([max(sequence.distances_m[i] or 0.0 for i in frames) for frames in worn])


def _fit_law(
    law: Law, sequence: Sequence, values: Array, information: Array, *, cost: float, freedom: int
) -> LawFit:
    """A law through the values that the frames say, its ln Z but for a constant. The friction moves
    with the law's parameters: a law weighs what it would take to change it.
    """
    widened = max(1.0, cost / freedom)
    ends, count = segment_ends(sequence), len(law.names)
    segment, friction = (_unknowns_of(sequence, key) for key in (WEAR, FRICTION))
    reduced, size = marginal(information / widened, friction + segment)
    centre = np.concatenate([law.start, values[friction]])
    precision = np.concatenate([1.0 / law.prior**2, np.zeros(len(friction))])
    steps = np.concatenate([np.full(count, 1e-5), 1e-2 / size[: len(friction)]])

    def curve(unknown: Array) -> Array:
        moved = values.copy()
        moved[friction] = unknown[count:]
        scene = sequence.whole(moved).with_values(law.wear(unknown[:count]))
        moved[segment] = mean_coefficients(scene, ends)
        return (moved - values)[friction + segment] * size

    starts = [[0.0]]
    if count > 1:  # such a law may have several valleys
        starts = [[0.0, ratio, turn] for ratio in (-0.7, 0.7) for turn in (-0.7, 0.7)]
    places = [
        nearest_point(
            curve, centre + np.pad(start, (0, len(friction))), centre, steps, reduced, precision
        )
        for start in starts
    ]
    best = min(places, key=lambda place: place.cost)
    narrow = law.prior[np.isfinite(law.prior)]
    log_z = -0.5 * (best.cost + float(np.linalg.slogdet(best.normal)[1]))
    log_z -= float(np.log(narrow).sum())
    spread = np.sqrt(np.diag(np.linalg.inv(best.normal)))[:count].tolist()
    value = np.exp(best.unknown[:count]).tolist()
    return LawFit(
        law=law.name,
        parameters={
            name: {"value": v, "standard_uncertainty": v * u}
            for name, v, u in zip(law.names, value, spread, strict=True)
        },
        between=tuple((values[segment] + (best.here / size)[len(friction) :]).tolist()),
        misfit=best.distance,
        freedom=len(segment) - len(law.names),
        chi=float(np.sqrt((cost + widened * best.distance) / freedom)),
        log_evidence=log_z,
    )


def marginal(information: Array, selected: list[int]) -> tuple[Array, Array]:
    """What is known of `selected` unknowns whatever the others are: N_kk - N_kr N_rr^-1 N_rk. Times
    `size`, (k, k), and that `size` (k,), with which the information's diagonal is one.
    """
    others = [k for k in range(len(information)) if k not in selected]
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information / np.outer(size, size)
    cross = scaled[np.ix_(selected, others)]
    marginal_matrix = scaled[np.ix_(selected, selected)]
    if others:
        marginal_matrix = marginal_matrix - cross @ np.linalg.solve(
            scaled[np.ix_(others, others)], cross.T
        )
    return marginal_matrix, size[selected]


@dataclass(frozen=True)
class CurvePlace:
    """A place `unknown` u (m,) on a curve c, as of `nearest_point`. `here`, c(u) (k,); `distance`,
    c^T N c; `cost`, with the prior's part; `normal`, J^T N J + Λ.
    """

    unknown: Array
    here: Array
    distance: float
    cost: float
    normal: Array


def nearest_point(
    curve: Callable[[Array], Array],
    unknown: Array,
    centre: Array,
    steps: Array,
    information: Array,
    precision: Array,
) -> CurvePlace:
    """The point of a curve c (m,) -> (k,) with least c(u)^T N c(u) + (u - u0)^T Λ (u - u0).
    `centre` u0 and `precision`, the diagonal of Λ, of the prior; `steps` (m,), of differences.
    """
    from scipy.optimize import least_squares

    size, along = np.linalg.eigh(information)
    root, known = np.sqrt(np.maximum(size, 0.0))[:, None] * along.T, np.sqrt(precision)

    def residual(at: Array) -> Array:
        return np.concatenate([root @ curve(at), known * (at - centre)])

    def slope(at: Array) -> Array:
        ahead = [residual(at + move) for move in np.diag(steps)]
        return np.asarray((np.array(ahead) - residual(at)).T / steps)

    best = least_squares(residual, unknown, jac=slope, x_scale="jac")
    here, normal = curve(best.x), best.jac.T @ best.jac
    return CurvePlace(best.x, here, float(here @ information @ here), 2.0 * best.cost, normal)


_UNLIKELY = 1e-4
"""Chance of a law's misfit below which the frames speak against it."""

_BY_FRICTION = {"archard", "sarkar", "dissipated_energy"}
"""Laws that differ only by how they take friction in."""


@dataclass(frozen=True)
class WearLaws:
    """The wear laws by falling evidence, and the fit that needs none.

    `between`, its mean coefficient from the last frame's distance to a frame's own, {from_m, to_m,
    value, standard_uncertainty}, mm²/N; `chi`, its residual over noise.
    """

    laws: tuple[LawFit, ...]
    between: tuple[dict[str, float], ...]
    chi: float

    @classmethod
    def of(cls, free: JointFit) -> WearLaws:
        """The wear laws, compared by what was worn between the frames of a fit without one."""
        ends = segment_ends(free.sequence)
        worn = [k for k, u in enumerate(free.unknowns) if u.key == WEAR]
        names = ("from_m", "to_m", "value", "standard_uncertainty")
        columns = [0.0, *ends[:-1]], ends, free.values[worn], free.standard_uncertainty[worn]
        between = tuple(dict(zip(names, row, strict=True)) for row in np.array(columns).T.tolist())
        assert free.information is not None
        cost, freedom = free.cost, free.freedom
        laws = compare_laws(
            free.sequence, free.values, free.information, cost=cost, freedom=freedom
        )
        return cls(laws, between, free.chi)

    @property
    def close(self) -> tuple[LawFit, ...]:
        """The preferred law, and those that the frames do not tell from it."""
        return tuple(law for law in self.laws if law.log_evidence > -CLEAR)

    @property
    def none_fits(self) -> bool:
        """Whether even the preferred law misses what was worn by far more than its uncertainty."""
        best = self.laws[0]
        return best.freedom > 0 and float(chdtrc(best.freedom, best.misfit)) < _UNLIKELY

    def sentence(self) -> str:
        """Which law the frames prefer, and by how much, or that they cannot tell."""
        names = [law.law for law in self.close]
        if len(names) > 1:
            listed = f"{', '.join(names[:-1])} and {names[-1]}"
            text = message("frames_cannot_tell_apart", listed=listed, clear=CLEAR)
            if len(_BY_FRICTION & set(names)) > 1:
                text += message("laws_differ_friction_alone")
        else:
            (name,), law, margin = names, self.laws[1].law, -self.laws[1].log_evidence
            text = message(
                "frames_prefer_margin_ln", names=name, margin=margin, law=law, clear=CLEAR
            )
        if self.none_fits:
            best = self.laws[0]
            text += message(
                "yet_leaves_misfit_variances",
                law=best.law,
                misfit=best.misfit,
                freedom=best.freedom,
            )
        return text

    def speaks_against(self, law: str) -> bool:
        """Whether a law is behind the preferred one by a clear margin; not if none weighed it."""
        return any(one.law == law and one.log_evidence <= -CLEAR for one in self.laws)

    def to_json(self) -> list[dict[str, Any]]:
        """A dictionary for each law, its parameters among its keys."""
        return [
            {name: getattr(law, field) for name, field in _IN_JSON.items()}
            | {key.removeprefix("wear."): value for key, value in law.parameters.items()}
            for law in self.laws
        ]

    def table(self) -> dict[str, list[Any]]:
        """The columns of wear_laws.csv."""
        names = ("law", "log_evidence", "chi", "misfit", "degrees_of_freedom")
        columns = {name: [getattr(law, _IN_JSON[name]) for law in self.laws] for name in names}
        for name, part in ((_SHORT, "value"), ("standard_uncertainty",) * 2):
            columns[name] = [law.parameters[WEAR][part] for law in self.laws]
        return columns


_SHORT = WEAR.removeprefix("wear.")
_IN_JSON = {name: name for name in ("law", "chi", "log_evidence", "misfit")}
_IN_JSON |= {"degrees_of_freedom": "freedom", "between": "between"}
"""Names in JSON of what is known of a law, and the attributes that hold it."""


def restored_laws(found: Mapping[str, Any]) -> WearLaws:
    """The wear laws from a fit's JSON."""
    laws = []
    for row in found["wear_laws"]:
        parameters = {n: values for n, values in row.items() if n not in _IN_JSON}
        parts = {field: row[name] for name, field in _IN_JSON.items()}
        parts |= {"parameters": {WEAR: parameters.pop(_SHORT), **parameters}}
        laws.append(LawFit(**parts | {"between": tuple(row["between"])}))
    return WearLaws(tuple(laws), tuple(found["wear_between_frames"]), found["wear_chi"])
