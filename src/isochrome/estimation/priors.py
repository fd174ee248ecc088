"""What is known beforehand, as priors or inputs of a budget, and when unknowns are worth having.

With J the derivatives of a model by its unknowns, and D by an input that is held, over the noise,
and P = diag(1/u²) of the unknowns that have a prior, the fit's values move by

    c = -(JᵀJ + P)⁻¹ Jᵀ D  of a held input,   c = (JᵀJ + P)⁻¹ P  of a stated unknown.

Sources: JCGM 100:2008 (GUM), 5.1 and 5.2, for u² = Σ (c u)²; JCGM 102:2011, 6.2, for the inputs of
an implicit model.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from isochrome.estimation.covariance import Array

POOR_CHI = 1.3
"""Residual over noise beyond which the model does not describe a frame within its noise.

The noise is estimated from the frame itself, to some 3 to 11 % of its standard deviation
(`isochrome.frames.linear`), and chi of a right model is off from 1 by as much. Three times that is
no accident of the estimate."""

GOOD_CHI = 1.03
"""Residual over noise up to which a model describes a frame: the noise is known to 1 or 2 %, and
slopes about what leaves no more tell what may be there besides."""

ALIKE_CHI = 1.05
"""Ratio of two minima's chi below which an image does not decide between them: a fraction of what
the noise's own estimate is off by, and what a small misfit of either model makes."""

RIVAL_CHI = 1.3
"""Ratio of two minima's chi below which a finer model may yet turn their order round: the search's
own model, or its fewer unknowns of light, do not decide between them."""


HALF = 0.5
"""Share of chi² - 1 that is left by what does not explain much."""


def is_explained(before: float, after: float, share: float) -> bool:
    """Whether chi² - 1, of residual over noise, fell below a share of what it was."""
    return after**2 - 1.0 < share * (before**2 - 1.0)


@dataclass(frozen=True)
class Prior:
    """Gaussian priors of a fit's unknowns (p,)."""

    values: Array
    weight: Array  # 1/u², 0 where nothing is stated

    @property
    def any(self) -> bool:
        """Whether anything is stated."""
        return bool(self.weight.any())

    @property
    def normal(self) -> Array:
        """What is added to the normal equations, (p, p)."""
        return np.diag(self.weight)

    def gradient(self, values: Array) -> Array:
        """What is added to their right side at some values, (p,)."""
        return np.asarray(self.weight * (self.values - values))

    def misfit(self, values: Array) -> tuple[Array, Array]:
        """1/u (p,), and how far the stated values are from some values, over u (p,)."""
        root = np.sqrt(self.weight)
        return root, root * (self.values - values)

    def cost(self, values: Array) -> float:
        """The sum of ((value - stated)/u)²."""
        return float(np.sum(self.weight * (self.values - values) ** 2))


def no_prior(count: int) -> Prior:
    """The prior of unknowns of which nothing is stated: no weights."""
    return Prior(np.zeros(count), np.zeros(count))


@dataclass(frozen=True, kw_only=True)
class BudgetInput:
    """What one input adds to the standard uncertainty of a value.

    Parameters
    ----------
    input : str
        Its key, or 'image noise'.
    value : float, optional
        Its stated value, None of noise.
    standard_uncertainty : float
        Its standard uncertainty; of noise, what it adds to the value.
    sensitivity : float
        Change of the value over that of the input.
    share : float
        Its part of the value's variance, 0 to 1.
    """

    input: str
    value: float | None
    standard_uncertainty: float
    sensitivity: float
    share: float

    @property
    def contribution(self) -> float:
        """What it adds, |c| u, in the value's unit."""
        return abs(self.sensitivity) * self.standard_uncertainty

    def to_json(self) -> dict[str, Any]:
        """Its fields by name."""
        return asdict(self)


BudgetRow = tuple[str, float | None, float, float]

NOISE = "image noise"
"""How a budget calls what the images' noise adds."""


def variance_shares(contributions: Array) -> Array:
    """The part of a variance that each standard uncertainty is; 0 where nothing contributes."""
    squares = np.square(np.asarray(contributions, dtype=float))
    total = float(squares.sum())
    return np.asarray(squares / total if total > 0.0 else squares)


def less_explained(
    residual: Array, rows: Array, inverse: Array, held: Array, spread: Array
) -> Array:
    """Take off residuals r (n,) what errors of inputs that a fit holds explain of them. r - Hᵀ δ, δ
    = argmin |r - Hᵀ δ|² + Σ (δ/u)², H = `held` (m, n) less what the unknowns, `rows` (p, n),
    follow; all over the noise. The inputs' own share of the uncertainty counts this, and noise is
    what is left. Source: Tarantola (2005), Inverse problem theory, section 3.2, for δ.
    """
    if not len(held):
        return residual
    reduced = (held - ((held @ rows.T) @ inverse).astype(held.dtype) @ rows) * spread[:, None]
    normal = (reduced @ reduced.T).astype(float) + np.eye(len(held))
    return np.asarray(
        residual - np.linalg.solve(normal, (reduced @ residual).astype(float)) @ reduced
    )


def budgets_of(
    noise: Array, inputs: tuple[tuple[str, float, float], ...], sensitivity: Array
) -> tuple[tuple[BudgetInput, ...], ...]:
    """Budgets of values (p,), none without inputs; `sensitivity` (p, m), NaN: not an input of a
    value.
    """
    if not inputs:
        return ((),) * len(noise)
    budgets = []
    for noise_of, row in zip(noise.tolist(), sensitivity.tolist(), strict=True):
        items = [(*one, c) for one, c in zip(inputs, row, strict=True) if not np.isnan(c)]
        budgets.append(budget_items([(NOISE, None, noise_of, 1.0), *items]))
    return tuple(budgets)


def budget_items(rows: Sequence[BudgetRow]) -> tuple[BudgetInput, ...]:
    """The budget of inputs, the largest share first; NaN shares where a part is not finite."""
    parts = np.array([u * c for _, _, u, c in rows])
    shares = variance_shares(parts) if np.all(np.isfinite(parts)) else np.full(len(rows), np.nan)
    items = [
        BudgetInput(input=key, value=value, standard_uncertainty=u, sensitivity=c, share=float(s))
        for (key, value, u, c), s in zip(rows, shares, strict=True)
    ]
    return tuple(sorted(items, key=lambda item: -item.share))
