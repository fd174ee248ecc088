"""Stress fields at a few hundred pixels for many sets of values at once: the model of a search.

A set of values is a row θ of seven numbers, see `THETA`; a field takes (m, 7) and gives (m, n).

Contact pressures over load and wear are short series, of which a search tries thousands. On a
contact of half-width a about c the pressure is p = √(1 - t²) Σ b_n U_n(t), t = (x - c)/a. Its
Cauchy transform is then a polynomial in u = ζ - √(ζ² - 1), ζ = (x + iz - c)/a:
F = ∫ p(t) dt/(s - t) = (2 P'/a) Σ g_n u^(n+1), with g_n = b_n/b_0 and P' the load per thickness.
Hertz's pressure is the first term alone. Between a few solved contacts a and g_n go with the
logarithms of load and wear.
Source: Mason & Handscomb (2003), Chebyshev Polynomials, section 9.5 (transform of U_n).

Damped descents of many starts side by side, on a few hundred pixels, light eliminated linearly.

For each signal f the light's linear part, I = f Σ a_k B_k + Σ c_k C_k, is eliminated as in
`estimation.least_squares`; here the normal equations of a whole batch of signals are two matrix
products, of f² and f with the bases' products. Kaufman's Jacobian (BIT 15, 1975, 49-57) is that of
`estimation.intensity`, one batch of fields for all differences of all starts. A start that leads
nowhere costs as much as a good one, and no more. Those that have arrived are left out of the batch,
and friction holds the others back: that is why the loop is not `isochrome.estimation.minimise_all`,
whose steps and damping it takes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import SurfaceState, mean_wear_rate
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import MOSTLY, FrameData, damped_steps, next_damping
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.frame.single_state import is_held, with_part
from isochrome.scene import Scene, Wear
from isochrome.simulation import scene_states
from isochrome.specimens import specimen_model
from isochrome.stress import PixelGrid, RegularStress, pixel_grid

THETA = (
    "load.normal_n", "load.tangential_n", "friction.coefficient", "wear.coefficient_mm2_per_n",
    "load.bulk_mpa", "camera.left_mm", "camera.top_mm",
)  # fmt: skip
"""What a row θ stands for: ln P, Q/P, mu, ln k, bulk stress (MPa), the picture's place (mm)."""

LOAD, SHEAR, FRICTION, WEAR, BULK, LEFT, TOP = range(7)
SLIPPING = 0.98
"""Largest tangential force of a held contact that is tried, over what friction can hold."""

_CHUNK = 30_000
"""Pixels times rows at a time: they stay in the processor's cache."""

_LOADS = np.geomspace(0.02, 5.0, 8)
"""Loads over the scene's: down to what sticks of a contact that slips nearly everywhere."""

_WORN_LOADS = np.geomspace(0.2, 5.0, 6)
_DOSES = np.geomspace(0.25, 4.0, 6)
_TERMS = 10
_NOTHING = 3e-3
_TOLERANCE = 1e-2


class ContactField:
    """A half-plane under a contact, its pressure from a table, its shear by friction.

    conj D = (2/π) [z F_p' - F_q - i z F_q'] + bulk, F_p and F_q the transforms of pressure and
    shear: q = mu p where it slides, q = mu [p(P) - p(P - |Q|/mu)] where it is held (Jäger 1998;
    Ciavarella 1998). A block's sides add what they add to a half-plane, by the two forces.
    Source: Muskhelishvili (1953), Singular Integral Equations; Johnson (1985), section 2.4.
    """

    def __init__(self, scene: Scene, pixels: PixelGrid, keep: Mask, table: PressureTable) -> None:
        """`pixels`, the nominal ones; `keep` (rows, cols), which of them are wanted (n)."""
        assert scene.specimen.thickness_mm is not None
        row, col = np.nonzero(keep)
        places = (np.broadcast_to(v, keep.shape)[row, col] for v in pixels.places)
        # θ holds the place of the whole picture, whose pixels may be smaller
        self._shift = (pixels.left_mm, pixels.top_mm)
        self._x, self._z = (v - v0 for v, v0 in zip(places, self._shift, strict=True))
        self._table = table
        self._thickness = scene.specimen.thickness_mm
        self._held = is_held(scene)
        self._scene = scene
        self._here = theta_of(scene)
        self._rest = _changing_bulk(scene)
        self._sides = specimen_model(scene).side_stress_of_forces(scene)

    def difference(self, theta: Array) -> Array:
        """(sigma_x - sigma_z) + 2i tau_xz (m, n), MPa, for θ (m, 7)."""
        rows = max(1, _CHUNK // len(self._x))
        parts = [self._some(theta[i : i + rows]) for i in range(0, len(theta), rows)]
        return np.concatenate(parts)

    def _some(self, theta: Array) -> Array:
        shift = theta[:, [LEFT, TOP]] - self._here[[LEFT, TOP]] + self._shift
        x, z = (_single(self._x + shift[:, :1]), _single(self._z + shift[:, 1:]))
        inside = z > 0.0
        depth = np.maximum(z, np.float32(1e-6))
        value, slope = self._transform(theta, theta[:, LOAD], x, depth)
        friction = theta[:, FRICTION, None]
        total = slope * depth
        if self._held:
            limit = np.maximum(np.abs(theta[:, FRICTION]), 1e-9)
            share = np.minimum(np.abs(theta[:, SHEAR]) / limit, SLIPPING)
            inner = self._transform(theta, theta[:, LOAD] + np.log1p(-share), x, depth)
            friction = np.copysign(friction, theta[:, SHEAR, None])
            value -= inner[0]
            slope -= inner[1]
        if friction.any():
            slope *= 1j * depth
            value += slope
            value *= _single(friction)
            total -= value
        field = np.conj(total, out=total)
        field *= np.float32(2.0 / np.pi)
        field += _single(theta[:, BULK, None])
        if self._rest:
            field += self._rest.difference(x, depth).astype(field.dtype)
        if self._sides:
            field += self._block(theta, x, depth).astype(field.dtype)
        return field if inside.all() else np.where(inside, field, np.complex64(0.0))

    def _transform(self, theta: Array, log_load: Array, x: Array, z: Array) -> tuple[Array, Array]:
        """F and F' of the pressure at loads (m,), at places x, z (m, n)."""
        half, centre, series = self._table.at(log_load, self._dose(theta), theta[:, FRICTION])
        a = _single(half[:, None])
        x = x - _single(centre[:, None]) if centre.any() else x
        root = _edge_root(x, z, a)
        u = root + x
        u.imag += z
        np.divide(a, u, out=u)
        value, slope = u, u
        terms = series.shape[1]
        if terms > 1:
            g = _single(series[:, None, :])
            value, slope = g[..., -1] + 0.0 * u, terms * g[..., -1] + 0.0 * u
            for n in range(terms - 2, -1, -1):
                value, slope = value * u + g[..., n], slope * u + (n + 1) * g[..., n]
            value *= u
            slope *= u
        strength = 2.0 * np.exp(log_load)[:, None] / (self._thickness * half[:, None])
        slope = slope * _single(-strength)
        slope /= root
        return value * _single(strength), slope

    def _block(self, theta: Array, x: Array, z: Array) -> Array:
        """What a block's sides and support add, by the normal and the tangential force."""
        line_load = np.exp(theta[:, LOAD, None]) / self._thickness
        shear = theta[:, SHEAR if self._held else FRICTION, None]
        normal, tangential = (unit.difference(x, z) for unit in self._sides)
        return np.asarray(line_load * (normal + shear * tangential))

    def _dose(self, theta: Array) -> Array:
        """Logarithm of the worn dose over the scene's own."""
        wear = self._scene.wear
        if wear is None or len(self._table.log_wear) == 1:
            return np.zeros(len(theta))
        rate, own = (
            _mean_rate(wear, rows.T[WEAR], rows.T[FRICTION]) for rows in (theta, self._here)
        )
        return np.asarray(np.log(np.maximum(rate, 1e-9 * own) / own))


class BodyField:
    """A specimen whose stress goes with its load: its field at unit load at the last place."""

    def __init__(self, scene: Scene, pixels: PixelGrid, keep: Mask) -> None:
        """`pixels`, the nominal ones; `keep` (rows, cols), which of them are wanted (n)."""
        self._scene = scene.with_values({"load.normal_n": 1.0})
        self._pixels, self._keep = pixels, keep
        self._here = theta_of(scene)
        self._model = specimen_model(scene)
        self._last: tuple[tuple[float, float], Array] | None = None

    def difference(self, theta: Array) -> Array:
        """(sigma_x - sigma_z) + 2i tau_xz (m, n), MPa, for θ (m, 7); 0 outside the body."""
        return np.array([np.exp(row[LOAD]) * self._unit(row) for row in theta])

    def _unit(self, row: Array) -> Array:
        place = float(row[LEFT] - self._here[LEFT]), float(row[TOP] - self._here[TOP])
        if self._last is None or self._last[0] != place:
            grid = replace(
                self._pixels,
                left_mm=self._pixels.left_mm + place[0],
                top_mm=self._pixels.top_mm + place[1],
            )
            field = self._model.difference(self._scene, None, grid)[self._keep]
            self._last = place, np.nan_to_num(field)
        return self._last[1]


Field = ContactField | BodyField


def field_maker(scene: Scene) -> Callable[[PixelGrid, Mask], Field]:
    """The quick fields of a one-state scene; a contact's pressures are solved once for all.

    Parameters: `scene`, its place written out. Returns a function of `pixels`, thinned, and `keep`
    (rows, cols), which of them are wanted, that returns a Field. Raises PhysicsError where a
    contact cannot be solved at any load near the scene's, InputError for a specimen that is no
    contact and not proportional to its load.
    """
    if scene.indenter is not None:
        table = pressure_table(scene)
        return lambda pixels, keep: ContactField(scene, pixels, keep, table)
    if not specimen_model(scene).is_proportional:
        raise InputError("stress_does_not_go", name=scene.name, model=scene.model)
    return lambda pixels, keep: BodyField(scene, pixels, keep)


def theta_of(scene: Scene) -> Array:
    """The row θ (7,) of a one-state scene, its place written out; ln k is 0 without wear."""
    load, camera = scene.load, scene.camera
    assert load is not None and camera is not None
    assert camera.left_mm is not None and camera.top_mm is not None
    normal = scene.load_at(0.0)
    wear = scene.wear_coefficient_at(0.0)
    return np.array([
        np.log(normal),
        (load.tangential_n or 0.0) / normal,
        scene.friction_at(0.0),
        np.log(wear) if wear > 0.0 else 0.0,
        load.bulk_mpa or 0.0,
        camera.left_mm,
        camera.top_mm,
    ])  # fmt: skip


def search_values(theta: Array, keys: tuple[str, ...]) -> dict[str, float]:
    """The values that a row θ gives to some of the keys in THETA."""
    load = float(np.exp(theta[LOAD]))
    result = {
        "load.normal_n": load,
        "load.tangential_n": float(theta[SHEAR]) * load,
        "wear.coefficient_mm2_per_n": float(np.exp(theta[WEAR])),
    }
    plain = {key: float(theta[i]) for i, key in enumerate(THETA)}
    return {key: result.get(key, plain[key]) for key in keys if key in THETA}


def _mean_rate(wear: Wear, log_coefficient: Array, friction: Array) -> Array:
    """Mean rates (m,) of the scene's law for ln k and mu (m,)."""
    tried = wear.model_copy(update={"coefficient_mm2_per_n": np.exp(log_coefficient)})
    return mean_wear_rate(tried, friction, wear.distances_m[-1])


def _log_wear(wear: Wear, friction: float) -> Array:
    """Logarithms of the doses at `_DOSES` times the distance, over the dose at the distance."""
    end = wear.distances_m[-1]
    rates = np.array([mean_wear_rate(wear, friction, end * dose) for dose in _DOSES])
    return np.asarray(np.log(_DOSES * (rates / mean_wear_rate(wear, friction, end))))


def _changing_bulk(scene: Scene) -> RegularStress:
    """The bulk stress's changes along the surface and with depth, which the search leaves alone."""
    load = scene.load
    if load is None:
        return RegularStress()
    slope = complex(load.bulk_along_x_mpa_per_mm or 0.0, load.bulk_along_z_mpa_per_mm or 0.0)
    return RegularStress((0j, slope)) if slope else RegularStress()


def _single(values: Array) -> Array:
    """In single precision: a search needs no more, and it is twice as quick."""
    return values.astype(np.float32)


def _edge_root(x: Array, z: Array, a: Array) -> Array:
    """√(s² - a²), s = x + iz, Im > 0, by real roots: of each part the one that does not cancel."""
    real, imag = (x - a) * (x + a) - z * z, 2.0 * x * z
    large = np.hypot(real, imag)
    large += np.abs(real)
    large *= np.float32(0.5)
    np.sqrt(large, out=large)
    small = np.abs(imag)
    small /= np.maximum(2.0 * large, np.float32(1e-30))
    out = np.empty(large.shape, dtype=np.complex64)
    outside = real > 0.0
    out.real = np.copysign(np.where(outside, large, small), imag)
    out.imag = np.where(outside, small, large)
    return out


@dataclass(frozen=True, kw_only=True)
class PressureTable:
    """Solved contacts over wear and load.

    `log_wear` (w,), logarithms of the worn dose over the scene's; `log_load` (l,), of P/N;
    `log_half` (w, l), of the half-width a/mm; `centre` (w, l), c over a; `series` (w, l, k), g_n.
    `friction`, that they were solved with; `even`, whether the indenter is symmetric, so that what
    is odd in p comes from friction alone.
    """

    log_wear: Array
    log_load: Array
    log_half: Array
    centre: Array
    series: Array
    friction: float
    even: bool

    def at(self, log_load: Array, log_wear: Array, friction: Array) -> tuple[Array, Array, Array]:
        """Half-width a (m,) and centre c (m,), mm, and g_n (m, k), at m loads, doses, frictions."""
        load, along = _between(self.log_load, log_load)
        wear, across = _between(self.log_wear, log_wear)
        half = np.exp(_bilinear(self.log_half, wear, across, load, along))
        inside, between = np.clip(across, 0.0, 1.0), np.clip(along, 0.0, 1.0)
        centre = half * _bilinear(self.centre, wear, inside, load, between)
        series = _bilinear(self.series, wear, inside, load, between)
        if self.even and self.friction:
            lean = friction / self.friction
            centre = centre * lean
            series[:, 1::2] *= lean[:, None]
        return half, centre, series


def pressure_table(scene: Scene) -> PressureTable:
    """Solve a one-state contact scene at a few loads and worn doses about its own.

    Parameters: `scene`, one state, its wear coefficient a number. Returns a PressureTable. Raises
    PhysicsError where none of its contacts can be solved.
    """
    wear = scene.wear
    worn = wear is not None and wear.coefficient_mm2_per_n != 0.0 and max(wear.distances_m) > 0.0
    result = [
        (factor, _states(scene, factor, worn)) for factor in (_WORN_LOADS if worn else _LOADS)
    ]
    solved = [(factor, states) for factor, states in result if states is not None]
    if not solved:
        raise PhysicsError("contact_cannot_solved_any", name=scene.name)
    rows = np.array([[_series(state) for state in states] for _, states in solved])
    table = rows.swapaxes(0, 1)
    series = table[..., 2:]
    selected = np.flatnonzero(np.abs(series).max(axis=(0, 1)) > _NOTHING)
    indenter = scene.indenter
    return PressureTable(
        log_wear=_log_wear(wear, scene.friction_at(0.0)) if wear and worn else np.zeros(1),
        log_load=np.log([scene.load_at(0.0) * factor for factor, _ in solved]),
        log_half=table[..., 0],
        centre=table[..., 1],
        series=series[..., : int(selected.max()) + 1],
        friction=scene.friction_at(0.0) if scene.friction and not is_held(scene) else 0.0,
        even=indenter is not None and indenter.profile is None,
    )


def _states(scene: Scene, factor: float, worn: bool) -> list[SurfaceState] | None:
    """The states at one load and all doses; None where they cannot be solved."""
    one = with_part(scene, "numerics", window_mm=None, tolerance=_TOLERANCE)
    one = with_part(one, "load", normal_n=factor * scene.load_at(0.0), tangential_n=None)
    # a held contact is solved without its shear, which follows from the pressures
    if is_held(scene):
        one = one.model_copy(update={"friction": None})
    if scene.wear is not None and worn:
        distances = tuple(float(scene.wear.distances_m[-1] * dose) for dose in _DOSES)
        one = with_part(one, "wear", distances_m=distances)
    try:
        surfaces = [state.surface for state in scene_states(one)]
    except PhysicsError:
        return None
    return [s for s in surfaces if s is not None]


def _series(state: SurfaceState) -> Array:
    """ln a, c/a, and g_0 = 1, g_1, ...: moments of the pressure with U_n."""
    left, right = state.edges_mm
    half = 0.5 * (right - left)
    place = np.clip((state.grid.x_mm - 0.5 * (left + right)) / half, -1.0, 1.0)
    polynomials = [np.ones_like(place), 2.0 * place]
    while len(polynomials) < _TERMS:
        polynomials.append(2.0 * place * polynomials[-1] - polynomials[-2])
    moments = np.array(polynomials) @ state.pressure_mpa
    return np.array([np.log(half), 0.5 * (left + right) / half, *(moments / moments[0])])


def _between(nodes: Array, at: Array) -> tuple[NDArray[np.intp], Array]:
    """The node below each value, and the fraction of the way to the next (beyond the ends too)."""
    if len(nodes) == 1:
        return np.zeros(len(at), dtype=np.intp), np.zeros(len(at))
    below = np.clip(np.searchsorted(nodes, at) - 1, 0, len(nodes) - 2)
    return below, (at - nodes[below]) / (nodes[below + 1] - nodes[below])


def _bilinear(
    table: Array, row: NDArray[np.intp], down: Array, col: NDArray[np.intp], along: Array
) -> Array:
    """Values between a table's (w, l[, k]) nodes; one node in a direction: no change along it."""
    shape = (-1,) + (1,) * (table.ndim - 2)
    down, along = down.reshape(shape), along.reshape(shape)
    last_row, last_col = table.shape[0] - 1, table.shape[1] - 1
    lower, right = np.minimum(row + 1, last_row), np.minimum(col + 1, last_col)
    upper = (1.0 - along) * table[row, col] + along * table[row, right]
    under = (1.0 - along) * table[lower, col] + along * table[lower, right]
    return np.asarray((1.0 - down) * upper + down * under)


_LONGEST = np.array([0.3, 0.2, 0.2, 0.5, 1.0, 0.05, 0.025])
"""Longest step in ln P, Q/P, mu, ln k, in fringes of bulk stress, in widths of the picture."""

_STEP = 1e-3
"""Difference step over the natural change: far above the noise of single precision."""

_STUCK = 1e5
_STEEPEST_FRICTION = 2.0
_RIDGE = 1e-9


class Misfit(NamedTuple):
    """Of m signals: `chi` (m,), residual over noise; coefficients `light` (m, ka), `dark` (m, kc).

    chi is inf where the light's mean over the pixels is negative: another contrast than the
    frame's.
    """

    chi: Array
    light: Array
    dark: Array


class SearchPixels:
    """Pixels of one frame: `data` (n,), `light` (ka, n), `dark` (kc, n), all over the noise."""

    def __init__(
        self,
        frame: FrameData,
        scene: Scene,
        make_field: Callable[[PixelGrid, Mask], Field],
        usable: Mask,
        stride: int,
    ) -> None:
        """Every `stride`-th of the `usable` pixels (rows, cols); see `field_maker`."""
        thin, keep = frame.every(stride), usable[::stride, ::stride]
        weight = 1.0 / thin.sigma[keep]
        self.data = thin.light[keep] * weight
        self.light = np.ascontiguousarray(thin.illumination[:, keep] * weight)
        self.dark = np.ascontiguousarray(thin.background[:, keep] * weight)
        self.field = make_field(pixel_grid(scene, frame.shape).every(stride), keep)
        self.optics = scene_optics(scene)
        self._pairs = list(combinations_with_replacement(range(len(self.light)), 2))
        self._square = np.array([self.light[i] * self.light[j] for i, j in self._pairs]).T.copy()
        cross = self.light[:, None] * np.concatenate((self.dark, self.data[None]))
        self._cross = cross.reshape(-1, self.size).T.copy()
        self._dark_gram, self._dark_right = self.dark @ self.dark.T, self.dark @ self.data
        self._energy = float(self.data @ self.data)

    @property
    def size(self) -> int:
        """Number of pixels n."""
        return self.data.size

    def signal_of(self, theta: Array) -> Array:
        """Polariscope signals (m, n), 0..1, of rows θ (m, 7)."""
        return self.optics.signal(self.field.difference(theta))

    def misfit(self, signal: Array) -> Misfit:
        """How well signals (m, n) explain the pixels, with the best light for each."""
        ka, kc, m = len(self.light), len(self.dark), len(signal)
        square = (signal * signal) @ self._square
        cross = (signal @ self._cross).reshape(m, ka, kc + 1)
        gram = np.empty((m, ka + kc, ka + kc))
        for column, (i, j) in enumerate(self._pairs):
            gram[:, i, j] = gram[:, j, i] = square[:, column]
        gram[:, :ka, ka:] = cross[..., :kc]
        gram[:, ka:, :ka] = cross[..., :kc].swapaxes(1, 2)
        gram[:, ka:, ka:] = self._dark_gram
        diagonal = np.arange(ka + kc)
        gram[:, diagonal, diagonal] *= 1.0 + _RIDGE
        gram[:, diagonal, diagonal] += _RIDGE * self._dark_gram[0, 0]
        right = np.empty((m, ka + kc))
        right[:, :ka], right[:, ka:] = cross[..., kc], self._dark_right
        result = np.linalg.solve(gram, right[..., None])[..., 0]
        cost = np.maximum(self._energy - np.einsum("mk,mk->m", result, right), 0.0)
        bright = result[:, :ka] @ self.light.mean(axis=1) > 0.0
        chi = np.sqrt(cost / max(1, self.size - ka - kc))
        return Misfit(np.where(bright, chi, np.inf), result[:, :ka], result[:, ka:])


@dataclass(frozen=True)
class Space:
    """What may move in a row θ: indices `free` (p,); `held`, whether shear is below friction's.

    `size` (7,), a natural change of each: 1, one fringe of bulk stress, the picture's width.
    """

    free: NDArray[np.intp]
    size: Array
    held: bool

    def allowed(self, theta: Array) -> Array:
        """Rows θ (m, 7) brought back to where friction holds them."""
        theta[:, FRICTION] = np.clip(theta[:, FRICTION], -_STEEPEST_FRICTION, _STEEPEST_FRICTION)
        if self.held:
            friction = np.abs(theta[:, FRICTION])
            if FRICTION in self.free:
                friction = np.maximum(friction, np.abs(theta[:, SHEAR]) / SLIPPING)
                theta[:, FRICTION] = friction
            theta[:, SHEAR] = np.clip(theta[:, SHEAR], -SLIPPING * friction, SLIPPING * friction)
        return theta


class Descended(NamedTuple):
    """Where starts led: rows `theta` (m, 7), `chi` (m,); `gain` (m,), mean light over noise.

    `sound` (m,), False where more than a few pixels' light came out negative.
    """

    theta: Array
    chi: Array
    gain: Array
    sound: Mask

    def rows(self, chosen: Any) -> Descended:
        """Some of them, by index."""
        return Descended(*(part[chosen] for part in self))

    def joined(self, other: Descended) -> Descended:
        """These and others."""
        return Descended(*map(np.concatenate, zip(self, other, strict=True)))

    @property
    def order(self) -> NDArray[np.intp]:
        """Indices by rising chi, the sound ones first."""
        return np.lexsort((self.chi, ~self.sound))


def descend(pixels: SearchPixels, starts: Array, space: Space, *, steps: int) -> Descended:
    """Take each start down to its minimum, by a few damped steps.

    Parameters: `pixels`; `starts` (m, 7); `space`, what may move; `steps`, how many are tried.
    Returns Descended, in the order of the starts.
    """
    theta = space.allowed(starts.copy())
    signal = pixels.signal_of(theta)
    here = pixels.misfit(signal)
    damping = np.full(len(theta), 1e-2)
    longest = (_LONGEST * space.size)[space.free]
    for _ in range(steps if space.free.size else 0):
        moving = np.flatnonzero((damping < _STUCK) & np.isfinite(here.chi))
        if not moving.size:
            break
        some = Misfit(*(part[moving] for part in here))
        normal, slope = _equations(pixels, theta[moving], signal[moving], some, space)
        diagonal = np.einsum("mjj->mj", normal)
        diagonal += 1e-9 * diagonal.max(axis=1, keepdims=True) + 1e-300
        step = damped_steps(normal, slope, damping[moving])
        trial = theta[moving]
        trial[:, space.free] += np.clip(step, -longest, longest)
        trial = space.allowed(trial)
        tried = pixels.signal_of(trial)
        there = pixels.misfit(tried)
        better = there.chi < here.chi[moving]
        damping[moving] = next_damping(damping[moving], better)
        # a step that changes nothing any more has arrived
        settled = better & (there.chi > (1.0 - 1e-5) * here.chi[moving])
        damping[moving[settled]] = _STUCK
        won = moving[better]
        theta[won], signal[won] = trial[better], tried[better]
        for old, new in zip(here, there, strict=True):
            old[won] = new[better]
    amplitude = here.light @ pixels.light
    sound = np.mean(amplitude <= 0.0, axis=1) <= MOSTLY
    return Descended(theta, here.chi, amplitude.mean(axis=1), sound & np.isfinite(here.chi))


def _equations(
    pixels: SearchPixels, theta: Array, signal: Array, here: Misfit, space: Space
) -> tuple[Array, Array]:
    """Normal equations (m, p, p) and gradient (m, p) of rows θ, light eliminated."""
    amplitude = here.light @ pixels.light
    moved = np.repeat(theta[:, None], space.free.size, axis=1)
    count = np.arange(space.free.size)
    change = _STEP * space.size[space.free]
    # inwards, where friction holds the shear
    inwards = np.where(space.free == FRICTION, -1.0, 1.0) if space.held else np.ones(count.size)
    change = np.where(theta[:, space.free] * inwards > 0.0, -change, change)
    moved[:, count, space.free] += change
    above = pixels.signal_of(moved.reshape(-1, theta.shape[1])).reshape(*moved.shape[:2], -1)
    rows = (above - signal[:, None]) * (amplitude[:, None] / change[..., None])
    residual = pixels.data - amplitude * signal - here.dark @ pixels.dark
    light = signal[:, None] * pixels.light
    dark = np.broadcast_to(pixels.dark, (len(theta), *pixels.dark.shape))
    linear = np.concatenate((light, dark), axis=1)
    gram = linear @ linear.swapaxes(1, 2)
    diagonal = np.einsum("mkk->mk", gram)
    diagonal += 1e-9 * diagonal.max(axis=1, keepdims=True)
    cross = linear @ rows.swapaxes(1, 2)
    normal = rows @ rows.swapaxes(1, 2) - cross.swapaxes(1, 2) @ np.linalg.solve(gram, cross)
    return normal, np.einsum("mpn,mn->mp", rows, residual)


def bulk_hops(theta: Array, space: Space) -> Array:
    """Starts (m, 7) a half and a whole fringe of bulk stress away from rows θ.

    There lie a fringe pattern's nearest rivals: far from the contact bulk stress adds a constant.
    """
    if BULK not in space.free:
        return theta[:0]
    hops = np.array([-1.0, -0.5, 0.5, 1.0]) * space.size[BULK]
    starts = np.repeat(theta, len(hops), axis=0)
    starts[:, BULK] += np.tile(hops, len(theta))
    return starts
