"""Stress fields at a few hundred pixels for many sets of values at once: the model of a search.

A set of values is a row θ of seven numbers, see `THETA`; a field takes (m, 7) and gives (m, n).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from isochrome.contact.course import wear_rate
from isochrome.fit.search_pressure import PressureTable, pressure_table
from isochrome.scene import Scene
from isochrome.stress import PixelGrid, RegularStress, beam_difference, disc_difference
from isochrome.stress.block import block_series, block_sides

Array = NDArray[Any]

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


class Field(Protocol):
    """Stress differences at n pixels for rows θ."""

    def difference(self, theta: Array) -> Array:
        """(sigma_x - sigma_z) + 2i tau_xz (m, n), MPa, for θ (m, 7)."""


class ContactField:
    """A half-plane under a contact, its pressure from a table, its shear by friction.

    conj D = (2/π) [z F_p' - F_q - i z F_q'] + bulk, F_p and F_q the transforms of pressure and
    shear: q = mu p where it slides, q = mu [p(P) - p(P - |Q|/mu)] where it is held (Jäger 1998;
    Ciavarella 1998). A block's sides add what they add to a half-plane, by the two forces.
    Source: Muskhelishvili (1953), Singular Integral Equations; Johnson (1985), section 2.4.
    """

    def __init__(
        self, scene: Scene, pixels: PixelGrid, keep: NDArray[np.bool_], table: PressureTable
    ) -> None:
        """`pixels`, the nominal ones; `keep` (rows, cols), which of them are wanted (n)."""
        assert scene.specimen.thickness_mm is not None
        row, col = np.nonzero(keep)
        self._x, self._z = pixels.pixel_mm * (col + 0.5), pixels.pixel_mm * (row + 0.5)
        # θ holds the place of the whole picture, whose pixels may be smaller
        self._shift = (pixels.left_mm, pixels.top_mm)
        self._table = table
        self._thickness = scene.specimen.thickness_mm
        self._held = scene.load is not None and scene.load.tangential_n is not None
        self._scene = scene
        self._here = theta_of(scene)
        self._rest = _changing_bulk(scene)
        sides = block_sides(scene)
        self._sides = block_series(sides).unit[:2] if sides else ()

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
        rate = wear_rate(wear.law, np.exp(theta[:, WEAR]), theta[:, FRICTION])
        own = wear_rate(wear.law, np.exp(self._here[WEAR]), self._here[FRICTION])
        return np.asarray(np.log(np.maximum(rate, 1e-9 * own) / own))


class BodyField:
    """A disc or a beam: its closed form at unit load, kept for the last places."""

    def __init__(self, scene: Scene, pixels: PixelGrid, keep: NDArray[np.bool_]) -> None:
        """`pixels`, the nominal ones; `keep` (rows, cols), which of them are wanted (n)."""
        self._scene = scene.with_values({"load.normal_n": 1.0})
        self._pixels, self._keep = pixels, keep
        self._here = theta_of(scene)
        self._solve = disc_difference if scene.model == "disc" else beam_difference
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
            field = self._solve(self._scene, grid)[self._keep]
            self._last = place, np.nan_to_num(field)
        return self._last[1]


def field_maker(scene: Scene) -> Callable[[PixelGrid, NDArray[np.bool_]], Field]:
    """The quick fields of a one-state scene; a contact's pressures are solved once for all.

    Parameters: `scene`, its place written out. Returns a function of `pixels`, thinned, and `keep`
    (rows, cols), which of them are wanted, that returns a Field. Raises PhysicsError where a
    contact cannot be solved at any load near the scene's.
    """
    if scene.model != "contact":
        return lambda pixels, keep: BodyField(scene, pixels, keep)
    table = pressure_table(scene)
    return lambda pixels, keep: ContactField(scene, pixels, keep, table)


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


def values_of(theta: Array, keys: tuple[str, ...]) -> dict[str, float]:
    """The values that a row θ gives to some of the keys in THETA."""
    load = float(np.exp(theta[LOAD]))
    found = {
        "load.normal_n": load,
        "load.tangential_n": float(theta[SHEAR]) * load,
        "wear.coefficient_mm2_per_n": float(np.exp(theta[WEAR])),
    }
    plain = {key: float(theta[i]) for i, key in enumerate(THETA)}
    return {key: found.get(key, plain[key]) for key in keys if key in THETA}


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
