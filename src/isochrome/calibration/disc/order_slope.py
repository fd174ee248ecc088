"""The rise of the order with load, pixel by pixel, whatever stress the disc already holds.

With an arbitrary residual order n(x) along the same principal directions, a pixel sees
I = c + a cos(2 pi k h P) + b sin(2 pi k h P) over the loads P: h(x) is the disc's known field over
its centre value, k the centre's fringes per N, and a, b, c (with n in them) are free at every
pixel. The k that explains most of the variation, pooled over the disc, needs no start, no
illumination and no knowledge of n. (A Lomb-Scargle periodogram; Lomb, Astrophys. Space Sci. 39,
1976, 447-462.)
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.disc.disc_field import ORDERS, Circle, DiscPixels, disc_image, disc_order
from isochrome.calibration.result import ImageFit, View
from isochrome.calibration.shot import Shot

Array = NDArray[np.float64]

FEWEST_LOADS = 5
"""Three numbers a pixel are free: fewer loads leave nothing to judge k by."""

ANGLES_DEG = (-6.0, -3.0, 0.0, 3.0, 6.0)
SIDE = 90
THIN = 4
"""Columns of which one is looked at while a rise is searched for."""
WITHIN, ALONG = 0.8, 0.6
"""Radii about the centre, and along the loads, that are used."""


@dataclass(frozen=True)
class Overlay:
    """All images on the unit disc: `stack` (n, m, m), its `grid` in radii, `loads` (n,)."""

    stack: Array
    grid: DiscPixels
    loads: Array

    @property
    def used(self) -> NDArray[np.bool_]:
        """Pixels (m, m) away from the rim and from the loads."""
        x, z = self.grid.cols, self.grid.rows
        return (x**2 + z**2 < WITHIN**2) & (np.abs(z) < ALONG)

    def field(self, angle: float, scale: float = 1.0, z: float = 0.0, x: float = 0.0) -> Array:
        """Order over centre order (m, m) for loads at `angle` (rad), on a disc that is `scale`
        times the rim as found and lies `z`, `x` radii from it.
        """
        return disc_order(self.grid, (1.0, z, x, scale, angle))


@dataclass(frozen=True)
class Rise:
    """`slope` k (fringe/N) for loads at `angle` (rad): its share of the variation `explained`,
    and the best share of any other slope, `runner_up`.
    """

    slope: float
    angle: float
    explained: float
    runner_up: float

    @property
    def clear(self) -> bool:
        """Whether the slope explains most of the variation, and clearly more than any other."""
        return self.explained > 0.5 and self.explained > 1.25 * self.runner_up


def overlay(shots: Sequence[Shot], circles: Sequence[Circle]) -> Overlay:
    """Lay the images over each other on their rims; `shots` (n,), `circles` (n,)."""
    unit = np.linspace(-WITHIN, WITHIN, SIDE)
    z, x = np.meshgrid(unit, unit, indexing="ij")
    stack = np.stack([_on_unit_disc(s, c, z, x) for s, c in zip(shots, circles, strict=True)])
    grid = DiscPixels(z[:, :1], x[:1], unit[1] - unit[0])
    return Overlay(stack, grid, np.array([s.load_n for s in shots]))


def rise_with_load(images: Overlay) -> Rise | None:
    """Find the centre order's rise with load; None below five different loads."""
    loads = images.loads
    if np.unique(loads).size < FEWEST_LOADS:
        return None
    slopes = np.arange(ORDERS[0], ORDERS[-1], 0.04) / loads.max()
    angles = np.radians(ANGLES_DEG)
    shares = np.stack([_shares(images, angle, slopes) for angle in angles])
    i, best = np.unravel_index(int(np.argmax(shares)), shares.shape)
    far = np.abs(slopes - slopes[best]) * np.ptp(loads) > 1.0
    runner = float(shares[:, far].max()) if far.any() else 0.0
    return Rise(float(slopes[best]), float(angles[i]), float(shares[i, best]), runner)


def _on_unit_disc(shot: Shot, circle: Circle, z: Array, x: Array) -> Array:
    from scipy.ndimage import gaussian_filter, map_coordinates

    smooth = gaussian_filter(shot.light, max(1.0, circle.radius / 200.0))
    places = [circle.row + z * circle.radius, circle.col + x * circle.radius]
    return np.asarray(map_coordinates(smooth, places, order=1, mode="nearest"))


def _shares(images: Overlay, angle: float, slopes: Array) -> Array:
    """Share of the variation over the loads that each slope explains, pooled over the pixels."""
    field, used = images.field(angle)[:, ::THIN], images.used[:, ::THIN]
    data = images.stack[:, :, ::THIN][:, used]
    total = float(np.sum((data - data.mean(axis=0)) ** 2))
    left = [
        float(np.sum(pixel_waves(data, slope * images.loads, field[used])[0] ** 2))
        for slope in slopes
    ]
    return 1.0 - np.array(left) / total


def pixel_waves(data: Array, orders: Array, field: Array) -> tuple[Array, Array]:
    """Fit c + a cos(2 pi h N_i) + b sin(2 pi h N_i) at every pixel.

    Parameters: `data` (n, m) intensities, `orders` (n,) N at the centre, `field` (m,) h.
    Returns the residuals (n, m) and the coefficients (a, b) (2, m).
    """
    phase = 2.0 * np.pi * orders[:, None] * field
    wave = np.stack([np.cos(phase), np.sin(phase)])
    wave -= wave.mean(axis=1, keepdims=True)
    rest = data - data.mean(axis=0)
    cc, ss = np.einsum("kln,kln->kn", wave, wave)
    cs = np.einsum("ln,ln->n", wave[0], wave[1])
    cy, sy = np.einsum("kln,ln->kn", wave, rest)
    below = np.maximum(cc * ss - cs**2, 1e-3)
    coefficients = np.stack([(cy * ss - sy * cs) / below, (sy * cc - cy * cs) / below])
    return rest - np.einsum("kln,kn->ln", wave, coefficients), coefficients


ENOUGH = 1e-6
"""Relative fall of the misfit, or relative move, below which a step is the last."""

MEMORY_PX = 4.0
"""Pixels of a frame over which the overlaid images' noise and misfit are correlated, at least."""


def fit_rise(
    shots: Sequence[Shot],
    circles: Sequence[Circle],
    images: Overlay,
    rise: Rise,
    diameter_mm: float,
) -> tuple[ImageFit, ...]:
    """Fit every image's centre order with the residual order free at every pixel.

    Parameters: `shots`, their `circles` and `images`, laid over each other; `rise`, the start;
    `diameter_mm`. Returns the ImageFits; the constant that they share is known up to a whole order,
    and chosen within half an order at zero load.
    """
    fitted = fit_orders(images, rise.slope * images.loads, rise.angle)
    orders, place = fitted.orders, fitted.place
    variance = np.diag(np.linalg.pinv(fitted.normal))[: len(orders) - 1]
    angle, scale, z, x = place
    field, used = images.field(*place), images.used
    residual, waves = pixel_waves(images.stack[:, used], orders, field[used])
    spread = np.sqrt(np.mean(residual**2, axis=1) * len(orders) / (len(orders) - 3))
    errors = MEMORY_PX * np.sqrt(np.concatenate([[variance.mean()], variance])) * spread.mean()
    offset = _centre_order(images, waves, shots[0].bright)
    rest = np.polynomial.polynomial.polyfit(images.loads, orders + offset, 1)[0]
    orders = orders + offset - np.round(rest)
    fits = []
    for i, (shot, circle) in enumerate(zip(shots, circles, strict=True)):
        row, col = circle.row + z * circle.radius, circle.col + x * circle.radius
        fits.append(
            disc_image(
                shot,
                [orders[i], row, col, scale * circle.radius, angle],
                circle.radius,
                spread=float(errors[i]),
                chi=float(spread[i] / np.median(shot.sigma)),
                view=_view(shot, images, i, residual[i], orders[i] * field, diameter_mm),
            )
        )
    return tuple(fits)


@dataclass(frozen=True)
class OrdersFit:
    """Every image's centre order (n,), the first's as it was given; `place`: the loads' angle, the
    disc's scale, z and x (4,); `rest` (n, m) and its `jacobian` (n, m, n + 3) by the orders but the
    first, then the place.
    """

    orders: Array
    place: Array
    rest: Array
    jacobian: Array

    @property
    def normal(self) -> Array:
        """The normal equations (n + 3, n + 3)."""
        flat = self.jacobian.reshape(-1, self.jacobian.shape[-1])
        return np.asarray(flat.T @ flat)


def fit_orders(images: Overlay, first: Array, angle: float) -> OrdersFit:
    """Fit the centre order of every image with the residual order free at every pixel.

    Parameters: `images` (n,); `first` (n,), the orders to start from, of which the first is kept;
    `angle` of the loads, rad. Returns an OrdersFit.
    """
    from scipy.optimize import least_squares

    used = images.used
    data, count = images.stack[:, used], len(first)

    def left(free: Array) -> Array:
        orders = np.concatenate([first[:1], free[: count - 1]])
        return pixel_waves(data, orders, images.field(*free[count - 1 :])[used])[0].ravel()

    start = np.concatenate([first[1:], [angle, 1.0, 0.0, 0.0]])
    size = np.concatenate([np.full(count - 1, 0.1), [0.05, 0.01, 0.01, 0.01]])
    room = np.concatenate([np.full(count - 1, 1.0), [0.2, 0.06, 0.06, 0.06]])
    result = least_squares(
        left, start, x_scale=size, bounds=(start - room, start + room), ftol=ENOUGH, xtol=ENOUGH
    )
    orders = np.concatenate([first[:1], result.x[: count - 1]])
    return OrdersFit(
        orders,
        result.x[count - 1 :],
        result.fun.reshape(count, -1),
        result.jac.reshape(count, -1, start.size),
    )


def _centre_order(images: Overlay, waves: Array, bright: bool) -> float:
    """Order at the centre beside N_i, from the phase: I ~ -cos 2 pi (h N_i + n) in a dark field."""
    near = np.hypot(images.grid.cols, images.grid.rows)[images.used] < 0.1
    a, b = waves[:, near].sum(axis=1) * (-1.0 if bright else 1.0)
    return float(np.arctan2(b, -a) / (2.0 * np.pi))


def _view(
    shot: Shot, images: Overlay, index: int, residual: Array, order: Array, diameter_mm: float
) -> View:
    left, image = np.full(order.shape, np.nan), images.stack[index]
    left[images.used] = residual
    return View(
        image=image,
        model=image - left,
        residual=left,
        sigma=float(np.median(shot.sigma)),
        cut=np.s_[len(order) // 2, :],
        order=order,
        position_mm=0.5 * diameter_mm * images.grid.cols[0],
        pixel_mm=(0.5 * diameter_mm * float(images.grid.step),) * 2,
    )
