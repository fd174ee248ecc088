"""`calibrate_scale`: mm a pixel and the lens, from a target's points or from two parallel edges.

With g = i + √-1 j the points' columns and rows, c a target's place, s the spacing in pixels of the
picture's middle, and w the place on the plane that the lens of `isochrome.stress` looks at from a
point's place in the picture, the residual is r = w(u, v; roll, distortion, keystone) - c - s g. All
points weigh the same; their noise is their residual's own scatter.
Source: Zhang (2000), IEEE Trans. Pattern Anal. Mach. Intell. 22, 1330-1334, for a plane target.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_filter1d
from scipy.special import chdtri

from isochrome.calibration.result import CONTRADICTED, UNLIKELY
from isochrome.calibration.scale_result import LENS, MeasuredValue, ScaleCalibration, ScalePicture
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import NOISE, BudgetInput, BudgetRow, budget_items
from isochrome.frames import open_frames
from isochrome.messages import message
from isochrome.scene import FramesLike, frames_of
from isochrome.stress import Lens

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]

SMOOTH_PX = 1.5
"""Standard deviation of the Gaussian whose slope finds an edge: the slope's peak is then nearly
Gaussian itself, and three pixels give its place. No point of an edge lies further from its line."""

LEAST_SHARE = 0.6
"""Share of the rows or columns in which both edges must be found."""

FINDER_PX = 0.01
"""What the place of an edge may be off by alike in all rows, by where in a pixel it lies; half of
it is what that of a corner or dot is uncertain by at least, whatever its residuals."""


@dataclass(frozen=True, kw_only=True)
class EdgePair:
    """Two edges: `places` (n, 2) of their points, column and row (px), these points' distances
    (n, 2) from their lines, and the lines' `distance_px` along their normal with its standard
    uncertainty. `spreading` is the change of the distance along the edges, where it is clear.
    """

    places: Array
    residual_px: Array
    distance_px: float
    standard_uncertainty: float
    spreading: float


def find_edge_pair(image: Array, *, name: str) -> EdgePair:
    """Find the two edges, upright or lying, whichever more rows or columns show.

    Both lines have one direction, and their points' scatter makes the distance uncertain.
    PhysicsError where there are not two straight ones.
    """
    tries = [(_along(picture), turned) for picture, turned in ((image, False), (image.T, True))]
    (lines, turned) = max(tries, key=lambda pair: 0 if pair[0] is None else len(pair[0][0]))
    if lines is None:
        raise PhysicsError("no_two_straight_edges", name=name)
    across, *edges = lines
    x = across - across.mean()
    slopes = [float(x @ edge / (x @ x)) for edge in edges]
    slope, middles = float(np.mean(slopes)), [float(edge.mean()) for edge in edges]
    long = float(np.hypot(1.0, slope))
    residual = [(e - m - slope * x) / long for e, m in zip(edges, middles, strict=True)]
    distance = abs(middles[1] - middles[0]) / long
    scatter = [float(np.sqrt(r @ r / (r.size - 2))) for r in residual]
    noise = math.hypot(*scatter) / np.sqrt(x.size)
    tilt = math.hypot(*scatter) / (2.0 * float(np.sqrt(x @ x)))
    turn = distance * slope / long**2 * tilt  # what the direction's noise does to the distance
    apart = abs(slopes[1] - slopes[0])
    order = 1 if turned else -1
    return EdgePair(
        places=np.concatenate([np.stack([across, edge][::order], axis=-1) for edge in edges]),
        residual_px=np.concatenate(residual)[:, None] * (np.array([-slope, 1.0][::order]) / long),
        distance_px=distance,
        standard_uncertainty=float(np.sqrt(noise**2 + turn**2 + 2.0 * FINDER_PX**2)),
        spreading=apart * float(np.ptp(x)) / distance if apart > CONTRADICTED * 2.0 * tilt else 0.0,
    )


def _along(image: Array) -> tuple[Array, Array, Array] | None:
    """Rows in which both edges lie on their lines, and the edges' columns; None for too few."""
    slope = gaussian_filter1d(image, SMOOTH_PX, axis=1, order=1, mode="nearest")
    row = np.arange(len(image), dtype=float)
    rising, falling = _peaks(slope), _peaks(-slope)
    good = np.isfinite(rising) & np.isfinite(falling)
    least = max(FEWEST, LEAST_SHARE * len(image))
    if good.sum() < least:
        return None
    off = [np.abs(edge - _robust(row, edge, good)) for edge in (rising, falling)]
    good = np.max(off, axis=0) < SMOOTH_PX
    return (row[good], rising[good], falling[good]) if good.sum() >= least else None


def _peaks(slope: Array) -> Array:
    """Where each row is steepest, to a part of a pixel; NaN at the picture's sides.

    The peak of a Gaussian through three pixels: that of a parabola through their logarithms.
    """
    best = np.argmax(slope, axis=1)
    row, middle = np.arange(len(slope)), np.clip(best, 1, slope.shape[1] - 2)
    three = [slope[row, middle + k] for k in (-1, 0, 1)]
    usable = (best > 0) & (best < slope.shape[1] - 1) & (np.min(three, axis=0) > 0.0)
    low, top, high = (np.log(np.where(usable, value, 1.0)) for value in three)
    bend = low - 2.0 * top + high
    usable &= bend < 0.0
    return np.where(usable, middle + 0.5 * (low - high) / np.where(usable, bend, 1.0), np.nan)


def _robust(row: Array, edge: Array, good: NDArray[np.bool_]) -> Array:
    """A line through points of which some are wrong: the median of the slopes, and of the rest."""
    x, y = row[good], edge[good]
    half = x.size // 2
    slope = float(np.median((y[half : 2 * half] - y[:half]) / (x[half : 2 * half] - x[:half])))
    return np.asarray(slope * row + np.median(y - slope * x))


_WINDOW = 0.35
"""Half the window that a corner is refined in, in distances to the next corner: no other's edges
that end within it."""

_LOOKED_AT_PX = 600
"""Longest side that corners are first looked for in: in large pictures, whose edges are many
pixels wide, OpenCV takes long and may find none. They are refined in the whole picture."""

_LEAST_DOT = 12.0
"""Area of a dot, px: a smaller one is noise."""


def target_places(image: Array, target: str, columns: int, rows: int, *, name: str) -> Array:
    """Where a picture shows a target's corners or dots, row by row of it: (rows, columns, 2), px.

    Columns and rows in the picture, from the first pixel's middle; `columns` and `rows` are of
    inner corners, or dots. PhysicsError where the target is not found.
    """
    # from black to white, whatever its levels; dust and glare are cut
    low, high = np.percentile(image, [0.5, 99.5])
    share = np.clip((image - low) / max(high - low, 1e-12), 0.0, 1.0)
    finder = _corners if target == "chessboard" else _dots
    places = finder(np.asarray(np.rint(255.0 * share), dtype=np.uint8), image, (columns, rows))
    if places is None:
        what = "inner corners" if target == "chessboard" else "dots"
        other = " (a board of 10 x 7 squares has 9 x 6)" if target == "chessboard" else ""
        raise PhysicsError(
            "no_found_count_columns", name=name, target=target, columns=columns, rows=rows,
            what=what, other=other,
        )  # fmt: skip
    return places.reshape(rows, columns, 2)


def _corners(grey: NDArray[np.uint8], image: Array, size: tuple[int, int]) -> Array | None:
    """A chessboard's inner corners, each refined where all gradients about it point past it."""
    import cv2

    sure = cv2.CALIB_CB_ACCURACY
    hard = sure | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE  # finds less in noise
    small = -(-max(grey.shape) // _LOOKED_AT_PX)
    for block, flags in ((small, sure), (small, hard), (1, sure)):
        tall, wide = (n // block for n in grey.shape)  # what is over at the right and below is cut
        binned = grey[: tall * block, : wide * block].reshape(tall, block, wide, block)
        level = np.asarray(np.rint(binned.mean(axis=(1, 3))), dtype=np.uint8)
        success, corners = cv2.findChessboardCornersSB(level, size, flags=flags)
        if success:
            break
    else:
        return None
    corners = np.asarray((corners + 0.5) * block - 0.5, dtype=np.float32)
    places = corners.reshape(size[1], size[0], 2)
    near = min(float(np.linalg.norm(np.diff(places, axis=k), axis=2).min()) for k in (0, 1))
    half = max(FEWEST, int(_WINDOW * near))
    light = np.asarray(image / max(float(np.abs(image).max()), 1e-12), dtype=np.float32)
    light = gaussian_filter(light, SMOOTH_PX, mode="nearest")
    end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-4)
    refined = cv2.cornerSubPix(light, corners.copy(), (half, half), (-1, -1), end)
    return np.asarray(refined, dtype=float)


def _dots(grey: NDArray[np.uint8], image: Array, size: tuple[int, int]) -> Array | None:
    """A grid's dots, dark ones or else bright ones: the middles of their areas."""
    import cv2

    blobs: Any = cv2  # its stubs do not know them
    options = blobs.SimpleBlobDetector_Params()
    options.minArea, options.maxArea = _LEAST_DOT, image.size / (size[0] * size[1])
    options.minDistBetweenBlobs = np.sqrt(_LEAST_DOT)
    finder = blobs.SimpleBlobDetector_create(options)
    for shades in (grey, np.asarray(255 - grey, dtype=np.uint8)):
        flags = cv2.CALIB_CB_SYMMETRIC_GRID
        success, middles = cv2.findCirclesGrid(shades, size, flags=flags, blobDetector=finder)
        if success:
            return np.asarray(middles, dtype=float)
    return None


SHARED = ("spacing_px", "keystone_x", "keystone_z", "distortion")
"""The unknowns that all pictures share; each has a place and a roll besides."""

_LARGEST = 0.1
"""Distortion or keystone beyond which the lens's model is not meant to hold."""


@dataclass(frozen=True, kw_only=True)
class TargetFit:
    """The camera of a target's pictures: `values` and `spread` by SHARED, each roll and its ±.

    `residual_px` (rows, columns, 2) of each, `rms_px` of a coordinate; `likeness`, the correlation
    of neighbours' residuals, and `shortening` in one direction, both 0 where they are not clear.
    """

    values: dict[str, float]
    spread: dict[str, float]
    rolls_deg: tuple[tuple[float, float], ...]
    residual_px: tuple[Array, ...]
    rms_px: float
    likeness: float
    shortening: float


def fit_target(places: Sequence[Array], shape: tuple[int, int]) -> TargetFit:
    """Fit the camera to a target's places, (rows, columns, 2) px, one array a picture.

    `shape` (rows, cols) of the pictures. PhysicsError where the lens lies beyond its model.
    """
    from scipy.optimize import least_squares

    points = [p[..., 0] - 0.5 * (shape[1] - 1) + 1j * (p[..., 1] - 0.5 * (shape[0] - 1))
            for p in places]  # fmt: skip
    grids, starts = zip(*(_start(s) for s in points), strict=True)
    spacing = float(np.mean([start[0] for start in starts]))
    first = np.concatenate([[spacing, 0.0, 0.0, 0.0], *(start[1:] for start in starts)])

    def residual(values: Array) -> Array:
        residuals = _residual(values, points, grids, shape)
        return np.concatenate([part.ravel().view(float) for part in residuals])

    options = {"method": "trf", "jac": "3-point", "x_scale": "jac", "xtol": 1e-12, "ftol": 1e-12}
    best = least_squares(residual, first, **options)
    if np.abs(best.x[1:4]).max() > _LARGEST:
        x, x_2, x_3 = best.x[1:4]
        raise PhysicsError(
            "target_seen_keystone_distortion", x=x, x_2=x_2, x_3=x_3, largest=_LARGEST
        )
    residuals = _residual(best.x, points, grids, shape)
    more = least_squares(residual, np.append(best.x, [0.0, 0.0]), **options)
    shortening = _shortening(more.x, more.jac, more.fun)
    # a shortening is a cause of its own, and no likeness
    likeness = _likeness(_residual(more.x, points, grids, shape) if shortening else residuals)
    # as of a first-order process in both directions: so many points are worth one
    scatter = max(float(np.sqrt(2.0 * best.cost / (best.fun.size - best.x.size))), 0.5 * FINDER_PX)
    widened = scatter * (1.0 + likeness) / (1.0 - likeness)
    spread = widened * np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)))
    rolls = zip(np.degrees(best.x[6::3]), np.degrees(spread[6::3]), strict=True)
    turned = [np.exp(-1j * roll) * part for roll, part in zip(best.x[6::3], residuals, strict=True)]
    return TargetFit(
        values=dict(zip(SHARED, map(float, best.x), strict=False)),
        spread=dict(zip(SHARED, map(float, spread), strict=False)),
        rolls_deg=tuple((float(roll), float(u)) for roll, u in rolls),
        residual_px=tuple(np.stack([part.real, part.imag], axis=-1) for part in turned),
        rms_px=float(np.sqrt(np.mean(best.fun**2))),
        likeness=likeness,
        shortening=shortening,
    )


def _start(points: Complexes) -> tuple[Complexes, Array]:
    """The points' columns and rows as complex numbers, and spacing, place and roll by similarity.

    A target looks the same after a quarter or half turn, or mirrored: rows and columns are counted
    so that it lies within 45 degrees of upright, and is not mirrored.
    """
    rows, cols = points.shape
    j, i = np.meshgrid(np.arange(rows), np.arange(cols), indexing="ij")
    grid = (i - 0.5 * (cols - 1)) + 1j * (j - 0.5 * (rows - 1))
    off = points - points.mean()
    if abs(np.vdot(grid.conj(), off)) > abs(np.vdot(grid, off)):
        grid = grid.conj()
    turn = np.vdot(grid, off) / np.vdot(grid, grid)
    quarter = 1j ** int(np.rint(np.angle(turn) / (0.5 * np.pi)))
    grid, turn = grid * quarter, turn / quarter
    roll = -float(np.angle(turn))  # z is down: counter-clockwise is against the angle
    place = np.exp(1j * roll) * points.mean()
    return grid, np.array([abs(turn), place.real, place.imag, roll])


def _residual(
    values: Array, points: Sequence[Complexes], grids: Sequence[Complexes], shape: tuple[int, int]
) -> list[Complexes]:
    """Each picture's residual on the target's plane, px; two values more are a shortening."""
    spacing, keystone_x, keystone_z, distortion = values[:4]
    count = 3 * len(points)
    strain = complex(*values[4 + count :]) if values.size > 4 + count else 0.0
    residuals = []
    for k, (picture, grid) in enumerate(zip(points, grids, strict=True)):
        x, z, roll = values[4 + 3 * k : 7 + 3 * k]
        lens = Lens(
            right_mm=0.0, down_mm=0.0, half_width_mm=0.5 * shape[1], half_height_mm=0.5 * shape[0],
            roll_deg=float(np.degrees(roll)), distortion=float(distortion),
            keystone_x=float(keystone_x), keystone_z=float(keystone_z),
        )  # fmt: skip
        looked_x, looked_z = lens.looked_at(picture.real, picture.imag)
        on_plane = grid + strain * np.exp(2j * roll) * grid.conj()  # the strain is the picture's
        residuals.append(looked_x + 1j * looked_z - complex(x, z) - spacing * on_plane)
    return residuals


def _likeness(residuals: Sequence[Complexes]) -> float:
    """Correlation of the residuals of neighbours, 0 unless it is clear."""
    products, squares, count = 0.0, 0.0, 0
    for part in residuals:
        for axis in (0, 1):
            a, b = (np.take(part, range(k, part.shape[axis] - 1 + k), axis) for k in (0, 1))
            products += float(np.sum((a * b.conj()).real))
            squares += 0.5 * float(np.sum(np.abs(a) ** 2 + np.abs(b) ** 2))
            count += 2 * a.size
    correlation = products / squares if squares > 0.0 else 0.0
    return min(correlation, 0.9) if correlation > CONTRADICTED / np.sqrt(count) else 0.0


def _shortening(values: Array, jac: Array, residual: Array) -> float:
    """By how much the target is shorter in one direction, where the residual clearly asks for it.

    A lens has no such thing, but a target that is seen aslant is: by 1 - cos of the angle.
    """
    strain = values[-2:]
    per_scatter = np.linalg.inv(jac.T @ jac)[-2:, -2:]
    square = max(float(residual @ residual) / (residual.size - values.size), (0.5 * FINDER_PX) ** 2)
    clear = float(strain @ np.linalg.solve(per_scatter, strain)) > chdtri(2, UNLIKELY) * square
    return 2.0 * float(np.hypot(*strain)) if clear else 0.0


TARGETS = ("chessboard", "dots")

FEWEST = 3
"""Corners or dots in a row or column: two show no bend."""

_POOR_PX = 0.2
"""Residual of a coordinate, px, from which on points are poorly found: twice a finder's own."""

_PATTERN_PX = 0.05
"""The same where neighbours' residuals are alike, which no noise does."""


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
    if target is not None and edges_mm is not None:
        raise InputError("target_edges_mm_both_given")
    if target is None and edges_mm is None:
        raise InputError("neither_target_nor_edges_mm")
    _check_uncertainty("spacing_uncertainty_mm", spacing_uncertainty_mm, spacing_mm, "spacing_mm")
    _check_uncertainty("edges_uncertainty_mm", edges_uncertainty_mm, edges_mm, "edges_mm")
    if target is None:
        distance = _positive("edges_mm", edges_mm)
        pictures = _pictures(paths)
        pairs = [find_edge_pair(image, name=name) for name, image in pictures]
        return _from_edges(pictures, pairs, distance, edges_uncertainty_mm)
    if target not in TARGETS:
        raise InputError("target_none_name_one", target=target, targets=", ".join(TARGETS))
    size = _count("columns", columns), _count("rows", rows)
    spacing = _positive("spacing_mm", spacing_mm)
    pictures = _pictures(paths)
    places = [target_places(image, target, *size, name=name) for name, image in pictures]
    fit = fit_target(places, pictures[0][1].shape[:2])
    return _from_target(pictures, places, fit, target, (spacing, spacing_uncertainty_mm))


def _check_uncertainty(key: str, value: float | None, of: float | None, what: str) -> None:
    if value is None:
        return
    _positive(key, value)
    if of is None:
        raise InputError("there_no_give_too", key=key, value=value, what=what)


def _positive(key: str, value: float | None) -> float:
    if value is None or not (math.isfinite(value) and value > 0.0):
        given = "is not given" if value is None else f"= {value:g}"
        raise InputError("give_length_above_zero", key=key, given=given)
    return value


def _count(key: str, value: int | None) -> int:
    if value is None or value < FEWEST:
        given = "is not given" if value is None else f"= {value}"
        raise InputError("give_number_inner_corners", key=key, given=given, fewest=FEWEST)
    return value


def _pictures(paths: Sequence[FramesLike]) -> list[tuple[str, Array]]:
    """Every frame of the files, with its name; colours as their mean. Raises InputError."""
    pictures = [
        (frame.name, np.asarray(frame.image, dtype=float))
        for path in paths
        for frame in open_frames(path, channel="mean")
    ]
    if not pictures:
        raise InputError("list_images_empty_name")
    name, image = pictures[0]
    for other, second in pictures[1:]:
        if second.shape != image.shape:
            raise InputError(
                "has_rows_columns_give", other=other, shape=second.shape[0],
                shape_2=second.shape[1], name=name, shape_3=image.shape[0], shape_4=image.shape[1],
            )  # fmt: skip
    for name, image in pictures:
        if not np.isfinite(image).all() or np.ptp(image) == 0.0:
            raise InputError("blank_holds_what_no", name=name)
    return pictures


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
    inputs: list[BudgetRow] = []
    if spacing[1] is not None:
        inputs.append(("spacing_mm", spacing[0], spacing[1], pixel / spacing[0]))
    if target == "dots":
        # the middle of a dot's picture is further out than that of the dot, by k a² / R² of the
        # distance; for dots of radius a = spacing / 4
        bent, reach = values["distortion"], 0.5 * math.hypot(*pictures[0][1].shape)
        effect = abs(bent) * (0.25 * values["spacing_px"] / reach) ** 2
        inputs.append(("size of the dots", bent, effect, pixel))
    if fit.shortening:
        inputs.append(("seen aslant", fit.shortening, 0.5 * fit.shortening, pixel))
    measured, budget = _combined(pixel, pixel * spread["spacing_px"] / values["spacing_px"], inputs)
    lens: dict[str, Any] = {n: MeasuredValue(values[n], spread[n]) for n in LENS}
    rolls = [MeasuredValue(*roll) for roll in fit.rolls_deg]
    parts = zip(pictures, places, fit.residual_px, rolls, strict=True)
    return ScaleCalibration(
        target=target, shape=(pictures[0][1].shape[0], pictures[0][1].shape[1]),
        pixel_mm=measured, **lens, roll_deg=rolls[0], residual_px=fit.rms_px,
        corners=sum(place[..., 0].size for place in places),
        images=tuple(
            ScalePicture(file=name, image=image, places=place.reshape(-1, 2),
                         residual_px=residual.reshape(-1, 2), roll=roll)
            for (name, image), place, residual, roll in parts
        ),
        budget=budget, taken_as_exact=("spacing_mm",) if spacing[1] is None else (),
        warnings=tuple(_target_warnings(fit)),
    )  # fmt: skip


def _combined(
    value: float, noise: float, inputs: Sequence[BudgetRow]
) -> tuple[MeasuredValue, tuple[BudgetInput, ...]]:
    """A value with all that it is uncertain by, and the budget of that."""
    budget = budget_items([(NOISE, None, noise, 1.0), *inputs])
    return MeasuredValue(value, math.hypot(*(item.contribution for item in budget))), budget


def _target_warnings(fit: TargetFit) -> Iterator[str]:
    if fit.shortening:
        angle = math.degrees(math.acos(1.0 - min(fit.shortening, 1.0)))
        yield message("target_seen_shorter_one", shortening=100.0 * fit.shortening, angle=angle)
    if fit.rms_px > _POOR_PX:
        yield message("residual_px_where_sharp", rms_px=fit.rms_px)
    elif fit.likeness and fit.rms_px > _PATTERN_PX:
        yield message("residuals_neighbours_alike_correlation", likeness=fit.likeness)


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
    inputs: list[BudgetRow] = []
    if uncertainty_mm is not None:
        inputs.append(("edges_mm", edges_mm, uncertainty_mm, pixel / edges_mm))
    spreading = max(pair.spreading for pair in pairs)
    messages: tuple[str, ...] = ()
    if spreading:
        inputs.append(("edges not parallel", spreading, 0.5 * spreading, pixel))
        messages = (message("edges_further_apart_one", spreading=100.0 * spreading),)
    measured, budget = _combined(pixel, noise, inputs)
    off = np.hypot(*np.concatenate([pair.residual_px for pair in pairs]).T)
    return ScaleCalibration(
        target="edges", shape=(pictures[0][1].shape[0], pictures[0][1].shape[1]),
        pixel_mm=measured, distortion=None, keystone_x=None, keystone_z=None, roll_deg=None,
        residual_px=float(np.sqrt(np.mean(off**2))), corners=off.size,
        images=tuple(
            ScalePicture(file=name, image=image, places=pair.places, residual_px=pair.residual_px)
            for (name, image), pair in zip(pictures, pairs, strict=True)
        ),
        budget=budget,
        taken_as_exact=("edges_mm",) if uncertainty_mm is None else (), warnings=messages,
    )  # fmt: skip
