r"""The wear coefficient by a law, from volumes by distance.

Each law here is V = k x(s), linear in k, x in N mm:

    archard            x = P s                       (equation 11 of the paper: k = V/(P s))
    sarkar             x = P s sqrt(1 + 3 mu²)
    dissipated_energy  x = P s |mu|
    running_in         x = P (s + (r-1) (s - s²/(2 s0))), s <= s0;   P (s + (r-1) s0/2) beyond

the last Archard's with a coefficient that goes linearly from r k to k over s0. With variances u² of
the volumes k = Σ xV/u² / Σ x²/u², and with χ² what it leaves, a flat prior of ln k gives

    ln Z = -χ²/2 - 1/2 ln(k² Σ x²/u²) + const,

averaged for running_in over its prior: ln r and ln s0 Gaussian, of a factor of e about 1 and about
the distances' geometric mean. Sources: Archard (1953), J. Appl. Phys. 24, 981; Sarkar (1980),
Friction and Wear; Fouvry et al. (1997), Wear 203-204, 390; MacKay (2003), Information Theory,
Inference, and Learning Algorithms, chapter 28.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from isochrome.calibration.wear.worn_volumes import WornVolume
from isochrome.contact import wear_rate
from isochrome.scene import Wear

Array = NDArray[Any]

SURE = 5.0
"""Difference of ln Z that is a clear margin: odds of 150 to 1 (Kass & Raftery 1995, JASA 90,
773)."""

_NODES, _ZOOMS = 41, 4
_REACH = 4.0
"""Nodes of an average over the priors, how often they are drawn closer about the posterior, and how
far they reach at first, in the priors' standard deviations."""


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

    def to_json(self) -> dict[str, Any]:
        """Its numbers by name."""
        found: dict[str, Any] = {
            "law": self.law,
            "coefficient_mm2_per_n": self.coefficient_mm2_per_n,
            "own_uncertainty_mm2_per_n": self.own_uncertainty,
            "chi_square": self.chi_square,
            "freedom": self.freedom,
            "log_evidence": self.log_evidence,
        }
        if self.law == "running_in":
            found["first_over_last"] = self.first_over_last
            found["running_in_distance_m"] = self.running_in_distance_m
        return found


def work_of(volume: WornVolume, law: str) -> float:
    """What a volume is k times of, x of a law of one parameter, N mm."""
    wear = Wear(coefficient_mm2_per_n=1.0, law=law, distances_m=(volume.distance_m,))
    return volume.work_n_mm * float(wear_rate(wear, volume.friction or 0.0, volume.distance_m))


def fit_laws(volumes: Sequence[WornVolume], spread: Array) -> tuple[WearLawFit, ...]:
    """The laws by falling evidence.

    Parameters: `volumes`, n of them; `spread` (n,), standard uncertainties of their own errors,
    mm³. Laws with friction are asked where all volumes state one, and running_in where there are
    three distances.
    """
    values = np.array([volume.volume_mm3 for volume in volumes])
    laws = ["archard"]
    if all(volume.friction for volume in volumes):
        laws += ["sarkar", "dissipated_energy"]
    found = [
        _line(law, np.array([work_of(v, law) for v in volumes]), values, spread) for law in laws
    ]
    if len({volume.distance_m for volume in volumes}) > 2:
        found.append(_running_in(volumes, values, spread))
    best = max(fit.log_evidence for fit in found)
    found = [replace(fit, log_evidence=fit.log_evidence - best) for fit in found]
    return tuple(sorted(found, key=lambda fit: -fit.log_evidence))


def _solve(work: Array, values: Array, spread: Array) -> tuple[Array, Array, Array, Array]:
    """k, its information, χ² and ln Z for works (..., n)."""
    information = np.sum((work / spread) ** 2, axis=-1)
    k = np.sum(work * values / spread**2, axis=-1) / information
    square = np.sum(((values - k[..., None] * work) / spread) ** 2, axis=-1)
    # where k is no larger than its uncertainty, ln k has no narrower place than a factor of e
    narrow = np.log(np.maximum(k * np.sqrt(information), 1.0))
    return k, information, square, -0.5 * square - narrow


def _line(law: str, work: Array, values: Array, spread: Array) -> WearLawFit:
    """A law of one parameter."""
    k, information, square, log_z = _solve(work, values, spread)
    return WearLawFit(
        law=law,
        coefficient_mm2_per_n=float(k),
        own_uncertainty=float(1.0 / np.sqrt(information)),
        chi_square=float(square),
        freedom=len(values) - 1,
        log_evidence=float(log_z),
    )


def _running_in(volumes: Sequence[WornVolume], values: Array, spread: Array) -> WearLawFit:
    """Running-in, averaged over its priors; what it gives is the average by the posterior."""
    slid = np.array([volume.distance_m for volume in volumes])
    load = np.array([volume.normal_n for volume in volumes])
    typical = float(np.exp(np.mean(np.log(np.unique(slid)))))
    ranges = [(-_REACH, _REACH)] * 2
    for _ in range(_ZOOMS):
        one, two = (np.linspace(low, high, _NODES) for low, high in ranges)
        ratio, turn = np.exp(one)[:, None, None], typical * np.exp(two)[None, :, None]
        until = np.minimum(slid, turn)
        extra = until - until**2 / (2.0 * turn)  # ∫ (1 - s/s0) ds
        work = 1e3 * load * (slid + (ratio - 1.0) * extra)
        k, information, square, log_z = _solve(work, values, spread)
        cell = (one[1] - one[0]) * (two[1] - two[0]) / (2.0 * np.pi)
        total = log_z - 0.5 * (one[:, None] ** 2 + two**2) + np.log(cell)
        log_evidence = logsumexp(total)
        weight = np.exp(total - log_evidence)
        ranges = [_narrowed(nodes, weight.sum(axis=axis)) for axis, nodes in ((1, one), (0, two))]

    def mean(part: Array) -> float:
        return float(np.sum(weight * part))

    middle = mean(k)
    return WearLawFit(
        law="running_in",
        coefficient_mm2_per_n=middle,
        own_uncertainty=float(np.sqrt(mean(1.0 / information + (k - middle) ** 2))),
        chi_square=float(square.min()),
        freedom=len(values) - 3,
        log_evidence=float(log_evidence),
        first_over_last=float(np.exp(mean(one[:, None]))),
        running_in_distance_m=typical * float(np.exp(mean(two[None, :]))),
    )


def _narrowed(nodes: Array, weight: Array) -> tuple[float, float]:
    """Where a posterior is, with room: its grid is made finer until it is wider than its cells."""
    middle = float(weight @ nodes)
    spread = float(np.sqrt(np.sum(weight * (nodes - middle) ** 2)))
    room = float(max(_REACH * 1.5 * spread, 3.0 * (nodes[1] - nodes[0])))
    return max(middle - room, float(nodes[0])), min(middle + room, float(nodes[-1]))
