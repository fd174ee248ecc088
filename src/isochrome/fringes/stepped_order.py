"""Absolute fringe order and isoclinic angle from a phase-stepped set.

The steps' light gives cos δ, sin δ exp 2iθ and (1 - cos δ) exp 4iθ in every pixel
(`step_equations`), these the continuous direction up to 90°, along which δ is signed and
unwraps without the ambiguity (δ, θ) ~ (-δ, θ + 90°): n = (φ/2π + m) exp 2iθ, the stress
difference's tensor in fringes, does not change with it. Then N = |n| and θ = arg(n)/2. One whole
number m for each connected part is all that is not known. It comes from the user's known orders,
from equilibrium and compatibility, or from a model (`settle`); where the first two disagree, or
nothing tells, that is said, and a part that has none is left unknown.

In a plane elastic specimen without body forces n obeys equilibrium and compatibility:
σy - σx + 2iτxy = 2 (z* Φ' + Ψ) with Φ', Ψ analytic in z = x + iy, y upward, so that ∂²n/∂z² = 0.
Any other whole number adds (m' - m) exp 2iθ, which does not obey it where θ varies: the equation,
linear in m, is solved for m by least squares over the part, on derivatives of Gaussians. Residual
stress obeys equilibrium and no compatibility: its n leaves the imaginary part of 4 ∂²n/∂z² alone
nought, 2 (∂xx - ∂yy) τxy - 2 ∂x∂y (σx - σy); the real part is -∇²(σx + σy).

A residual stress is the unloaded specimen's n₀. Stresses add up as tensors, and so do n: the load's
own is n - n₀, not N - N₀. This holds for plane stress that is uniform through the thickness, where
the specimen is one retarder; where stress varies through it, retarders stand one behind the other,
and n adds up where they are weak or turned alike. It is weak: below half an order sin δ > 0, and
n₀ = δ/2π exp 2iθ with δ = atan2(|A sin δ exp 2iθ|, A cos δ) pixel by pixel, as well where it is
nearly nil. The field is followed as a loaded one's is, beyond half an order too; its whole number
comes from equilibrium or, where that does not tell, from most of the specimen being below half an
order. What cannot be followed is left unknown.
Sources: Muskhelishvili (1953), Some Basic Problems of the Mathematical Theory of Elasticity, for
the stresses' form, the use made of it here was derived from it; Frocht (1941), Photoelasticity,
vol. 1, for stresses that add up in one plane; Aben & Guillemet (1993), Photoelasticity of Glass,
for those that vary along the light.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from isochrome.estimation import POOR_CHI
from isochrome.fringes.on_branch import (
    BRANCH,
    LARGEST_UNCERTAINTY,
    NOTABLE,
    SURE,
    WINDOW_PX,
    OrderReading,
    make_reading,
)
from isochrome.fringes.step_equations import Direction, StepLight, StepTerms, measure_steps, unwrap
from isochrome.fringes.windows import Array, Mask, beside_jumps, block_means, masked, valid_means
from isochrome.messages import message
from isochrome.optics import Chain

_BLOCK = 4
_FULL = 0.7
_SUPPORT = 3.5
"""Of a Gaussian, in its widths."""
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


def balance(
    turns: Array, direction: Array, inside: Mask,
    *, spread: Array, residual: Array | None = None, compatible: bool = True,
) -> Balance | None:  # fmt: skip
    """The whole number m of a part of the field by equilibrium and compatibility, if they tell.
    Least Σ |∂²_z (turns e - n₀) + m ∂²_z e|², weighted by the noise and robustly, less the noise's
    own share of the sums, which would draw m to -turns. `turns` φ/2π, signed; `direction` e = exp
    2iθ; `spread`, a pixel's own deviation of 2θ (rad); `residual` n₀; `compatible`, as the
    module's."""
    share = block_means(inside.astype(float), _BLOCK)
    load_turns = turns * direction if residual is None else turns * direction - residual
    field, angle, signed, noise = (
        valid_means(values, inside, _BLOCK)
        for values in (load_turns, direction, turns, np.square(spread) / _BLOCK**2)
    )
    # a masked pixel here and there is no edge of the part
    depth = ndimage.distance_transform_edt(np.pad(share > _FULL, 1))[1:-1, 1:-1]
    # Gaussians, the widest first that fits: the noise falls as the sixth power of its width
    widest = float(depth.max()) / _SUPPORT
    for width in widest * 2.0 ** -np.arange(1.0, np.log2(max(widest, 2.0)), 0.5):
        use = depth > _SUPPORT * width
        places = np.count_nonzero(use) / (4.0 * np.pi * width**2)
        if places < _FEWEST:
            continue
        # white noise of variance v is left with v ∫ k⁴ exp(-k²w²) d²k/4π² = v/(2π w⁶)
        noise_slope = ndimage.gaussian_filter(noise, width)[use] / (2.0 * np.pi * width**6)
        bent, turned = _bending(field, width)[use], _bending(angle, width)[use]
        if not compatible:  # one equation of the two, which has half the noise
            bent, turned, noise_slope = 1j * bent.imag, 1j * turned.imag, 0.5 * noise_slope
            places = 0.5 * places
        solution = _solve(bent, turned, signed[use], noise_slope, places)
        if solution is not None:
            return solution
    return None


def _bending(values: Array, width: float) -> Array:
    """4 ∂²/∂z² = ∂xx - ∂yy - 2i ∂x∂y of complex values, with y upward, under a Gaussian."""
    xx, yy, xy = (ndimage.gaussian_filter(values, width, order=o) for o in ((0, 2), (2, 0), (1, 1)))
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


KnownOrder = tuple[int, int, float]
"""Row, column (pixels), and the fringe order there."""
_Seed = tuple[KnownOrder, tuple[int, int]]
"""A known order, and the pixel of the part at which it is looked up."""
_NEAR_PX = 3
_TIE = 0.1
"""Misfit, in fringes, by which two numbers are as good; beyond `BRANCH` none is."""


@dataclass(frozen=True)
class FieldPart:
    """A connected part's whole `number`, of a known order, equilibrium, model; None of none."""

    number: int | None
    source: str


def settle(
    turns: Array, direction: Direction, known: Mask,
    *, known_order: Sequence[KnownOrder] = (), model: Callable[[], Array] | None = None,
    residual: Array | None = None, compatible: bool = True,
) -> tuple[Array, tuple[FieldPart, ...], tuple[str, ...]]:  # fmt: skip
    """The whole number m of each part, so that N = |turns + m|; NaN where it is open. `turns` φ/2π,
    unwrapped; `known`, where it and the continuous direction are; `known_order`, (row, col, N)
    each; `model` gives a model's order where nothing else tells; for `residual` n and `compatible`
    see `balance`. Then the parts that are not too small, largest first, and warnings."""
    # the noise of 2θ if it were independent from pixel to pixel (rad)
    spread = 2.0 * np.minimum(direction.scatter, 0.5) * np.sqrt(4.0 * np.pi) * WINDOW_PX
    labels, count = ndimage.label(known)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    seeds = _seeds_of_parts(labels, known_order)
    warnings = [
        message("frames_known_order_row_column_order", row=row, col=col, order=order)
        for (row, col, order), _ in seeds.pop(0, [])
    ]
    numbers = np.full(turns.shape, np.nan)
    parts = []
    for index in (np.argsort(-sizes[1:]) + 1).tolist():
        if sizes[index] < NOTABLE * sizes[1:].sum() and index not in seeds:
            continue
        inside = labels == index
        equilibrium = balance(
            turns, direction.twice, inside, spread=spread, residual=residual, compatible=compatible
        )
        balanced = equilibrium.whole if equilibrium else None
        if index in seeds:
            number, notes = _from_seeds(turns, seeds[index], balanced)
            source = "none" if number is None else "known order"
        elif balanced is not None:
            number, source, notes = balanced, "equilibrium", []
        else:
            number = _from_model(turns, inside, model()) if model else None
            source, notes = "model", [message("whole_number_order_taken")]
            if number is None:
                count_in = np.count_nonzero(inside)
                source, notes = "none", [message("part_pixels_has_no", count_nonzero=count_in)]
        warnings += notes
        parts.append(FieldPart(number, source))
        if number is not None:
            numbers[inside] = number
    return numbers, tuple(parts), tuple(warnings)


def _seeds_of_parts(labels: Array, known_order: Sequence[KnownOrder]) -> dict[int, list[_Seed]]:
    """Known orders by the part they lie in or beside, with the pixel to look at; 0: none."""
    seeds_of: dict[int, list[_Seed]] = {}
    rows, cols = labels.shape
    for seed in known_order:
        row, col = seed[0], seed[1]
        near = [
            (abs(r - row) + abs(c - col), r, c)
            for r in range(max(0, row - _NEAR_PX), min(rows, row + _NEAR_PX + 1))
            for c in range(max(0, col - _NEAR_PX), min(cols, col + _NEAR_PX + 1))
            if labels[r, c]
        ]
        place = min(near)[1:] if near else (0, 0)
        seeds_of.setdefault(int(labels[place]) if near else 0, []).append((seed, place))
    return seeds_of


def _from_seeds(
    turns: Array, seeds: list[_Seed], balanced: int | None
) -> tuple[int | None, list[str]]:
    """The number under which |turns + m| is the known orders, and what to say of it."""
    here = np.array([turns[place] for _, place in seeds])
    orders = np.array([seed[2] for seed, _ in seeds])
    tried = np.unique(np.rint([orders - here, -orders - here])).astype(int)
    misfit = np.array([np.mean(np.abs(np.abs(here + m) - orders)) for m in tried])
    best = tried[misfit < misfit.min() + _TIE]
    if misfit.min() > BRANCH:
        return None, [message("frames_known_order_disagrees_light", min=misfit.min())]
    if len(best) > 1 and balanced not in best:
        return None, [message("frames_known_order_leaves_two")]
    number = balanced if len(best) > 1 else int(best[0])
    if balanced is not None and balanced != number:
        apart = abs(balanced - (number or 0))
        return number, [message("frames_known_order_equilibrium_field", number=apart)]
    return number, []


def _from_model(turns: Array, inside: Mask, model: Array) -> int | None:
    """The number under which the order is nearest to a model's, low orders before high ones. None
    where the model does not single one out: a wrong load shifts high orders by whole ones."""
    both = inside & np.isfinite(model)
    if np.count_nonzero(both) < 0.5 * np.count_nonzero(inside):
        return None
    here, order = turns[both], model[both]
    weight = 1.0 / (0.1 + order) ** 2
    middle = [np.rint(np.median(sign * order - here)) for sign in (1, -1)]
    tried = np.unique(np.add.outer(middle, np.arange(-2, 3))).astype(int)
    misfit = np.array([np.average(np.abs(np.abs(here + m) - order), weights=weight) for m in tried])
    first, second = np.sort(misfit)[:2]
    return int(tried[misfit.argmin()]) if first < BRANCH and second > 2.0 * first else None


SMOOTHED_PX = 1.2
LARGEST_TURN = np.radians(2.0)
"""Standard uncertainty of θ (rad) beyond which a direction is not known."""
_LOST = 0.15
"""Scatter of θ (rad) at which a break of 90 degrees in θ, 45 either way, is five of it."""
_SMOOTH = 0.18
"""Fringes over a window of one standard deviation, beyond which smoothing would bend n."""


def settle_field(
    light: StepLight,
    *, known_order: Sequence[KnownOrder] = (), model: Callable[[], Array] | None = None,
    residual: Array | None = None, compatible: bool = True,
) -> tuple[Array, tuple[FieldPart, ...], tuple[str, ...]]:  # fmt: skip
    """The field n of a set (rows, cols), fringes, NaN = not known; its parts, and warnings."""
    direction = light.direction
    terms = light.terms  # φ/2π unwrapped along the direction
    phase = np.arctan2((terms.sine * np.conj(direction.twice)).real, terms.cosine)
    turns = unwrap(phase, light.seen) / (2.0 * np.pi)
    known = light.seen & np.isfinite(turns)
    if residual is not None:
        known &= np.isfinite(residual)
    # where fringes are too steep, or the sign of the direction breaks between neighbours: that does
    # harm where the signed order is not zero, or a direction is seen; one that is lost over a wide
    # window, in noise or in elements a little off, may have broken unseen. Nearer to a whole order
    # than to be told from zero, a sign that breaks may do no harm
    loaded = np.abs(turns - np.rint(turns)) > SURE
    off = loaded | (direction.uncertainty < LARGEST_TURN)
    broken = beside_jumps(turns)
    for axis in (0, 1):
        twice, beside = direction.twice.swapaxes(0, axis), broken.swapaxes(0, axis)
        flipped = (twice[1:] * np.conj(twice[:-1])).real < 0.0
        flipped &= off.swapaxes(0, axis)[1:]
        beside[1:] |= flipped
        beside[:-1] |= flipped
    known &= ~(ndimage.binary_dilation(broken) | (loaded & (direction.bridge > _LOST)))
    numbers, parts, warnings = settle(
        turns, direction, known, known_order=known_order, model=model, residual=residual,
        compatible=compatible,
    )  # fmt: skip
    known &= np.isfinite(numbers)
    return np.where(known, (turns + numbers) * direction.twice, np.nan), parts, warnings


_WINDOWS_PX = (SMOOTHED_PX, 4.0)
_NEAR_HALF = 0.4
"""Order beyond which noise, or fringes, may lead past the half order, where the least one ends."""
_FEW = 0.9
_LEAST_ORDER = 4.0
"""Standard uncertainties of an order from which its direction is told: below, its sign is noise."""
_SURELY = 5.5
"""Standard uncertainties that the largest of a million pixels of noise does not reach."""


@dataclass(frozen=True)
class ResidualStress:
    """The field n₀ = N exp 2iθ (rows, cols) of a residual stress, fringes; NaN = not known."""

    field: Array
    uncertainty: Array  # standard, of N, and of N times twice the angle
    kept: float  # share of the specimen that is known
    warnings: tuple[str, ...]  # in plain words
    # where the no-load light fits the steps: its direction may be believed
    agrees: Mask | bool = True

    @property
    def order(self) -> Array:
        """The residual stress's own fringe order (rows, cols) float32."""
        return np.abs(self.field).astype(np.float32)

    @property
    def largest(self) -> float:
        """The largest order that stands out of its noise, 0 where none does (fringes)."""
        order = np.abs(self.field)
        return float(np.max(order, where=order > _SURELY * self.uncertainty, initial=0.0))

    @property
    def isoclinic(self) -> Array:
        """Direction of sigma_1, degrees; NaN where nearly nil, or the light does not fit."""
        known = (np.abs(self.field) > _LEAST_ORDER * self.uncertainty) & self.agrees
        return np.where(known, 0.5 * np.degrees(np.angle(self.field)), np.nan).astype(np.float32)


def read_residual(
    stack: Array, chains: Sequence[Chain], *, sigma: Array | float, valid: Mask | None = None
) -> ResidualStress:
    """Read the residual stress from the images (steps, rows, cols) of an unloaded specimen."""
    light = measure_steps(stack, chains, sigma=sigma, valid=valid)
    least = np.abs(least_field(light.terms))
    # where the order is below a half for most of what hangs together
    labels, _ = ndimage.label(light.specimen | light.seen)
    below, count = ndimage.label(light.seen & (least < _NEAR_HALF))
    owner = np.zeros(count + 1, dtype=int)
    owner[below.ravel()] = labels.ravel()
    main = 2 * np.bincount(below.ravel()) > np.bincount(labels.ravel())[owner]
    main[0] = False
    known_model = np.where(main[below], least, np.nan)
    shown, *_ = settle_field(light, model=lambda: known_model, compatible=False)
    field, along, turn, known = _of_load(light, shown, windows_px=_WINDOWS_PX)
    spread = np.fmax(along, 2.0 * np.abs(field) * turn)
    known &= spread < LARGEST_UNCERTAINTY
    field, spread = (np.where(known, part, np.nan) for part in (field, spread))
    known_share = float(known.sum() / max(1, np.count_nonzero(known | light.specimen)))
    remarks = []
    if light.chi > POOR_CHI:
        lost = "" if light.agrees.any() else message("no_isoclinic_given_load")
        remarks.append(message("no_load_steps_chi", chi=light.chi, lost=lost))
    if known_share < _FEW:
        remarks.append(message("no_load_steps_only", known_share=100 * known_share))
    return ResidualStress(field, spread, known_share, tuple(remarks), light.agrees)


def least_field(terms: StepTerms) -> Array:
    """N exp 2iθ of the least order that the light allows, 1/2 at most, pixel by pixel."""
    size = np.abs(terms.sine)
    order = np.arctan2(size, terms.cosine) / (2.0 * np.pi)
    return np.asarray(order * terms.sine / np.maximum(size, 1e-30))


_SMALL = 0.15
"""Order below which the least order that the light allows is the order."""


@dataclass(frozen=True, kw_only=True)
class SteppedReading:
    """What a phase-stepped set tells of the load; maps (rows, cols) float32, NaN = not known."""

    reading: OrderReading
    # direction of sigma_1, degrees counter-clockwise from the image's +x, -90 to 90; NaN too
    # where the light does not fit the steps, whose angles it follows
    isoclinic: Array
    isoclinic_uncertainty: Array  # standard, degrees
    dark_field: Array  # ideal, (1 - cos δ)/2
    contrast: Array  # A V, in the light's unit
    chi: float  # residual of the light over its noise; NaN: the steps leave none
    parts: tuple[FieldPart, ...]  # connected, and what settled their whole numbers
    warnings: tuple[str, ...]  # in plain words

    @property
    def order(self) -> Array:
        """The fringe order (rows, cols)."""
        return self.reading.order


def read_steps(
    stack: Array, chains: Sequence[Chain],
    *, sigma: Array | float, valid: Mask | None = None, known_order: Sequence[KnownOrder] = (),
    model: Callable[[], Array] | None = None, residual: ResidualStress | None = None,
) -> SteppedReading:  # fmt: skip
    """Read order and isoclinic angle of one state from the images (steps, rows, cols) of its steps.
    Not known: masked, low contrast, noise over 0.03 fringe, fringes finer than 3 pixels, a part's
    whole number open, or the residual not known. `known_order` (row, col, N) and `model`, called
    where nothing else tells, are orders that the frames show, residual stress and all."""
    light = measure_steps(stack, chains, sigma=sigma, valid=valid)
    unloaded = None if residual is None else residual.field
    shown, parts, warnings = settle_field(
        light, known_order=known_order, model=model, residual=unloaded
    )
    field, uncertainty, turn, known = _of_load(light, shown, residual)
    # nearer to zero its sign is noise
    clear = known & (turn < LARGEST_TURN) & (np.abs(field) > _LEAST_ORDER * uncertainty)
    turned = clear & light.agrees & (True if residual is None else residual.agrees)

    specimen = known | light.specimen
    reading = make_reading(np.abs(field), uncertainty, known, of=specimen)
    if residual is not None:
        cosine, readable = np.cos(2.0 * np.pi * reading.order), known
    else:
        cosine, readable = light.terms.cosine / np.maximum(light.contrast, 1e-30), specimen
    lost = float(np.mean(~light.agrees[clear])) if clear.any() else 0.0
    remarks = [*warnings]
    if light.chi > POOR_CHI:
        none = "" if light.agrees.any() else ": no isoclinic is given"
        remarks.append(message("chi_steps_angles_plates", chi=light.chi, none=none))
    if NOTABLE < lost < 1.0:
        remarks.append(message("no_isoclinic_given_pixels", lost=100.0 * lost, poor_chi=POOR_CHI))
    if reading.kept < 0.5 and all(part.number is not None for part in parts):
        remarks.append(message("only_specimen_pixels_could_read", kept=100 * reading.kept))
    return SteppedReading(
        reading=reading, isoclinic=masked(0.5 * np.degrees(np.angle(field)), turned),
        isoclinic_uncertainty=masked(np.degrees(turn), turned),
        dark_field=masked(0.5 - 0.5 * cosine, readable), contrast=light.contrast.astype(np.float32),
        chi=light.chi, parts=parts, warnings=tuple(remarks),
    )  # fmt: skip


def _of_load(
    light: StepLight, shown: Array, residual: ResidualStress | None = None,
    windows_px: Sequence[float] = (SMOOTHED_PX,),
) -> tuple[Array, Array, Array, Mask]:  # fmt: skip
    """n of the load alone, smoothed, noise of |n| and of arg(n)/2 (rad), and where it is known."""
    known = np.isfinite(shown)
    shown = np.where(known, shown, 0.0)
    small = known & (np.abs(shown) < _SMALL)
    # about an isotropic point and in a valley the window's direction is that of the pixels around,
    # or noise; that of the pixel's own light is not
    least = least_field(light.terms)
    shown = np.where(small, least, shown)
    field = shown if residual is None else np.where(known, shown - residual.field, 0.0)
    # n under the widest kernel that leaves it as it is, where its whole support is known: 2 G(w) -
    # G(√2 w), G a Gaussian of deviation w, has no second moment, and leaves white noise with the
    # factor √(0.458/π)/w of it; where fringes are fine, or beside a mask, n stays the pixel's
    filled = np.where(known, field, 0.0).astype(np.complex64)
    depth = ndimage.distance_transform_edt(np.pad(known, 1))[1:-1, 1:-1]
    along = light.uncertainty
    for window in windows_px:
        narrow = ndimage.gaussian_filter(filled, window, truncate=3.0)
        smooth = 2.0 * narrow - ndimage.gaussian_filter(filled, 2**0.5 * window, truncate=3.0)
        rows, cols = np.gradient(np.abs(smooth))
        use = known & (depth > 4.5 * window) & (np.hypot(rows, cols) * window < _SMOOTH)
        field = np.where(use, smooth, field)
        along = np.where(use, np.sqrt(0.458 / np.pi) / window * light.uncertainty, along)
    # what smoothing n takes of the direction's noise, which is pooled already, by both kernels
    ratio = (SMOOTHED_PX / WINDOW_PX) ** 2
    smoothed_off = 1.0 - 4.0 / (1.0 + ratio) + 4.0 / (1.0 + 1.5 * ratio) - 1.0 / (1.0 + 2.0 * ratio)
    less = np.where(along < light.uncertainty, smoothed_off, 0.0)
    less *= np.square(light.direction.scatter)
    turn = np.sqrt(np.square(light.direction.uncertainty) - less)
    # across the least n its noise is that of N along, times δ/sin δ, which grows to the half order
    delta = 2.0 * np.pi * np.minimum(np.abs(least), _NEAR_HALF)
    of_least = along * np.fmax(1.0, delta / np.maximum(np.sin(delta), 1e-9))
    across = np.where(small, of_least, 2.0 * np.abs(shown) * turn)
    away = np.angle(shown * np.conj(field))
    taken_off = 0.0 if residual is None else residual.uncertainty
    uncertainty, swing = (
        np.sqrt(np.square(a * np.cos(away)) + np.square(b * np.sin(away)) + np.square(taken_off))
        for a, b in ((along, across), (across, along))
    )
    turn = swing / np.maximum(2.0 * np.abs(field), 1e-30)
    return field, uncertainty, turn, known & (uncertainty < LARGEST_UNCERTAINTY)
