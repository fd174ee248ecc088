r"""From wrapped to absolute fringe order: unwrapping, and the whole number that phase leaves open.

Phase stepping gives δ and the direction of sigma_1 up to the joint change (δ, θ) ~ (-δ, θ + 90°),
which leaves n = (sigma_1 - sigma_2 as fringes) exp 2iθ = (φ/2π + m) exp 2iθ as it is once θ is
continuous. One whole number m for each connected part is then all that is not known.

In a plane elastic specimen without body forces n obeys equilibrium and compatibility:
σy - σx + 2iτxy = 2 (z* Φ' + Ψ) with Φ', Ψ analytic in z = x + iy, y upward, so that ∂²n/∂z² = 0.
Any other whole number adds (m' - m) exp 2iθ, which does not obey it where θ varies: the equation,
linear in m, is solved for m by least squares over the part, on derivatives of Gaussians. Residual
stress obeys equilibrium and no compatibility: its n leaves the imaginary part of 4 ∂²n/∂z² alone
nought, 2 (∂xx - ∂yy) τxy - 2 ∂x∂y (σx - σy); the real part is -∇²(σx + σy).
Source: Muskhelishvili (1953), Some Basic Problems of the Mathematical Theory of Elasticity, for
the stresses' form; the use made of it here was derived from it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from isochrome.fringes.windows import Array, Mask, block_means, valid_means

_BLOCK = 4
_FULL = 0.7
_WIDTHS = (12.0, 8.0, 5.0, 3.0, 2.0)
"""Of the Gaussians, in blocks of pixels, the widest first: noise falls as the sixth power of it."""

_SUPPORT = 3.5
_FEWEST = 5.0
"""Independent places, of one Gaussian's area each, that a part must have."""

_NEAR = 0.3
"""How far from a whole number m and twice its uncertainty may lie."""

_LEAST_SIGNAL = 0.5
"""Of what is seen of exp 2iθ's second derivative; the rest is the noise that is expected. In a beam
the direction does not vary, and all of it is noise."""


@dataclass(frozen=True)
class Balance:
    """The number m that equilibrium and compatibility ask for, and its standard uncertainty."""

    number: float
    standard_uncertainty: float

    @property
    def whole(self) -> int | None:
        """The whole number, None where the equations do not single it out."""
        near = abs(self.number - round(self.number)) + 2.0 * self.standard_uncertainty
        return round(self.number) if near < _NEAR else None


def unwrap(phase: Array, mask: Mask) -> Array:
    """Phase (rad) made continuous over the masked-in pixels, fringe quality first; NaN elsewhere.

    A NaN hangs scikit-image's unwrap_phase, so that only finite pixels are passed to it. Parts that
    do not touch have whole turns of their own. Source: Herraez, Burton, Lalor & Gdeisat (2002),
    Applied Optics 41, 7437.
    """
    from skimage.restoration import unwrap_phase

    good = mask & np.isfinite(phase)
    if np.count_nonzero(good) < 2 or min(phase.shape) < 2:
        return np.where(good, phase, np.nan)
    hidden = np.ma.array(np.where(good, phase, 0.0), mask=~good)
    return np.where(good, np.asarray(unwrap_phase(hidden).filled(0.0)), np.nan)


def balance(
    turns: Array,
    direction: Array,
    inside: Mask,
    *,
    spread: Array,
    residual: Array | None = None,
    compatible: bool = True,
) -> Balance | None:
    """The whole number m of a part of the field by equilibrium and compatibility, if they tell.

    Least Σ |∂²_z (turns e - n₀) + m ∂²_z e|², weighted by the noise and robustly, less the noise's
    own share of the sums, which would draw m to -turns. `turns` φ/2π, signed; `direction` e = exp
    2iθ, continuous; `spread`, a pixel's own deviation of 2θ (rad); `residual` n₀, all over the
    part; not `compatible`: turns e is itself a residual stress's. Source: the module's.
    """
    share = block_means(inside.astype(float), _BLOCK)
    load_turns = turns * direction if residual is None else turns * direction - residual
    field, angle, signed, noise = (
        valid_means(values, inside, _BLOCK)
        for values in (load_turns, direction, turns, np.square(spread) / _BLOCK**2)
    )
    # a masked pixel here and there is no edge of the part
    depth = distance_transform_edt(np.pad(share > _FULL, 1))[1:-1, 1:-1]
    for width in _WIDTHS:
        use = depth > _SUPPORT * width
        places = np.count_nonzero(use) / (4.0 * np.pi * width**2)
        if places < _FEWEST:
            continue
        # white noise of variance v is left with v ∫ k⁴ exp(-k²w²) d²k/4π² = v/(2π w⁶)
        noise_slope = gaussian_filter(noise, width)[use] / (2.0 * np.pi * width**6)
        bent, turned = _bending(field, width)[use], _bending(angle, width)[use]
        if not compatible:  # one equation of the two, which has half the noise
            bent, turned, noise_slope = 1j * bent.imag, 1j * turned.imag, 0.5 * noise_slope
        solution = _solve(
            bent, turned, signed[use], noise_slope, places if compatible else 0.5 * places
        )
        if solution is not None:
            return solution
    return None


def _bending(values: Array, width: float) -> Array:
    """4 ∂²/∂z² = ∂xx - ∂yy - 2i ∂x∂y of complex values, with y upward, under a Gaussian."""
    xx, yy, xy = (gaussian_filter(values, width, order=o) for o in ((0, 2), (2, 0), (1, 1)))
    return np.asarray(xx - yy + 2j * xy)  # rows grow downward: ∂y = -∂row


def _solve(bent: Array, turned: Array, turns: Array, noise: Array, places: float) -> Balance | None:
    """m of bent + m turned = 0, each place by its noise, and by its misfit where that is larger."""
    number, square = 0.0, np.abs(turned) ** 2
    weight = 1.0 / (noise + 1e-30)
    for _ in range(20):
        information = float((weight * (square - noise)).sum())
        if information < _LEAST_SIGNAL * float((weight * square).sum()):
            return None
        cross = (bent * np.conj(turned)).real - turns * noise
        number = -float((weight * cross).sum()) / information
        misfit = np.abs(bent + number * turned)
        # the noise of the sum is that of (turns + m) e, and of turns
        scale = np.sqrt(noise * (1.0 + (turns + number) ** 2)) + 1e-15
        weight = 1.0 / (scale * np.maximum(scale, misfit / np.median(misfit / scale)) + 1e-30)
    spread = (weight**2 * misfit**2 * square).sum() * 0.5 * len(bent) / places
    return Balance(number, float(np.sqrt(spread)) / information)
