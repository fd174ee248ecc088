"""The undeformed gap between indenter and specimen, and the grid on which the contact is solved."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from isochrome.contact.surface import Floats
from isochrome.errors import InputError, PhysicsError
from isochrome.scene import Scene

STEEPEST = 0.3
"""Largest half-width over radius: beyond it, the parabola is over 2 % off the cylinder's arc."""

FAR_MM = 1e3
"""Gap beyond a flat's corners: nothing touches there."""

_MAX_NODES = 32_768
_NODES_IN_HALF_WIDTH = 350
"""Fine enough for 1e-3 of the peak pressure in the first row of pixels, beside the edge."""
_MARGIN = 1.3


@dataclass(frozen=True)
class Grid:
    """Uniform nodes along the surface: x = left_mm + i spacing_mm, i = 0 .. nodes-1."""

    left_mm: float
    spacing_mm: float
    nodes: int

    @property
    def x_mm(self) -> Floats:
        """Positions of the nodes (n,), mm."""
        return self.left_mm + self.spacing_mm * np.arange(self.nodes)


def elastic_constants(scene: Scene) -> tuple[float, float]:
    """E* (MPa) and 1/G* (1/MPa) of a contact scene, for its plane strain or plane stress.

    Equations: 1/E* = Σ (1-nu²)/E and 1/G* = (1-2nu1)/G1 - (1-2nu2)/G2 in plane strain; plane
    stress is the same with nu/(1+nu) for nu at unchanged G. Source: Johnson (1985), sections 2.4
    and 5.4; Timoshenko & Goodier (1970), section 16, for the exchange.
    """
    block, other = scene.specimen, scene.indenter
    assert other is not None and block.young_gpa is not None and block.poisson is not None
    compliance = coupling = 0.0
    for young, nu, sign in (
        (block.young_gpa, block.poisson, 1),
        (other.young_gpa, other.poisson, -1),
    ):
        shear = 1e3 * young / (2.0 * (1.0 + nu))
        nu = nu if block.plane == "strain" else nu / (1.0 + nu)
        compliance += (1.0 - nu) / (2.0 * shear)
        coupling += sign * (1.0 - 2.0 * nu) / shear
    return 1.0 / compliance, coupling


def line_load(scene: Scene, distance_m: float = 0.0) -> float:
    """Normal load over thickness, P' (N/mm), at a sliding distance (m)."""
    assert scene.specimen.thickness_mm is not None
    return scene.load_at(distance_m) / scene.specimen.thickness_mm


def undeformed_gap(scene: Scene, x_mm: Floats) -> Floats:
    """Gap between the unloaded bodies, up to a constant.

    Equation: x²/(2R) for a cylinder, 0 between a flat's corners, and what the profile file adds.
    Parameters: `scene`, with an indenter; `x_mm` (n,). Returns (n,), mm. Raises InputError on a
    profile file that cannot be used.
    """
    indenter = scene.indenter
    assert indenter is not None
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
    """A measured profile: a CSV file with the columns x_mm and gap_mm (or gap_um).

    Returns x (m,) rising and the gap (m,), mm. Raises InputError that names the file and the fix.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = list(csv.DictReader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: the profile cannot be read ({error}); check its name") from error
    unit = 1e-3 if rows and "gap_um" in rows[0] else 1.0
    name = "gap_um" if unit == 1e-3 else "gap_mm"
    try:
        table = np.array([[float(row["x_mm"]), float(row[name])] for row in rows], dtype=float)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: a profile needs the columns x_mm and gap_mm (or gap_um), numbers in all rows"
        ) from error
    if len(table) < 3 or not np.isfinite(table).all() or (np.diff(table[:, 0]) <= 0.0).any():
        raise InputError(f"{path}: a profile needs three rows or more, finite, with rising x_mm")
    return table[:, 0], table[:, 1] * unit


def contact_grid(
    scene: Scene,
    *,
    largest_dose_mm_per_mpa: float,
    line_loads_n_per_mm: tuple[float, float] | None = None,
    growth: float = 1.0,
) -> Grid:
    """A grid that holds the contact at every state, fine enough for the unworn one.

    The half-width is that of Hertz, a, joined with that of the worn arc, c = (3 R K P'/2)^(1/3),
    as (a³ + c³)^(1/3), with a margin. The spacing divides the camera's pixel, so that the stress
    below needs no interpolation.
    Parameters: `scene`; `largest_dose_mm_per_mpa`, K = ∫kappa ds of the last state;
    `line_loads_n_per_mm`, the smallest P', which sets the fineness, and the largest, which sets the
    window (the scene's at no distance if None); `growth`, factor on the window, for a second try.
     Raises PhysicsError on a contact too wide for its model.
    """
    modulus, _ = elastic_constants(scene)
    loads = line_loads_n_per_mm or (line_load(scene), line_load(scene))
    finest, reach = _contact_reach(scene, modulus, largest_dose_mm_per_mpa, loads)
    half = scene.numerics.window_mm / 2.0 if scene.numerics.window_mm else _MARGIN * growth * reach
    spacing = scene.numerics.spacing_mm or finest / _NODES_IN_HALF_WIDTH
    pixel = scene.camera.pixel_mm if scene.camera else None
    if pixel:
        spacing = pixel / math.ceil(pixel / spacing * (1.0 - 1e-9))
    nodes = 2 * math.ceil(half / spacing) + 1
    if nodes > _MAX_NODES:
        raise PhysicsError(
            f"{scene.name}: the contact needs {nodes} nodes of {spacing:.3g} mm over "
            f"{2 * half:.3g} mm, more than {_MAX_NODES}; set a coarser numerics.spacing_mm or a "
            "smaller numerics.window_mm"
        )
    if nodes < 16:
        raise PhysicsError(
            f"{scene.name}: a window of {2 * half:.3g} mm has only {nodes} nodes of {spacing:.3g} "
            "mm; set a finer numerics.spacing_mm or a larger numerics.window_mm"
        )
    return Grid(left_mm=-spacing * (nodes // 2), spacing_mm=spacing, nodes=nodes)


def _contact_reach(
    scene: Scene, modulus: float, dose: float, loads: tuple[float, float]
) -> tuple[float, float]:
    """The half-width of the smallest load's unworn contact and the widest to be expected (mm)."""
    indenter = scene.indenter
    assert indenter is not None
    if indenter.shape == "flat" and indenter.half_width_mm is not None:
        return indenter.half_width_mm, indenter.half_width_mm
    if indenter.radius_mm is None:
        assert indenter.profile is not None
        x, _ = read_profile(scene.path(indenter.profile))
        half = float(np.abs(x).max())
        return half / 2.0, half
    radius = indenter.radius_mm
    finest, hertz = (math.sqrt(4.0 * load * radius / (math.pi * modulus)) for load in loads)
    worn = (1.5 * radius * dose * loads[1]) ** (1.0 / 3.0)
    reach = (hertz**3 + worn**3) ** (1.0 / 3.0)
    if reach > STEEPEST * radius:
        raise PhysicsError(
            f"{scene.name}: the contact's half-width would be {reach:.3g} mm, over {STEEPEST:g} of "
            f"the radius {radius:g} mm, where a half-plane under a parabola no longer holds; lower "
            "load.normal_n or the wear, or raise indenter.radius_mm"
        )
    return finest, reach
