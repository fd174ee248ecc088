r"""Wear of the specimen on a fixed grid, for every profile, stepped implicitly.

With the dose K(s) = ∫ kappa ds (mm/MPa) a law dh = kappa p ds is dh/dK = p(h): a stiff equation,
since the pressure answers a short wave of depth with a stiffness of about E*/4 per wavelength.
Each step of the second-order backward differentiation formula with a variable ratio w,

    h_{n+1} = [(1+w)² h_n - w² h_{n-1}]/(1+2w) + dK (1+w)/(1+2w) p_{n+1},

is one contact solve with dK (1+w)/(1+2w) added to the operator's diagonal: no more work than an
explicit step, stable for any step and better conditioned. Steps are chosen so that the pressure
stays near its own linear forecast in two measures. One is the displacement that the difference
would make, in which a kink one node wide at the moving edge of the contact is as small as its
effect below the surface. But so is a corner, or the top of a narrow hill: the other measure is the
pressure itself where it is largest, for which the tolerance is promised.
Sources: Archard (1953), J. Appl. Phys. 24, 981; Hairer, Nørsett & Wanner (1993), Solving ODEs I,
section III.5.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from isochrome.contact.pressure import ContactState, solve_pressure
from isochrome.contact.sliding_history import OutputState, SlidingHistory, paused_doses, same_drive
from isochrome.contact.surface import Floats, Surface, displacement

_ACCURACY = 1e-3
"""Residual of each step's contact over the tolerance."""
_GROW = 2.0
_SHRINK = 0.3
_SAFETY = 0.9
_FORECAST, _LARGEST_FORECAST = 30.0, 0.01
_PEAK_FORECAST, _LARGEST_PEAK_FORECAST = 2.0, 0.05
"""Largest forecast errors over the tolerance, in the displacement and in the largest pressure (both
where it is and where it was), and their caps: forecast and result both err by the step squared.
Measured under cylinders, corners, ledges and roughness: p_max and depth are then within the
tolerance from 1e-3 to 1e-5, and under cylinders and corners to 1e-6 (tests/contact, tests/hard)."""
_CHANGING = 0.1
"""Share of the first where load or friction change: a contact that overruns an edge which it left
behind stands on nodes that were each passed once, by one step (measured: p_max errs up to 1.5 of
the tolerance without, 0.5 with)."""
_APPROACH, _SETTLE = 0.6, 0.05
"""Steps shorten towards a dose that is asked for, to this share of what is left, until what is left
is this share of the dose in which the shortest wave of depth relaxes. A long step leaves too much
depth on the nodes that the edge of the contact passed in it, and so a spike of pressure there."""
_CAREFUL = 3.0
"""Over the root of the tolerance: share of what is left towards a jump of load or friction. A
contact that grows there finds each node by itself where the edge was, and not the mean of many."""

_SAME = 1e-12
"""Doses nearer than this, relatively, are one."""


@dataclass(frozen=True)
class WornStart:
    """Where a run goes on: dose and worn depth (n,) by then."""

    dose_mm_per_mpa: float
    depth_mm: Floats


@dataclass(frozen=True)
class WornState:
    """The contact at a dose, and the worn depth h (n,) there."""

    dose_mm_per_mpa: float
    contact: ContactState
    depth_mm: Floats


@dataclass(frozen=True)
class _Allowed:
    """Largest errors of a step: its contact's residual, and its forecast's in the displacement and
    in the largest pressure."""

    residual: float
    displacement: float
    peak: float


def _allowed(tolerance: float, *, steady: bool) -> _Allowed:
    share = 1.0 if steady else _CHANGING
    return _Allowed(
        residual=_ACCURACY * tolerance,
        displacement=share * min(_FORECAST * tolerance, _LARGEST_FORECAST),
        peak=min(_PEAK_FORECAST * tolerance, _LARGEST_PEAK_FORECAST),
    )


@dataclass(frozen=True)
class _Past:
    """What the formula remembers: the last depth and pressure, and the step that led from them."""

    depth: Floats
    pressure: Floats
    step: float


def wear_history(
    surface: Surface,
    gap_mm: Floats,
    course: SlidingHistory,
    stops: Sequence[OutputState],
    *,
    tolerance: float = 1e-4,
    start: WornStart | None = None,
) -> Iterator[WornState]:
    """Solve a worn contact at rising doses, hit exactly, each state yielded as soon as it is known.

    `gap_mm` (n,) is the unworn gap; the friction counts in the coupling alone; `stops` are sorted
    by dose, each with its own load and friction; `tolerance` is the wanted relative error of the
    pressure. PhysicsError where a contact does not converge.
    """
    start = start or WornStart(0.0, np.zeros(surface.nodes))
    load, mu = course.leaving(start.dose_mm_per_mpa)
    contact = solve_pressure(surface, gap_mm + start.depth_mm, load, friction=mu, tolerance=1e-10)
    now = WornState(start.dose_mm_per_mpa, contact, start.depth_mm)
    past: _Past | None = None
    allowed = _allowed(tolerance, steady=course.steady)
    scale = (gap_mm[contact.pressure > 0.0].max() - gap_mm.min()) / contact.pressure.max()
    relaxing, careful = float(surface.lattice_normal[-1]), _CAREFUL * tolerance**0.5
    near = _Near(relaxing, careful, paused_doses(course, stops))
    first = 1e-3 * tolerance**0.5 * max(scale, stops[-1].dose_mm_per_mpa * 1e-6)
    step = first
    for stop in stops:
        while stop.dose_mm_per_mpa - now.dose_mm_per_mpa > _SAME * stop.dose_mm_per_mpa:
            size, target = _size(course, now.dose_mm_per_mpa, stop, step, near)
            load, mu = course.at(target)
            new, error = _advance(surface, gap_mm, load, now, past, size, mu, allowed)
            factor = _SAFETY / max(error, 1e-300) ** 0.5
            if error > 1.0 and size > 1e-12 * stop.dose_mm_per_mpa:
                step = size * max(_SHRINK, factor)
                continue
            past = _Past(now.depth_mm, now.contact.pressure, size)
            step = size * min(_GROW, max(_SHRINK, factor))
            now = replace(new, dose_mm_per_mpa=target)
            after = course.leaving(target)
            if stop.dose_mm_per_mpa > target and not same_drive(after, (load, mu)):
                past, step = None, first
                now = replace(now, contact=_settled(surface, gap_mm, now, *after))
        settled = _settled(surface, gap_mm, now, stop.line_load_n_per_mm, stop.friction)
        yield replace(now, contact=settled)


@dataclass(frozen=True)
class _Near:
    """How steps shorten: the dose in which the shortest wave relaxes, the share of what is left
    that a step takes towards a jump, and the doses of states that are one."""

    relaxing: float
    careful: float
    pauses: frozenset[float]

    def longest(self, left: float, *, jumps: bool) -> float:
        """The longest step where this much is left to a dose, at which they may jump."""
        share = min(self.careful, _APPROACH) if jumps else _APPROACH
        settle = min(share, _SETTLE) * self.relaxing
        return left if left <= settle else max(settle, share * left)


def _size(
    course: SlidingHistory, dose: float, stop: OutputState, step: float, near: _Near
) -> tuple[float, float]:
    """The next step's size and the dose where it ends: the stop and breaks are met exactly."""
    left, until = stop.dose_mm_per_mpa - dose, course.next_break(dose * (1.0 + _SAME)) - dose
    size, beyond = min(step, near.longest(left, jumps=False)), dose * (1.0 + _SAME)
    pause = min((k for k in near.pauses if k > beyond), default=float("inf"))
    jump = min(course.next_jump(beyond), pause) - dose
    if jump < float("inf"):
        size = min(size, near.longest(jump, jumps=True))
    if size >= until and until < left:
        return until, dose + until
    if 2.0 * size > until and until < left:  # two halves, not a whole and a sliver
        size = 0.5 * until
    return size, stop.dose_mm_per_mpa if size == left else dose + size


def _settled(
    surface: Surface, gap: Floats, now: WornState, load: float, friction: float
) -> ContactState:
    """The contact on the worn surface, solved afresh."""
    return solve_pressure(
        surface,
        gap + now.depth_mm,
        load,
        friction=friction,
        start=now.contact.pressure,
        tolerance=1e-9,
    )


def _advance(
    surface: Surface,
    gap: Floats,
    load: float,
    now: WornState,
    past: _Past | None,
    size: float,
    friction: float,
    allowed: _Allowed,
) -> tuple[WornState, float]:
    """One implicit step, and its forecast's error over what is allowed."""
    if past is None:
        base, diagonal, forecast = now.depth_mm, size, now.contact.pressure
    else:
        w = size / past.step
        base = ((1.0 + w) ** 2 * now.depth_mm - w * w * past.depth) / (1.0 + 2.0 * w)
        diagonal = size * (1.0 + w) / (1.0 + 2.0 * w)
        forecast = now.contact.pressure + w * (now.contact.pressure - past.pressure)
    contact = solve_pressure(
        surface,
        gap + base,
        load,
        friction=friction,
        wear_mm_per_mpa=diagonal,
        start=np.maximum(forecast, 0.0),
        tolerance=allowed.residual,
    )
    error = _forecast_error(surface, now.contact.pressure, contact.pressure, forecast, allowed)
    depth = base + diagonal * contact.pressure
    return WornState(now.dose_mm_per_mpa + size, contact, depth), error


def _forecast_error(
    surface: Surface, before: Floats, pressure: Floats, forecast: Floats, allowed: _Allowed
) -> float:
    """The larger of the forecast's two errors, each over what is allowed."""
    miss, peak = pressure - forecast, pressure.max()
    u = displacement(surface, np.stack([miss, pressure]), friction=0.0)
    at = [int(pressure.argmax()), int(before.argmax())]
    below = np.ptp(u[0]) / np.ptp(u[1]) / allowed.displacement
    above = np.abs(miss[at]).max() / peak / allowed.peak
    return float(max(below, above))
