"""What acts on the specimen's surface in one state of a contact. A scene's elastic constants and
load, and the grid on which its contact is solved."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from isochrome.contact.pressure import NO_PRESSURE, Floats, read_profile, undeformed_gap
from isochrome.contact.sliding_history import NODES, WEIGHTS
from isochrome.errors import InputError, PhysicsError
from isochrome.scene import UNDOUBTED_MM, DistanceTable, Scene

STEEPEST = 0.3
"""Largest half-width over radius, beyond which the parabola is over 2 % off the cylinder's arc; and
largest scar over the contact's half-width, beyond which the worn surface is no half-plane's."""

_MAX_NODES = 32_768
_NODES_IN_HALF_WIDTH = 350
"""Fine enough for 1e-3 of the peak pressure in the first row of pixels, beside the edge."""
_MARGIN = 1.3
_SPACINGS_IN_ROW_STEP, _FEWEST_IN_ROW_STEP = 4, 2
"""Spacings from one row of a measured profile to the next, by default and at least, so that no row
is passed over. A profile is straight between its rows: at a row that is a kink, the pressure has a
logarithm, which grows as the spacing is made finer."""


@dataclass(frozen=True)
class ContactGrid:
    """Uniform nodes along the surface: x = left_mm + i spacing_mm, i = 0 .. nodes-1.

    Parameters
    ----------
    left_mm : float
        Place of the first node, mm.
    spacing_mm : float
        Distance of the nodes, mm.
    nodes : int
        How many there are.
    """

    left_mm: float
    spacing_mm: float
    nodes: int

    @property
    def x_mm(self) -> Floats:
        """Positions of the nodes (n,), mm."""
        return self.left_mm + self.spacing_mm * np.arange(self.nodes)


def elastic_constants(scene: Scene) -> tuple[float, float]:
    """E* (MPa) and 1/G* (1/MPa) of a scene with an indenter, in its plane strain or plane stress.
    1/E* = Σ (1-nu²)/E and 1/G* = (1-2nu1)/G1 - (1-2nu2)/G2 in plane strain; plane stress is the
    same with nu/(1+nu) for nu at unchanged G; a plate between them has its share of both. Source:
    Johnson (1985), sections 2.4 and 5.4; Timoshenko & Goodier (1970), section 16, for the
    exchange."""
    block, other = scene.specimen, scene.indenter
    assert other is not None and block.young_gpa is not None and block.poisson is not None
    share = block.share_of_plane_stress
    if share is None:
        raise InputError("specimen_plane_unknown", name=scene.name)
    compliance = coupling = 0.0
    bodies = (block.young_gpa, block.poisson, 1), (other.young_gpa, other.poisson, -1)
    for young, nu, sign in bodies:
        shear = 1e3 * young / (2.0 * (1.0 + nu))
        nu = (1.0 - share) * nu + share * nu / (1.0 + nu)
        compliance += (1.0 - nu) / (2.0 * shear)
        coupling += sign * (1.0 - 2.0 * nu) / shear
    return 1.0 / compliance, coupling


def line_load(scene: Scene) -> float:
    """Normal load over thickness P' before sliding, N/mm."""
    assert scene.specimen.thickness_mm is not None
    return scene.load_at(0.0) / scene.specimen.thickness_mm


def contact_grid(
    scene: Scene,
    *,
    largest_dose_mm_per_mpa: float,
    line_loads_n_per_mm: tuple[float, float] | None = None,
    growth: float = 1.0,
) -> ContactGrid:
    """A grid that holds the contact at every state, fine enough for the unworn one. Half-width (a³
    + c³)^(1/3) with a margin, a of Hertz, c = (3 R K P'/2)^(1/3) of the worn arc; it reaches a
    measured profile's outer hills. Spacing: 1/4 of the profile's row step at most, a part of the
    pixel, so that the stress needs no interpolation. Of `line_loads_n_per_mm` the smaller sets it,
    the larger the window, which `growth` widens. PhysicsError where no grid does."""
    modulus, _ = elastic_constants(scene)
    loads = line_loads_n_per_mm or (line_load(scene), line_load(scene))
    loads = loads[0], loads[1] * float(slice_loads(scene)[0][-1])
    finest, reach = _contact_reach(scene, modulus, largest_dose_mm_per_mpa, loads)
    half = scene.numerics.window_mm / 2.0 if scene.numerics.window_mm else _MARGIN * growth * reach
    spacing = _spacing(scene, finest / _NODES_IN_HALF_WIDTH, min(half, reach))
    pixel = scene.camera.pixel_mm if scene.camera else None
    if pixel:
        spacing = pixel / math.ceil(pixel / spacing * (1.0 - 1e-9))
    nodes = 2 * math.ceil(half / spacing) + 1
    if nodes > _MAX_NODES:
        raise PhysicsError(
            "contact_needs_nodes_mm", name=scene.name, nodes=nodes, spacing=spacing, half=2 * half,
            max_nodes=_MAX_NODES,
            words=" (and smooth the profile to fewer rows)" if scene.profile_file else "",
        )  # fmt: skip
    if nodes < 16:
        raise PhysicsError(
            "window_mm_has_only", name=scene.name, half=2 * half, nodes=nodes, spacing=spacing
        )
    # every pixel would be divided into thousands of nodes
    if pixel and pixel > max(2.0 * reach, UNDOUBTED_MM):
        raise PhysicsError(
            "camera_pixel_mm_wider_contact", name=scene.name, pixel=pixel, reach=2.0 * reach
        )
    return ContactGrid(left_mm=-spacing * (nodes // 2), spacing_mm=spacing, nodes=nodes)


def _spacing(scene: Scene, smooth: float, half: float) -> float:
    """The scene's own spacing or that of a smooth contact, and none that passes over rows (mm)."""
    given = scene.numerics.spacing_mm
    row = math.inf
    if scene.profile_file is not None:
        x, _ = read_profile(scene.path(scene.profile_file))
        steps = np.diff(x)[(x[1:] > -half) & (x[:-1] < half)]
        if len(steps):
            row = float(np.median(steps))
        coarsest = row / _FEWEST_IN_ROW_STEP
        if given is not None and given > coarsest * (1.0 + 1e-6):
            raise PhysicsError(
                "numerics_spacing_mm_does_not", name=scene.name, given=given,
                profile_file=scene.profile_file, row=row, coarsest=coarsest,
            )  # fmt: skip
    return given or min(smooth, row / _SPACINGS_IN_ROW_STEP)


def _contact_reach(
    scene: Scene, modulus: float, dose: float, loads: tuple[float, float]
) -> tuple[float, float]:
    """The half-width of the smallest load's unworn contact and the widest to be expected (mm)."""
    indenter = scene.pressed_body
    if indenter.shape == "flat" and indenter.half_width_mm is not None:
        return indenter.half_width_mm, indenter.half_width_mm
    if indenter.radius_mm is None:
        assert indenter.profile is not None
        x, _ = read_profile(scene.path(indenter.profile))
        half = float(np.abs(x).max())
        return half / 2.0, half
    radius = indenter.radius_mm
    # root by root, so that no load overflows on its way to the refusal
    per_load = 2.0 * math.sqrt(radius / (math.pi * modulus))
    finest, hertz = (per_load * math.sqrt(load) for load in loads)
    # a layer gives way as wear does
    dose = dose + _ends(scene.contact.layer_um_per_mpa)[1]
    worn = (1.5 * radius * dose) ** (1.0 / 3.0) * loads[1] ** (1.0 / 3.0)
    widest = max(hertz, worn)
    reach = widest * ((hertz / widest) ** 3 + (worn / widest) ** 3) ** (1.0 / 3.0)
    # beside a contact the gap is at least (x - a)²/(2R)
    least, most = (math.sqrt(radius) * math.sqrt(v) for v in _ends(scene.contact.roughness_um))
    finest = math.hypot(finest, least)
    reach += math.sqrt(-2.0 * math.log(NO_PRESSURE)) * most
    if not reach <= STEEPEST * radius:
        name = scene.name
        raise PhysicsError(
            "contact_half_width_would", name=name, reach=reach, steepest=STEEPEST, radius=radius
        )
    if indenter.profile is not None:
        x, _ = read_profile(scene.path(indenter.profile))
        gap = undeformed_gap(scene, x)
        low = gap - gap.min() <= reach**2 / (2.0 * radius)
        reach = max(reach, float(np.abs(x[low]).max()))
    return finest, reach


@dataclass(frozen=True, kw_only=True)
class SurfaceState:
    """What acts on the specimen's surface in one state.

    Parameters
    ----------
    grid : ContactGrid
        The nodes, with `x_mm` (n,).
    pressure_mpa : ndarray, shape (n,)
        Pressure p, MPa.
    shear_mpa : ndarray, shape (n,)
        Shear traction q along +x, MPa.
    wear_depth_mm : ndarray, shape (n,)
        Worn depth h, mm.
    distance_m : float
        Distance slid, m.
    friction : float
        Friction coefficient mu.
    sliding : bool
        False in a static state.
    residual : float
        Residual of the contact's complementarity.
    scar_edges_mm : tuple of float, optional
        The edges of contact, mm, where a mesh knew them better than the grid.
    rough : bool, default False
        Whether the pressure fades out without an edge, as between rough surfaces.
    """

    grid: ContactGrid
    pressure_mpa: Floats
    shear_mpa: Floats
    wear_depth_mm: Floats
    distance_m: float
    friction: float
    sliding: bool
    residual: float
    scar_edges_mm: tuple[float, float] | None = None
    rough: bool = False

    @property
    def p_max_mpa(self) -> float:
        """Largest nodal pressure (MPa)."""
        return float(self.pressure_mpa.max())

    @property
    def edges_mm(self) -> tuple[float, float]:
        """Outermost places where the pressure reaches zero, or 1 % of a rough contact's (mm).

        Near an edge p² is linear in x (p ~ the root of the distance), so p² of the last two nodes
        in contact is carried on to zero, by one spacing at most: second order in the spacing.
        """
        if self.scar_edges_mm is not None:
            return self.scar_edges_mm
        faint = 0.01 * self.p_max_mpa if self.rough else 0.0
        p2, h = np.maximum(self.pressure_mpa - faint, 0.0) ** 2, self.grid.spacing_mm
        inside = np.flatnonzero(p2 > 0.0)
        first, last = int(inside[0]), int(inside[-1])
        left_mm = self.grid.x_mm[first] - h * _carried(p2[first], p2[min(first + 1, last)])
        right = self.grid.x_mm[last] + h * _carried(p2[last], p2[max(last - 1, first)])
        return float(left_mm), float(right)

    @property
    def contact_width_mm(self) -> float:
        """Distance between the outermost edges of contact (mm)."""
        left_mm, right = self.edges_mm
        return right - left_mm

    @property
    def line_load_n_per_mm(self) -> float:
        """Normal load per thickness that the pressure carries, ∫p dx (N/mm)."""
        return float(self.pressure_mpa.sum() * self.grid.spacing_mm)

    @property
    def worn_area_mm2(self) -> float:
        """Area of the worn cross-section, ∫h dx (mm²)."""
        return float(self.wear_depth_mm.sum() * self.grid.spacing_mm)


def slice_loads(scene: Scene) -> tuple[Floats, Floats]:
    """Loads of slices through the thickness over their mean, rising, and their shares of it: points
    and weights of Gauss and Legendre where the bodies touch, P'(y) = c max(0, 1 + |tilt| y). Eight
    slices err by 4e-5, 3e-4 and 1e-3 fringe (RMS from two pixels down, 44 N) at loads that change
    by 25, 50 and 100 % to either side: at a depth by a factor for each slice, at the surface, where
    each has an edge, with their number alone."""
    assert scene.load is not None and scene.specimen.thickness_mm is not None
    change = 0.5 * abs(scene.load.tilt) * scene.specimen.thickness_mm
    if not change:
        return np.ones(1), np.ones(1)
    touching = min(1.0, 0.5 + 0.5 / change)  # share of the thickness
    shares = 0.5 * touching * WEIGHTS
    loads = 1.0 + change * (1.0 - touching * (1.0 - NODES))
    return loads / float(shares @ loads), shares


def slices(scene: Scene) -> list[Scene]:
    """Scenes of a contact's slices through the thickness, that of the largest load last: each has
    its part of the normal and of the tangential load, and wears by itself. The scene's own without
    a tilt."""
    load = scene.load
    assert load is not None
    if not load.tilt:
        return [scene]
    whole, held, result = load.normal_n, load.tangential_n, []
    for share in slice_loads(scene)[0].tolist():
        if isinstance(whole, DistanceTable):
            update: dict[str, Any] = {"value": tuple(share * v for v in whole.value)}
            normal: Any = whole.model_copy(update=update)
        else:
            normal = share * whole
        update = {"tilt": 0.0, "normal_n": normal, "tangential_n": held and share * held}
        result.append(scene.model_copy(update={"load": load.model_copy(update=update)}))
    return result


def mean_state(scene: Scene, states: tuple[SurfaceState, ...]) -> SurfaceState:
    """The mean of a scene's `slices` in one state. Stress is linear in the tractions, so that it is
    that of their mean."""
    if len(states) == 1:
        return states[0]
    shares, last = slice_loads(scene)[1], states[-1]

    def mean(key: str) -> Floats:
        return np.asarray(shares @ np.stack([getattr(state, key) for state in states]))

    edges = [state.scar_edges_mm for state in states if state.scar_edges_mm is not None]
    lefts, rights = zip(*edges, strict=True) if len(edges) == len(states) else ((), ())
    return replace(
        last, pressure_mpa=mean("pressure_mpa"), shear_mpa=mean("shear_mpa"),
        wear_depth_mm=mean("wear_depth_mm"), residual=max(state.residual for state in states),
        scar_edges_mm=(min(lefts), max(rights)) if lefts else None,
    )  # fmt: skip


def _ends(between: float | DistanceTable) -> tuple[float, float]:
    """The least and the largest of a layer's (mm/MPa) or a roughness's (mm) values, given in um."""
    values = between.value if isinstance(between, DistanceTable) else (between,)
    return 1e-3 * min(values), 1e-3 * max(values)


def _carried(outer: float, inner: float) -> float:
    """Fraction of a spacing beyond the outer node at which a straight line reaches zero."""
    return min(1.0, outer / (inner - outer)) if inner > outer else 1.0
