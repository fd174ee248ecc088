r"""Fringe orders of specimens by closed forms, written out: no code of the package.

Each field is e = sigma_y - sigma_x + 2i tau_xy at complex places w = x + iy (y upward), the picture
1 in half its width, and the order N = |e| up to a scale. Sources: Muskhelishvili (1953), Some basic
problems of the mathematical theory of elasticity (holes); Westergaard (1939), J. Appl. Mech. 6, 49
(cracks); Frocht (1948), Photoelasticity, vol. 2 (discs); Timoshenko & Goodier (1951), Theory of
elasticity (wedge, beam, half-plane, thick ring); Williams (1952), J. Appl. Mech. 19, 526 (free
corner).
"""

import numpy as np

RIM = 0.03
"""Share of half a picture's width beside loads and tips that belongs to no specimen here."""


def hole(w, rng):
    """Kirsch's hole, stresses of a random ratio far away."""
    radius, ratio = rng.uniform(0.15, 0.35), rng.uniform(-0.6, 0.8)
    field = sum(
        share * _ellipse(w / radius, 0.0, turn)
        for share, turn in ((1.0, 0.0), (ratio, 0.5 * np.pi))
    )
    return field, np.abs(w) > radius


def ellipse(w, rng):
    """Inglis' ellipse, under tension across some direction."""
    size, m, turn = rng.uniform(0.15, 0.3), rng.uniform(0.2, 0.7), rng.uniform(0.0, np.pi)
    x, y = w.real / size, w.imag / size
    body = (x / (1.0 + m)) ** 2 + (y / (1.0 - m)) ** 2 > 1.0
    return _ellipse(w / size, m, turn), body


def _ellipse(z, m, turn=0.0):
    """An elliptic hole z = s + m/s, |s| = 1, under unit tension along `turn`."""
    root = np.sqrt(z * z - 4.0 * m + 0j)
    s = 0.5 * (z + root)
    s = np.where(np.abs(s) < 1.0, z - s, s)
    s = np.where(np.abs(s) < 1.0, 1.0, s)
    a = 2.0 * np.exp(2j * turn) - m
    slope = 1.0 - m / s**2
    bend = 0.25 * 2.0 * s * (a - m) / (s * s - m) ** 2 / slope
    b = np.exp(2j * turn)
    # psi' with its poles at 0 and at s² = m; m = 0 is the circle
    if m:
        inner = -b / (m * s**2) + (1.0 + m * m) * (b - m) / m * (s * s + m) / (s * s - m) ** 2
    else:  # the limit: -1/s² (of the tension itself) and 3 b/s⁴
        inner = -1.0 / s**2 + 3.0 * b / s**4
    psi = -0.5 * (np.conj(b) + inner) / slope
    return 2.0 * (np.conj(z) * bend + psi)


def crack(w, rng):
    """Westergaard's crack in tension and shear, with a stress along it."""
    half, shear, along = rng.uniform(0.25, 0.6), rng.uniform(-0.5, 0.5), rng.uniform(-1.0, 1.0)
    w = w * np.exp(1j * rng.uniform(-0.5, 0.5))
    root = np.sqrt(w - half) * np.sqrt(w + half)
    open_, slope = w / root, -(half**2) / root**3
    field = -2j * w.imag * slope - along + shear * (2j * open_ - 2.0 * w.imag * slope)
    body = ~((np.abs(w.imag) < RIM) & (np.abs(w.real) < half + RIM))
    return field, body


def crack_tip(w, rng):
    """Williams' leading terms about a tip: K_I, K_II and T."""
    shear, along = rng.uniform(-0.8, 0.8), rng.uniform(-1.0, 1.0)
    w = (w - rng.uniform(-0.4, 0.2)) * np.exp(1j * rng.uniform(-0.5, 0.5))
    open_, slope = w**-0.5, -0.5 * w**-1.5
    field = -2j * w.imag * slope - along + shear * (2j * open_ - 2.0 * w.imag * slope)
    return field, ~((np.abs(w.imag) < RIM) & (w.real < 0.0)) & (np.abs(w) > RIM)


def disc(w, rng, loads=2):
    """A disc under two radial loads, or more; its rim in the picture."""
    radius = rng.uniform(0.62, 0.72)
    z = w / radius * np.exp(1j * rng.uniform(0.0, 2.0 * np.pi))
    if loads == 2:
        at, size = np.array([1.0, -1.0]), np.ones(2)
    else:
        at = np.exp(2j * np.pi * np.array([0.0, rng.uniform(0.28, 0.42), rng.uniform(0.58, 0.72)]))
        # equilibrium of three radial forces: the sines of the angles between the other two
        size = np.sin(np.angle(np.roll(at, -2) / np.roll(at, -1)))
    body = np.abs(z) < 0.985
    for place in at:
        body &= np.abs(z - place) > 3.0 * RIM
    return sum(f * _radial(z, place, -place) for f, place in zip(size, at, strict=True)), body


def three_loads(w, rng):
    """A disc under three loads."""
    return disc(w, rng, loads=3)


def _radial(z, place, inward):
    """A point load on an edge: radial pressure 2 cos(theta)/(pi r) of unit load."""
    away = z - place
    far = np.maximum(np.abs(away), 1e-6)
    cosine = (away * np.conj(inward)).real / far
    return 2.0 * cosine / (np.pi * far) * np.conj((away / far) ** 2)


def thick_ring(w, rng):
    """Lamé's ring under pressure from inside, and a pull along one direction far away."""
    inner = rng.uniform(0.2, 0.35)
    pull = rng.choice([0.0, 0.15])
    field = 2.0 * np.conj((w / np.abs(w)) ** 2) / np.abs(w / inner) ** 2
    return field + pull * _ellipse(w / inner, 0.0), np.abs(w) > inner


def wedge(w, rng):
    """A wedge loaded at its tip: radial stress alone, of a push and of a bend."""
    half, bend = rng.uniform(0.35, 0.9), rng.uniform(-0.6, 0.6)
    z = (w - (-0.95 + 0j)) * np.exp(1j * rng.uniform(-0.1, 0.1))
    angle = np.angle(z)
    push = np.cos(angle) / (half + 0.5 * np.sin(2 * half))
    across = bend * np.sin(angle) / (half - 0.5 * np.sin(2 * half))
    field = (push + across) / np.abs(z) * np.conj((z / np.abs(z)) ** 2)
    return field, (np.abs(angle) < half) & (np.abs(z) > 6.0 * RIM)


def half_plane(w, rng):
    """Two loads on an edge above the picture, and a stress along it."""
    edge = 1j * rng.uniform(0.8, 0.95)
    first, second = rng.uniform(-0.7, 0.0), rng.uniform(0.1, 0.7)
    turn = np.exp(1j * rng.uniform(-0.4, 0.4))
    field = _radial(w, edge + first, -1j) + rng.uniform(0.3, 1.0) * _radial(
        w, edge + second, -1j * turn
    )
    return field - rng.uniform(-0.4, 0.4), w.imag < edge.imag - 3.0 * RIM


def contact(w, rng):
    """Hertz' contact without friction (McEwen 1949)."""
    half, edge = rng.uniform(0.15, 0.4), rng.uniform(0.65, 0.75)
    z = (edge - w.imag) + 1j * (w.real - rng.uniform(-0.2, 0.2))  # depth + i along
    x, y = np.imag(z), np.maximum(np.real(z), 1e-9)
    square = half**2 - x**2 + y**2
    root = np.hypot(square, 2.0 * x * y)
    m = np.sqrt(np.maximum(0.5 * (root + square), 1e-18))
    n = np.sign(x) * np.sqrt(np.maximum(0.5 * (root - square), 0.0))
    ratio = (y**2 + n**2) / (m**2 + n**2)
    along = -(m * (1.0 + ratio) - 2.0 * y) / half
    down = -m * (1.0 - ratio) / half
    shear = n * (m**2 - y**2) / (m**2 + n**2) / half
    return down - along + 2j * shear, np.real(z) > RIM


def beam(w, rng):
    """A cantilever under its end's load, with a pull along it."""
    height, pull = rng.uniform(0.5, 0.65), rng.uniform(-0.3, 0.3)
    z = w * np.exp(1j * rng.uniform(-0.05, 0.05))
    bent = 1.5 * (z.real + 1.6) * z.imag / height**3
    sheared = 0.75 * (height**2 - z.imag**2) / height**3
    return -(bent + pull) + 2j * sheared, np.abs(z.imag) < 0.98 * height


def bowl(w, rng):
    """Closed rings of a bowl, on a slope: no specimen, but a clean interferogram."""
    z = w - rng.uniform(-0.3, 0.3) - 1j * rng.uniform(-0.2, 0.2)
    field = 1.0 + rng.uniform(0.2, 1.0) * z.real**2 + rng.uniform(0.2, 1.0) * z.imag**2
    return field + rng.uniform(0.0, 0.5) + 0j, np.abs(w) >= 0.0


def free_corner(w, rng):
    """A plate's corner between two free sides, right of its tip: Williams' first term.

    phi = A z^l + conj(A) z^conj(l), psi likewise with C, and sin(2 l a) + l sin(2 a) = 0 of half
    the angle, a: then phi + z conj(phi') + conj(psi), the force from the tip, is 0 on both sides.
    """
    half = 0.5 * np.radians(rng.uniform(60.0, 105.0))
    power = _williams(half)
    z = np.where(np.abs(w + 0.9) > 1e-9, w + 0.9, 1e-9)  # the tip left in the picture
    factor = np.exp(1j * rng.uniform(0.0, np.pi))
    other = -factor * (np.cos(2.0 * power * half) + power * np.cos(2.0 * half))
    field = 0.0
    for a, c, p in ((factor, other, power), tuple(map(np.conj, (factor, other, power)))):
        field = field + 2.0 * p * (a * (p - 1.0) * np.conj(z) * z ** (p - 2.0) + c * z ** (p - 1.0))
    return field, np.abs(np.angle(z)) < half


def _williams(half):
    """The least root of sin(2 l a) = -l sin(2 a) beyond 1, by Newton's steps."""
    power = 2.74 * np.pi / 4.0 / half * (1.0 + 0.4j)
    for _ in range(60):
        value = np.sin(2.0 * power * half) + power * np.sin(2.0 * half)
        power = power - value / (2.0 * half * np.cos(2.0 * power * half) + np.sin(2.0 * half))
    return power


KINDS = {
    each.__name__.replace("_", " "): each
    for each in (
        hole, ellipse, crack, crack_tip, disc, three_loads, thick_ring, wedge, half_plane, contact,
        beam, bowl,
    )
}  # fmt: skip


def packed_discs(w, rng):
    """Three discs of different sizes in a row, pressed together along it; each is a body."""
    radii = 0.92 * rng.dirichlet([20.0, 20.0, 20.0])
    field, body = np.zeros_like(w), np.zeros(w.shape, dtype=bool)
    left = -0.92
    for radius in radii:
        z = (w - (left + radius)) / radius
        own = np.abs(z) < 0.985
        for place in (1.0, -1.0):
            own &= np.abs(z - place) > RIM / radius
            field = np.where(np.abs(z) < 1.0, field + _radial(z, place, -place) / radius, field)
        body |= own
        left += 2.0 * radius
    return field, body


BODIES = {"packed discs": packed_discs}
"""Several bodies in a picture, which `case_silent`'s frames do not have."""


def places(shape, samples):
    """Complex places of the samples of a picture (rows samples, cols samples)."""
    rows, cols = shape
    x = ((np.arange(cols * samples) + 0.5) / samples - 0.5 * cols) / (0.5 * cols)
    y = -((np.arange(rows * samples) + 0.5) / samples - 0.5 * rows) / (0.5 * cols)
    return x[None, :] + 1j * y[:, None]


def order_field(kind, shape, seed, *, highest, steepest=0.12, samples=3):
    """Order and body at the samples, scaled to `highest`; `steepest`, fringes a pixel, is passed by
    2 % of the specimen at most."""
    rng = np.random.default_rng(seed)
    draw = free_corner if kind == "free corner" else (KINDS | BODIES)[kind]
    field, body = draw(places(shape, samples), rng)
    order = np.abs(field)
    slope = samples * np.hypot(*np.gradient(order))[body]
    scale = min(highest / np.percentile(order[body], 98.0), steepest / np.percentile(slope, 98.0))
    return scale * order, body
