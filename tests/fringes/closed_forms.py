"""Light of known fringe orders in a few lines of numpy, without the package: the tests' truth."""

import numpy as np


def point_load(
    shape: tuple[int, int],
    *,
    load: float,
    bulk: float = 0.0,
    tilt_deg: float = 0.0,
    above_px: float = 12.0,
) -> np.ndarray:
    """N exp 2i theta of a force on a half-plane and a stress along x, theta from +x, y upward.
    Flamant: radial compression of `load` cos(alpha)/r fringes, r in pixels and alpha from the
    force, which leans by `tilt_deg`; the surface is `above_px` above the first row, in the middle.
    """
    rows, cols = np.indices(shape, dtype=float)
    x, y = cols - 0.5 * (shape[1] - 1), -(rows + above_px)
    z = x + 1j * y
    force = np.exp(-1j * np.radians(90.0 - tilt_deg))
    return -load * (z * np.conj(force)).real * z / (np.abs(z) ** 2 * np.conj(z)) + bulk


def disc(shape: tuple[int, int], radius_px: float, centre: float) -> np.ndarray:
    """N exp 2i theta of a disc under diametral load, `centre` fringes there; NaN outside.
    Frocht (1948): 4 (1 - |s|^2)/conj(s^2 + 1)^2, over its value of 4 in the centre."""
    rows, cols = np.indices(shape, dtype=float)
    s = (cols - 0.5 * (shape[1] - 1) - 1j * (rows - 0.5 * (shape[0] - 1))) / radius_px
    inside = (np.abs(s) < 0.97) & (np.abs(np.abs(s.imag) - 1.0 + 1j * s.real) > 0.3)
    s = np.where(inside, s, 0.0)
    return np.where(inside, centre * (1.0 - np.abs(s) ** 2) / np.conj(s**2 + 1.0) ** 2, np.nan)


def valley(shape: tuple[int, int], *, slope: float, lowest: float) -> np.ndarray:
    """N exp 2i theta whose real part passes through 0 down the middle; the other is `lowest` on.
    `slope` in fringes a pixel; the imaginary part doubles from the first row to the last."""
    rows, cols = np.indices(shape, dtype=float)
    return slope * (cols - 0.5 * shape[1]) + 1j * lowest * (1.0 + rows / shape[0])


def dark_field(order: np.ndarray, *, background: float = 0.05, amplitude: float = 0.8):
    """I = Ib + Ia sin^2(pi N), of full scale."""
    return background + amplitude * np.sin(np.pi * order) ** 2


def grey(light: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
    """Light as a camera of 8 bits gives it, of full scale: noise in grey levels, and rounding."""
    levels = np.rint(255.0 * light + noise * rng.standard_normal(light.shape))
    return np.clip(levels, 0.0, 255.0) / 255.0


def step_light(
    field: np.ndarray,
    angles,
    *,
    background: float = 0.05,
    amplitude: float = 0.8,
    plate: float = 1.0,
):
    """The light of one step by products of Jones matrices, plates of `plate` quarter waves.
    `angles`: polariser, both plates' fast axes (None without plates) and analyser, degrees."""
    polariser, first, second, analyser = angles
    theta, delta = 0.5 * np.angle(field), 2.0 * np.pi * np.abs(field)
    wave = np.cos(np.radians(polariser)), np.sin(np.radians(polariser))
    if first is not None:
        wave = _retarded(wave, 0.5 * np.pi * plate, np.radians(first))
    wave = _retarded(wave, delta, theta)
    if second is not None:
        wave = _retarded(wave, 0.5 * np.pi * plate, np.radians(second))
    passed = np.cos(np.radians(analyser)) * wave[0] + np.sin(np.radians(analyser)) * wave[1]
    return background + amplitude * np.abs(passed) ** 2


def _retarded(wave, retardance, axis):
    """A wave (x, y) behind a retarder: into its axes, each its phase, and back."""
    cos, sin = np.cos(axis), np.sin(axis)
    along = (cos * wave[0] + sin * wave[1]) * np.exp(-0.5j * retardance)
    across = (cos * wave[1] - sin * wave[0]) * np.exp(0.5j * retardance)
    return cos * along - sin * across, sin * along + cos * across
