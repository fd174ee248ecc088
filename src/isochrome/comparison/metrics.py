"""Numbers that say how far a simulated fringe pattern is from a captured one.

Residuals are experiment minus simulation. NaN is "not known" on either side and never counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import InputError

Floats = NDArray[np.float64]

WRONG_BRANCH_FRINGES = 0.25
"""Beyond this difference in fringe order a pixel counts as standing on a wrong branch."""

_SSIM_WINDOW = 7


@dataclass(frozen=True)
class OrderMetrics:
    """How far two maps of the fringe order are apart.

    Parameters
    ----------
    rms : float
        Root mean square of the difference over all compared pixels, fringes.
    p95 : float
        The 95th percentile of |difference|, fringes.
    wrong_branch_share : float
        Share of the compared pixels that stand on a wrong branch, 0 to 1.
    bias : float
        Mean of experiment - simulation, fringes.
    compared_share : float
        Compared pixels over those of the mask, 0 to 1.
    rms_right_branch : float
        Root mean square over the pixels on the right branch, fringes; NaN where there are none.
    """

    rms: float
    p95: float
    wrong_branch_share: float
    bias: float
    compared_share: float
    rms_right_branch: float


@dataclass(frozen=True)
class SignalMetrics:
    """How far two images are apart.

    The line experiment = gain simulation + offset is fitted before `rmse` and `ssim`.

    Parameters
    ----------
    ncc : float
        Normalised cross-correlation.
    rmse : float
        Root mean square of the residual, in units of the signal.
    rmse_over_noise : float
        Root mean square of the residual over the noise.
    ssim : float
        Structural similarity.
    gain : float
        Slope of the line.
    offset : float
        Offset of the line, in units of the signal.
    """

    ncc: float
    rmse: float
    rmse_over_noise: float
    ssim: float
    gain: float
    offset: float


def compare_orders(
    experiment: ArrayLike, simulation: ArrayLike, *, mask: ArrayLike | None = None
) -> OrderMetrics:
    """Compare two maps (row, col) of the fringe order N, NaN = not known, where both are known.

    d = N_experiment - N_simulation; rms = sqrt(mean d²); wrong branch: |d| > 0.25. The dark field,
    sin²(pi N), has branches of half a fringe: inside the right one an arcsine errs by far less than
    half of it, beyond it another is nearer. A pixel mirrored beside a branch's edge is not counted:
    the share is a lower bound. InputError where the shapes differ or nothing is known in both.
    """
    measured, model, valid = _paired(experiment, simulation, mask, "fringe-order maps")
    known = valid & np.isfinite(measured) & np.isfinite(model)
    _check_any(known, "fringe order")
    difference = measured[known] - model[known]
    size = np.abs(difference)
    right = size <= WRONG_BRANCH_FRINGES
    return OrderMetrics(
        rms=_rms(difference),
        p95=float(np.percentile(size, 95.0)),
        wrong_branch_share=float(1.0 - right.mean()),
        bias=float(difference.mean()),
        compared_share=float(known.sum() / valid.sum()),
        rms_right_branch=_rms(difference[right]),
    )


def compare_signals(
    experiment: ArrayLike,
    simulation: ArrayLike,
    *,
    mask: ArrayLike | None = None,
    noise: ArrayLike | None = None,
    data_range: float = 1.0,
) -> SignalMetrics:
    """Compare two images of the same fringes, whatever their brightness and contrast.

    NCC = <(E - Ē)(S - S̄)>/(sd E sd S); RMSE = rms r, r = E - (gain S + offset) by least squares;
    over noise (a standard deviation) rms (r/noise), 1 if only noise is left. SSIM (7 x 7, E and
    gain S + offset, windows wholly known, `data_range` E's span) is given as others report it: a
    perfect model scores .893 on one noisy frame, one 1 % off in load .890. NaN: cannot be said.
    """
    measured, model, valid = _paired(experiment, simulation, mask, "images")
    known = valid & np.isfinite(measured) & np.isfinite(model)
    _check_any(known, "signal")
    gain, offset = brightness_line(measured[known], model[known])
    residual = measured - (gain * model + offset)
    over_noise = np.nan
    if noise is not None:
        deviation = np.broadcast_to(np.asarray(noise, dtype=float), measured.shape)[known]
        if not np.all(deviation > 0.0):
            raise InputError("noise for an image comparison holds values <= 0: give it above zero")
        over_noise = _rms(residual[known] / deviation)
    return SignalMetrics(
        ncc=_correlation(measured[known], model[known]),
        rmse=_rms(residual[known]),
        rmse_over_noise=over_noise,
        ssim=_ssim(measured, gain * model + offset, known, data_range),
        gain=gain,
        offset=offset,
    )


def brightness_line(measured: Floats, model: Floats) -> tuple[float, float]:
    """Least-squares gain and offset of  measured = gain model + offset  (1-D, finite)."""
    centred = model - model.mean()
    power = float(centred @ centred)
    if power <= (1e-9 * (1.0 + float(np.abs(model).max()))) ** 2 * model.size:
        return 0.0, float(measured.mean())
    gain = float(centred @ (measured - measured.mean())) / power
    return gain, float(measured.mean() - gain * model.mean())


def _paired(
    experiment: ArrayLike, simulation: ArrayLike, mask: ArrayLike | None, what: str
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Bring both sides and the mask to arrays of one shape, or refuse."""
    measured = np.asarray(experiment, dtype=np.float64)
    model = np.asarray(simulation, dtype=np.float64)
    if measured.shape != model.shape or measured.ndim != 2:
        raise InputError(
            f"{what} of shape {measured.shape} (experiment) and {model.shape} (simulation): give "
            "two 2-D arrays of one shape; simulate with the experiment's [camera] width_px, "
            "height_px and [frames] roi"
        )
    if mask is None:
        return measured, model, np.ones(measured.shape, dtype=bool)
    valid = np.asarray(mask, dtype=bool)
    if valid.shape != measured.shape:
        raise InputError(
            f"a mask of shape {valid.shape} for {what} of shape {measured.shape}: give equal shapes"
        )
    return measured, model, valid


def _check_any(known: NDArray[np.bool_], what: str) -> None:
    """Refuse a comparison of nothing."""
    if not known.any():
        raise InputError(
            f"no pixel has a known {what} in both the experiment and the simulation: nothing to "
            "compare; check the mask, the region of interest and that the frames overlap"
        )


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _correlation(measured: Floats, model: Floats) -> float:
    a, b = measured - measured.mean(), model - model.mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    tiny = 1e-18 * measured.size * (1.0 + float(np.abs(measured).max() * np.abs(model).max()))
    return float(np.clip(a @ b / scale, -1.0, 1.0)) if scale > tiny else float("nan")


def _ssim(measured: Floats, model: Floats, known: NDArray[np.bool_], data_range: float) -> float:
    from scipy.ndimage import binary_erosion
    from skimage.metrics import structural_similarity

    whole = binary_erosion(known, np.ones((_SSIM_WINDOW, _SSIM_WINDOW)))
    if not whole.any():
        return float("nan")
    level = float(measured[known].mean())
    _, local = structural_similarity(
        np.where(known, measured, level),
        np.where(known, model, level),
        win_size=_SSIM_WINDOW,
        data_range=data_range,
        full=True,
    )
    return float(local[whole].mean())
