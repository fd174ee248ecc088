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

BINNING = 4
"""The ends vary slowly: binned pixels tell as much, sixteen times as fast."""
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


def fit_ends(light: Array, sigma: Array, valid: Mask) -> Ends:
    """Find the dark and bright ends of a frame in which both occur.

    Parameters: `light` I (rows, cols), linear; `sigma`, its noise (rows, cols); `valid`, True =
    trusted. Returns the Ends. Raises InputError where the frame has no contrast.
    """
    small, noise, whole = binned(light, sigma, valid, BINNING)
    if not whole.any():
        raise InputError("no part of the frame is trusted; check its mask and exposure")
    low, high = np.percentile(small[whole], [_LOW, _HIGH])
    if not high > low:
        raise InputError("the frame has no contrast; is the light on, and the specimen loaded?")
    shape = binned_polynomials(light.shape, _DEGREE, BINNING)
    count = shape.shape[-1]
    terms = np.zeros(2 * count)
    terms[0], terms[count] = low, high
    settled = False
    for _ in range(_ROUNDS):
        step = _step(small, noise, whole, shape, terms, high - low)
        terms = terms + step
        if np.abs(step).max() < _STILL * (high - low):
            settled = True
            break
    full = binned_polynomials(light.shape, _DEGREE, 1)
    return Ends(full @ terms[:count], full @ terms[count:], settled)


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
    light: Array, sigma: Array, valid: Mask, shape: Array, terms: Array, scale: float
) -> Array:
    """One Gauss-Newton step of the ends, every patch following."""
    count = shape.shape[-1]
    dark, bright = shape @ terms[:count], shape @ terms[count:]
    contrast = bright - dark
    seen = valid & (contrast > _FAINT * scale)
    safe = np.where(seen, contrast, scale)
    frame = 1.0 - 2.0 * (light - dark) / safe, 2.0 * sigma / safe, seen
    cut: PatchLight = gather_patches(*frame)
    patches = fit_patches(cut, *frame)
    chi = patches.chi.ravel()
    use = np.flatnonzero((chi < _WORST_CHI) & (patches.filled.ravel() > 0.6))
    dy, dx, _ = offsets()
    places = np.stack(np.meshgrid(patches.rows, patches.cols, indexing="ij"), axis=-1)
    rows, cols = (places.reshape(-1, 2)[use, k][:, None] + d for k, d in enumerate((dy, dx)))
    basis = patch_basis()
    angle = TURN * (patches.terms.reshape(-1, 6)[use] @ basis.T)
    signal = 0.5 - 0.5 * np.cos(angle)
    # a patch that no quadratic describes counts for less
    noise = sigma[rows, cols] * np.maximum(chi[use], 1.0)[:, None]
    weight = cut.weight[use] / noise**2
    here = shape[rows, cols]
    by_ends = np.concatenate([here * (1.0 - signal[..., None]), here * signal[..., None]], axis=-1)
    by_patch = (safe[rows, cols] * np.pi * np.sin(angle))[..., None] * basis
    residual = light[rows, cols] - by_ends @ terms
    return _eliminated(weight, residual, by_ends, by_patch, terms, scale)


def _eliminated(
    weight: Array,
    residual: Array,
    by_ends: Array,
    by_patch: Array,
    terms: Array,
    scale: float,
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
    prior = np.full(len(terms), 1.0 / (_SMOOTH * scale) ** 2)
    prior[[0, len(terms) // 2]] = 0.0
    matrix = matrix + np.diag(prior) + 1e-2 * np.diag(np.diag(matrix))
    return np.asarray(np.linalg.solve(matrix, slope - prior * terms))
