"""Frames of contacts that are not their scene's: Hertz's pressure, changed, on strips of uniform
traction. Contact, stress, light and camera are written here once more; nothing is the package's."""

import numpy as np

from fitting.sliding_bench import FRICTION, LOAD, bench

SAMPLES, STRIPS = 5, 1200
NOISE_GREY = 3.0


def frame(seed=0, *, rows=164, cols=220, modulus=1.0, debris=None, shear=0.0, bulk=(0.0, 0.0),
          tilt=0.0):  # fmt: skip
    """The stored grey levels of the bench's contact, with friction that does not couple.

    `modulus`, of the specimen over the stated; `debris`, (height over the largest pressure, width
    mm, place over the half-width); `shear`, power that it falls faster to the edges; `bulk`, stress
    (MPa) and its change along the surface (MPa/mm); `tilt`, change of the load through the
    thickness over its mean.
    """
    scene = bench(rows, cols)
    line = LOAD / scene.specimen.thickness_mm
    places, weights = np.polynomial.legendre.leggauss(5) if tilt else ([0.0], [2.0])
    pixel = 4.0 / cols
    x = -2.0 + pixel * (np.arange(cols * SAMPLES) + 0.5) / SAMPLES
    z = pixel * (np.arange(rows * SAMPLES) + 0.5) / SAMPLES
    field = sum(
        0.5 * w * stress(x, z, *tractions(scene, line * (1.0 + tilt * t), modulus, debris, shear))
        for t, w in zip(places, weights, strict=True)
    )
    # balance in the half-plane: a change along the surface needs a shear that grows with depth
    field = field + bulk[0] + bulk[1] * (x[None, :] - 2j * z[:, None])
    order = scene.specimen.thickness_mm / scene.specimen.fringe_value_n_per_mm * np.abs(field)
    return grey(np.sin(np.pi * order) ** 2, seed)


def tractions(scene, line, modulus, debris, shear):
    """Strips' edges (mm), pressure and shear (MPa), under a load a thickness (N/mm)."""
    soft, hard = scene.specimen, scene.indenter
    compliance = (1.0 - soft.poisson**2) / (1e3 * soft.young_gpa * modulus)
    compliance += (1.0 - hard.poisson**2) / (1e3 * hard.young_gpa)
    half = np.sqrt(4.0 * line * hard.radius_mm * compliance / np.pi)
    peak = 2.0 * line / (np.pi * half)
    edges = np.linspace(-1.5 * half, 1.5 * half, STRIPS + 1)
    width, middle = edges[1] - edges[0], 0.5 * (edges[1:] + edges[:-1])
    u = np.clip(edges / half, -1.0, 1.0)
    pressure = 0.5 * peak * half * np.diff(u * np.sqrt(1.0 - u**2) + np.arcsin(u)) / width
    inside = np.abs(middle) < half
    if debris:
        height, size, at = debris
        bump = np.exp(-0.5 * ((middle - at * half) / size) ** 2)
        pressure = pressure + height * peak * bump * inside
    pressure *= line / (pressure.sum() * width)
    traction = FRICTION * pressure
    if shear:
        traction = np.maximum(0.0, 1.0 - (middle / half) ** 2) ** (0.5 + shear)
        traction *= FRICTION * line / (traction.sum() * width)
    return edges, pressure, traction


def stress(x, z, edges, pressure, shear):
    """(sigma_x - sigma_z) + 2i tau_xz on a grid below strips of uniform traction.

    The sum over strips of -(2/pi) [z (p + iq) (1/(ζ-b) - 1/(ζ-a)) + q ln((ζ-a)/(ζ-b))], ζ = x - iz.
    Source: Johnson (1985), Contact Mechanics, section 2.5.
    """
    zeta, total = x[None, :] - 1j * z[:, None], 0.0
    slopes = np.diff(np.r_[0.0, pressure + 1j * shear, 0.0])
    steps = np.diff(np.r_[0.0, shear, 0.0])
    for edge, slope, step in zip(edges, slopes, steps, strict=True):
        away = zeta - edge
        total = total - slope * z[:, None] / away + step * np.log(away)
    return -2.0 / np.pi * total


def grey(signal, seed):
    """8-bit grey levels of pixels, the mean of their samples, under a lamp that falls off."""
    z, x = (np.linspace(-1.0, 1.0, n) for n in signal.shape)
    light = 1.0 - 0.15 * (z[:, None] ** 2 + x[None, :] ** 2)
    light = 0.8 * light / light.max() * signal + 0.05
    rows, cols = (n // SAMPLES for n in light.shape)
    light = light.reshape(rows, SAMPLES, cols, SAMPLES).mean(axis=(1, 3))
    noise = NOISE_GREY * np.random.default_rng(seed).normal(size=light.shape)
    return np.clip(np.rint(255.0 * light + noise), 0.0, 255.0).astype(np.uint8)
