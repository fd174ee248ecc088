"""Scars that a scene's wear makes, with what its inputs' uncertainties move.

A measured trace beside the simulated scar: aligned, subtracted, and told in numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import SurfaceState, contact_states
from isochrome.errors import InputError
from isochrome.output import with_uncertainty
from isochrome.scars import LevelledTrace
from isochrome.scene import Scene

Array = NDArray[np.floating]

_PARTS = ("specimen", "indenter", "load", "friction", "wear")
"""Tables whose numbers a scar follows."""


@dataclass(frozen=True, kw_only=True)
class SimulatedScar:
    """A simulated scar at one distance; what an input's standard uncertainty does is by its key."""

    distance_m: float
    x_mm: Array
    depth_um: Array  # worn depth (n,)
    edges_mm: tuple[float, float]
    moved_um: Mapping[str, Array]  # of the depth
    moved_area_mm2: Mapping[str, float]
    moved_width_mm: Mapping[str, float]
    moved_depth_um: Mapping[str, float]  # of the largest depth

    @property
    def width_mm(self) -> float:
        """Distance of the edges, mm."""
        return self.edges_mm[1] - self.edges_mm[0]

    @property
    def centre_mm(self) -> float:
        """Middle between the edges, mm."""
        return 0.5 * (self.edges_mm[0] + self.edges_mm[1])

    @property
    def worn_area_mm2(self) -> float:
        """Worn area ∫h dx, mm²."""
        return _area(self.x_mm, self.depth_um)

    def on_bins(self, x_mm: Array, values: Array) -> Array:
        """Means (m,) of a profile (n,) of this scar over equal bins about places (m,), mm."""
        step = x_mm[1] - x_mm[0]
        total = np.concatenate(
            [[0.0], np.cumsum(0.5 * np.diff(self.x_mm) * (values[1:] + values[:-1]))]
        )
        ends = np.append(x_mm - 0.5 * step, x_mm[-1] + 0.5 * step)
        return np.asarray(np.diff(np.interp(ends, self.x_mm, total)) / step)

    def slope(self, x_mm: Array) -> Array:
        """Slope (m,) of the depth over equal bins about places (m,), µm/mm."""
        step = x_mm[1] - x_mm[0]
        ends = np.append(x_mm - 0.5 * step, x_mm[-1] + 0.5 * step)
        return np.asarray(np.diff(np.interp(ends, self.x_mm, self.depth_um)) / step)


def root_sum_square(moved: Mapping[str, Any]) -> Any:
    """Root of the sum of squares of what inputs that know nothing of each other move."""
    return np.sqrt(sum((np.square(value) for value in moved.values()), np.zeros(())))


def simulated_scars(scene: Scene, distances_m: Sequence[float]) -> list[SimulatedScar]:
    """Simulate a scene's scars, and how its stated uncertainties move them.

    Each input is moved by its standard uncertainty to both sides: dh = (h(+u) - h(-u))/2, which is
    h's derivative times u to the second order. InputError where there is no wear, or an input less
    its uncertainty is no value that it may have; PhysicsError where a contact cannot be solved.
    """
    if scene.wear is None:
        raise InputError(f"{scene.name}: has no [wear], which makes scars; add it")
    worn = scene.with_values({"wear.distances_m": tuple(distances_m)})
    keys = [k for k, u in scene.uncertainties.items() if k.split(".")[0] in _PARTS and u > 0.0]
    states = _states(worn)
    moved = {key: tuple(_states(_shifted(worn, key, side)) for side in (1.0, -1.0)) for key in keys}
    return [
        _scar(state, {key: (more[i], less[i]) for key, (more, less) in moved.items()})
        for i, state in enumerate(states)
    ]


def _states(scene: Scene) -> list[SurfaceState]:
    """The worn states: the static one that may come first is left out."""
    assert scene.wear is not None
    return contact_states(scene)[-len(scene.wear.distances_m) :]


def _shifted(scene: Scene, key: str, side: float) -> Scene:
    spread = scene.uncertainties[key]
    try:
        return scene.with_values({key: scene.get(key) + side * spread})
    except InputError as error:
        raise InputError(
            f"{scene.name}: {key} with its standard_uncertainty = {spread:g}: {error}"
        ) from error


def _scar(
    state: SurfaceState, moved: dict[str, tuple[SurfaceState, SurfaceState]]
) -> SimulatedScar:
    x = state.grid.x_mm
    profiles = {
        key: tuple(np.interp(x, s.grid.x_mm, _depth(s), left=0.0, right=0.0) for s in pair)
        for key, pair in moved.items()
    }
    edges = {key: tuple(_edges(s) for s in pair) for key, pair in moved.items()}
    return SimulatedScar(
        distance_m=state.distance_m,
        x_mm=x,
        depth_um=_depth(state),
        edges_mm=_edges(state),
        moved_um={key: 0.5 * (a - b) for key, (a, b) in profiles.items()},
        moved_area_mm2={
            key: 0.5 * (a.worn_area_mm2 - b.worn_area_mm2) for key, (a, b) in moved.items()
        },
        moved_width_mm={
            key: 0.5 * ((a[1] - a[0]) - (b[1] - b[0])) for key, (a, b) in edges.items()
        },
        moved_depth_um={key: 0.5 * float(a.max() - b.max()) for key, (a, b) in profiles.items()},
    )


def _depth(state: SurfaceState) -> Array:
    """Worn depth (n,), µm."""
    return 1e3 * state.wear_depth_mm


def _edges(state: SurfaceState) -> tuple[float, float]:
    """Where the surface is worn, mm: the contact's own edges where it only grew."""
    if state.scar_edges_mm is not None:
        return state.scar_edges_mm
    worn = np.flatnonzero(state.wear_depth_mm > 0.0)
    x, half = state.grid.x_mm, 0.5 * state.grid.spacing_mm
    return float(x[worn[0]]) - half, float(x[worn[-1]]) + half


def _area(x_mm: Array, depth_um: Array) -> float:
    return float(1e-3 * np.trapezoid(depth_um, x_mm))


def simulated_text(value: float, spread: float) -> str:
    """A simulated value with its uncertainty, alone where no input's uncertainty is stated."""
    return with_uncertainty(value, spread) if spread > 0.0 else f"{value:.4g}"


_FIRM = 1e-8
"""Of a covariance's diagonal, added to it: rounding."""
_STEPS, _SETTLED = 10, 0.02
"""Most steps of an alignment, and the step over the shift's uncertainty that ends it."""


@dataclass(frozen=True, kw_only=True)
class ScarPair:
    """A levelled trace, moved onto the simulated scar of its distance.

    Parameters
    ----------
    trace : LevelledTrace
        The trace.
    scar : SimulatedScar
        The scar.
    shift_mm : float
        What was taken off the trace's x, mm.
    shift_uncertainty_mm : float
        Its standard uncertainty, mm.
    x_mm : ndarray, shape (n,)
        Places of the trace's bins in the scene, mm.
    simulated_um : ndarray, shape (n,)
        The simulated depth, as means over the bins, µm.
    simulated_uncertainty_um : ndarray, shape (n,)
        Its standard uncertainty by the scene's inputs, µm.
    difference_um : ndarray, shape (n,)
        Measured less simulated depth, µm.
    difference_uncertainty_um : ndarray, shape (n,)
        Its standard uncertainty by roughness, levelling, shift and inputs, µm.
    rms_um : float
        Root mean square difference over the scar, µm.
    chi : float
        The difference over its uncertainty, over the scar: near 1 where both agree.
    """

    trace: LevelledTrace
    scar: SimulatedScar
    shift_mm: float
    shift_uncertainty_mm: float
    x_mm: Array
    simulated_um: Array
    simulated_uncertainty_um: Array
    difference_um: Array
    difference_uncertainty_um: Array
    rms_um: float
    chi: float

    @property
    def area_difference_mm2(self) -> tuple[float, float]:
        """Measured less simulated worn area, and its standard uncertainty, mm²."""
        own = float(root_sum_square(self.scar.moved_area_mm2))
        return (
            self.trace.worn_area_mm2 - self.scar.worn_area_mm2,
            float(np.hypot(self.trace.worn_area_uncertainty_mm2, own)),
        )

    @property
    def measured_width_uncertainty_mm(self) -> float:
        """Standard uncertainty of the measured width, by its edges, mm."""
        return float(np.hypot(*self.trace.edge_uncertainty_mm))


def pair_scar(trace: LevelledTrace, scar: SimulatedScar) -> ScarPair:
    """Move a trace, whose x begins anywhere, onto a simulated scar, and subtract.

    With d = h_measured - h_simulated over n bins the shift is that of least dᵀ C_trace⁻¹ d, from
    the middles between both scars' edges: u_shift² = 1/(h'ᵀ C_trace⁻¹ h'), C = C_trace + Σ_inputs
    δh δhᵀ + u_shift² h' h'ᵀ, chi² = dᵀ C⁻¹ d/n. A scar that is deeper or wider than the other stays
    in the middle: h' is odd about it.
    """
    shift, spread = _aligned(trace, scar)
    x = trace.x_mm - shift
    inside, slope = _both(trace, scar, shift), scar.slope(x)
    simulated = scar.on_bins(x, scar.depth_um)
    rows = [scar.on_bins(x, moved) for moved in scar.moved_um.values()]
    inputs = np.array(rows).reshape(-1, len(x))
    covariance = trace.depth_covariance_um2 + inputs.T @ inputs
    covariance += spread**2 * np.outer(slope, slope)
    difference = trace.depth_um - simulated
    d = difference[inside]
    part = _firm(covariance[np.ix_(inside, inside)])
    return ScarPair(
        trace=trace,
        scar=scar,
        shift_mm=shift,
        shift_uncertainty_mm=spread,
        x_mm=x,
        simulated_um=simulated,
        simulated_uncertainty_um=np.sqrt(np.sum(inputs**2, axis=0)),
        difference_um=difference,
        difference_uncertainty_um=np.sqrt(np.diag(covariance)),
        rms_um=float(np.sqrt(np.mean(d**2))),
        chi=float(np.sqrt(d @ np.linalg.solve(part, d) / len(d))),
    )


def _firm(covariance: Array) -> Array:
    """A covariance (n, n) that is definite beyond rounding."""
    return covariance + _FIRM * np.diag(np.diag(covariance))


def _aligned(trace: LevelledTrace, scar: SimulatedScar) -> tuple[float, float]:
    """The shift (mm) of least squares by Gauss-Newton steps, and its standard uncertainty."""
    shift = trace.centre_mm - scar.centre_mm
    for _ in range(_STEPS):
        x = trace.x_mm - shift
        inside, slope = _both(trace, scar, shift), scar.slope(x)
        d = (trace.depth_um - scar.on_bins(x, scar.depth_um))[inside]
        weighed = np.linalg.solve(
            _firm(trace.depth_covariance_um2[np.ix_(inside, inside)]), slope[inside]
        )
        weight = float(weighed @ slope[inside])
        step = -float(weighed @ d) / weight
        shift += step
        if abs(step) < _SETTLED * weight**-0.5:
            break
    return shift, weight**-0.5


def _both(trace: LevelledTrace, scar: SimulatedScar, shift: float) -> NDArray[np.intp]:
    """Bins where either of both scars reaches."""
    left, right = (edge - shift for edge in trace.window_mm)
    low, high = min(left, scar.edges_mm[0]), max(right, scar.edges_mm[1])
    x = trace.x_mm - shift
    return np.flatnonzero((x >= low) & (x <= high))


def scar_columns(name: str, scar: SimulatedScar, pair: ScarPair | None) -> dict[str, Any]:
    """A row of metrics.csv; None where the trace shows no scar.

    Parameters: `name` of the trace; `scar` at its distance; `pair`. Returns name to value.
    """
    trace = pair.trace if pair else None
    area, spread = pair.area_difference_mm2 if pair else (None, None)
    return {
        "trace": name,
        "distance_m": scar.distance_m,
        "shift_mm": pair and pair.shift_mm,
        "shift_uncertainty_mm": pair and pair.shift_uncertainty_mm,
        "measured_area_mm2": trace and trace.worn_area_mm2,
        "measured_area_uncertainty_mm2": trace and trace.worn_area_uncertainty_mm2,
        "simulated_area_mm2": scar.worn_area_mm2,
        "simulated_area_uncertainty_mm2": float(root_sum_square(scar.moved_area_mm2)),
        "area_difference_mm2": area,
        "area_difference_uncertainty_mm2": spread,
        "measured_width_mm": trace and trace.width_mm,
        "measured_width_uncertainty_mm": pair and pair.measured_width_uncertainty_mm,
        "simulated_width_mm": scar.width_mm,
        "simulated_width_uncertainty_mm": float(root_sum_square(scar.moved_width_mm)),
        "simulated_depth_um": float(scar.depth_um.max()),
        "simulated_depth_uncertainty_um": float(root_sum_square(scar.moved_depth_um)),
        "difference_rms_um": pair and pair.rms_um,
        "difference_chi": pair and pair.chi,
    }


def profile_columns(name: str, pair: ScarPair) -> dict[str, Any]:
    """The rows of scars.csv for one trace. Parameters: `name` of the trace; `pair`."""
    return {
        "trace": [name] * len(pair.x_mm),
        "distance_m": [pair.scar.distance_m] * len(pair.x_mm),
        "x_mm": pair.x_mm,
        "measured_um": pair.trace.depth_um,
        "measured_uncertainty_um": np.sqrt(np.diag(pair.trace.depth_covariance_um2)),
        "simulated_um": pair.simulated_um,
        "simulated_uncertainty_um": pair.simulated_uncertainty_um,
        "difference_um": pair.difference_um,
        "difference_uncertainty_um": pair.difference_uncertainty_um,
    }
