r"""The dark and the bright end of a frame without no-load frames, from its fringes alone.

The light is I = D (1 - s) + B s, s = sin² pi N, with D and B slowly varying over the frame:
polynomials of the place. Each patch (see `fringes.patches`) has a quadratic N of its own, so that
the ends are what all patches together leave open. They are found by Gauss-Newton steps on all
unknowns at once, of which the patches' are eliminated patch by patch (Schur complement): a step in
the ends is thus taken with every patch following it, and few are needed. Where a patch spans no
crest its order follows any change of the ends, and it says nothing of them.
Source: Golub & Pereyra (1973), SIAM J. Numer. Anal. 10, 413, for the elimination.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isochrome.errors import InputError
from isochrome.fringes.patches import (
    TURN,
    Array,
    Mask,
    PatchLight,
    binned,
    fit_patches,
    gather_patches,
    offsets,
    patch_basis,
    patch_prior,
)

_BINNINGS = (4, 2, 1)
"""The ends vary slowly: binned pixels tell as much, sixteen times as fast."""
_LEAST_PIXELS = 100
"""Binned pixels that the shorter side of a frame needs: eight patches or so."""
_LEAST_PATCHES = 12
_DEGREE = 2
_LOW, _HIGH = 1.0, 99.0
"""Percentiles of the light at which the search for the ends starts: both occur in a frame that
holds at least one whole fringe."""
_ROUNDS, _STILL = 15, 3e-4
_WORST_CHI = 30.0
_FAINT = 0.1
_SMOOTH = 0.5
"""Prior of a polynomial's terms beyond the constant, over the contrast."""


@dataclass(frozen=True)
class Ends:
    """Light of the dark and the bright end (rows, cols), and whether the search came to rest."""

    dark: Array
    bright: Array
    settled: bool


def fit_ends(
    light: Array,
    sigma: Array,
    valid: Mask,
    *,
    dark: Array | None = None,
    bright: Array | None = None,
) -> Ends:
    """Find the dark and bright ends of a frame in which both occur.

    Parameters: `light` I (rows, cols), linear; `sigma`, its noise (rows, cols); `valid`, True =
    trusted; `dark`, `bright` (rows, cols), the one end that a no-load frame gives, if any.
    Returns the Ends. Raises InputError where the frame has no contrast, or no fringe that can be
    followed.
    """
    by = next((b for b in _BINNINGS if min(light.shape) // b >= _LEAST_PIXELS), 1)
    small, noise, whole = binned(light, sigma, valid, by)
    if not whole.any():
        raise InputError("no part of the frame is trusted; check its mask and exposure")
    low, high = np.percentile(small[whole], [_LOW, _HIGH])
    if not high > low:
        raise InputError("the frame has no contrast; is the light on, and the specimen loaded?")
    shape = binned_polynomials(light.shape, _DEGREE, by)
    starts = ((dark, low), (bright, high))
    bases = [shape if end is None else _binned_end(end, valid, by) for end, _ in starts]
    terms = [
        np.eye(shape.shape[-1])[0] * start if end is None else np.ones(1) for end, start in starts
    ]
    free = np.repeat([dark is None, bright is None], [len(t) for t in terms])
    joined, settled = np.concatenate(terms), False
    for _ in range(_ROUNDS):
        step = _step(small, noise, whole, bases, joined, free, high - low)
        joined = joined + step
        if np.abs(step).max() < _STILL * (high - low):
            settled = True
            break
    full, cut = binned_polynomials(light.shape, _DEGREE, 1), len(terms[0])
    return Ends(
        full @ joined[:cut] if dark is None else dark,
        full @ joined[cut:] if bright is None else bright,
        settled,
    )


def _binned_end(end: Array, valid: Mask, by: int) -> Array:
    """A known end as the one term of its own, on binned pixels."""
    return binned(end, np.ones_like(end), valid, by)[0][..., None]


def binned_polynomials(shape: tuple[int, ...], degree: int, by: int) -> Array:
    """Products of powers of the place up to a degree, at a frame's binned pixels.

    Parameters: `shape` (rows, cols) of the whole frame, over which the place runs from -1 to 1;
    `degree`; `by`, pixels a bin. Returns (rows // by, cols // by, terms).
    """
    y, x = (2.0 * (by * np.arange(n // by) + 0.5 * (by - 1)) / max(n - 1, 1) - 1.0 for n in shape)
    return np.stack(
        [
            y[:, None] ** i * x[None, :] ** j
            for i in range(degree + 1)
            for j in range(degree + 1 - i)
        ],
        axis=-1,
    )


def _step(
    light: Array,
    sigma: Array,
    valid: Mask,
    bases: list[Array],
    terms: Array,
    free: Mask,
    scale: float,
) -> Array:
    """One Gauss-Newton step of the ends, every patch following."""
    count = bases[0].shape[-1]
    dark, bright = bases[0] @ terms[:count], bases[1] @ terms[count:]
    contrast = bright - dark
    seen = valid & (contrast > _FAINT * scale)
    safe = np.where(seen, contrast, scale)
    frame = 1.0 - 2.0 * (light - dark) / safe, 2.0 * sigma / safe, seen
    cut: PatchLight = gather_patches(*frame)
    patches = fit_patches(cut, *frame)
    chi = patches.chi.ravel()
    use = np.flatnonzero((chi < _WORST_CHI) & (patches.filled.ravel() > 0.6))
    if len(use) < _LEAST_PATCHES:
        raise InputError(
            "too few fringes can be followed to find background and illumination from them; give "
            "both no-load frames"
        )
    dy, dx, _ = offsets()
    places = np.stack(np.meshgrid(patches.rows, patches.cols, indexing="ij"), axis=-1)
    rows, cols = (places.reshape(-1, 2)[use, k][:, None] + d for k, d in enumerate((dy, dx)))
    basis = patch_basis()
    angle = TURN * (patches.terms.reshape(-1, 6)[use] @ basis.T)
    signal = (0.5 - 0.5 * np.cos(angle))[..., None]
    # a patch that no quadratic describes counts for less
    noise = sigma[rows, cols] * np.maximum(chi[use], 1.0)[:, None]
    weight = cut.weight[use] / noise**2
    by_ends = np.concatenate(
        [bases[0][rows, cols] * (1.0 - signal), bases[1][rows, cols] * signal], axis=-1
    )
    by_patch = (safe[rows, cols] * np.pi * np.sin(angle))[..., None] * basis
    residual = light[rows, cols] - by_ends @ terms
    smooth = np.where(np.isin(np.arange(len(terms)), (0, count)), 0.0, (_SMOOTH * scale) ** -2)
    step = np.zeros(len(terms))
    step[free] = _eliminated(
        weight, residual, by_ends[..., free], by_patch, terms[free], smooth[free]
    )
    return step


def _eliminated(
    weight: Array,
    residual: Array,
    by_ends: Array,
    by_patch: Array,
    terms: Array,
    prior: Array,
) -> Array:
    """Solve the normal equations for the ends, the patches' own terms eliminated."""
    transposed = (weight[..., None] * by_patch).swapaxes(1, 2)  # (p, 6, k)
    own = transposed @ by_patch + np.diag(patch_prior() + 1e-3)
    mixed = transposed @ by_ends
    pull = (transposed @ residual[..., None])[..., 0]
    solved = np.linalg.solve(own, np.concatenate([mixed, pull[..., None]], axis=-1))
    flat = by_ends.reshape(-1, by_ends.shape[-1])
    weighted = flat * weight.reshape(-1, 1)
    matrix = weighted.T @ flat - np.einsum("pij,pik->jk", mixed, solved[..., :-1])
    slope = weighted.T @ residual.ravel() - np.einsum("pij,pi->j", mixed, solved[..., -1])
    matrix = matrix + np.diag(prior) + 1e-2 * np.diag(np.diag(matrix))
    return np.asarray(np.linalg.solve(matrix, slope - prior * terms))
