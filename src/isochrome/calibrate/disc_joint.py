"""All images of a disc together: each its own order and place, one residual stress for all.

Least squares on the intensities with each image's light eliminated (variable projection, see
`isochrome.fit`); Levenberg and Marquardt move centre order, centre, radius and load direction of
each image, and the shared coefficients of the residual stress (`disc_residual`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibrate.disc_field import Grid, disc_mask, thin_grid
from isochrome.calibrate.disc_residual import Complexes, Form, load_field
from isochrome.calibrate.rim import Circle
from isochrome.calibrate.shot import Shot
from isochrome.fit import polynomial_basis
from isochrome.fit.linear import LinearPart, Problem, prepare, scaled_inverse, solve_linear

Array = NDArray[np.float64]

OWN = 5
"""Unknowns of each image: centre order, row, column, radius, angle of the loads."""

STEPS = np.array([1e-4, 2e-3, 2e-3, 2e-3, 1e-5])
"""Steps of the differences in an image's own unknowns (fringes, px, rad)."""

LARGEST = np.array([0.3, 0.03, 0.03, 0.03, 0.05])
"""Largest move of an image's own unknowns in one step (fringes, radii, rad)."""


@dataclass(frozen=True)
class Picture:
    """One image in the joint fit: its pixels `rows`, `cols` (n,), its linear `problem`, the
    residual's members `basis` (k, n) there, and whether it is loaded (its own unknowns are free).
    """

    shot: Shot
    grid: Grid
    rows: Array
    cols: Array
    problem: Problem
    basis: Complexes
    loaded: bool


@dataclass(frozen=True)
class JointDisc:
    """A joint fit: `own` (n, 5) and `coefficients` (k,) of the residual `form`, each image's
    linear `parts`, `normal` equations (p, p) over own then shared unknowns, and `converged`.
    """

    pictures: tuple[Picture, ...]
    form: Form
    bright: bool
    own: Array
    coefficients: Array
    parts: tuple[LinearPart, ...]
    normal: Array
    converged: bool

    @property
    def cost(self) -> float:
        """Chi-square over all images."""
        return sum(part.cost for part in self.parts)

    @property
    def pixels(self) -> int:
        """Valid pixels over all images."""
        return sum(p.problem.size for p in self.pictures)

    @property
    def chi(self) -> Array:
        """Each image's root mean square residual in units of its noise, (n,)."""
        return np.array(
            [
                np.sqrt(part.cost / (p.problem.size - len(part.coefficients)))
                for part, p in zip(self.parts, self.pictures, strict=True)
            ]
        )

    def order(self, index: int) -> Array:
        """Fringe order of one image at its valid pixels (m,)."""
        picture = self.pictures[index]
        return np.abs(_field(picture, self.form, self.own[index], self.coefficients)[1])

    @property
    def explained(self) -> Array:
        """Share of each image's variation that the fit explains, (n,)."""
        shares = [
            1.0 - np.var(part.residual) / np.var(p.problem.data)
            for part, p in zip(self.parts, self.pictures, strict=True)
        ]
        return np.array(shares)


def make_pictures(
    shots: Sequence[Shot],
    own: Array,
    form: Form,
    *,
    pixels: int,
    degrees: tuple[int, int],
    light: ArrayLike | None = None,
) -> tuple[Picture, ...]:
    """The images on thinned grids about where their discs are.

    Parameters: `shots` (n,); `own` (n, 5), see OWN (an order of 0: no load); `form` of the
    residual; `pixels` of the square about each disc; `degrees` of the polynomials of illumination
    and background; `light` (rows, cols), the no-load bright minus dark frame. Returns Pictures.
    """
    pictures = []
    for shot, values in zip(shots, own, strict=True):
        _, row, col, radius, _ = values
        grid = thin_grid(shot.image.shape, Circle(row, col, radius, 0.0), pixels)
        pick = np.ix_(grid.rows[:, 0].astype(int), grid.cols[0].astype(int))
        mask = shot.mask[pick] & disc_mask(grid, values)
        shape = (mask.shape[0], mask.shape[1])
        times = None if light is None else np.asarray(light, dtype=float)[pick]
        problem = prepare(
            shot.image[pick],
            mask=mask,
            sigma=shot.sigma[pick],
            illumination=polynomial_basis(shape, degrees[0], times=times),
            background=polynomial_basis(shape, degrees[1]),
        )
        rows = np.broadcast_to(grid.rows, shape)[problem.keep]
        cols = np.broadcast_to(grid.cols, shape)[problem.keep]
        basis = form.basis((cols - col) / radius, (rows - row) / radius)
        pictures.append(Picture(shot, grid, rows, cols, problem, basis, bool(values[0] > 0)))
    return tuple(pictures)


def fit_joint(
    pictures: tuple[Picture, ...],
    form: Form,
    own: Array,
    coefficients: Array,
    *,
    bright: bool = False,
    iterations: int = 40,
) -> JointDisc:
    """Fit all pictures together from a start.

    Parameters: `pictures` (n,); `form`; `own` (n, 5) and `coefficients` (k,), the start;
    `bright`, for a bright field; `iterations` at the most. Returns the JointDisc.
    """
    now = evaluate_joint(pictures, form, bright, own, coefficients)
    damping, growth = 1e-3, 2.0
    normal, gradient = _equations(now)
    for _ in range(iterations):
        step = _step(now, normal, gradient, damping)
        gain = float(step @ (2.0 * gradient - normal @ step))
        if abs(gain) < 1e-3 * max(1.0, now.cost / now.pixels):
            return _with(now, normal, converged=True)
        trial = evaluate_joint(pictures, form, bright, *_moved(now, step))
        if trial.cost < now.cost and all(p.positive for p in trial.parts):
            ratio = (now.cost - trial.cost) / max(gain, 1e-300)
            damping, growth = damping * max(1e-2, 1.0 - (2.0 * ratio - 1.0) ** 3), 2.0
            now = trial
            normal, gradient = _equations(now)
        else:
            damping, growth = damping * growth, growth * 2.0
    return _with(now, normal, converged=False)


def jacobian(fit: JointDisc, index: int) -> Array:
    """Weighted derivatives of one image by its own unknowns and the shared ones, (5 + k, n)."""
    picture, part = fit.pictures[index], fit.parts[index]
    h, total = _field(picture, fit.form, fit.own[index], fit.coefficients)
    order = np.abs(total)
    # d sin^2(pi N)/dN over N, which stays smooth where the order vanishes
    slope = 2.0 * np.pi**2 * np.sinc(2.0 * order) * (-1.0 if fit.bright else 1.0)
    rows = np.zeros((OWN + len(fit.coefficients), picture.problem.size))
    rows[0] = slope * total.real * h
    for j in range(1, OWN):
        moved = fit.own[index].copy()
        moved[j] += STEPS[j]
        rows[j] = (
            _signal(picture, fit.form, fit.bright, moved, fit.coefficients) - part.signal
        ) / STEPS[j]
    members = picture.basis if fit.form.along else picture.basis * _turn(picture, fit.own[index])
    rows[OWN:] = slope * (total.real * members.real + total.imag * members.imag)
    if not picture.loaded:
        rows[:OWN] = 0.0
    return rows * part.amplitude


def _turn(picture: Picture, own: Array) -> Complexes:
    return load_field(picture.rows, picture.cols, own[1:])[1]


def _field(
    picture: Picture, form: Form, own: Array, coefficients: Array
) -> tuple[Array, Complexes]:
    """h (n,) and the whole order as a complex number in the loads' directions (n,)."""
    h, turn = load_field(picture.rows, picture.cols, own[1:])
    residual = coefficients @ picture.basis
    return h, own[0] * h + (residual if form.along else turn * residual)


def _signal(picture: Picture, form: Form, bright: bool, own: Array, coefficients: Array) -> Array:
    wave = np.square(np.sin(np.pi * np.abs(_field(picture, form, own, coefficients)[1])))
    return np.asarray(1.0 - wave if bright else wave)


def evaluate_joint(
    pictures: tuple[Picture, ...], form: Form, bright: bool, own: Array, coefficients: Array
) -> JointDisc:
    """A joint fit's state where it stands, without a step; arguments as in `fit_joint`."""
    parts = tuple(
        solve_linear(p.problem, _signal(p, form, bright, values, coefficients))
        for p, values in zip(pictures, own, strict=True)
    )
    return JointDisc(pictures, form, bright, own, coefficients, parts, np.zeros((0, 0)), False)


def _with(fit: JointDisc, normal: Array, *, converged: bool) -> JointDisc:
    return replace(fit, normal=normal, converged=converged)


def _equations(fit: JointDisc) -> tuple[Array, Array]:
    """Normal equations with every image's light eliminated, and the gradient."""
    count, shared = len(fit.pictures), len(fit.coefficients)
    normal = np.zeros((OWN * count + shared,) * 2)
    gradient = np.zeros(len(normal))
    for i, (picture, part) in enumerate(zip(fit.pictures, fit.parts, strict=True)):
        rows = jacobian(fit, i)
        columns = np.concatenate((picture.problem.light * part.signal, picture.problem.dark))
        cross = rows @ columns.T
        block = rows @ rows.T - cross @ part.inverse @ cross.T
        place = np.r_[OWN * i : OWN * (i + 1), OWN * count : OWN * count + shared]
        normal[np.ix_(place, place)] += block
        gradient[place] += rows @ part.residual
    return normal, gradient


def _step(fit: JointDisc, normal: Array, gradient: Array, damping: float) -> Array:
    """The damped step, shortened where an image would move too far at once."""
    matrix = normal + damping * np.diag(np.diag(normal))
    step = scaled_inverse(matrix, 1e-14) @ gradient
    own = step[: OWN * len(fit.pictures)].reshape(-1, OWN)
    limit = LARGEST * np.where([False, True, True, True, False], fit.own[:, 3:4], 1.0)
    worst = float(np.max(np.abs(own) / limit))
    return np.asarray(step / max(1.0, worst))


def _moved(fit: JointDisc, step: Array) -> tuple[Array, Array]:
    split = OWN * len(fit.pictures)
    return fit.own + step[:split].reshape(-1, OWN), fit.coefficients + step[split:]
