"""What the light of a phase-stepped set says in each pixel, before any whole number is settled.

The light of a step is I = C + A [|α|² cos²(δ/2) + |w|² sin²(δ/2) - Im(α w*) sin δ] with
w = β cos 2θ + γ sin 2θ, and α, β, γ of its elements alone. Written out, it is linear in C, A,
A cos δ, A (1 - cos δ) (cos 4θ, sin 4θ) and A sin δ (cos 2θ, sin 2θ), so that one small matrix takes
the images of all steps to these seven maps, exactly, with unmatched plates as with ideal ones. A
frame that cannot be trusted in a pixel, saturated there or faulty, is left out of that pixel alone,
where the other frames still tell.

For the direction of sigma_1, (sin δ exp 2iθ)² and (1 - cos δ) exp 4iθ both point along exp 4iθ. The
first is nothing at whole and half orders, the second at whole ones; weighted with their information
they are summed over a small window, which no wrap of θ disturbs, and which fringes do not
interrupt. The root, exp 2iθ, keeps a sign that continuity settles: about an isotropic point 2θ
turns whole, so that a continuous choice exists all round it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, maximum_filter

from isochrome.errors import InputError
from isochrome.estimation import POOR_CHI
from isochrome.fringes.on_branch import LARGEST_MISFIT, LARGEST_UNCERTAINTY, WIDE_PX, WINDOW_PX
from isochrome.fringes.windows import COMPLETE, DIMMEST, POOLED_PX, Array, Mask, pooled
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
_PASSES = 3
"""Each takes out what the one before left, but for a share of the size of the elements' errors. So
often, too, all is solved where the steps leave something out, with the direction of before."""
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
    """The equations of a set of steps. `matrix` (steps, 7), over C, A, A cos δ, A (1 - cos δ) cos
    4θ, A (1 - cos δ) sin 4θ, A sin δ cos 2θ, A sin δ sin 2θ; `solved`, the columns that the steps
    tell apart; `inverse` (solved, steps), the least-squares solution; `covariance` (solved, solved)
    of the solution for unit noise."""

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
    """The maps (rows, cols) that a set of steps gives, in the light's unit. A, A V cos δ, A V sin δ
    exp 2iθ, and A (1 - V cos δ) exp 4iθ (None where the steps do not give it), with V the contrast
    that a pixel's area leaves. A is taken with V = 1 where they do not give it."""

    amplitude: Array
    cosine: Array
    sine: NDArray[np.complexfloating]
    cross: NDArray[np.complexfloating] | None


def step_row(chain: Chain) -> list[float]:
    """The coefficients of one step's light over the seven unknowns of `StepDesign`. |w|² = (|β|² +
    |γ|²)/2 + (|β|² - |γ|²)/2 cos 4θ + Re(β γ*) sin 4θ in the module's I."""
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
    InputError, with the steps to add, where cos δ or sin δ cannot be told."""
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
    # the unknowns that the steps do not resolve, each with the steps that would
    columns = _SETS[-1]
    _, values, right = np.linalg.svd(matrix[:, columns], full_matrices=False)
    resolved = (right[values > _WEAKEST] ** 2).sum(axis=0)
    poor = [j for j, r in zip(columns, resolved, strict=True) if j in _ADVICE and r < 0.9]
    missing = ", nor ".join(_ADVICE[j] for j in poor or _ADVICE)
    raise InputError("polariscope_step_steps_do", chains_count=len(chains), missing=missing)


def solve_steps(stack: Array, design: StepDesign, direction: Array | None = None) -> StepTerms:
    """Least squares of every pixel's light over the steps, one product of matrices. Where the steps
    do not tell 4θ or A apart but depend on them a little (misaligned elements), a second pass takes
    that out, with the first's amplitude and `direction` exp 2iθ, up to its sign."""
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


_WIDE_SPREAD = 0.2
"""What the wide window's 4θ is trusted to (rad), where the narrow one has nothing: whole orders."""
_OFF = 0.007
"""Light, of the amplitude, that elements 0.2 degree off add: 0.0035 rad, twice in 2θ."""


@dataclass(frozen=True)
class Direction:
    """The direction of sigma_1, up to 90°, as maps (rows, cols)."""

    twice: Array  # exp 2iθ, continuous
    scatter: Array  # standard, of θ (rad), from the noise
    uncertainty: Array  # with what is added where the direction bends within the window
    # scatter (rad) in a wide window, which spans a thin line of no information, from noise and
    # from elements a little off: where it is large, exp 2iθ may change sign across the line
    bridge: Array


def find_direction(
    terms: StepTerms, design: StepDesign, *, sigma: Array | float, valid: Mask
) -> Direction:
    """The continuous direction of a set of steps, up to 90° over each connected part. Each pixel's
    information on 4θ, times sigma², is E = S²/(4 vS) + Q (A - c)/vQ along exp 4iθ, with S = A sin δ
    exp 2iθ, Q = A (1 - cos δ) exp 4iθ, c = A cos δ, and vS, vQ their variances for unit noise; the
    squares' means of noise are taken off."""
    first, second = design.variance(SINE), design.variance(SINE_SINE)
    spread = 0.5 * (first + second)
    asymmetry = first - second + 2j * design.variance(SINE, SINE_SINE)
    noise = np.square(sigma)
    along = (terms.sine**2 - asymmetry * noise) / (4.0 * spread)
    size = np.maximum(np.abs(terms.sine) ** 2 - 2.0 * spread * noise, 0.0) / (4.0 * spread)
    if terms.cross is not None:
        spread = 0.5 * (design.variance(CROSS) + design.variance(CROSS_SINE))
        lift = np.maximum(pooled(terms.amplitude, 2.0 * WINDOW_PX) - terms.cosine, 0.0)
        along = along + terms.cross * lift / spread
        size = size + lift**2 / spread
    along, size = (np.where(valid, part, 0.0) for part in (along, size))
    narrow, information = _centred(along, size, WINDOW_PX)
    wide = pooled(along, WIDE_PX)
    area = 4.0 * np.pi * WINDOW_PX**2
    wide = wide / np.maximum(np.abs(wide), 1e-30) * noise / (area * _WIDE_SPREAD**2)
    twice = np.exp(0.5j * np.nan_to_num(unwrap(np.angle(narrow + wide), valid)))
    scatter = 0.25 * np.sqrt(noise / np.maximum(information * area, 1e-30))
    # elements a little off do not average out, nor does what was taken out along the direction
    doubt = noise / (4.0 * np.pi * WIDE_PX**2) + np.square(max(_OFF, design.leak) * terms.amplitude)
    bridge = 0.25 * np.sqrt(doubt / np.maximum(pooled(size, WIDE_PX), 1e-30))
    # where the direction bends within the window the error grows as its area: it is the difference
    # to one of twice the area, less noise, a sixth of the narrow window's variance; beside an edge
    # it grows as the window's width instead
    double = np.sqrt(2.0) * WINDOW_PX
    away = 0.25 * np.angle(_centred(along, size, double)[0] * np.conj(narrow))
    share = gaussian_filter(valid.astype(np.float32), double, mode="constant")
    away *= np.where(share > COMPLETE, 1.0, 1.0 / (2.0**0.5 - 1.0))
    trust = 1.0 / np.square(scatter)
    square = pooled(trust * np.square(away) - 1.0 / 6.0, POOLED_PX)
    bent = np.sqrt(np.maximum(square, 0.0) / pooled(trust, POOLED_PX))
    return Direction(twice, scatter, np.hypot(scatter, bent), bridge)


def _centred(along: Array, size: Array, window_px: float) -> tuple[Array, Array]:
    """Pooled exp 4iθ, turned from where its information lies to the window's middle, and that.
    Fringes put its centre of mass w² ∇J/J beside the middle of a Gaussian window of width w, where
    4θ is another by its gradient: ψ(0) = ψ - ∇ψ w² ∇J/J."""
    narrow, information = pooled(along, window_px), pooled(size, window_px)
    rough = pooled(narrow, _MISFIT_PX)
    square = np.maximum(np.square(np.abs(rough)), 1e-30)
    turn = np.zeros(information.shape)
    for axis in (0, 1):
        slope = (np.conj(rough) * np.gradient(rough, axis=axis)).imag / square
        turn += slope * np.gradient(information, axis=axis)
    turn *= window_px**2 / np.maximum(information, 1e-30)
    return narrow * np.exp(-1j * np.clip(turn, -1.0, 1.0)), information


def unwrap(phase: Array, mask: Mask) -> Array:
    """Phase (rad) made continuous over the masked-in pixels, fringe quality first; NaN elsewhere. A
    NaN hangs scikit-image's unwrap_phase (Herraez et al. (2002), Applied Optics 41, 7437), so that
    only finite pixels are passed to it. Parts that do not touch have whole turns of their own."""
    from skimage.restoration import unwrap_phase

    good = mask & np.isfinite(phase)
    if np.count_nonzero(good) < 2 or min(phase.shape) < 2:
        return np.where(good, phase, np.nan)
    hidden = np.ma.array(np.where(good, phase, 0.0), mask=~good)
    return np.where(good, np.asarray(unwrap_phase(hidden).filled(0.0)), np.nan)


_MOST_NOISE = 3.0
"""Times the noise of the whole set that a pixel may have for want of some of its frames."""
_LEAST_CONTRAST = 0.7
"""Of the contrast around: a pixel's area takes that much of it at 0.45 fringe a pixel."""
_AROUND_PX = 32
_MISFIT_PX = 2.0


@dataclass(frozen=True, kw_only=True)
class StepLight:
    """What a set's light says; maps (rows, cols)."""

    terms: StepTerms
    direction: Direction
    seen: Mask  # the fringes can be read
    specimen: Mask  # light comes through at all
    contrast: Array  # A V, in the light's unit
    uncertainty: Array  # of φ/2π, fringes
    chi: float  # residual of the light over its noise
    agrees: Mask  # the light fits the steps, whose angles the direction follows


def measure_steps(
    stack: Array, chains: Sequence[Chain], *, sigma: Array | float, valid: Mask | None = None
) -> StepLight:
    """Read δ, the direction of sigma_1 and their noise from the images of a set's steps."""
    design = make_design(chains)
    light = np.asarray(stack, dtype=np.promote_types(stack.dtype, np.float32))
    good = np.isfinite(light) & (True if valid is None else valid)
    light, (gain, turn_gain) = fill_gaps(np.where(good, light, 0.0), good, design)
    trusted, complete, swing = np.isfinite(gain), good.all(axis=0), sigma
    if (gain > 1.0).any():
        swing, sigma = sigma * np.fmax(turn_gain, 1.0), sigma * np.fmax(gain, 1.0)
    twice = None
    for _ in range(_PASSES if design.leaks else 1):
        terms = solve_steps(light, design, twice)
        direction = find_direction(terms, design, sigma=swing, valid=trusted)
        twice = direction.twice
    contrast = np.hypot(terms.cosine, np.abs(terms.sine))
    brightest = float(np.percentile(contrast[trusted], 90)) if trusted.any() else 0.0
    lit = trusted & (contrast > DIMMEST * brightest)  # light comes through: no dark surround
    # a pixel's area leaves sinc(g_x) sinc(g_y) of the contrast, g the gradient in fringes a pixel;
    # beyond half a fringe a pixel phase turns back on itself, and only the contrast tells
    usual = pooled(np.where(trusted, contrast, 0.0), _MISFIT_PX)
    readable = lit & (contrast > _LEAST_CONTRAST * maximum_filter(usual, _AROUND_PX))
    misfit, chi = step_misfit(light, design, sigma, readable & complete)
    # an element that is off turns the direction everywhere, also where the light hardly shows it:
    # where most of the picture does not fit, nothing of it is believed; else all but a part's
    compared = readable & complete
    rms = float(np.sqrt(np.mean(np.square(misfit[compared])))) if compared.any() else 1.0
    isolated = pooled(compared, _MISFIT_PX) < 0.5  # too few about it to compare with
    agrees = (rms <= POOR_CHI) & (isolated | (misfit <= POOR_CHI * max(rms, 1.0)))
    times = np.maximum(misfit, 1.0)  # the noise over what was stated
    more = np.square(direction.scatter) * (np.square(times) - 1.0)
    direction = replace(
        direction, scatter=direction.scatter * times,
        uncertainty=np.sqrt(np.square(direction.uncertainty) + more),
    )  # fmt: skip
    # of φ/2π, φ = atan2(A sin δ, A cos δ) along the direction, with var φ = σ² gᵀ Σ g and
    # g = (-sin φ, cos φ cos 2θ, cos φ sin 2θ)/(A V) (JCGM 100:2008, 5.1.2)
    twice = direction.twice
    along = (terms.sine * np.conj(twice)).real
    size = np.hypot(terms.cosine, along) + 1e-30
    cosine = terms.cosine / size
    slopes = (-along / size, cosine * twice.real, cosine * twice.imag)
    total = np.zeros(cosine.shape, dtype=cosine.dtype)
    for i, first in enumerate((COSINE, SINE, SINE_SINE)):
        total += design.variance(first) * slopes[i] ** 2
        for j, second in enumerate((COSINE, SINE, SINE_SINE)[:i]):
            if abs(design.variance(first, second)) > 1e-12:
                total += 2.0 * design.variance(first, second) * slopes[i] * slopes[j]
    uncertainty = np.asarray(sigma * np.sqrt(total) / size / (2.0 * np.pi)) * times
    readable &= (uncertainty < LARGEST_UNCERTAINTY) & (
        misfit * sigma < np.maximum(LARGEST_MISFIT * contrast, 2.0 * sigma)
    )
    return StepLight(
        terms=terms, direction=direction, seen=readable, specimen=lit, contrast=contrast,
        uncertainty=uncertainty, chi=chi, agrees=agrees,
    )  # fmt: skip


def fill_gaps(light: Array, good: Mask, design: StepDesign) -> tuple[Array, Array]:
    """Give frames that cannot be trusted in a pixel (nought there) the light that the others ask. I
    = M x there, x the least squares of the others. Also how many times the noise is a whole
    pixel's, at most of any unknown but the background, and of those that tell the direction (rows,
    cols); NaN where the rest cannot tell the order. Source: Yates (1933), Empire J. Exp. Agric. 1,
    129."""
    gains = np.where(good.all(axis=0), 1.0, np.nan)[None].repeat(2, axis=0).astype(np.float32)
    wanting = np.isnan(gains[0]) & good.any(axis=0)
    if design.leaks or not wanting.any():
        return light, gains
    code = np.int64(1) << np.arange(len(light), dtype=np.int64)
    kinds = np.tensordot(code, good[:, wanting].astype(np.int64), axes=1)
    values, noise = light[:, wanting], np.full((2, kinds.size), np.nan, dtype=np.float32)
    unknowns = np.array(design.solved)
    turning = np.isin(unknowns, (CROSS, CROSS_SINE, SINE, SINE_SINE))
    for kind in np.unique(kinds):
        present, here = (kind & code) > 0, kinds == kind
        part = design.matrix[present][:, design.solved]
        if np.linalg.matrix_rank(part, tol=1e-6) < len(unknowns):
            continue
        inverse = np.linalg.pinv(part)
        growth = np.square(inverse).sum(axis=1) / np.diag(design.covariance)
        more = np.sqrt([growth[unknowns != BACKGROUND].max(), growth[turning].mean()])
        if more[0] <= _MOST_NOISE:
            missing = design.matrix[~present][:, design.solved] @ inverse
            chosen = values[np.ix_(present, here)]
            values[np.ix_(~present, here)] = missing.astype(light.dtype) @ chosen
            noise[:, here] = more[:, None]
    filled = light.copy()
    filled[:, wanting] = values
    gains[:, wanting] = noise
    return filled, gains


def step_misfit(
    light: Array, design: StepDesign, sigma: Array | float, readable: Mask
) -> tuple[Array, float]:
    """Residual of the light over its noise, pooled about each pixel, and over all of them. What no
    unknowns explain: moved or dirty elements, a wrong gamma. 1, and NaN, where nothing can."""
    directions, values, _ = np.linalg.svd(design.matrix)
    rank = int((values > 1e-6).sum())
    free = len(light) - rank
    if free == 0:
        return np.ones(light.shape[1:]), float("nan")
    over = np.tensordot(directions[:, rank:].T.astype(light.dtype), light, axes=1)
    square = (over**2).sum(axis=0) / (free * np.square(sigma))
    weight = np.maximum(pooled(readable, _MISFIT_PX), 1e-6)
    misfit = np.sqrt(np.maximum(pooled(np.where(readable, square, 0.0), _MISFIT_PX), 0.0) / weight)
    return misfit, float(np.sqrt(np.mean(square[readable]))) if readable.any() else float("nan")
