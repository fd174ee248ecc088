"""Where to sample a course over the distance: kinks, smooth stretches, and the dose over them.

kappa is smooth between the points of the scene's tables: Gauss-Legendre quadrature of each smooth
stretch gives the dose to rounding where a coefficient is a number or a table. Stretches of a law
that goes with the distance otherwise are halved until a second rule gives the same dose. Load and
friction are linear in the distance, not in the dose; each stretch is halved until they are linear
in the dose as well, which puts samples densely where kappa vanishes and sparsely elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from isochrome.contact.surface import Floats
from isochrome.scene import DistanceTable, Scene

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_LEGENDRE = np.polynomial.Legendre.basis(8)
_INNER = np.real(_LEGENDRE.deriv().roots())
_INNER_WEIGHTS = 2.0 / (72.0 * _LEGENDRE(_INNER) ** 2)
"""Gauss-Lobatto's rule, as exact as Gauss's by other nodes, of which these lie inside."""
_SAME_DOSE, _ROUNDING = 1e-12, 1e-14
"""Largest difference of a stretch's dose by the two rules: this share of the whole dose, and the
second of what the largest rate makes over the whole distance, for the distances' own rounding."""
_STRAIGHT, _STRAIGHTEST = 1e-3, 1e-9
"""Largest error of the linear interpolation in the dose, over the largest value: this share of the
wear's tolerance, and no less than the second. A long measured table would else need millions of
samples."""
_FRICTION_STRETCH = 0.25
"""Change of mu over a stretch: sqrt(1 + 3 mu²), singular at mu = ± i/√3, is then exact to 1e-15."""
_MAX_HALVINGS = 40


def kinks_of(scene: Scene, end: float) -> Floats:
    """Distances at which a slope changes: the tables' points, and the zeros of mu for |mu|.

    Parameters: `scene`, with a load; `end` (m). Returns them (m,), m, rising from 0 to `end`.
    """
    assert scene.load is not None
    friction = scene.friction.coefficient if scene.friction else 0.0
    wear = dict(scene.wear).values() if scene.wear else ()
    found = [0.0, end]
    for table in (scene.load.normal_n, friction, *wear):
        if isinstance(table, DistanceTable):
            found += table.distance_m
    if isinstance(friction, DistanceTable):
        s, mu = np.array(friction.distance_m), np.array(friction.value)
        i = np.flatnonzero(mu[:-1] * mu[1:] < 0.0)
        found += (s[i] - mu[i] * (s[i + 1] - s[i]) / (mu[i + 1] - mu[i])).tolist()
    kinks = np.unique(found)
    return kinks[kinks <= end]


def _stretches(scene: Scene, kinks: Floats) -> Floats:
    """The kinks, and points between them so that mu changes little from one to the next."""
    change = np.abs(np.diff(scene.friction_at(kinks)))
    parts = np.maximum(1, np.ceil(change / _FRICTION_STRETCH)).astype(int)
    pieces = [
        np.linspace(a, b, n, endpoint=False)
        for a, b, n in zip(kinks[:-1], kinks[1:], parts, strict=True)
    ]
    return np.concatenate([*pieces, kinks[-1:]])


def integral(
    rate: Callable[[Floats], Floats],
    a: Floats,
    b: Floats,
    *,
    nodes: Floats = _NODES,
    weights: Floats = _WEIGHTS,
) -> Floats:
    """Integrals of a rate over smooth stretches, by Gauss-Legendre quadrature.

    Equation: ∫ rate ds from a to b. Parameters: `rate`, a function of distances of any shape; `a`,
    `b` (m,), the stretches' ends, m; `nodes`, `weights` (k,) of another rule on -1 to 1. Returns
    (m,).
    """
    half = 0.5 * (b - a)
    values = rate((0.5 * (a + b))[:, None] + half[:, None] * nodes)
    result: Floats = half * np.einsum("ij,j->i", values, weights)
    return result


def mean(rate: Callable[[float], Floats], distance_m: float) -> Floats:
    """Mean of a rate from 0 to a distance (m), by eight points; a constant to its last bit.

    Parameters: `rate`, of a distance, of any shape; `distance_m`. Returns that shape.
    """
    first, *others = [rate(0.5 * distance_m * (1.0 + float(node))) for node in _NODES]
    steps = [0.5 * w * (r - first) for w, r in zip(_WEIGHTS[1:], others, strict=True)]
    return np.asarray(first + np.sum(steps, axis=0))


def _resolved(rate: Callable[[Floats], Floats], s: Floats) -> Floats:
    """Distances, and points between them so that quadrature between neighbours gives the dose.

    A stretch is halved where two rules of quadrature differ; the second sees its ends, where a
    running-in far shorter than the stretch shows. Source: Gander & Gautschi (2000), BIT 40, 84.
    """
    for _ in range(_MAX_HALVINGS):
        a, b = s[:-1], s[1:]
        dose = integral(rate, a, b)
        ends = (b - a) / 72.0 * (rate(a) + rate(b))  # at the ends exactly: beyond may be a jump
        other = ends + integral(rate, a, b, nodes=_INNER, weights=_INNER_WEIGHTS)
        largest = float(np.max(dose / (b - a), initial=0.0))
        bent = np.abs(other - dose) > _SAME_DOSE * dose.sum() + _ROUNDING * largest * s[-1]
        if not bent.any():
            break
        s = np.union1d(s, (0.5 * (a + b))[bent])
    return s


def sampled(scene: Scene, rate: Callable[[Floats], Floats], kinks: Floats) -> Floats:
    """Distances (m,), m, between which load and friction are linear in the dose ∫ rate ds.

    Stretches are halved until quadrature gives their dose, and two places in each show the line: in
    one place, an inflection of the dose could pass for a straight line. For `kinks` see `kinks_of`.
    """
    s = _resolved(rate, _stretches(scene, kinks))
    samples, a, b = [s], s[:-1], s[1:]
    scale = [np.abs(f(s)).max() or 1.0 for f in (scene.load_at, scene.friction_at)]
    straight = max(_STRAIGHTEST, _STRAIGHT * scene.numerics.tolerance)
    for _ in range(_MAX_HALVINGS):
        if not len(a):
            break
        bent = np.zeros(len(a), dtype=bool)
        whole = integral(rate, a, b)
        change = np.maximum(
            np.abs(scene.load_at(b) - scene.load_at(a)) / scale[0],
            np.abs(scene.friction_at(b) - scene.friction_at(a)) / scale[1],
        )
        for place in (0.25, 0.5):
            part = integral(rate, a, a + place * (b - a))
            share = np.divide(part, whole, out=np.full(len(a), place), where=whole > 0.0)
            bent |= np.abs(share - place) * change > straight
        a, b = a[bent], b[bent]
        middle = 0.5 * (a + b)
        samples.append(middle)
        a, b = np.concatenate([a, middle]), np.concatenate([middle, b])
    return np.sort(np.concatenate(samples))
