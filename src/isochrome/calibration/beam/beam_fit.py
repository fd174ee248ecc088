"""One image of a beam in bending: the whole span by least squares on its intensities."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibration.beam.beam_view import FEWEST, BeamView, find_beam
from isochrome.calibration.settings import Beam
from isochrome.calibration.shot import Shot
from isochrome.errors import PhysicsError
from isochrome.estimation import ALIKE_CHI, IntensityFit, SeveralStarts, smooth_starts

Array = NDArray[np.float64]

PIXELS = 20_000
"""Pixels of an image from which the set starts."""

MARGINS = (0.1, 0.03, 0.03, 0.03)
"""Part of the height left out at each edge, where chamfers and blur are, in each round of the fit:
more at first, while the edges are known roughly."""

EDGE_REACH = 0.1
CLOSE_PX = 1.5
"""How far the edges may lie from the last guess, in heights, and how near is the same, in px."""

ODD = 400.0
"""Largest squared residual, in noise variances, that a pixel counts for in finding the edges."""

FAINTEST = 2.0
"""Standard deviation of the fringes' intensities, in noise sigmas, at the least."""


@dataclass(frozen=True)
class BeamFit:
    """A fitted image: `best.values` are slope (fringe/px), row of N = 0 and tilt (rows a column).

    `cols` (m,) are the columns that are fitted; the maps of `best` are (rows, m).
    """

    shot: Shot
    view: BeamView
    cols: Array
    best: IntensityFit

    @property
    def pick(self) -> NDArray[np.intp]:
        """The fitted columns as indices."""
        return self.cols.astype(np.intp)

    @property
    def mask(self) -> NDArray[np.bool_]:
        """The fitted pixels (rows, m)."""
        return np.isfinite(self.best.residual)

    @property
    def places(self) -> tuple[Array, Array]:
        """Rows (rows, 1), and columns from the frame's middle (1, m)."""
        rows, width = self.shot.light.shape
        return np.arange(rows, dtype=float)[:, None], (self.cols - 0.5 * (width - 1))[None, :]


def beam_order(params: ArrayLike, y: Array, x: Array) -> Array:
    """Order, with its sign, in pure bending: N = slope (y - row - tilt x).

    Parameters: `params` (3,), slope (fringe/px), row of N = 0 at x = 0, tilt (rows a column);
    `y`, `x` in pixels, x from the frame's middle.
    """
    slope, row, tilt = np.asarray(params, dtype=float)
    return np.asarray(slope * (y - row - tilt * x))


def beam_signal(order: Array, bright: bool) -> Array:
    """Ideal circular polariscope, 0..1: sin^2(pi N) in a dark field, cos^2(pi N) in a bright."""
    wave = np.cos(2.0 * np.pi * order)
    return 0.5 + 0.5 * wave if bright else 0.5 - 0.5 * wave


def fit_beam(shot: Shot, beam: Beam, pixel_mm: float) -> BeamFit:
    """Fit one image's whole span: slope across the height, neutral axis, tilt, illumination.

    Parameters: as in `bending_from_shots`. Returns the BeamFit. Raises PhysicsError for too few
    fringes, an ambiguous slope or a fit that did not converge.
    """
    view = find_beam(shot, beam.height_mm / pixel_mm)
    stride = max(1, int(np.ceil(shot.light.size / PIXELS)))
    cols = np.arange(stride // 2, shot.light.shape[1], stride, dtype=float)
    for margin in MARGINS:
        try:
            result = _fit(shot, view, cols, margin)
        except PhysicsError as error:  # every start turned the light negative
            raise _not_fitted(shot) from error
        fit = BeamFit(shot, view, cols, result.best)
        top = _refined_top(fit)
        if margin == MARGINS[-1] and abs(top - view.top) <= CLOSE_PX:
            break
        view = replace(view, top=top)
    _check(shot, result, min(view.height_px, float(shot.light.shape[0])))
    return fit


def _refined_top(fit: BeamFit) -> float:
    """The top edge's row for which fringes inside and an even level outside explain most.

    The first guess has the fringes' slope roughly only, and an edge of order 1 is as dark as what
    lies beyond it: a few rows of that would pull the fit.
    """
    (y, x), height_px = fit.places, fit.view.height_px
    row = np.rint(y - fit.view.tilt * x).astype(np.intp)
    low = int(row.min())
    depth = row - fit.view.top
    away = fit.shot.valid[:, fit.pick] & (
        (depth < -EDGE_REACH * height_px) | (depth > (1.0 + EDGE_REACH) * height_px)
    )
    valid = fit.shot.valid[:, fit.pick]
    image, sigma = fit.shot.light[:, fit.pick], fit.shot.sigma[:, fit.pick]
    outer = valid & ((depth < 0.0) | (depth > height_px))
    if np.count_nonzero(outer) < 0.01 * outer.size:
        return fit.view.top  # the beam fills the frame, and nothing lies beyond its edges
    level = float(np.median(image[away if away.any() else outer]))
    model = fit.best.model
    # what is neither fringes nor even counts little: a roller, a label, the bench behind
    outside, inside = (np.minimum(((image - m) / sigma) ** 2, ODD) for m in (level, model))
    gain = np.bincount((row - low)[valid], weights=(outside - inside)[valid])
    total = np.concatenate([[0.0], np.cumsum(gain)])
    near = fit.view.top + np.arange(-EDGE_REACH, EDGE_REACH, 1.0 / height_px) * height_px
    first = np.clip(np.rint(near - low).astype(np.intp), 0, gain.size)
    last = np.clip(np.rint(near - low + height_px).astype(np.intp), 0, gain.size)
    return float(near[int(np.argmax(total[last] - total[first]))])


def _fit(shot: Shot, view: BeamView, cols: Array, share: float) -> SeveralStarts:
    """Fit the fringes inside the beam, less a `share` of it at each edge, on the columns `cols`."""
    pick = cols.astype(int)
    y = np.arange(shot.light.shape[0], dtype=float)[:, None]
    x = (cols - 0.5 * (shot.light.shape[1] - 1))[None, :]
    margin = max(4.0, share * view.height_px)
    depth = y - view.tilt * x - view.top
    return smooth_starts(
        shot.light[:, pick],
        lambda params: beam_signal(beam_order(params, y, x), shot.bright),
        view.starts,
        light=shot.lamp(slice(None), pick),
        mask=shot.valid[:, pick] & (depth > margin) & (depth < view.height_px - margin),
        sigma=shot.sigma[:, pick],
        scale=view.scale,
        lower=[0.0, -np.inf, -0.3],
        upper=[0.5, np.inf, 0.3],
        scan_pixels=20_000,
    )


def _check(shot: Shot, found: SeveralStarts, seen_px: float) -> None:
    best = found.best
    slope = float(best.values[0])
    used = np.isfinite(best.residual)
    contrast = float(np.std((best.illumination_map * best.signal)[used]))
    if contrast < FAINTEST * float(np.median(shot.sigma)):
        raise PhysicsError("too_few_fringes_too", name=shot.name)
    if slope * seen_px < FEWEST or best.standard_uncertainty[0] > 0.2 * slope:
        raise PhysicsError("fringes_view_too_few", name=shot.name, seen_px=slope * seen_px)
    alike = [m for m in found.others if m.chi < ALIKE_CHI * best.chi]
    rivals = [m for m in alike if abs(m.values[0] / slope - 1) > 0.02]
    if rivals:
        raise PhysicsError(
            "two_fringe_slopes_explain", name=shot.name, chi=best.chi, chi_2=rivals[0].chi
        )
    if not (best.converged and best.positive):
        raise _not_fitted(shot)


def _not_fitted(shot: Shot) -> PhysicsError:
    return PhysicsError("fringes_not_those_pure", name=shot.name)
