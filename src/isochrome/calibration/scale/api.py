"""`calibrate_scale`: mm a pixel and the lens, from a target or from two edges."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.scale.edge_pair import EdgePair, find_edge_pair
from isochrome.calibration.scale.result import (
    LENS,
    MeasuredValue,
    ScaleCalibration,
    ScalePicture,
)
from isochrome.calibration.scale.target_corners import target_places
from isochrome.calibration.scale.target_fit import TargetFit, fit_target
from isochrome.errors import InputError
from isochrome.estimation import BudgetInput, budget_of
from isochrome.frames import open_frames
from isochrome.scene import FramesLike, frames_of

Array = NDArray[np.float64]

TARGETS = ("chessboard", "dots")

FEWEST = 3
"""Corners or dots in a row or column: two show no bend."""

_POOR_PX = 0.2
"""Residual of a coordinate, px, from which on points are poorly found: twice a finder's own."""

_PATTERN_PX = 0.05
"""The same where neighbours' residuals are alike, which no noise does."""

Input = tuple[str, float, float, float]


def calibrate_scale(
    images: FramesLike,
    *,
    target: str | None = None,
    columns: int | None = None,
    rows: int | None = None,
    spacing_mm: float | None = None,
    spacing_uncertainty_mm: float | None = None,
    edges_mm: float | None = None,
    edges_uncertainty_mm: float | None = None,
) -> ScaleCalibration:
    """Find the camera's `pixel_mm`, and its distortion and keystone, from a target or two edges.

    A chessboard or a grid of dots lies in the specimen's plane and fills the picture; its points
    are seen through the lens of a scene's camera, whose values are fitted. Several pictures of one
    target share the camera. Two parallel edges, such as the specimen's own, give `pixel_mm` alone,
    taken through no lens. Source: Zhang (2000), IEEE Trans. Pattern Anal. Mach. Intell. 22,
    1330-1334; Brown (1971), Photogramm. Eng. 37, 855-866, for the distortion.

    Parameters
    ----------
    images : str, Path, sequence of them, array or sequence of arrays
        One picture or several, of one size, as files or in memory, as for `open_frames`.
    target : {'chessboard', 'dots'}, optional
        What they show; give this or `edges_mm`.
    columns, rows : int, optional
        A chessboard's inner corners (one fewer than its squares), or the dots, in a row and in a
        column.
    spacing_mm : float, optional
        From corner to corner or from dot to dot, mm.
    spacing_uncertainty_mm : float, optional
        Its standard uncertainty, mm.
    edges_mm : float, optional
        The distance of two parallel edges, mm.
    edges_uncertainty_mm : float, optional
        Its standard uncertainty, mm.

    Returns
    -------
    ScaleCalibration
        The values, each with its standard uncertainty.

    Raises
    ------
    InputError
        Where options are missing, contradict each other or are not positive, or an image cannot
        be read.
    PhysicsError
        Where the target or the edges are not found in an image.

    Examples
    --------
    >>> import isochrome, numpy, tifffile
    >>> row, col = numpy.indices((220, 300)) // 25  # squares of 25 pixels
    >>> board = numpy.where((row + col) % 2 & (row < 8) & (col < 11), 30, 220).astype("uint8")
    >>> tifffile.imwrite("board.tif", numpy.pad(board, 20, constant_values=220))
    >>> size = {"columns": 10, "rows": 7, "spacing_mm": 0.5}
    >>> found = isochrome.calibrate_scale("board.tif", target="chessboard", **size)
    >>> round(found.pixel_mm.value, 4)
    0.02
    """
    given = frames_of(images)
    paths = given if isinstance(given, tuple) else (given,)
    _check_one_way(target, edges_mm)
    _check_uncertainty("spacing_uncertainty_mm", spacing_uncertainty_mm, spacing_mm, "spacing_mm")
    _check_uncertainty("edges_uncertainty_mm", edges_uncertainty_mm, edges_mm, "edges_mm")
    if target is None:
        distance = _positive("edges_mm", edges_mm)
        pictures = _pictures(paths)
        pairs = [find_edge_pair(image, name=name) for name, image in pictures]
        return _from_edges(pictures, pairs, distance, edges_uncertainty_mm)
    if target not in TARGETS:
        raise InputError(f"target = {target}: is none of {', '.join(TARGETS)}; name one of them")
    size = _count("columns", columns), _count("rows", rows)
    spacing = _positive("spacing_mm", spacing_mm)
    pictures = _pictures(paths)
    places = [target_places(image, target, *size, name=name) for name, image in pictures]
    fit = fit_target(places, pictures[0][1].shape[:2])
    return _from_target(pictures, places, fit, target, (spacing, spacing_uncertainty_mm))


def _check_one_way(target: str | None, edges_mm: float | None) -> None:
    if target is not None and edges_mm is not None:
        raise InputError("target and edges_mm are both given; a scale is from one of them")
    if target is None and edges_mm is None:
        raise InputError(
            "neither target nor edges_mm is given; name --target chessboard or dots with "
            "--columns, --rows and --spacing-mm, or --edges-mm"
        )


def _check_uncertainty(key: str, value: float | None, of: float | None, what: str) -> None:
    if value is None:
        return
    _positive(key, value)
    if of is None:
        raise InputError(f"{key} = {value:g}: there is no {what} that it is of; give that too")


def _positive(key: str, value: float | None) -> float:
    if value is None or not (math.isfinite(value) and value > 0.0):
        given = "is not given" if value is None else f"= {value:g}"
        raise InputError(f"{key} {given}; give a length above zero, mm")
    return value


def _count(key: str, value: int | None) -> int:
    if value is None or value < FEWEST:
        given = "is not given" if value is None else f"= {value}"
        raise InputError(
            f"{key} {given}; give the number of inner corners or dots, at least {FEWEST}"
        )
    return value


def _pictures(paths: Sequence[FramesLike]) -> list[tuple[str, Array]]:
    """Every frame of the files, with its name; colours as their mean. Raises InputError."""
    found = [
        (frame.name, np.asarray(frame.image, dtype=float))
        for path in paths
        for frame in open_frames(path, channel="mean")
    ]
    if not found:
        raise InputError("the list of images is empty; name at least one")
    name, image = found[0]
    for other, second in found[1:]:
        if second.shape != image.shape:
            raise InputError(
                f"{other}: has {second.shape[0]} rows and {second.shape[1]} columns, and {name} "
                f"{image.shape[0]} and {image.shape[1]}; give pictures of one camera, uncut"
            )
    for name, image in found:
        if not np.isfinite(image).all() or np.ptp(image) == 0.0:
            raise InputError(f"{name}: is blank, or holds what is no number; give another picture")
    return found


def _from_target(
    pictures: Sequence[tuple[str, Array]],
    places: Sequence[Array],
    fit: TargetFit,
    target: str,
    spacing: tuple[float, float | None],
) -> ScaleCalibration:
    """The result by a target: spacing in mm over that in pixels."""
    values, spread = fit.values, fit.spread
    pixel = spacing[0] / values["spacing_px"]
    inputs: list[Input] = []
    if spacing[1] is not None:
        inputs.append(("spacing_mm", spacing[0], spacing[1], pixel / spacing[0]))
    if target == "dots":
        inputs.append(("size of the dots", *_dot_effect(fit, pictures[0][1]), pixel))
    if fit.shortening:
        inputs.append(("seen aslant", fit.shortening, 0.5 * fit.shortening, pixel))
    noise = pixel * spread["spacing_px"] / values["spacing_px"]
    measured, budget = _combined(pixel, noise, inputs)
    lens = {name: MeasuredValue(values[name], spread[name]) for name in LENS}
    rolls = [MeasuredValue(*roll) for roll in fit.rolls_deg]
    parts = zip(pictures, places, fit.residual_px, rolls, strict=True)
    return ScaleCalibration(
        target=target, shape=(pictures[0][1].shape[0], pictures[0][1].shape[1]),
        pixel_mm=measured, distortion=lens["distortion"], keystone_x=lens["keystone_x"],
        keystone_z=lens["keystone_z"], roll_deg=rolls[0], residual_px=fit.rms_px,
        corners=sum(place[..., 0].size for place in places),
        images=tuple(
            ScalePicture(file=name, image=image, places=place.reshape(-1, 2),
                         residual_px=left.reshape(-1, 2), roll=roll)
            for (name, image), place, left, roll in parts
        ),
        budget=budget, taken_as_exact=("spacing_mm",) if spacing[1] is None else (),
        warnings=_target_warnings(fit),
    )  # fmt: skip


def _dot_effect(fit: TargetFit, image: Array) -> tuple[float, float]:
    """Distortion, and what it does to the scale: the middle of a dot's picture is not that of the
    dot, but further out by k a² / R² of the distance; for dots of radius a = spacing / 4.
    """
    distortion, radius = fit.values["distortion"], 0.25 * fit.values["spacing_px"]
    return distortion, abs(distortion) * (radius / (0.5 * math.hypot(*image.shape))) ** 2


def _combined(
    value: float, noise: float, inputs: Sequence[Input]
) -> tuple[MeasuredValue, tuple[BudgetInput, ...]]:
    """A value with all that it is uncertain by, and the budget of that."""
    stated = tuple((key, of, u) for key, of, u, _ in inputs)
    budget = budget_of(noise, stated, np.array([sensitivity for *_, sensitivity in inputs]))
    total = math.hypot(*(item.contribution for item in budget))
    return MeasuredValue(value, total), budget


def _target_warnings(fit: TargetFit) -> tuple[str, ...]:
    said = []
    if fit.shortening:
        angle = math.degrees(math.acos(1.0 - min(fit.shortening, 1.0)))
        said.append(
            f"the target is seen {100.0 * fit.shortening:.2g} % shorter in one direction than "
            f"across it, as from an angle of {angle:.1f} degrees: no scene's camera has that, and "
            "pixel_mm is uncertain by half of it; set the camera square to the target, or check "
            "that its spacing is the same both ways"
        )
    if fit.rms_px > _POOR_PX:
        said.append(
            f"the residual is {fit.rms_px:.2f} px where a sharp target leaves 0.1 or less: the "
            "values are as uncertain as that; check that the target is flat, sharp and evenly lit"
        )
    elif fit.likeness and fit.rms_px > _PATTERN_PX:
        said.append(
            f"the residuals of neighbours are alike (correlation {fit.likeness:.2f}), as of a "
            "target that is not flat or a lens that bends otherwise: the uncertainties are widened "
            "for it; see the arrows in scale.png"
        )
    return tuple(said)


def _from_edges(
    pictures: Sequence[tuple[str, Array]],
    pairs: Sequence[EdgePair],
    edges_mm: float,
    uncertainty_mm: float | None,
) -> ScaleCalibration:
    """The result by edges: the mean of the pictures, each by its own uncertainty."""
    each = np.array([pair.distance_px for pair in pairs])
    weight = np.array([pair.standard_uncertainty for pair in pairs]) ** -2.0
    distance = float(weight @ each / weight.sum())
    chi = float(np.sqrt(weight @ (each - distance) ** 2 / max(len(pairs) - 1, 1)))
    pixel = edges_mm / distance
    noise = pixel * max(chi, 1.0) / float(np.sqrt(weight.sum())) / distance
    inputs: list[Input] = []
    if uncertainty_mm is not None:
        inputs.append(("edges_mm", edges_mm, uncertainty_mm, pixel / edges_mm))
    spreading = max(pair.spreading for pair in pairs)
    said: tuple[str, ...] = ()
    if spreading:
        inputs.append(("edges not parallel", spreading, 0.5 * spreading, pixel))
        said = (
            f"the edges are {100.0 * spreading:.2g} % further apart at one end than at the other, "
            "and pixel_mm is uncertain by half of it; set the camera square, or use --target",
        )
    measured, budget = _combined(pixel, noise, inputs)
    found = []
    for (name, image), pair in zip(pictures, pairs, strict=True):
        places, left = np.concatenate(pair.points), np.concatenate(pair.residual_px)
        found.append(ScalePicture(file=name, image=image, places=places, residual_px=left))
    residuals = np.concatenate([left for pair in pairs for left in pair.residual_px])
    off = np.hypot(*residuals.T)
    return ScaleCalibration(
        target="edges", shape=(pictures[0][1].shape[0], pictures[0][1].shape[1]),
        pixel_mm=measured, distortion=None, keystone_x=None, keystone_z=None, roll_deg=None,
        residual_px=float(np.sqrt(np.mean(off**2))), corners=off.size,
        images=tuple(found), budget=budget,
        taken_as_exact=("edges_mm",) if uncertainty_mm is None else (), warnings=said,
    )  # fmt: skip
