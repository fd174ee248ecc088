"""Fringe skeletons: the centre lines of dark and bright fringes, to a fraction of a pixel.

Two roads: from an image signal alone, without a model (`skeletons`), and from a known map of the
fringe order (`order_contours`). Positions are (row, col) of pixel centres, dark field.

From an image, the signal f is smoothed with a Gaussian G, sharpened against the shift that
smoothing gives to curved and unevenly spaced fringes, g = G * (f - sigma²/2 ∇²f). With n the
eigenvector of the Hessian H of g for the larger |eigenvalue|, the line passes the pixel at the
offset t n, t = -(n·∇g) / (nᵀ H n), and is kept where it falls inside the pixel. A line must
somewhere reach a sigma² |nᵀHn| of 10 deviations of the image's own noise; it is followed down to
half of that. A second pass with three times the sigma, and 6 deviations, adds the wide fringes,
away from the lines of the first. Lines under 12 px, or three times the sigma, are dropped. Dark
lines lie below, bright ones above the middle of the signal's range. Source: Steger (1998), An
unbiased detector of curvilinear structures, IEEE TPAMI 20(2).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from isochrome.errors import InputError
from isochrome.fringes.windows import COMPLETE, Indices, gaussian, nearest_known

Floats = NDArray[np.float64]
FOLLOW_SHARE = 0.5
"""A line that reached the threshold is followed down to this share of it."""
_TRUNCATE = 6.0  # in sigma: at 4 a flat image has a second derivative of 1e-4
_RUN = 2.0  # a fringe centre is level along its run; the flank of a round fringe is not
_REACH_PX = 1.5  # neighbours: side by side or corner to corner


def noise_gain(sigma_px: float) -> float:
    """Deviation of sigma² g_xx for an image of white noise of deviation 1."""
    half = int(np.ceil(6.0 * sigma_px)) + 2
    impulse = np.zeros((2 * half + 1, 2 * half + 1))
    impulse[half, half] = 1.0
    curved = gaussian(_sharpened(impulse, sigma_px), sigma_px, (0, 2))
    return sigma_px**2 * float(np.sqrt(np.sum(curved**2)))


def _sharpened(image: Floats, sigma_px: float) -> Floats:
    """Take back, to first order, what a Gaussian of sigma_px will do: f - sigma²/2 ∇²f."""
    return np.asarray(image - 0.5 * sigma_px**2 * ndimage.laplace(image))


def line_points(image: Floats, sigma_px: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Strength of the line that passes each pixel of `image` (NaN: not known), its point, level.
    Strength: sigma² times the curvature across it, > 0 dark, < 0 bright, 0 where no line passes or
    the neighbourhood is not known."""
    known = np.isfinite(image)
    if not known.all():
        image = nearest_known(image, known)
    pad = int(np.ceil(_TRUNCATE * sigma_px)) + 1
    pad = min(pad, min(image.shape) - 1)
    wide = _sharpened(np.pad(image, pad, mode="reflect", reflect_type="odd"), sigma_px)
    core = (slice(pad, -pad), slice(pad, -pad))
    level, g_r, g_c, h_rr, h_rc, h_cc = (
        gaussian(wide, sigma_px, which, reach=_TRUNCATE)[core]
        for which in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    )
    mean, half = 0.5 * (h_rr + h_cc), 0.5 * (h_rr - h_cc)
    bent = mean + np.where(mean >= 0.0, 1.0, -1.0) * np.hypot(half, h_rc)
    angle = 0.5 * np.arctan2(h_rc, half) + np.where(mean >= 0.0, 0.0, 0.5 * np.pi)
    n_r, n_c = np.cos(angle), np.sin(angle)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        step = -(g_r * n_r + g_c * n_c) / bent
        off_r, off_c = step * n_r, step * n_c  # NaN beside a level of one value: no line there
    level_run = np.abs(g_c * n_r - g_r * n_c) <= _RUN * sigma_px * np.abs(bent)
    on_line = level_run & (np.abs(off_r) <= 0.6) & (np.abs(off_c) <= 0.6)
    # the neighbourhood is to be known, and not a continuation past the border
    complete, rim = np.zeros_like(known), int(np.ceil(sigma_px))
    complete[rim:-rim, rim:-rim] = True
    on_line &= complete & known
    if not known.all():
        on_line &= gaussian(known.astype(float), sigma_px) >= COMPLETE
    rows, cols = np.indices(image.shape, dtype=float)
    strength = np.where(on_line, sigma_px**2 * bent, 0.0)
    return strength, rows + np.where(on_line, off_r, 0), cols + np.where(on_line, off_c, 0), level


def line_pixels(rows: Floats, cols: Floats, shape: tuple[int, ...]) -> tuple[Indices, ...]:
    """Rows and columns of the pixels that are nearest to places (rows, cols)."""
    return tuple(
        np.clip(np.rint(places).astype(int), 0, count - 1)
        for places, count in zip((rows, cols), shape, strict=True)
    )


def _paths(points: NDArray[Any], min_length: float) -> Iterator[NDArray[Any]]:
    """Cut a cloud of pixels into ordered paths, the longest of each connected part first."""
    if len(points) < min_length:
        return
    cloud = cKDTree(points)
    near = cloud.sparse_distance_matrix(cloud, _REACH_PX, output_type="coo_matrix").tocsr()
    count, part = csgraph.connected_components(near, directed=False)
    if count > 1:
        for number in range(count):
            yield from _paths(points[part == number], min_length)
        return
    tree = csgraph.minimum_spanning_tree(near)
    # its longest path is from the farthest point to the farthest from there
    begin = int(np.argmax(csgraph.dijkstra(tree, directed=False, indices=0)))
    reach, before = csgraph.dijkstra(tree, directed=False, indices=begin, return_predecessors=True)
    order = [int(np.argmax(reach))]
    while order[-1] != begin:
        order.append(int(before[order[-1]]))
    path = points[order]
    if len(path) >= min_length:
        yield path
        beside = cKDTree(path).query(points, distance_upper_bound=_REACH_PX)[0]
        yield from _paths(points[~np.isfinite(beside)], min_length)


Kind = Literal["dark", "bright"]
_PASSES = ((2.0, 10.0), (6.0, 6.0))  # smoothing sigma, px, least strength in noise deviations
_FLOOR = 4e-4  # least strength of all: rounding of a noise-free image
SHORTEST_PX = 12
"""Of a fringe line: where the order is level, noise makes small loops of it."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """One centre line of a fringe, its n points in order, in px counted at pixel centres."""

    kind: Kind  # what a dark field shows on the line
    rows: Floats
    cols: Floats
    order: float | None = None  # None: not known


def skeletons(signal: ArrayLike) -> list[Skeleton]:
    """Centre lines of dark and bright fringes in a normalised dark field, longest first. For the
    method see the module; fringes closer than about 8 px are lost. Where the order turns back
    between n and n + 1/2 the image has a crest that is no order line; it is returned too, as no
    image alone can tell. InputError where it is too small."""
    image = np.asarray(signal, dtype=np.float64)
    least = int(4 * _PASSES[0][0])
    if min(image.shape) < least:
        raise InputError("signal_shape_skeletons_give", shape=image.shape, ceil=least)
    if np.isfinite(image).sum() < SHORTEST_PX:
        return []
    # the noise's deviation from second differences (Immerkær 1996, with a median)
    kernel = np.outer((1.0, -2.0, 1.0), (1.0, -2.0, 1.0))
    rough = np.abs(ndimage.convolve(image, kernel)[1:-1, 1:-1])
    rough = rough[np.isfinite(rough)]
    noise = float(np.median(rough)) / (0.6745 * 6.0) if rough.size else 0.0
    middle = 0.5 * float(np.sum(np.nanpercentile(image, (2.0, 98.0))))
    lines: list[Skeleton] = []
    for scale, deviations in _PASSES:
        if min(image.shape) < 4 * scale:
            break
        limit = max(deviations * noise * noise_gain(scale), _FLOOR)
        strength, rows, cols, level = line_points(image, scale)
        free = np.ones(image.shape, dtype=bool)
        for line in lines:
            free[line_pixels(line.rows, line.cols, image.shape)] = False
        if not free.all():  # beside the lines of the pass before there are none
            strength[ndimage.distance_transform_edt(free) < 2 * scale] = 0.0
        kinds: tuple[tuple[Kind, Floats], ...] = (
            ("dark", np.where(level < middle, strength, 0.0)),
            ("bright", np.where(level > middle, -strength, 0.0)),
        )
        for kind, weight in kinds:
            labels, count = ndimage.label(weight > FOLLOW_SHARE * limit, structure=np.ones((3, 3)))
            strong = ndimage.maximum(weight, labels, np.arange(count + 1)) >= limit
            for path in _paths(np.argwhere(strong[labels]), max(SHORTEST_PX, 3 * scale)):
                pixels = tuple(path.T)
                lines.append(Skeleton(kind, rows[pixels], cols[pixels]))
    return sorted(lines, key=lambda each: -each.rows.size)


def order_contours(
    order: ArrayLike, levels: Iterable[float] | None = None, *, min_length_px: float = 0.0
) -> list[Skeleton]:
    """Lines of a known order map (NaN: not known) at whole (dark) and half (bright) orders. N is
    linear between pixel centres, which puts a line within N''/(8 N') px of its place. `levels` are
    multiples of 1/2, by default all: N = 0 is touched, not crossed, so it has no line."""
    from skimage.measure import find_contours

    field = np.asarray(order, dtype=np.float64)
    if min(field.shape) < 2:
        raise InputError("fringe_order_map_shape", shape=field.shape)
    known = np.isfinite(field)
    if levels is None:
        highest = float(field[known].max()) if known.any() else 0.0
        levels = np.arange(0.5, highest + 1e-12, 0.5).tolist()
    lines: list[Skeleton] = []
    for level in levels:
        kind: Kind = "bright" if round(2.0 * level) % 2 else "dark"
        for line in find_contours(np.where(known, field, 0.0), float(level), mask=known):
            if np.hypot(*np.diff(line, axis=0).T).sum() >= min_length_px:
                lines.append(Skeleton(kind, line[:, 0], line[:, 1], float(level)))
    return lines


def skeleton_table(
    lines: Sequence[Skeleton],
    *, pixel_mm: float | None = None, left_mm: float = 0.0, top_mm: float = 0.0,
) -> dict[str, NDArray[Any]]:  # fmt: skip
    """Lines as columns: line, kind, order, row_px, col_px, x_mm, z_mm; NaN: not known."""
    counts = [line.rows.size for line in lines]
    rows = np.concatenate([line.rows for line in lines] or [np.zeros(0)])
    cols = np.concatenate([line.cols for line in lines] or [np.zeros(0)])
    scale = np.nan if pixel_mm is None else pixel_mm
    orders = [np.nan if line.order is None else line.order for line in lines]
    return {
        "line": np.repeat(np.arange(len(lines)), counts),
        "kind": np.repeat(np.array([line.kind for line in lines], dtype="U6"), counts),
        "order": np.repeat(np.array(orders, dtype=float), counts),
        "row_px": rows,
        "col_px": cols,
        "x_mm": left_mm + (cols + 0.5) * scale,
        "z_mm": top_mm + (rows + 0.5) * scale,
    }


_APART = 0.15
"""Fringes between a line and its half order: a crest that is no order line lies farther off."""
_MOST = 0.75


def number_lines(lines: Sequence[Skeleton], order: ArrayLike) -> list[Skeleton]:
    """Give fringe lines the half order k/2 that the reading (NaN: not known) has along them. The
    nearest to the median of N along the line, where N is known on half of its points or more, and
    within 0.15 fringe of k/2 on three quarters of these; else the order is not known."""
    field = np.asarray(order, dtype=np.float64)
    numbered = []
    for line in lines:
        along = field[line_pixels(line.rows, line.cols, field.shape)]
        known = along[np.isfinite(along)]
        level = 0.5 * np.rint(2.0 * np.median(known)) if known.size else 0.0
        near = np.count_nonzero(np.abs(known - level) < _APART)
        tells = 0 < along.size <= 2 * known.size and near >= _MOST * known.size
        numbered.append(replace(line, order=float(level) if tells else None))
    return numbered
