"""Scars that a scene's wear makes, with what its inputs' uncertainties move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import SurfaceState, contact_states
from isochrome.errors import InputError
from isochrome.output import with_uncertainty
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
