"""`calibrate_scale`: mm a pixel and the lens, from a target's points or from two parallel edges.

With g = i + √-1 j the points' columns and rows, c a target's place, s the spacing in pixels of the
picture's middle, and w the place on the plane that the lens of `isochrome.stress` looks at from a
point's place in the picture, the residual is r = w(u, v; roll, distortion, keystone) - c - s g. All
points weigh the same; their noise is their residual's own scatter.
Source: Zhang (2000), IEEE Trans. Pattern Anal. Mach. Intell. 22, 1330-1334, for a plane target.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_filter1d
from scipy.special import chdtri

from isochrome.calibration.result import CONTRADICTED, MOST_SHOWN, UNLIKELY
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import NOISE, BudgetInput, BudgetRow, budget_items
from isochrome.figures import (
    FRAME_MAP,
    LINE_COLOURS,
    OVERLAY_COLOUR,
    PaperPanels,
    PictureKind,
    budget_plot,
    chosen_frames,
    panels_figure,
    plain_name,
    show_image,
)
from isochrome.frames import open_frames
from isochrome.messages import message, warnings_json
from isochrome.output import Result, columns_of, counted, with_uncertainty
from isochrome.scene import FramesLike, frames_of
from isochrome.stress import Lens

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]

LENS = ("distortion", "keystone_x", "keystone_z")
"""What bends the picture; each is a key of a scene's [camera], as is pixel_mm."""

_NAMES = ("pixel_mm", *LENS, "roll_deg")


@dataclass(frozen=True)
class MeasuredValue:
    """A value and its standard uncertainty.

    Parameters
    ----------
    value : float
        The value.
    standard_uncertainty : float
        Its standard uncertainty, in the same unit.
    """

    value: float
    standard_uncertainty: float


@dataclass(frozen=True, kw_only=True)
class ScalePicture:
    """One picture's part of a scale.

    Parameters
    ----------
    file : str
        Its name.
    image : (rows, cols) array
        Its grey levels.
    places : (n, 2) array
        Column and row of the points that were found, px.
    residual_px : (n, 2) array
        What the model leaves of them, px.
    roll : MeasuredValue, optional
        How it is turned against the target, degrees; None by edges.
    """

    file: str
    image: Array
    places: Array
    residual_px: Array
    roll: MeasuredValue | None = None

    @property
    def rms_px(self) -> float:
        """Root mean square of the residual of a coordinate, px."""
        return float(np.sqrt(np.mean(self.residual_px**2)))

    def to_json(self) -> dict[str, Any]:
        """Its file, how many points it shows, their residual and the target's roll."""
        return {
            "file": self.file,
            "corners": len(self.places),
            "residual_px": self.rms_px,
            "roll_deg": None if self.roll is None else vars(self.roll),
        }


@dataclass(frozen=True, repr=False, kw_only=True)
class ScaleCalibration(Result):
    """The size of a pixel and the lens's distortion and keystone, with standard uncertainties.

    Parameters
    ----------
    target : str
        'chessboard', 'dots' or 'edges'.
    shape : tuple of int
        Rows and columns of the pictures.
    pixel_mm : MeasuredValue
        Side of a pixel at the picture's middle, mm.
    distortion, keystone_x, keystone_z : MeasuredValue or None
        As a scene's camera has them; None by edges, which do not tell them.
    roll_deg : MeasuredValue or None
        How the first picture is turned against the target, counter-clockwise, degrees.
    residual_px : float
        Root mean square of what the model leaves of a coordinate, px.
    corners : int
        Corners or dots in all pictures, or points along edges.
    images : tuple of ScalePicture
        The pictures' parts.
    budget : tuple of BudgetInput
        What the uncertainty of `pixel_mm` consists of.
    taken_as_exact : tuple of str
        Inputs that no uncertainty was given of.
    warnings : tuple of str
        What the user should know.
    """

    target: str
    shape: tuple[int, int]
    pixel_mm: MeasuredValue
    distortion: MeasuredValue | None
    keystone_x: MeasuredValue | None
    keystone_z: MeasuredValue | None
    roll_deg: MeasuredValue | None
    residual_px: float
    corners: int
    images: tuple[ScalePicture, ...]
    budget: tuple[BudgetInput, ...]
    taken_as_exact: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def values(self) -> dict[str, MeasuredValue]:
        """Those that were found, by their names."""
        return {name: value for name in _NAMES if (value := getattr(self, name)) is not None}

    @property
    def columns(self) -> dict[str, list[Any]]:
        """A row a value."""
        return columns_of([{"key": key, **vars(value)} for key, value in self.values.items()])

    @property
    def budget_columns(self) -> dict[str, list[Any]]:
        """Those of budget.csv: a row an input, the largest share first."""
        return columns_of(
            [item.to_json() | {"contribution_mm": item.contribution} for item in self.budget]
        )

    @property
    def title(self) -> str:
        """What was seen, and in how many pictures."""
        what = "two edges" if self.target == "edges" else self.target
        return f"Scale from {what} in {counted(len(self.images), 'image')}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """Each value with its uncertainty, and the residual."""
        for name, measured in self.values.items():
            yield name, with_uncertainty(measured.value, measured.standard_uncertainty)
        yield "residual", f"{self.residual_px:.3f} px over {counted(self.corners, 'point')}"

    def figure(self) -> Figure:
        """Each picture with its points and their residuals magnified, and the budget."""
        texts = _texts(self)
        head = ["    ".join(line) for line in (texts[:1] + texts[4:], texts[1:4]) if line]
        panels = self.panels(tuple(range(len(self.images[:MOST_SHOWN]))))
        return panels_figure(replace(panels, notes=panels.notes[1:]), "\n".join(head))

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give pictures with their points, and the budget, for a paper; see `paper_figure`.

        `frames`: numbers of the pictures that are shown. Raises InputError where one is not there.
        """
        images = self.images
        few = range(min(len(images), _FOR_PAPER))
        shown = [images[k] for k in chosen_frames(frames, len(images), few, items="pictures")]
        # residuals are drawn so many times as long: 1, 2 or 5 times a power of ten
        largest = max(float(np.percentile(np.hypot(*p.residual_px.T), 95)) for p in shown)
        most = _LONGEST_ARROW * self.shape[1] / max(largest, 1e-9) * 1.0001
        decade = 10.0 ** np.floor(np.log10(most))
        factor = float(max(step for step in (1.0, 2.0, 5.0) if step * decade <= most) * decade)

        def draw(axes: Axes, k: int) -> AxesImage:
            picture = shown[k]
            low, high = np.percentile(picture.image, [0.5, 99.5]).tolist()
            drawn = show_image(axes, picture.image, cmap=FRAME_MAP, vmin=low, vmax=high)
            pick = slice(None, None, -(-len(picture.places) // MOST_POINTS))
            (x, z), (u, v) = picture.places[pick].T, factor * picture.residual_px[pick].T
            axes.plot(x, z, "o", mfc="none", mec=LINE_COLOURS[4], ms=5)
            as_long: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0}
            axes.quiver(x, z, u, v, color=OVERLAY_COLOUR, width=0.003, **as_long)
            axes.set_xlim(-0.5, self.shape[1] - 0.5)
            axes.set_ylim(self.shape[0] - 0.5, -0.5)
            return drawn

        parts = {item.input: item.contribution for item in self.budget}
        drawn = f"px, drawn {factor:g} times as long."
        notes = [f"{plain_name(one.file)}: residual {one.rms_px:.3f} {drawn}" for one in shown]
        return PaperPanels(
            kinds=[PictureKind(name="points", draw=draw)],
            labels=[plain_name(picture.file, 24) for picture in shown],
            plots=[budget_plot("budget of pixel_mm", parts, unit="mm")],
            notes=["; ".join(_texts(self)) + ".", *notes],
        )

    @property
    def scene_values(self) -> dict[str, tuple[float, float]]:
        """What `--into` may set: key, value and standard uncertainty.

        The roll is the target's, which need not lie as the specimen does, and is none of them.
        """
        return {
            f"camera.{name}": (measured.value, measured.standard_uncertainty)
            for name, measured in self.values.items()
            if name != "roll_deg"
        }

    @property
    def scene_comment(self) -> str:
        """What a scene's comment states of the values."""
        return f"residual {self.residual_px:.3f} px"

    def to_json(self) -> dict[str, Any]:
        """The result as plain numbers, texts and lists for `scale.json`.

        `pixel_mm`, `distortion`, `keystone_x`, `keystone_z` and `roll_deg` are each {value,
        standard_uncertainty}, or None where the edges do not tell them.
        """
        height, width = self.shape
        values = {name: vars(measured) for name, measured in self.values.items()}
        return {
            "target": self.target, "width_px": width, "height_px": height,
            **dict.fromkeys(_NAMES), **values,
            "residual_px": self.residual_px,
            "corners": self.corners,
            "images": [image.to_json() for image in self.images],
            "budget": [item.to_json() for item in self.budget],
            "taken_as_exact": list(self.taken_as_exact),
            **warnings_json(self.warnings),
        }  # fmt: skip


_FOR_PAPER = 2
"""Those of a figure for a paper where nobody names them."""

MOST_POINTS = 150
"""Points of a picture that are drawn."""

_LONGEST_ARROW = 0.06
"""Length of the longest arrows, over the picture's width."""


def _texts(calibration: ScaleCalibration) -> list[str]:
    return [
        f"{name} = {with_uncertainty(measured.value, measured.standard_uncertainty)}"
        for name, measured in calibration.values.items()
    ]


SMOOTH_PX = 1.5
"""Standard deviation of the Gaussian whose slope finds an edge: the slope's peak is then nearly
Gaussian itself, and three pixels give its place. No point of an edge lies further from its line."""

LEAST_SHARE = 0.6
"""Share of the rows or columns in which both edges must be found."""

FINDER_PX = 0.01
"""What the place of an edge may be off by alike in all rows, by where in a pixel it lies; half of
it is what that of a corner or dot is uncertain by at least, whatever its residuals."""


def find_edge_pair(image: Array, *, name: str) -> tuple[ScalePicture, tuple[float, float, float]]:
    """The points on two edges, upright or lying, whichever more rows or columns show; the distance
    of lines of one direction, px, its uncertainty by their scatter, and its change along the edges
    where that is clear. PhysicsError where there are not two straight ones.
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
    points = [np.stack([across, edge][::order], axis=-1) for edge in edges]
    uncertainty = float(np.sqrt(noise**2 + turn**2 + 2.0 * FINDER_PX**2))
    spreading = apart * float(np.ptp(x)) / distance if apart > CONTRADICTED * 2.0 * tilt else 0.0
    residual_px = np.concatenate(residual)[:, None] * (np.array([-slope, 1.0][::order]) / long)
    return ScalePicture(
        file=name, image=image, places=np.concatenate(points), residual_px=residual_px
    ), (distance, uncertainty, spreading)


def _along(image: Array) -> tuple[Array, Array, Array] | None:
    """Rows in which both edges lie on their lines, and the edges' columns; None for too few."""
    slope = gaussian_filter1d(image, SMOOTH_PX, axis=1, order=1, mode="nearest")
    row = np.arange(len(image), dtype=float)
    rising, falling = _peaks(slope), _peaks(-slope)
    good = np.isfinite(rising) & np.isfinite(falling)
    least = max(FEWEST, LEAST_SHARE * len(image))
    if good.sum() < least:
        return None
    x, half, off = row[good], np.count_nonzero(good) // 2, []
    for edge in (rising, falling):  # from a line by the median of the slopes, and of the rest
        y = edge[good]
        tilt = float(np.median((y[half : 2 * half] - y[:half]) / (x[half : 2 * half] - x[:half])))
        off.append(np.abs(edge - (tilt * row + np.median(y - tilt * x))))
    good = np.max(off, axis=0) < SMOOTH_PX
    return (row[good], rising[good], falling[good]) if good.sum() >= least else None


def _peaks(slope: Array) -> Array:
    """Where each row is steepest, by a Gaussian through three pixels; NaN at the sides."""
    best = np.argmax(slope, axis=1)
    row, middle = np.arange(len(slope)), np.clip(best, 1, slope.shape[1] - 2)
    three = [slope[row, middle + k] for k in (-1, 0, 1)]
    usable = (best > 0) & (best < slope.shape[1] - 1) & (np.min(three, axis=0) > 0.0)
    low, top, high = (np.log(np.where(usable, value, 1.0)) for value in three)
    bend = low - 2.0 * top + high
    usable &= bend < 0.0
    return np.where(usable, middle + 0.5 * (low - high) / np.where(usable, bend, 1.0), np.nan)


_WINDOW = 0.35
"""Half the window that a corner is refined in, in distances to the next corner: no other's edges
that end within it."""

_LOOKED_AT_PX = 600
"""Longest side that corners are first looked for in: in large pictures, whose edges are many
pixels wide, OpenCV takes long and may find none. They are refined in the whole picture."""

_LEAST_DOT = 12.0
"""Area of a dot, px: a smaller one is noise."""


def target_places(image: Array, target: str, columns: int, rows: int, *, name: str) -> Array:
    """A target's corners or dots (rows, columns, 2), column and row in px of the picture, row by
    row. PhysicsError where it is not found.
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
    rolls_deg: Array
    residual_px: list[Array]
    rms_px: float
    likeness: float
    shortening: float


def fit_target(places: Sequence[Array], shape: tuple[int, int]) -> TargetFit:
    """The camera by a target's places (rows, columns, 2), px. PhysicsError beyond its model."""
    from scipy.optimize import least_squares

    middle = complex(0.5 * (shape[1] - 1), 0.5 * (shape[0] - 1))
    points = [p[..., 0] + 1j * p[..., 1] - middle for p in places]
    grids, starts = zip(*(_start(s) for s in points), strict=True)
    spacing, size = float(np.mean([start[0] for start in starts])), 4 + 3 * len(points)

    def residuals(values: Array) -> list[Complexes]:
        """Those of each picture on the target's plane, px; two values more are a shortening."""
        keystone_x, keystone_z, distortion = values[1:4].tolist()
        strain = complex(*values[size:]) if values.size > size else 0.0
        parts, placed = [], values[4:size].reshape(-1, 3)
        for picture, grid, (x, z, roll) in zip(points, grids, placed, strict=True):
            lens = Lens(
                right_mm=0.0, down_mm=0.0, half_width_mm=0.5 * shape[1],
                half_height_mm=0.5 * shape[0], roll_deg=float(np.degrees(roll)),
                distortion=distortion, keystone_x=keystone_x, keystone_z=keystone_z,
            )  # fmt: skip
            looked_x, looked_z = lens.looked_at(picture.real, picture.imag)
            on_plane = grid + strain * np.exp(2j * roll) * grid.conj()  # it is the picture's
            parts.append(looked_x + 1j * looked_z - complex(x, z) - values[0] * on_plane)
        return parts

    def solved(start: Array) -> Any:
        return least_squares(
            lambda values: np.concatenate([r.ravel().view(float) for r in residuals(values)]),
            start, method="trf", jac="3-point", x_scale="jac", xtol=1e-12, ftol=1e-12,
        )  # fmt: skip

    best = solved(np.concatenate([[spacing, 0.0, 0.0, 0.0], *(start[1:] for start in starts)]))
    if np.abs(best.x[1:4]).max() > _LARGEST:
        x, x_2, x_3 = best.x[1:4]
        raise PhysicsError(
            "target_seen_keystone_distortion", x=x, x_2=x_2, x_3=x_3, largest=_LARGEST
        )
    least = 0.5 * FINDER_PX
    # a lens makes a target no shorter in one direction, but to see it aslant does: by 1 - cos of
    # the angle
    more = solved(np.append(best.x, [0.0, 0.0]))
    strain, per_scatter = more.x[size:], np.linalg.inv(more.jac.T @ more.jac)[size:, size:]
    square = max(2.0 * more.cost / (more.fun.size - more.x.size), least**2)
    clear = strain @ np.linalg.solve(per_scatter, strain) > chdtri(2, UNLIKELY) * square
    # a shortening is a cause of its own, and no likeness
    likeness = _likeness(residuals(more.x if clear else best.x))
    # as of a first-order process in both directions: so many points are worth one
    scatter = max(float(np.sqrt(2.0 * best.cost / (best.fun.size - best.x.size))), least)
    widened = scatter * (1.0 + likeness) / (1.0 - likeness)
    spread = widened * np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)))
    rolls = best.x[6::3]
    turned = [np.exp(-1j * r) * part for r, part in zip(rolls, residuals(best.x), strict=True)]
    return TargetFit(
        values=dict(zip(SHARED, best.x.tolist(), strict=False)),
        spread=dict(zip(SHARED, spread.tolist(), strict=False)),
        rolls_deg=np.degrees(np.stack([rolls, spread[6::3]], axis=1)),
        residual_px=[np.stack([part.real, part.imag], axis=-1) for part in turned],
        rms_px=float(np.sqrt(np.mean(best.fun**2))),
        likeness=likeness,
        shortening=2.0 * float(np.hypot(*strain)) if clear else 0.0,
    )


def _start(points: Complexes) -> tuple[Complexes, Array]:
    """The points' columns and rows as complex numbers, and spacing, place and roll by similarity. A
    target looks the same after a quarter or half turn, or mirrored: rows and columns are counted so
    that it lies within 45 degrees of upright, and is not mirrored.
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


def _likeness(residuals: Sequence[Complexes]) -> float:
    """Correlation of the residuals of neighbours, 0 unless it is clear."""
    pairs = [(part[1:], part[:-1]) for part in residuals]
    pairs += [(part[:, 1:], part[:, :-1]) for part in residuals]
    one, other = (
        np.concatenate([part.ravel() for part in side]) for side in zip(*pairs, strict=True)
    )
    square = 0.5 * float(np.vdot(one, one).real + np.vdot(other, other).real)
    correlation = float(np.vdot(one, other).real) / square if square > 0.0 else 0.0
    return min(correlation, 0.9) if correlation > CONTRADICTED / np.sqrt(2 * one.size) else 0.0


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
    for what, of, value in (
        ("spacing", spacing_mm, spacing_uncertainty_mm),
        ("edges", edges_mm, edges_uncertainty_mm),
    ):
        if value is not None:
            key = f"{what}_uncertainty_mm"
            _positive(key, value)
            if of is None:
                raise InputError("there_no_give_too", key=key, value=value, what=f"{what}_mm")
    if target is None:
        distance = _positive("edges_mm", edges_mm)
        return _from_edges(_pictures(paths), distance, edges_uncertainty_mm)
    if target not in TARGETS:
        raise InputError("target_none_name_one", target=target, targets=", ".join(TARGETS))
    size = _count("columns", columns), _count("rows", rows)
    spacing = _positive("spacing_mm", spacing_mm)
    return _from_target(_pictures(paths), target, size, spacing, spacing_uncertainty_mm)


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
    target: str,
    size: tuple[int, int],
    spacing_mm: float,
    uncertainty_mm: float | None,
) -> ScaleCalibration:
    """The result by a target of columns and rows: spacing in mm over that in pixels."""
    places = [target_places(image, target, *size, name=name) for name, image in pictures]
    rows, cols = pictures[0][1].shape
    fit = fit_target(places, (rows, cols))
    spacing_px, bent, aslant = fit.values["spacing_px"], fit.values["distortion"], fit.shortening
    pixel = spacing_mm / spacing_px
    inputs: list[BudgetRow] = [(NOISE, None, pixel * fit.spread["spacing_px"] / spacing_px, 1.0)]
    if uncertainty_mm is not None:
        inputs.append(("spacing_mm", spacing_mm, uncertainty_mm, pixel / spacing_mm))
    if target == "dots":
        # the middle of a dot's picture is further out than that of the dot, by k a² / R² of the
        # distance; for dots of radius a = spacing / 4
        effect = abs(bent) * (0.25 * spacing_px / (0.5 * math.hypot(rows, cols))) ** 2
        inputs.append(("size of the dots", bent, effect, pixel))
    messages = []
    if aslant:
        inputs.append(("seen aslant", aslant, 0.5 * aslant, pixel))
        angle = math.degrees(math.acos(1.0 - min(aslant, 1.0)))
        messages.append(message("target_seen_shorter_one", shortening=100.0 * aslant, angle=angle))
    if fit.rms_px > _POOR_PX:
        messages.append(message("residual_px_where_sharp", rms_px=fit.rms_px))
    elif fit.likeness and fit.rms_px > _PATTERN_PX:
        messages.append(message("residuals_neighbours_alike_correlation", likeness=fit.likeness))
    rolls = [MeasuredValue(*roll) for roll in fit.rolls_deg.tolist()]
    lens: dict[str, Any] = {n: MeasuredValue(fit.values[n], fit.spread[n]) for n in LENS}
    parts = zip(pictures, places, fit.residual_px, rolls, strict=True)
    images = [
        ScalePicture(file=name, image=image, places=place.reshape(-1, 2),
                     residual_px=residual.reshape(-1, 2), roll=roll)
        for (name, image), place, residual, roll in parts
    ]  # fmt: skip
    return _result(
        images, pixel, inputs, target=target, **lens, roll_deg=rolls[0], residual_px=fit.rms_px,
        taken_as_exact=() if uncertainty_mm else ("spacing_mm",), warnings=tuple(messages),
    )  # fmt: skip


def _from_edges(
    pictures: Sequence[tuple[str, Array]], edges_mm: float, uncertainty_mm: float | None
) -> ScaleCalibration:
    """The result by edges: the mean of the pictures, each by its own uncertainty."""
    images, numbers = zip(*(find_edge_pair(i, name=name) for name, i in pictures), strict=True)
    each, spread, spreadings = np.array(numbers).T.copy()
    weight = spread**-2.0
    distance = float(weight @ each / weight.sum())
    chi = float(np.sqrt(weight @ (each - distance) ** 2 / max(len(images) - 1, 1)))
    pixel = edges_mm / distance
    noise = pixel * max(chi, 1.0) / float(np.sqrt(weight.sum())) / distance
    inputs: list[BudgetRow] = [(NOISE, None, noise, 1.0)]
    if uncertainty_mm is not None:
        inputs.append(("edges_mm", edges_mm, uncertainty_mm, pixel / edges_mm))
    spreading, messages = float(spreadings.max()), []
    if spreading:
        inputs.append(("edges not parallel", spreading, 0.5 * spreading, pixel))
        messages = [message("edges_further_apart_one", spreading=100.0 * spreading)]
    off = np.concatenate([image.residual_px for image in images])
    return _result(
        images, pixel, inputs, target="edges", distortion=None, keystone_x=None, keystone_z=None,
        roll_deg=None, residual_px=float(np.sqrt(2.0 * np.mean(off**2))),
        taken_as_exact=() if uncertainty_mm else ("edges_mm",), warnings=tuple(messages),
    )  # fmt: skip


def _result(
    images: Sequence[ScalePicture], pixel_mm: float, inputs: list[BudgetRow], **values: Any
) -> ScaleCalibration:
    """A pixel's side with all that it is uncertain by, and the budget of that."""
    budget, (rows, cols) = budget_items(inputs), images[0].image.shape
    spread = math.hypot(*(item.contribution for item in budget))
    return ScaleCalibration(
        shape=(rows, cols), pixel_mm=MeasuredValue(pixel_mm, spread), images=tuple(images),
        corners=sum(len(image.places) for image in images), budget=budget, **values,
    )  # fmt: skip
