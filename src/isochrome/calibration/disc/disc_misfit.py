"""What a model that does not describe a disc's images may do to the slope: a block jackknife.

Misfit of a tone curve, of blur or of clipping is no noise: it is alike in the disc's four
quarters and in all images, and its effect on the orders does not fall with the number of pixels.
Leaving out one block of the disc after another, the same one in all quarters and images, shows how
much the slope depends on where it is read (`jackknife_variance`).
"""

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.disc.disc_field import disc_places
from isochrome.calibration.disc.disc_joint import OWN, JointDisc, jacobian
from isochrome.estimation import jackknife_variance, scaled_inverse

Array = NDArray[np.float64]

RINGS = (0.45, 0.7)
"""Radii between the blocks."""

SECTORS = 4
"""Blocks from the loads' direction to the one across it."""

BLOCKS = (len(RINGS) + 1) * SECTORS


def slope_misfit(fit: JointDisc) -> float:
    """Part of the slope's relative standard uncertainty that the noise does not explain.

    u^2 = (B - 1) var(k_b) / k^2 - (the fit's own)^2, k_b the slope of order with
    load from all but the block b, to first order in what is left out; 0 unless the jackknife's
    variance exceeds what noise alone gives it in all but one of a
    thousand cases.

    Parameters: `fit`, at its optimum. Returns a number, 0 or above.
    """
    from scipy.special import chdtri

    grams, gradients = _blocks(fit)
    weights = _slope_weights(fit, len(gradients[0]))
    whole, pull = grams.sum(axis=0), gradients.sum(axis=0)
    slopes = np.array(
        [
            weights @ (scaled_inverse(whole - gram, 1e-14) @ (pull - gradient))
            for gram, gradient in zip(grams, gradients, strict=True)
        ]
    )
    count = len(slopes)
    jackknife = float(jackknife_variance(slopes))
    noise = float(weights @ scaled_inverse(whole, 1e-14) @ weights)
    noise *= max(1.0, fit.cost / fit.pixels)
    if jackknife < noise * chdtri(count - 1, 1e-3) / (count - 1):
        return 0.0
    slope = float(weights[: OWN * len(fit.own) : OWN] @ fit.own[:, 0])
    return float(np.sqrt(jackknife - noise) / abs(slope))


def _slope_weights(fit: JointDisc, unknowns: int) -> Array:
    """d slope / d unknowns of the straight line through the loaded images' orders."""
    loads = np.array([p.shot.load_n for p in fit.pictures])
    loaded = np.array([p.loaded for p in fit.pictures])
    several = np.unique(loads[loaded]).size > 1
    away = np.where(loaded, loads - (loads[loaded].mean() if several else 0.0), 0.0)
    weights = np.zeros(unknowns)
    weights[: OWN * len(loads) : OWN] = away / np.sum(away * loads)
    return weights


def _blocks(fit: JointDisc) -> tuple[Array, Array]:
    """Normal equations and gradients of each block (B, q, q), (B, q); q: the light's as well."""
    sizes = [part.coefficients.size for part in fit.parts]
    start = OWN * len(fit.own) + fit.coefficients.size
    unknowns = start + sum(sizes)
    grams, gradients = np.zeros((BLOCKS, unknowns, unknowns)), np.zeros((BLOCKS, unknowns))
    shared = np.arange(OWN * len(fit.own), start)
    for i, (picture, part) in enumerate(zip(fit.pictures, fit.parts, strict=True)):
        rows = np.concatenate(
            (jacobian(fit, i), picture.problem.light * part.signal, picture.problem.dark)
        )
        place = np.r_[OWN * i : OWN * (i + 1), shared, start : start + sizes[i]]
        start += sizes[i]
        block = block_of(picture.rows, picture.cols, fit.own[i])
        for b in range(BLOCKS):
            here = np.ascontiguousarray(rows[:, block == b])
            grams[b][np.ix_(place, place)] += here @ here.T
            gradients[b][place] += here @ part.residual[block == b]
    return grams, gradients


def block_of(rows: Array, cols: Array, own: Array) -> NDArray[np.intp]:
    """The block of each pixel (n,): ring and sector, folded into one quarter of the disc.

    Parameters: `rows`, `cols` (n,), px; `own` (5,), the image's unknowns.
    """
    _, *sides = disc_places(rows, cols, own[1:])
    along, across = np.abs(sides)
    ring = np.searchsorted(RINGS, np.hypot(along, across))
    sector = np.minimum(np.arctan2(across, along) / (0.5 * np.pi) * SECTORS, SECTORS - 1)
    return np.asarray(ring * SECTORS + sector.astype(int))
