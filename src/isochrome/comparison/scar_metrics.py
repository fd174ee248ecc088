"""A measured trace beside the simulated scar: aligned, subtracted, and told in numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.comparison.simulated_scars import SimulatedScar, root_sum_square
from isochrome.scars import LevelledTrace

Array = NDArray[np.floating]

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
