"""Contact pressure under a fixed load, by an active set, and the surface operator behind it.

Find p >= 0 and the approach d with gap = g + u(p) + c p - d >= 0, p·gap = 0, h Σp = P'; c is a
layer's compliance, and k ds in an implicit wear step. Pressure is linear between nodes (hats of
half-width h), so that the displacement into the block,

    u(x) = -(2/(pi E*)) ∫ p(t) ln|x-t| dt - (mu/(2 G*)) ∫_x^{x2} p(t) dt + C,

is exact at every node and a sum over differences of nodes: one zero-padded FFT each way. On a trial
set the equations are linear: solved directly on a small grid, else by generalised conjugate
residuals, which converge for any operator with a positive definite symmetric part (friction's
coupling is antisymmetric), preconditioned by the inverse on an endless lattice. The set moves by
the signs of pressure and gap, run by run in the numbers that the root singularity at an edge tells,
with Murty's single pivot as the safeguard; a cold start comes from a coarser grid. Sources: Johnson
(1985), Contact Mechanics, sections 2.4 and 5.4; Júdice & Pires (1994), Comput. Oper. Res. 21, 587;
Eisenstat, Elman & Schultz (1983), SIAM J. Numer. Anal. 20, 345.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.linalg import toeplitz

from isochrome.errors import InputError, PhysicsError
from isochrome.output import read_given_table
from isochrome.scene import Scene

Floats = NDArray[np.floating]
Mask = NDArray[np.bool_]

COARSER = 4
"""Spacing of the next coarser grid over this one's."""
_DENSE = 256
"""Nodes up to which the operator is kept as a matrix: there a direct solve is the fastest."""

_NEAR = 20
"""Lags below which the antiderivative's second difference is used; above, its series."""


@dataclass(frozen=True, kw_only=True)
class Surface:
    """The surface operator of one grid of n nodes: spectra made once, used by every solve. The
    symbols on an endless grid are those of the same kernels; their inverse is the
    preconditioner."""

    nodes: int
    spacing_mm: float  # h
    modulus_mpa: float  # E*
    normal: NDArray[np.complex128] = field(repr=False)  # spectrum of the normal influence, mm/MPa
    coupling: NDArray[np.complex128] | None = field(repr=False)  # mm/MPa per unit mu, or none
    lattice_normal: Floats = field(repr=False)  # symbol on an endless grid
    lattice_coupling: NDArray[np.complex128] | None = field(repr=False)
    dense: tuple[Floats, Floats | None] | None = field(repr=False)  # kernels (n, n) of a small grid
    coarse: Surface | None = field(repr=False)  # every fourth node of a large one: a cold start's

    @property
    def length(self) -> int:
        """Length of the zero-padded transforms."""
        return int(scipy.fft.next_fast_len(2 * self.nodes, real=True))


@lru_cache(maxsize=8)
def make_surface(
    nodes: int, spacing_mm: float, *, contact_modulus_mpa: float, coupling_per_mpa: float = 0.0
) -> Surface:
    """The surface operator of a grid, for E* and the coupling 1/G* (0: none). The last ones are
    kept: a video's frames are solved on one. Source: see the module."""
    n, h = nodes, spacing_mm
    length = int(scipy.fft.next_fast_len(2 * n, real=True))
    half = -2.0 / (np.pi * contact_modulus_mpa) * log_of_hat(n, h)
    theta = 2.0 * np.pi * np.arange(length // 2 + 1) / length
    coupling = lattice_coupling = ahead = None
    if coupling_per_mpa != 0.0:
        step = 0.25 * coupling_per_mpa * h
        ahead = np.r_[0.0, np.full(n - 1, step)]
        coupling = scipy.fft.rfft(_circular(ahead, length, odd=True))
        with np.errstate(divide="ignore", invalid="ignore"):
            lattice_coupling = -1j * step / np.tan(theta / 2.0)
        lattice_coupling[0] = 0.0
    dense = coarse = None
    if n <= _DENSE:
        dense = toeplitz(half), None if ahead is None else toeplitz(ahead, -ahead)
    else:
        coarse = make_surface(
            (n - 1) // COARSER + 1, COARSER * h, contact_modulus_mpa=contact_modulus_mpa,
            coupling_per_mpa=coupling_per_mpa,
        )  # fmt: skip
    return Surface(
        nodes=n, spacing_mm=h, modulus_mpa=contact_modulus_mpa,
        normal=scipy.fft.rfft(_circular(half, length)), coupling=coupling,
        lattice_normal=2.0 * h / contact_modulus_mpa * _lattice_symbol(theta),
        lattice_coupling=lattice_coupling, dense=dense, coarse=coarse,
    )  # fmt: skip


def displacement(surface: Surface, pressure: Floats, *, friction: float = 0.0) -> Floats:
    """Displacement u into the block at the nodes (..., n), mm, up to a constant; mu of q = mu p."""
    spectrum = combined(surface.normal, surface.coupling, friction)
    product = spectrum * scipy.fft.rfft(pressure, surface.length)
    return np.asarray(scipy.fft.irfft(product, surface.length)[..., : surface.nodes])


def combined(
    normal: NDArray[Any], coupling: NDArray[np.complex128] | None, friction: float
) -> NDArray[Any]:
    """Spectrum of the normal kernel plus mu times the coupling's, which may be absent."""
    return normal if coupling is None or friction == 0.0 else normal + friction * coupling


def log_of_hat(nodes: int, spacing_mm: float) -> Floats:
    """Integrals ∫ hat(t) ln|x_j - t| dt (mm) for lags j = 0 .. nodes-1, hat of half-width h.
    [F(x+h) - 2F(x) + F(x-h)]/h with F = x² ln|x|/2 - 3x²/4 near by, and the hat's moments, h (ln x
    - Σ_m (h/x)^{2m} / (m (2m+1) (2m+2))), from lag 20, where F cancels."""
    lag = np.arange(nodes, dtype=float)
    far_lag = np.maximum(lag, _NEAR)
    series = np.log(far_lag)
    for m in range(1, 6):
        series -= far_lag ** (-2.0 * m) / (m * (2 * m + 1) * (2 * m + 2))
    near = lag[:_NEAR]
    before, middle, behind = (
        x * x * (0.5 * np.log(np.where(x == 0.0, 1.0, np.abs(x))) - 0.75)
        for x in (near - 1, near, near + 1)
    )
    series[:_NEAR] = behind + before
    series[:_NEAR] -= 2.0 * middle
    return np.asarray(spacing_mm * (series + np.log(spacing_mm)))


def _circular(half: Floats, length: int, *, odd: bool = False) -> Floats:
    """A kernel of lags 0 .. n-1 laid out on a circle, even or odd in the lag."""
    full = np.zeros(length)
    full[: len(half)] = half
    full[length - len(half) + 1 :] = (-1.0 if odd else 1.0) * half[:0:-1]
    return full


def _lattice_symbol(theta: Floats) -> Floats:
    """Transform of -ln|x|/pi against hats on an endless unit lattice: Σ_l sinc²(w/2)/|w|. w = theta
    + 2 pi l; the zero mode, which the load fixes, is given a finite stand-in."""
    shifts = theta[:, None] + 2.0 * np.pi * np.arange(-8, 9)[None, :]
    w = np.where(shifts == 0.0, theta[1] / 4.0, np.abs(shifts))
    return np.asarray((np.sinc(w / (2.0 * np.pi)) ** 2 / w).sum(axis=1))


FAR_MM = 1e3
"""Gap beyond a flat's corners: nothing touches there."""


def undeformed_gap(scene: Scene, x_mm: Floats) -> Floats:
    """Gap between the unloaded bodies (mm), up to a constant; InputError on an unusable profile.
    x²/(2R) for a cylinder, 0 between a flat's corners, and what the profile file adds."""
    indenter = scene.pressed_body
    gap = np.zeros_like(x_mm)
    if indenter.radius_mm is not None and indenter.shape == "cylinder":
        gap += x_mm**2 / (2.0 * indenter.radius_mm)
    if indenter.half_width_mm is not None and indenter.shape == "flat":
        gap[np.abs(x_mm) > indenter.half_width_mm * (1.0 + 1e-12)] = FAR_MM
    if indenter.profile is not None:
        x, height = read_profile(scene.path(indenter.profile))
        gap += np.interp(x_mm, x, height)
        gap[(x_mm < x[0]) | (x_mm > x[-1])] = FAR_MM
    return gap


def read_profile(path: Path) -> tuple[Floats, Floats]:
    """A measured profile, x rising and gap (mm): a CSV file with columns x_mm and gap_mm or gap_um.
    Its smallest gap is taken as 0, since the rounding of a datum would be felt as roughness.
    InputError names the file and the fix."""
    try:
        stat = path.stat()
    except OSError as error:
        raise InputError("profile_cannot_read_check", path=path, error=error) from error
    return _read_version(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=4)
def _read_version(path: Path, changed_ns: int, size: int) -> tuple[Floats, Floats]:
    """One version of a profile's file: every state of a scene asks for it, several times."""
    given = read_given_table(path, "the profile")
    name = "gap_um" if "gap_um" in given.names else "gap_mm"
    if not {"x_mm", name} <= set(given.names):
        raise InputError("profile_needs_columns_x_mm", path=path, header=given.header)
    x, gap = given.column("x_mm"), given.column(name)
    if len(x) < 3 or (np.diff(x) <= 0.0).any():
        raise InputError("profile_needs_three_rows", path=path)
    gap = (gap - gap.min()) * (1e-3 if name == "gap_um" else 1.0)
    for shared in (x, gap):
        shared.flags.writeable = False
    return x, gap


_MAX_KRYLOV = 80
_ROUNDING = 4.0 * float(np.finfo(float).eps)
"""Error of an equation over its gap below which nothing can be gained, whatever is asked for."""
_LOOK = 1e-3
"""Residual at which the signs are first looked at, and factor to the next look."""


@dataclass(frozen=True)
class ActiveSet:
    """The linear equations' solution on a trial set, and the nodes whose sign is `wrong`."""

    pressure: Floats
    gap: Floats
    wrong: Mask
    iterations: int


class ActiveSystem:
    """The linear equations on a trial contact set."""

    def __init__(
        self, surface: Surface, gap: Floats, load: float, friction: float, diagonal: float | Floats
    ) -> None:
        self.surface, self.gap, self.friction, self.diagonal = surface, gap, friction, diagonal
        self.total = load / surface.spacing_mm
        lattice = combined(surface.lattice_normal, surface.lattice_coupling, friction)
        self.weight: Floats | None = None
        if isinstance(diagonal, np.ndarray):
            # nodes whose diagonal is more than a short wave's share give way by it alone
            least, short = float(diagonal.min()), float(surface.lattice_normal[-1])
            self.weight = np.sqrt((short + least) / (short + diagonal))
            diagonal = least
        self.bare = diagonal == 0.0
        self.inverse = 1.0 / (lattice + diagonal)

    def apply(self, pressure: Floats) -> Floats:
        """Displacement that a pressure makes, that on the diagonal included."""
        u = displacement(self.surface, pressure, friction=self.friction)
        return u if self.bare else u + self.diagonal * pressure

    def precondition(self, inside: Floats, residual: Floats) -> Floats:
        """The lattice's inverse, cut to the contact set (1 inside, 0 outside)."""
        length = self.surface.length
        if self.weight is not None:
            inside, residual = inside * self.weight, residual * self.weight
        z = scipy.fft.irfft(self.inverse * scipy.fft.rfft(residual, length), length)
        return np.asarray(inside * z[: self.surface.nodes])

    def solve(self, active: Mask, start: Floats, tolerance: float, *, look: bool) -> ActiveSet:
        """Solve with contact on `active` to a relative residual, from a pressure near by. By
        Gauss's elimination on a small grid, with the load as the last row, and the approach as
        unknown. With `look` the signs are looked at on the way: a wrong set need not be solved to
        the end."""
        if self.surface.dense is None:
            return self._iteratively(active, start, tolerance, look)
        normal, coupling = self.surface.dense
        matrix = normal if coupling is None else normal + self.friction * coupling
        on, count = np.flatnonzero(active), int(np.count_nonzero(active))
        bordered = np.ones((count + 1, count + 1))
        bordered[:-1, :-1] = matrix[np.ix_(on, on)]
        bordered[np.arange(count), np.arange(count)] += np.broadcast_to(
            self.diagonal, active.shape
        )[on]
        bordered[-1, -1] = 0.0
        solution = np.linalg.solve(bordered, np.append(-self.gap[on], self.total))
        pressure = np.zeros(len(active))
        pressure[on] = solution[:-1]
        u = matrix @ pressure + self.diagonal * pressure
        return self._judged(active, pressure, u, tolerance, 0.0, 1)

    def _iteratively(self, active: Mask, start: Floats, tolerance: float, look: bool) -> ActiveSet:
        """Generalised conjugate residuals. Rows of `state` are p, the equations' error inside, and
        u; those of `move` their changes."""
        inside, count = active.astype(float), int(np.count_nonzero(active))
        along = self.precondition(inside, inside)
        along /= along.sum()
        p = inside * start
        borne = p.sum()
        p = p * (self.total / borne) if borne > 0.0 else inside * (self.total / inside.sum())
        u = self.apply(p)
        state = np.stack([p, _project(inside, count, self.gap + u), u])
        scale = _range(u) ** 2
        rounding = count * (_ROUNDING * self.gap[active].max()) ** 2
        level = _LOOK if look else 0.0
        moves, squares = np.empty((min(count, _MAX_KRYLOV), *state.shape)), np.empty(_MAX_KRYLOV)
        used = 0
        while (error := float(_dot(state[1], state[1]))) > max(scale * tolerance**2, rounding):
            if used == len(moves):
                break
            if error <= scale * level**2:
                trial = self._judged(active, state[0], state[2], level, level, used + 1)
                if trial.wrong.any():
                    return trial
                level *= _LOOK
            move = moves[used]
            z = self.precondition(inside, state[1])
            z -= z.sum() * along
            move[0], move[2] = z, self.apply(z)
            move[1] = _project(inside, count, move[2])
            if used:
                part = _dot(moves[:used, 1], move[1]) / squares[:used]
                move -= np.einsum("j,jik->ik", part, moves[:used])
            squares[used] = square = float(_dot(move[1], move[1]))
            if square == 0.0:
                break
            state -= (float(_dot(move[1], state[1])) / square) * move
            used += 1
        return self._judged(active, state[0], state[2], tolerance, 0.0, used + 1)

    def _judged(
        self, active: Mask, pressure: Floats, u: Floats, overlap: float, pull: float, used: int
    ) -> ActiveSet:
        """A solution with its gap; wrong is what overlaps or pulls by more than these shares."""
        gap = self.gap + u
        gap -= float(gap[active].mean())
        pulls, overlaps = pressure <= -pull * pressure.max(), gap < -overlap * _range(u)
        return ActiveSet(pressure, gap, np.where(active, pulls, overlaps), used)


def _project(inside: Floats, count: int, values: Floats) -> Floats:
    """Values on the contact set less their mean there; zero outside."""
    return np.asarray(inside * (values - _dot(inside, values) / count))


def _dot(rows: Floats, vector: Floats) -> Any:
    """Inner products along the last axis, without the threads of a BLAS, which only cost here."""
    return np.einsum("...i,i->...", rows, vector)


def _range(u: Floats) -> float:
    """Range of the displacement over the whole grid, the scale of a residual."""
    return float(max(u.max() - u.min(), np.finfo(float).tiny))


_PATIENCE = 8
_MAX_SETS = 500
_TOO_FAR = 0.15
"""Spacings by which the line through p² ends beyond the edge (measured: 0.1 to 0.3)."""
_WORST = 100.0
"""Residual over tolerance at which a solution is refused, not returned."""


@dataclass(frozen=True)
class ContactState:
    """A solved contact at n nodes, and how well it holds."""

    pressure: Floats  # MPa
    gap: Floats  # mm
    # KKT: the largest violation of gap = 0 in contact and gap >= 0 outside, over the range of the
    # elastic displacement
    residual: float
    iterations: int  # applications of the operator
    sets: int  # trial sets of nodes in contact


def solve_pressure(
    surface: Surface, gap_mm: Floats, line_load_n_per_mm: float, *, friction: float = 0.0,
    layer_mm_per_mpa: float = 0.0, roughness_mm: float = 0.0, start: Floats | None = None,
    tolerance: float = 1e-10,
) -> ContactState:  # fmt: skip
    """Contact pressure under the load P', for an undeformed gap (n,) that includes the worn depth.
    A constant offset of the gap does not matter; mu counts in the coupling alone;
    `layer_mm_per_mpa` is the diagonal c, `roughness_mm` lambda of `_rough_pressure`. `start` (n,),
    MPa: a coarser grid's where it is absent or bears nothing. `tolerance` is the residual's.
    InputError on a gap or load that is none, PhysicsError where it does not converge."""
    datum = float(gap_mm.min())  # its rounding would be felt as roughness
    if not (math.isfinite(datum) and math.isfinite(float(gap_mm.max()))):
        raise InputError("gap_between_bodies_not")
    if not 0.0 < line_load_n_per_mm < math.inf:
        raise InputError("load_mm_must_above", load=line_load_n_per_mm)
    gap = gap_mm - datum
    given = surface, gap, line_load_n_per_mm, friction, layer_mm_per_mpa
    if start is None or not (start > 0.0).any():
        start = _from_coarse(*given, roughness_mm)
    system = ActiveSystem(*given)
    if roughness_mm > 0.0:
        state = _rough_pressure(system, roughness_mm, start, tolerance)
        if state is None:  # a start from far off: waves that part the contact hold it
            state = _rough_pressure(
                system, roughness_mm, _from_coarse(*given, roughness_mm), tolerance
            )
        if state is None:
            raise _unsolved(friction, _MAX_KRYLOV)
        return state
    active = start > 0.0
    pressure = np.where(active, start, 0.0)
    fewest, patience, iterations = surface.nodes + 1, _PATIENCE, 0
    for sets in range(1, _MAX_SETS + 1):
        trial = system.solve(active, pressure, tolerance, look=patience >= 0)
        pressure, iterations = trial.pressure, iterations + trial.iterations
        count = int(np.count_nonzero(trial.wrong))
        if count == 0:
            violation = np.where(active, np.abs(trial.gap), np.maximum(-trial.gap, 0.0)).max()
            residual = float(violation / _range(trial.gap - gap))
            if not residual <= _WORST * tolerance:
                break
            return ContactState(pressure, trial.gap, residual, iterations, sets)
        if count < fewest:
            fewest, patience = count, _PATIENCE
        else:
            patience -= 1
        if patience >= 0:
            active = active ^ _to_the_edge(active, trial.wrong)
        else:
            active = active.copy()
            active[np.flatnonzero(trial.wrong)[-1]] ^= True
        if not active.any():
            active[np.argmin(trial.gap)] = True
    raise _unsolved(friction, sets)


def _unsolved(friction: float, sets: int) -> PhysicsError:
    """The refusal of a contact that does not converge."""
    lower = "lower friction.coefficient or " if friction else ""
    return PhysicsError("contact_pressure_did_not", friction=friction, sets=sets, lower=lower)


NO_PRESSURE = float(np.sqrt(np.finfo(float).eps))
"""Share of a rough contact's largest pressure below which there is none."""


def _rough_pressure(
    system: ActiveSystem, roughness: float, start: Floats, tolerance: float
) -> ContactState | None:
    """Pressure of rough surfaces, p ~ exp(-separation/lambda): gap + u + c p + lambda ln p = d.
    Newton's method: lambda/p is on the tangent's diagonal. Where p falls ln p takes the step, where
    it rises p: of a concave function's two forms the one that does not overshoot. None where it
    does not come to rest. Source: Greenwood & Williamson (1966), Proc. R. Soc. A 295, 300."""
    gap, layer, pressure = system.gap, system.diagonal, start
    used = 0
    for step in range(1, _MAX_KRYLOV + 1):
        pressure = np.where(pressure > NO_PRESSURE * pressure.max(), pressure, 0.0)
        active = pressure > 0.0
        u = system.apply(pressure)
        height = roughness * np.log(np.where(active, pressure, 1.0))
        total = float(pressure.sum())
        approach = float(_dot(gap + u + height, pressure)) / total
        # nodes that would bear more than nothing enter with little: from below nothing overshoots
        least = NO_PRESSURE * float(pressure.max())
        new = ~active & (approach - gap - u > roughness * np.log(least))
        off = np.where(active, gap + u + height - approach, 0.0)
        residual = float(np.abs(off).max()) / (_range(u) + roughness)
        unbalanced = abs(total / system.total - 1.0)
        if max(residual, unbalanced) <= tolerance and not new.any():
            return ContactState(pressure, gap + u - approach, residual, used, step)
        pressure, active = np.where(new, 2.0 * least, pressure), active | new
        height = roughness * np.log(np.where(active, pressure, 1.0))
        tangent = layer + roughness / np.where(active, pressure, pressure.max())
        linear = ActiveSystem(
            system.surface, gap + height - roughness, system.total * system.surface.spacing_mm,
            system.friction, tangent,
        )  # fmt: skip
        trial = linear.solve(active, pressure, tolerance, look=False)
        used += trial.iterations
        growth = trial.pressure / np.where(active, pressure, 1.0) - 1.0
        falls = pressure * np.exp(np.minimum(growth, 0.0))
        pressure = np.where(growth > 0.0, trial.pressure, falls)
    return None


def _to_the_edge(active: Mask, wrong: Mask) -> Mask:
    """The nodes to change: the wrong ones, in numbers that bring an edge of contact to its place.
    At the distance d from an edge that is δ too far out, p ~ (d - δ/2)/√d: only half of what is too
    much pulls. Beyond one that is δ too far in, the bodies overlap over 3δ/2."""
    change = wrong.copy()
    for start, end in _runs(wrong & active):
        more = end - start - 1
        if start == 0 or not active[start - 1]:
            change[end : end + more] = active[end : end + more]
        elif end == len(active) or not active[end]:
            change[max(start - more, 0) : start] = active[max(start - more, 0) : start]
    for start, end in _runs(wrong & ~active):
        less = (end - start) // 3
        if start > 0 and active[start - 1]:
            change[end - less : end] = False
        elif end < len(active) and active[end]:
            change[start : start + less] = False
    return change


def _runs(mask: Mask) -> NDArray[np.intp]:
    """First nodes of the runs in a mask, and those behind their last ones (m, 2)."""
    return np.flatnonzero(np.diff(np.pad(mask, 1).astype(np.int8))).reshape(-1, 2)


def _from_coarse(
    surface: Surface, gap: Floats, load: float, friction: float, layer: float, roughness: float
) -> Floats:
    """A start from a four times coarser grid; without one that is solved, where the bodies overlap.
    There the overlap at the contact's edge is taken as that of a parabola, x²/(2R) = 2 P'/(pi
    E*)."""
    coarse, state = surface.coarse, None
    if coarse is not None:
        with suppress(PhysicsError):  # where a few coarse nodes are in contact
            state = solve_pressure(
                coarse, gap[::COARSER], load, friction=friction, layer_mm_per_mpa=layer,
                roughness_mm=roughness, tolerance=1e-4,
            )  # fmt: skip
    if coarse is None or state is None:
        depth = gap.min() + 2.0 * load / (np.pi * surface.modulus_mpa)
        return np.where(gap <= depth, load, 0.0)
    nodes = np.arange(surface.nodes) / COARSER
    if roughness > 0.0:
        pressure = np.interp(nodes, np.arange(coarse.nodes), state.pressure)
        return np.where(gap <= gap[::COARSER][state.pressure > 0.0].max(), pressure, 0.0)
    # near an edge p² falls linearly to zero. The last node is left out of the line: it bears what
    # its element bears beyond the edge; the line through the next two ends 0.2 too far (measured)
    square, inside = state.pressure**2, np.zeros(len(nodes), dtype=bool)
    for start, end in _runs(square > 0.0):
        run = square[start:end]
        first, last = start - _reach(run), end - 1 + _reach(run[::-1])
        inside |= (nodes > first) & (nodes < last)
    pressure = np.interp(nodes, np.arange(coarse.nodes), state.pressure)
    return np.where(inside, np.maximum(pressure, 1e-3 * pressure.max()), 0.0)


def _reach(square: Floats) -> float:
    """How far beyond the first node of a run p² reaches zero, at most one spacing."""
    if len(square) < 4 or square[2] <= square[1]:
        return 0.5
    return float(np.clip(square[1] / (square[2] - square[1]) - 1.0 - _TOO_FAR, 0.0, 1.0))
