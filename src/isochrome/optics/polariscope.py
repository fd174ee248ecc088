"""The polariscope by Jones calculus (analyser, plate, specimen, plate, polariser), and its law.

A retarder of retardance δ with its fast axis at θ is J = cos(δ/2) I - i sin(δ/2) [[cos 2θ, sin 2θ],
[sin 2θ, -cos 2θ]]. The field behind the analyser is then α cos(δ/2) - i w sin(δ/2) with w = β cos
2θ + γ sin 2θ, and α, β, γ three complex numbers of the elements alone: real plates and any angles
cost no more than ideal ones. The specimen's axis is the direction of sigma_1; which of its axes is
the fast one only turns the sign of δ, which no frame of matched plates shows. Source: Theocaris &
Gdoutos (1979), Matrix Theory of Photoelasticity; Jones (1941), JOSA 31, 488.

The polariscope's signal for light of several wavelengths, in every channel of the camera.

The light of a spectrum S(l), seen by a channel of response R(l), is I = ∫ S R I(N l0/l) dl / ∫ S R
dl, l0 the wavelength of the material fringe value: the stress-optic constant is the same at all, so
that the order goes as 1/l. A pixel's area takes contrast off fringes and shows a mean order, no
aliasing. Source: Ajovalasit, Barone & Petrucci (1995), J. Strain Analysis 30, 29.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.optics.camera import Response
from isochrome.scene import Polariscope, Spectrum
from isochrome.stress import ROWS_AT_ONCE, StressDifference


def fringe_order(
    difference_mpa: StressDifference, *, thickness_mm: float, fringe_value_n_per_mm: float
) -> NDArray[np.floating]:
    """Fringe order N (rows, cols) of the stress difference (sigma_x - sigma_z) + 2i tau_xz, MPa. N
    = (sigma_1 - sigma_2) d / f_sigma, f_sigma in N/mm per fringe; the retardation is 2 pi N.
    Source: Dally & Riley (1991), Experimental Stress Analysis, section 12.2."""
    order = np.asarray(np.abs(difference_mpa))
    order *= thickness_mm / fringe_value_n_per_mm
    return order


Array = NDArray[np.floating]

_Angles = tuple[float, float | None, float | None, float]
"""Polariser, input plate, output plate, analyser (degrees); no plates in a plane polariscope."""

_DARK: _Angles = (90.0, 45.0, -45.0, 0.0)
"""In the bright field the analyser lies along the polariser."""


@dataclass(frozen=True)
class Chain:
    """The elements' three amplitudes: I = |α cos(δ/2) - i (β cos 2θ + γ sin 2θ) sin(δ/2)|²."""

    alpha: complex  # of light that the specimen leaves as it is
    beta: complex  # of what it changes, over cos 2θ
    gamma: complex  # over sin 2θ
    # +1 for the ideal dark field, -1 for the ideal bright one, where θ drops out; else 0
    ideal: int = 0
    band: float = 0.0  # standard deviation of the wavelengths over their mean


def make_chain(
    polariscope: Polariscope, step: int | None = None, *, wavelength_nm: float | None = None
) -> Chain:
    """The amplitudes of a scene's polariscope at one wavelength, by default the scene's one. The
    elements' errors are added to their angles. Plates are quarter-wave at `plate_wavelength_nm` (at
    every wavelength when absent), their retardance (π/2) plate_wavelength/wavelength: the
    dispersion of the birefringence is left out. The plane field is crossed, its polariser at
    `axis_deg`. `step`: which phase step. InputError where several wavelengths leave it open."""
    if wavelength_nm is None:
        if polariscope.several_wavelengths:
            raise InputError("polariscope_light_has_several")
        wavelength_nm = polariscope.wavelength_nm
    ratio = 1.0
    if polariscope.plate_wavelength_nm is not None and wavelength_nm is not None:
        ratio = polariscope.plate_wavelength_nm / wavelength_nm
    band = 0.0
    if polariscope.bandwidth_nm is not None and polariscope.wavelength_nm is not None:
        half_height = math.sqrt(8.0 * math.log(2.0))  # a Gaussian's width there, over its deviation
        band = polariscope.bandwidth_nm / half_height / polariscope.wavelength_nm
    polariser, first, second, analyser = _angles_of(polariscope, step)
    if step is None and ratio == 1.0 and (polariser, first, second) == _DARK[:3]:
        if analyser == _DARK[3]:
            return Chain(0j, 1 + 0j, 1j, 1, band)
        if analyser == polariser:
            return Chain(1 + 0j, 0j, 0j, -1, band)
    # unit vectors along the polariser's and the analyser's axis
    turns = math.radians(polariser), math.radians(analyser)
    light, output = (np.array([math.cos(turn), math.sin(turn)], dtype=complex) for turn in turns)
    if first is not None and second is not None:
        light = retarder(0.5 * math.pi * ratio, first) @ light
        output = output @ retarder(0.5 * math.pi * ratio, second)
    alpha, beta = complex(output @ light), complex(output[0] * light[0] - output[1] * light[1])
    return Chain(alpha, beta, complex(output[0] * light[1] + output[1] * light[0]), band=band)


def band_pass(order: Array, width: float) -> tuple[Array, Array]:
    """What a band of wavelengths takes from the fringes' contrast, V, and how it moves them, φ. The
    mean of exp(i a/(1+x)), a = 2 pi N, over Gaussian x of standard deviation s = `width`, with
    1/(1+x) = 1 - x + x², q = 2 a s², is exp(i a) V exp(i φ): V = (1+q²)^(-1/4) exp(-a² s²/(2 +
    2q²)), φ = atan(q)/2 - a³ s⁴/(1+q²), rad. What is left out moves a fringe by a s³ of a turn at
    most."""
    phase = np.asarray(2.0 * np.pi * order)
    bent = 2.0 * width**2 * phase
    below = 1.0 + bent**2
    contrast = below**-0.25 * np.exp(-0.5 * (width * phase) ** 2 / below)
    return contrast, 0.5 * np.arctan(bent) - width**4 * phase**3 / below


def _angles_of(polariscope: Polariscope, step: int | None) -> _Angles:
    """Angles of the elements as they stand, errors included (degrees)."""
    polariser, first, second, analyser = _DARK
    if polariscope.field == "bright":
        analyser = polariser
    if step is not None:
        angles = polariscope.step[step]
        polariser, analyser = angles.polariser_deg, angles.analyser_deg
        first, second = angles.input_plate_deg, angles.output_plate_deg
    elif polariscope.field == "plane":
        polariser = 90.0 if polariscope.axis_deg is None else polariscope.axis_deg
        first, second, analyser = None, None, polariser + 90.0
    if first is not None and second is not None:
        first += polariscope.input_plate_error_deg
        second += polariscope.output_plate_error_deg
    polariser += polariscope.polariser_error_deg
    return polariser, first, second, analyser + polariscope.analyser_error_deg


def retarder(retardance_rad: float, fast_axis_deg: float) -> NDArray[np.complex128]:
    """Jones matrix (2, 2) of a retarder with its fast axis at an angle from +x."""
    c, s = math.cos(0.5 * retardance_rad), math.sin(0.5 * retardance_rad)
    a, b = math.cos(math.radians(2 * fast_axis_deg)), math.sin(math.radians(2 * fast_axis_deg))
    return np.array([[c - 1j * s * a, -1j * s * b], [-1j * s * b, c + 1j * s * a]])


@dataclass(frozen=True)
class FringeWave:
    """A signal about an order N: mean + cosine cos t + sine sin t, t = `turns` + 2 pi d, at N + d.
    `turns`, rad; `sine` None: none."""

    mean: Array | float
    cosine: Array | float
    sine: Array | None
    turns: Array

    @property
    def light(self) -> Array:
        """The signal at the order itself."""
        light = np.asarray(np.cos(self.turns))
        light *= self.cosine
        if self.sine is not None:
            light += self.sine * np.sin(self.turns)
        light += self.mean
        return light

    def every(self, stride: int) -> "FringeWave":
        """The signal at every `stride`-th pixel."""

        def few(part: Array | float) -> Array:
            return np.broadcast_to(part, self.turns.shape)[::stride, ::stride]

        sine = None if self.sine is None else few(self.sine)
        return FringeWave(few(self.mean), few(self.cosine), sine, few(self.turns))


def polariscope_wave(
    order: Array, chain: Chain, *, direction: Array | None = None, visibility: Array | float = 1.0
) -> FringeWave:
    """The light near an order; what a band of wavelengths does changes little within a branch."""
    # in place: a fresh array of a frame costs more than the arithmetic on it
    turns = np.asarray(np.rint(order))
    np.subtract(order, turns, out=turns)
    turns *= 2.0 * np.pi
    if chain.band:
        contrast, shift = band_pass(order, chain.band)
        visibility, turns = visibility * contrast, turns + shift
    if chain.ideal:
        return FringeWave(0.5, -0.5 * chain.ideal * visibility, None, turns)
    if direction is None:
        raise ValueError(message("chain_not_ideal_needs"))
    # |w|² and Im(α w*) of w = β cos 2θ + γ sin 2θ in real numbers: a fourth of the arithmetic
    alpha, beta, gamma = chain.alpha, chain.beta.conjugate(), chain.gamma.conjugate()
    c, s = np.cos(2.0 * direction), np.sin(2.0 * direction)
    straight, both = abs(alpha) ** 2, 2.0 * (beta.conjugate() * gamma).real
    crossed = (abs(beta) ** 2 * c + both * s) * c + abs(gamma) ** 2 * (s * s)
    mixed = (alpha * beta).imag * c + (alpha * gamma).imag * s
    mean, cosine = 0.5 * (straight + crossed), 0.5 * (straight - crossed)
    return FringeWave(mean, visibility * cosine, -visibility * mixed, turns)


def polariscope_signal(
    order: Array, chain: Chain, *, direction: Array | None = None, visibility: Array | float = 1.0
) -> Array:
    """The light behind the analyser, 1 for the full light of the ideal bright field. |α|² cos²(δ/2)
    + |w|² sin²(δ/2) - Im(α w*) sin δ with δ = 2 pi N, where the pixel's area scales cos δ and sin δ
    by its visibility; ideal dark field: sin²(pi N). `direction` θ of sigma_1 (rad) is needed where
    the chain is not ideal (ValueError). Precise to 1e-14 in float64; in float32 to 2e-7 and what
    the order carries: whole fringes are taken off first, which loses no digit."""
    return polariscope_wave(order, chain, direction=direction, visibility=visibility).light


WHITE = Spectrum(wavelength_nm=(400.0, 700.0), power=(1.0, 1.0))
"""Equal energy over the visible."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
_LONGEST_NM = 25.0
"""Six nodes a piece hold a Gaussian of 30 nm over this length to 1e-12."""


@dataclass(frozen=True)
class Light:
    """Light as the channels of a camera weigh it."""

    wavelength_nm: Array  # (s,)
    weights: Array  # (channels, s), of sum 1 in each channel
    continuous: bool  # samples of a spectrum, not lines


def make_light(polariscope: Polariscope, response: Response, *, highest_order: float) -> Light:
    """The wavelengths of a scene's light and their weights in each channel of the camera. A
    spectrum is integrated between its own and the response's samples, by Gauss-Legendre with six
    nodes for every half turn of the retardation, at the highest order in the picture, and every 25
    nm: 1e-9. InputError where a channel sees nothing of it, or the wavelength is missing."""
    wavelength = polariscope.wavelength_nm
    if polariscope.lines is not None:
        places, power = np.array(polariscope.lines.wavelength_nm), np.array(polariscope.lines.power)
    elif wavelength is None:
        raise InputError("polariscope_wavelength_nm_missing_camera")
    elif polariscope.continuous:
        spectrum = polariscope.spectrum or WHITE
        edges = _edges(spectrum, response, wavelength * highest_order)
        half, middle = 0.5 * np.diff(edges), 0.5 * (edges[1:] + edges[:-1])
        places = (middle[:, None] + half[:, None] * _NODES).ravel()
        power = (half[:, None] * _WEIGHTS).ravel()
        power *= np.interp(places, spectrum.wavelength_nm, spectrum.power)
    else:
        places, power = np.array([wavelength]), np.ones(1)
    weights = response.at(places) * power
    total = weights.sum(axis=1, keepdims=True)
    for name, light in zip(response.names, total[:, 0], strict=True):
        if not light > 0.0:
            raise InputError("polariscope_camera_channel_sees", name=name)
    weights /= total
    visible = (weights > 0.0).any(axis=0)
    return Light(places[visible], weights[:, visible], polariscope.continuous)


def _edges(spectrum: Spectrum, response: Response, retardation_nm: float) -> Array:
    """Ends of the pieces in which the integrand is smooth and turns by half a fringe at most."""
    places = np.array(spectrum.wavelength_nm)
    if response.wavelength_nm is not None:
        inside = (response.wavelength_nm > places[0]) & (response.wavelength_nm < places[-1])
        places = np.union1d(places, response.wavelength_nm[inside])
    turns = retardation_nm * (1.0 / places[:-1] - 1.0 / places[1:])
    pieces = np.ceil(np.maximum(2.0 * turns, np.diff(places) / _LONGEST_NM)).astype(int)
    # equal steps of 1/l: equal turns
    inner = [
        1.0 / np.linspace(1.0 / a, 1.0 / b, n + 1)[:-1]
        for a, b, n in zip(places[:-1], places[1:], pieces, strict=True)
    ]
    return np.concatenate([*inner, places[-1:]])


_TINY = 1e-15
"""Added to a sinc's argument, so that 0/0 is 1; far below what changes any other."""


def pixel_visibility(order: Array) -> tuple[Array, float]:
    """Contrast V, in 0..1, that square pixels leave of the fringes, and the share too fine to see.
    The mean of cos 2 pi N over a pixel in which N has the gradient g (fringes a pixel) is sinc(g_x)
    sinc(g_y) cos 2 pi N, sinc(x) = sin(pi x)/(pi x), taken as 0 where negative. The share: of
    pixels with fringes (N > 1/2), those with one finer than two pixels. NaN: no specimen."""
    visibility, fine = np.empty_like(order), 0
    for start in range(0, len(order), ROWS_AT_ONCE):
        here = slice(start, start + ROWS_AT_ONCE)
        above = min(start, 1)
        rows = _slope(order[start - above : start + ROWS_AT_ONCE + 1], 0)[above:][:ROWS_AT_ONCE]
        cols = _slope(order[here], 1)
        contrast = slope_visibility(rows, cols, out=visibility[here])
        # sinc(g_x) sinc(g_y) <= 0.651 wherever g_x² + g_y² > 1/4: few pixels need the look
        likely = contrast < 0.66
        if likely.any():
            steep = np.hypot(rows[likely], cols[likely]) > 0.5
            fine += int(np.count_nonzero(steep & (order[here][likely] > 0.5)))
    bearing = int(np.count_nonzero(order > 0.5))
    return visibility, fine / bearing if bearing else 0.0


def slope_visibility(rows: Array, cols: Array, *, out: Array | None = None) -> Array:
    """Contrast sinc(g_x) sinc(g_y) that square pixels leave, of slopes in fringes a pixel."""
    return np.multiply(_sinc(rows), _sinc(cols), out=out)


def mean_order(order: Array, *, stride: float = 1.0, blur_px2: float = 0.0) -> Array:
    """The order M (rows, cols) that square pixels show of N in their middles, NaN off the specimen.
    Over a pixel of side 1 the mean of exp(2 pi i N) is V exp(2 pi i M), M = N + (d²N/dx² +
    d²N/dz²)/24, to second order in the pixel's size; V, see `pixel_visibility`. Beside an edge N
    has the bend of the next pixel, or none. `stride`: pixels from one entry to the next; a blur of
    variance `blur_px2` adds half of that times the same bend."""
    bend = _bend(order, 0)
    bend += _bend(order, 1)
    bend *= (1.0 / 24.0 + 0.5 * blur_px2) / stride**2
    bend += order
    return bend


def _sinc(x: Array) -> Array:
    """sin(pi x)/(pi x), and nothing where it turns the fringes' contrast round."""
    import cv2

    angle = np.pi * x
    angle += _TINY
    if angle.dtype == np.float32:  # both sine and cosine, in half the time of np.sin, to 2e-7
        value = np.asarray(cv2.polarToCart(1.0 / angle, angle)[1], np.float32)
    else:
        value = np.asarray(np.sin(angle) / angle)
    return np.asarray(np.maximum(value, 0.0, out=value))


def _slope(order: Array, axis: int) -> Array:
    """Fringes a pixel along an axis, of the neighbours with an order: an edge is no fringe."""
    if order.shape[axis] < 2:
        return np.zeros_like(order)
    slope = np.empty_like(order)  # central differences, one-sided at the borders
    n, s = order.swapaxes(0, axis), slope.swapaxes(0, axis)
    np.subtract(n[2:], n[:-2], out=s[1:-1])
    s[1:-1] *= 0.5
    s[0], s[-1] = n[1] - n[0], n[-1] - n[-2]
    if not math.isfinite(float(slope.max())):
        slope[~np.isfinite(order)] = 0.0
        at = _places(~np.isfinite(slope))
        total, count = np.zeros((2, len(at[0])), dtype=order.dtype)
        for step in (-1, 1):
            has, beside = _beside(at, axis, step, order.shape)
            change = np.where(has, (order[beside] - order[at]) * step, np.nan)
            known = np.isfinite(change)
            total += np.where(known, change, 0.0)
            count += known
        slope[at] = total / np.maximum(count, 1.0)
    return slope


def _places(where: NDArray[np.bool_]) -> tuple[NDArray[np.intp], ...]:
    """Rows and columns of the few pixels of a mask, a tenth of np.nonzero's time."""
    return np.unravel_index(np.flatnonzero(where), where.shape)


def _beside(
    at: tuple[NDArray[np.intp], ...], axis: int, step: int, shape: tuple[int, ...]
) -> tuple[NDArray[np.bool_], tuple[NDArray[np.intp], ...]]:
    """Whether pixels have a neighbour along an axis, and its place, or their own."""
    index = at[axis] + step
    has = (index >= 0) & (index < shape[axis])
    return has, tuple(np.where(has, index, p) if k == axis else p for k, p in enumerate(at))


def _bend(order: Array, axis: int) -> Array:
    """Second differences along an axis; beside an edge those of the next pixel, or none."""
    if order.shape[axis] < 3:
        return np.zeros_like(order)
    bend = np.empty_like(order)
    n, b = order.swapaxes(0, axis), bend.swapaxes(0, axis)
    np.multiply(n[1:-1], -2.0, out=b[1:-1])
    b[1:-1] += n[2:]
    b[1:-1] += n[:-2]
    b[0], b[-1] = b[1], b[-2]
    if math.isfinite(float(bend.max())):
        return bend
    for step in (1, -1):
        at = _places(np.isnan(bend))
        bend[at] = bend[_beside(at, axis, step, order.shape)[1]]
    bend[np.isnan(bend)] = 0.0
    return bend


_STEP = 0.0078125
"""Of the table over N: cubic pieces hold cos 2 pi k N to (2 pi k/128)⁴/384, 7e-8 at k = 1.5."""

_VISIBLE = 1e-3
"""Contrast below which a pixel's waves are left out of what a table must reach."""


def highest_visible(order: Array, visibility: Array | float = 1.0) -> float:
    """The highest order that leaves a thousandth of its contrast: at a load N has no bound."""
    return float(np.max(order, where=np.asarray(visibility) > _VISIBLE, initial=0.0))


def spectral_signal(
    order: Array, light: Light, chains: Sequence[Chain], *, reference_nm: float,
    direction: Array | None = None, visibility: Array | float = 1.0,
) -> Array:  # fmt: skip
    """The light behind the analyser (rows, cols, channels), 1 for the channel's full light. I_c =
    Σ_s w_cs I(k_s N, θ, V^(k_s²)), k_s = reference/wavelength, as the order goes, and nearly the
    visibility, sinc(k g), as its power k². Lines are summed; a spectrum's sum is a table over N,
    interpolated by cubics, with V^(k²) linear in k² about the channel's mean. N and V are those at
    the reference; θ (rad) is needed where a chain, one a wavelength, is not ideal."""
    ratio = reference_nm / light.wavelength_nm
    if not light.continuous:
        total = np.zeros((*order.shape, len(light.weights)))
        for k, chain, weights in zip(ratio, chains, light.weights.T, strict=True):
            one = polariscope_signal(
                k * order, chain, direction=direction, visibility=visibility ** (k * k)
            )
            total += one[..., None] * weights
        return total
    ideal = all(chain.ideal for chain in chains)
    if direction is None and not ideal:
        raise ValueError(message("chain_not_ideal_needs"))
    order = np.minimum(order, highest_visible(order, visibility))
    angles: list[Array] = [np.ones(())]  # and cos 4θ, sin 4θ, cos 2θ, sin 2θ
    if direction is not None and not ideal:
        turned = np.exp(2j * np.asarray(direction, dtype=float))
        twice = turned * turned
        angles += [twice.real, twice.imag, turned.real, turned.imag]
    still, cosine, sine = (terms[:, : len(angles)] for terms in _harmonics(chains))
    contrast = np.asarray(visibility, dtype=float)
    signals = []
    for weights in light.weights:
        mean = float(weights @ ratio**2)
        both = np.stack([weights, weights * (ratio**2 - mean)], axis=1)
        amplitudes = (np.einsum("sv,sa->sva", both, terms) for terms in (cosine, sine))
        waves = _wave_table(float(order.max()), ratio, *amplitudes)(order)
        steady, change = (_over(angles, wave) for wave in np.moveaxis(waves, -2, 0))
        # the smallest number: the logarithm stays finite, and its product with the contrast nothing
        wave = steady + np.log(np.maximum(contrast, np.finfo(float).tiny)) * change
        signals.append(_over(angles, weights @ still) + contrast**mean * wave)
    return np.stack(signals, axis=-1)


def _over(angles: Sequence[Array], amplitudes: Array) -> Array:
    """Sum of the angles' functions times their amplitudes (..., angles)."""
    return np.asarray(sum(angle * amplitudes[..., i] for i, angle in enumerate(angles)))


def _harmonics(chains: Sequence[Chain]) -> tuple[Array, Array, Array]:
    """The signal's amplitudes (s, 5) over 1, cos 4θ, sin 4θ, cos 2θ, sin 2θ, by 1, cos δ, sin δ.
    From I = (|α|² + |w|²)/2 + (|α|² - |w|²)/2 cos δ - Im(α w*) sin δ with w = β cos 2θ + γ sin
    2θ."""
    a, b, c = (np.array([getattr(x, n) for x in chains]) for n in ("alpha", "beta", "gamma"))
    straight, none = 0.5 * np.abs(a) ** 2, np.zeros(len(chains))
    mean, difference = (0.25 * (np.abs(b) ** 2 + sign * np.abs(c) ** 2) for sign in (1.0, -1.0))
    both = 0.5 * np.real(b * np.conj(c))
    still = [straight + mean, difference, both, none, none]
    cosine = [straight - mean, -difference, -both, none, none]
    sine = [none, none, none, -np.imag(a * np.conj(b)), -np.imag(a * np.conj(c))]
    return np.stack(still, axis=1), np.stack(cosine, axis=1), np.stack(sine, axis=1)


def _wave_table(
    highest: float, ratio: Array, cosine: Array, sine: Array
) -> Callable[[Array], Array]:
    """Σ_s (cosine_s cos 2 pi k_s N + sine_s sin 2 pi k_s N) as cubics in N with exact slopes.
    Within a block of orders the waves are those of the first block, turned: one product a block."""
    from scipy.interpolate import CubicHermiteSpline

    blocks = int(highest / (_STEP * ROWS_AT_ONCE)) + 1
    order = _STEP * np.arange(blocks * ROWS_AT_ONCE + 1)
    speed = 2.0 * np.pi * ratio
    wave = (cosine - 1j * sine).reshape(len(ratio), -1)
    both = np.hstack([wave, 1j * speed[:, None] * wave])  # the value, and the slope
    first = np.exp(1j * np.outer(order[: ROWS_AT_ONCE + 1], speed))
    table = np.empty((len(order), both.shape[1]))
    for start in range(0, blocks * ROWS_AT_ONCE, ROWS_AT_ONCE):
        turned = np.exp(1j * speed * order[start])[:, None] * both
        table[start : start + ROWS_AT_ONCE + 1] = (first @ turned).real
    value, slope = np.moveaxis(table.reshape(len(order), 2, *cosine.shape[1:]), 1, 0)
    result: Callable[[Array], Array] = CubicHermiteSpline(order, value, slope)
    return result
