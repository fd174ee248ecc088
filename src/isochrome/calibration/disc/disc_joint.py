"""All images of a disc together: each its own order and place, one residual stress for all.

Least squares on the intensities with each image's light eliminated (variable projection, see
`isochrome.estimation`); damped steps move centre order, centre, radius and direction of
each image, and the shared coefficients of the residual stress (`disc_residual`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.disc.disc_field import DiscPixels, disc_mask, squared_wave, thin_grid
from isochrome.calibration.disc.disc_residual import Complexes, ResidualForm, load_field
from isochrome.calibration.disc.disc_rim import Circle
from isochrome.calibration.shot import Shot
from isochrome.estimation import (
    Damping,
    LinearPart,
    SeparableProblem,
    minimise,
    prepare,
    smooth_light,
    solve_linear,
)

Array = NDArray[np.float64]

OWN = 5
"""Unknowns of each image: centre order, row, column, radius, angle of the loads."""

STEPS = np.array([1e-4, 2e-3, 2e-3, 2e-3, 1e-5])
"""Steps of the differences in an image's own unknowns (fringes, px, rad)."""

_MOST_STEPS = 40
_ENOUGH = 1e-3
"""Fall of chi-square, in units of the noise that is left, below which a step is the last."""

LARGEST = np.array([0.3, 0.03, 0.03, 0.03, 0.05])
"""Largest move of an image's own unknowns in one step (fringes, radii, rad)."""


@dataclass(frozen=True, kw_only=True)
class DiscImage:
    """One image in the joint fit: its pixels `rows`, `cols` (n,), its linear `problem`, and the
    members `basis` (k, n) there of the residual's `form`.
    """

    shot: Shot
    grid: DiscPixels
    rows: Array
    cols: Array
    problem: SeparableProblem
    form: ResidualForm
    basis: Complexes

    @property
    def loaded(self) -> bool:
        """Whether there is a load: its own unknowns are free."""
        return self.shot.load_n > 0

    def field(self, own: Array, coefficients: Array) -> tuple[Array, Complexes, Complexes | float]:
        """The loads' field h (n,), the whole order as a complex number in the loads' directions
        (n,), and how these see the residual.
        """
        h, turn = load_field(self.rows, self.cols, own[1:])
        seen = 1.0 if self.form.along else turn
        residual = coefficients @ self.basis
        return h, own[0] * h + seen * residual, seen

    def signal(self, own: Array, coefficients: Array) -> Array:
        """The ideal polariscope's 0..1 (n,)."""
        order = np.abs(self.field(own, coefficients)[1])
        return squared_wave(np.pi * order, self.shot.bright)


@dataclass(frozen=True)
class JointDisc:
    """A joint fit: `own` (n, 5) and `coefficients` (k,) of the residual `form`, each image's
    linear `parts`, and whether it `converged`.
    """

    pictures: tuple[DiscImage, ...]
    own: Array
    coefficients: Array
    parts: tuple[LinearPart, ...]
    converged: bool = False

    @property
    def form(self) -> ResidualForm:
        """The form of the residual, the same in all images."""
        return self.pictures[0].form

    @property
    def normal(self) -> Array:
        """Normal equations (p, p) over own then shared unknowns, the light's eliminated."""
        return self._equations[0]

    @property
    def gradient(self) -> Array:
        """The right side (p,) of these."""
        return self._equations[1]

    @cached_property
    def _equations(self) -> tuple[Array, Array]:
        """Normal equations with every image's light eliminated, and the gradient."""
        count, shared = len(self.pictures), len(self.coefficients)
        normal = np.zeros((OWN * count + shared,) * 2)
        gradient = np.zeros(len(normal))
        for i, (picture, part) in enumerate(zip(self.pictures, self.parts, strict=True)):
            rows = jacobian(self, i)
            columns = np.concatenate((picture.problem.light * part.signal, picture.problem.dark))
            cross = rows @ columns.T
            block = rows @ rows.T - cross @ part.inverse @ cross.T
            place = np.r_[OWN * i : OWN * (i + 1), OWN * count : OWN * count + shared]
            normal[np.ix_(place, place)] += block
            gradient[place] += rows @ part.residual
        return normal, gradient

    @property
    def cost(self) -> float:
        """Chi-square over all images."""
        return sum(part.cost for part in self.parts)

    @property
    def pixels(self) -> int:
        """Valid pixels over all images."""
        return sum(part.residual.size for part in self.parts)

    @property
    def chi(self) -> Array:
        """Each image's root mean square residual in units of its noise, (n,)."""
        return np.sqrt([p.cost / (p.residual.size - len(p.coefficients)) for p in self.parts])

    @property
    def explained(self) -> Array:
        """Share of each image's variation that the fit explains, (n,)."""
        shares = [
            1.0 - np.var(part.residual) / np.var(p.problem.data)
            for part, p in zip(self.parts, self.pictures, strict=True)
        ]
        return np.array(shares)


def make_pictures(
    shots: Sequence[Shot], own: Array, form: ResidualForm, *, pixels: int, degrees: tuple[int, int]
) -> tuple[DiscImage, ...]:
    """The images on thinned grids about where their discs are.

    Parameters: `shots` (n,); `own` (n, 5), see OWN (an order of 0: no load); `form` of the
    residual; `pixels` of the square about each disc; `degrees` of the polynomials of illumination
    and background.
    """
    pictures = []
    for shot, values in zip(shots, own, strict=True):
        _, row, col, radius, _ = values
        grid = thin_grid(shot.light.shape, Circle(row, col, radius, 0.0), pixels)
        mask = shot.valid[grid.pick] & disc_mask(grid, values)
        problem = prepare(
            shot.light[grid.pick],
            mask=mask,
            sigma=shot.sigma[grid.pick],
            **smooth_light(mask.shape, degrees, shot.lamp(*grid.pick)).bases,
        )
        rows, cols = (m[problem.keep] for m in np.broadcast_arrays(grid.rows, grid.cols))
        basis = form.basis((cols - col) / radius, (rows - row) / radius)
        pictures.append(
            DiscImage(
                shot=shot, grid=grid, rows=rows, cols=cols, problem=problem, form=form, basis=basis
            )
        )
    return tuple(pictures)


def fit_joint(pictures: tuple[DiscImage, ...], own: Array, coefficients: Array) -> JointDisc:
    """Fit all pictures together from a start.

    Parameters: `pictures` (n,); `own` (n, 5) and `coefficients` (k,), the start.
    """
    split = own.size

    def at(values: Array) -> JointDisc:
        places = values[:split].reshape(-1, OWN)
        return evaluate_joint(pictures, places, values[split:])

    def shortened(values: Array, step: Array) -> Array:
        """The step, shortened where an image would move too far at once."""
        radii = values[:split].reshape(-1, OWN)[:, 3:4]
        limit = LARGEST * np.where([False, True, True, True, False], radii, 1.0)
        worst = float(np.max(np.abs(step[:split].reshape(-1, OWN)) / limit))
        return np.asarray(step / max(1.0, worst))

    start = np.concatenate((own.ravel(), coefficients))
    result = minimise(
        at, start, at(start), damping=Damping(1e-3), iterations=_MOST_STEPS,
        enough=lambda fit: _ENOUGH * max(1.0, fit.cost / fit.pixels),
        better=lambda new, old: new.cost < old.cost and all(p.positive for p in new.parts),
        cut=shortened,
    )  # fmt: skip
    return replace(result.point, converged=result.converged)


def jacobian(fit: JointDisc, index: int) -> Array:
    """Weighted derivatives of one image by its own unknowns and the shared ones, (5 + k, n)."""
    picture, part = fit.pictures[index], fit.parts[index]
    h, total, seen = picture.field(fit.own[index], fit.coefficients)
    order = np.abs(total)
    # d sin^2(pi N)/dN over N, which stays smooth where the order vanishes
    slope = 2.0 * np.pi**2 * np.sinc(2.0 * order) * (-1.0 if picture.shot.bright else 1.0)
    rows = np.zeros((OWN + len(fit.coefficients), picture.problem.size))
    rows[0] = slope * total.real * h
    for j in range(1, OWN):
        moved = fit.own[index].copy()
        moved[j] += STEPS[j]
        rows[j] = (picture.signal(moved, fit.coefficients) - part.signal) / STEPS[j]
    members = picture.basis * seen
    rows[OWN:] = slope * (total.real * members.real + total.imag * members.imag)
    if not picture.loaded:
        rows[:OWN] = 0.0
    return rows * part.amplitude


def evaluate_joint(pictures: tuple[DiscImage, ...], own: Array, coefficients: Array) -> JointDisc:
    """A joint fit's state where it stands, without a step; arguments as in `fit_joint`."""
    parts = tuple(
        solve_linear(p.problem, p.signal(values, coefficients))
        for p, values in zip(pictures, own, strict=True)
    )
    return JointDisc(pictures, own, coefficients, parts)
