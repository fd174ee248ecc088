"""Phase steps as linear equations: what the light says of δ and θ, for any angles and plates.

The light of a step is I = C + A [|α|² cos²(δ/2) + |w|² sin²(δ/2) - Im(α w*) sin δ] with
w = β cos 2θ + γ sin 2θ, and α, β, γ of its elements alone. Written out, it is linear in C, A,
A cos δ, A (1 - cos δ) (cos 4θ, sin 4θ) and A sin δ (cos 2θ, sin 2θ), so that one small matrix takes
the images of all steps to these seven maps, exactly, with unmatched plates as with ideal ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.fringes.windows import Array
from isochrome.optics import Chain

BACKGROUND, AMPLITUDE, COSINE, CROSS, CROSS_SINE, SINE, SINE_SINE = range(7)

_WEAKEST = 0.1
"""Singular value below which unknowns count as not told apart: noise grows tenfold there."""

_NOISIEST = 0.02
"""The same where nothing can be left out: better told with fifty times the noise than not."""

_LEAK = 0.1
"""Of what is left out, in what is solved for: more would not be taken out by the second pass."""

_SETS = (
    tuple(range(7)),
    (BACKGROUND, COSINE, CROSS, CROSS_SINE, SINE, SINE_SINE),
    (BACKGROUND, AMPLITUDE, COSINE, SINE, SINE_SINE),
    (BACKGROUND, COSINE, SINE, SINE_SINE),
)
"""What is solved for, the fullest set first that the steps tell apart."""

_PASSES = 4
"""Each takes out what the one before left, but for a share of the size of the elements' errors."""

_ADVICE = {
    COSINE: "cos δ (add the circular dark and bright fields: polariser_deg = 90, input_plate_deg = "
    "45, output_plate_deg = -45 and analyser_deg = 0 and 90)",
    SINE: "sin δ cos 2θ (add polariser_deg = 90, input_plate_deg = 45, with output_plate_deg and "
    "analyser_deg both 45, and both 135)",
    SINE_SINE: "sin δ sin 2θ (add polariser_deg = 90, input_plate_deg = 45, with output_plate_deg "
    "and analyser_deg both 0, and both 90)",
}


@dataclass(frozen=True)
class StepDesign:
    """The equations of a set of steps.

    `matrix` (steps, 7), over C, A, A cos δ, A (1 - cos δ) cos 4θ, A (1 - cos δ) sin 4θ,
    A sin δ cos 2θ, A sin δ sin 2θ; `solved`, the columns that the steps tell apart; `inverse`
    (solved, steps), the least-squares solution; `covariance` (solved, solved) of the solution for
    unit noise.
    """

    matrix: Array
    solved: tuple[int, ...]
    inverse: Array
    covariance: Array

    @property
    def left(self) -> list[int]:
        """The unknowns that are not solved for."""
        return [j for j in range(7) if j not in self.solved]

    @property
    def leak(self) -> float:
        """The largest share of what is not solved for in what is, the background apart."""
        return float(np.abs(self.inverse[1:] @ self.matrix[:, self.left]).max(initial=0.0))

    @property
    def leaks(self) -> bool:
        """Whether what is not solved for changes what is, the background apart."""
        return self.leak > 1e-9

    def variance(self, first: int, second: int | None = None) -> float:
        """Covariance of two solved unknowns (or one's variance) for unit noise."""
        i = self.solved.index(first)
        return float(self.covariance[i, i if second is None else self.solved.index(second)])


@dataclass(frozen=True)
class StepTerms:
    """The maps (rows, cols) that a set of steps gives, in the light's unit.

    `amplitude` A, `cosine` A V cos δ, `sine` A V sin δ exp 2iθ (complex), `cross`
    A (1 - V cos δ) exp 4iθ (complex, None where the steps do not give it), with V the contrast that
    a pixel's area leaves. A is taken with V = 1 where the steps do not give it.
    """

    amplitude: Array
    cosine: Array
    sine: NDArray[np.complexfloating]
    cross: NDArray[np.complexfloating] | None


def step_row(chain: Chain) -> list[float]:
    """The coefficients of one step's light over the seven unknowns of `StepDesign`.

    |w|² = (|β|² + |γ|²)/2 + (|β|² - |γ|²)/2 cos 4θ + Re(β γ*) sin 4θ in I above. Source: as for
    `isochrome.optics.polariscope`; expanded here.
    """
    a, b, c = abs(chain.alpha) ** 2, abs(chain.beta) ** 2, abs(chain.gamma) ** 2
    mean = 0.5 * (b + c)
    return [
        1.0,
        0.5 * (a + mean),
        0.5 * (a - mean),
        0.25 * (b - c),
        0.5 * (chain.beta * np.conj(chain.gamma)).real,
        -(chain.alpha * np.conj(chain.beta)).imag,
        -(chain.alpha * np.conj(chain.gamma)).imag,
    ]


def make_design(chains: Sequence[Chain]) -> StepDesign:
    """The equations of a set of steps, of the unknowns that they tell apart, and their solution.

    Background and amplitude, and 4θ, are left out where the steps do not give them: six circular
    steps need neither. InputError, with the steps to add, where cos δ or sin δ cannot be told.
    """
    matrix = np.array([step_row(chain) for chain in chains]).reshape(-1, 7)
    for solved, weakest in (*((columns, _WEAKEST) for columns in _SETS), (_SETS[0], _NOISIEST)):
        part = matrix[:, solved]
        if np.linalg.matrix_rank(part, tol=weakest) < len(solved):
            continue
        inverse = np.linalg.pinv(part)
        design = StepDesign(matrix, solved, inverse, inverse @ inverse.T)
        # what leaks into the background alone does no harm: it is not used
        if design.leak < _LEAK:
            return design
    raise InputError(
        "polariscope_step_steps_do", chains_count=len(chains), missing=_missing(matrix)
    )


def _missing(matrix: Array) -> str:
    """The unknowns that the steps do not resolve, each with the steps that would."""
    columns = _SETS[-1]
    _, values, right = np.linalg.svd(matrix[:, columns], full_matrices=False)
    determined = right[values > _WEAKEST]
    resolved = (determined**2).sum(axis=0)
    poor = [j for j, r in zip(columns, resolved, strict=True) if j in _ADVICE and r < 0.9]
    return ", nor ".join(_ADVICE[j] for j in poor or _ADVICE)


def solve_steps(stack: Array, design: StepDesign, direction: Array | None = None) -> StepTerms:
    """Least squares of every pixel's light over the steps, one product of matrices.

    Where the steps do not tell 4θ or A apart but depend on them a little (misaligned elements), a
    second pass takes that out, with the first pass's amplitude and `direction` exp 2iθ (rows,
    cols), complex, up to its sign.
    """
    shape = stack.shape[1:]
    light = np.ascontiguousarray(stack).reshape(len(stack), -1)
    inverse = design.inverse.astype(light.dtype)
    terms = _terms((inverse @ light).reshape(-1, *shape), design)
    if direction is None or not design.leaks:
        return terms
    unsolved = design.matrix[:, design.left]
    for _ in range(_PASSES):
        cross = (terms.amplitude - terms.cosine) * direction**2
        maps = {AMPLITUDE: terms.amplitude, CROSS: cross.real, CROSS_SINE: cross.imag}
        unsolved_maps = np.stack([maps[j] for j in design.left]).reshape(unsolved.shape[1], -1)
        solved = inverse @ (light - unsolved.astype(light.dtype) @ unsolved_maps)
        terms = _terms(solved.reshape(-1, *shape), design)
    return terms


def _terms(maps: Array, design: StepDesign) -> StepTerms:
    solved = dict(zip(design.solved, maps, strict=True))
    sine = solved[SINE] + 1j * solved[SINE_SINE]
    cross = solved[CROSS] + 1j * solved[CROSS_SINE] if CROSS in solved else None
    amplitude = solved.get(AMPLITUDE, np.sqrt(solved[COSINE] ** 2 + np.abs(sine) ** 2))
    return StepTerms(amplitude, solved[COSINE], sine, cross)
