"""`calibrate_colour`: a colour table from the lab's own images, for light that nobody measured.

A beam in four-point bending has N = 12 M |y|/(h³ f_sigma) at the distance y from its neutral line,
M = P (Lo - Li)/4: the thickness cancels. Pixels of one order must be of one colour on both sides of
that line. With u = I/A and d = D/A, A the no-load frames' contrast and D their background, each
image I = e (D + A t) has f u - d = t(N), f = 1/e, linear in the factors f and in the table t, whose
values are eliminated order by order. One factor for all is left open: it is that by which the table
is the one of some light (`band_scale`).
Source: Timoshenko & Goodier (1970), Theory of Elasticity, art. 21.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from isochrome.calibration.settings import ColourBeam, ColourSet, ColourSetLike
from isochrome.calibration.shot import LARGEST_TILT, RIM, SMOOTHING_PX, read_one_frame
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import LEVEL_PX
from isochrome.figures import (
    BOLD_PT,
    CHANNEL_COLOURS,
    GREY,
    LINE_PT,
    LINE_STYLES,
    PaperPanels,
    Plot,
    panels_figure,
    style_axes,
)
from isochrome.frames import CHANNELS, as_captured, estimate_noise, load_mask, to_linear
from isochrome.fringes import (
    ALIKE,
    FOUND_ERROR,
    LOST,
    STEP,
    STRANGE,
    WIDTH,
    ColourShots,
    ColourTable,
    OwnLight,
    band_light,
    band_scale,
    find_light,
    measured_table,
    table_columns,
)
from isochrome.messages import message, warnings_json
from isochrome.optics import stored_type
from isochrome.output import Result, imagej_view, with_uncertainty, write_csv, write_tiff
from isochrome.scene import ArrayFrames, check_width

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[Any]

_PIXELS = 4_000
_ROWS = 1.5
_TILTS = 9
_LARGEST_SCATTER = 0.2


def known_beam_order(signal: Array, beam: ColourBeam, load_n: float, pixel_mm: float) -> Array:
    """The order N (rows, cols) in a beam's normalised `signal` (rows, cols, 3), NaN off the beam.
    PhysicsError where no line splits the image into two sides of like colours.
    """
    from scipy.optimize import minimize

    moment = 0.25 * load_n * (beam.outer_span_mm - beam.inner_span_mm)
    slope = 12.0 * moment / (beam.height_mm**3 * beam.fringe_value_n_per_mm) * pixel_mm
    half = 0.5 * (1.0 - RIM) * beam.height_mm / pixel_mm
    rows, cols = np.nonzero(np.isfinite(signal).all(axis=-1))
    if len(rows) < 100:
        raise PhysicsError("fewer_pixels_beam_can")
    picked = np.random.default_rng(0).choice(len(rows), min(_PIXELS, len(rows)), replace=False)
    place = np.stack([rows[picked], cols[picked] - 0.5 * (signal.shape[1] - 1)]).astype(float)
    colours = signal[rows[picked], cols[picked]].astype(float)

    def cost(line: Sequence[float]) -> float:
        """Share of the colours' variance that is within cells of one order."""
        away = _away(place, line)
        reach = min(half, float(away.max()), float(-away.min()))  # where there are two sides
        away = np.abs(away)
        inside = away < reach
        if 2 * np.count_nonzero(inside) < len(away):
            return 1.0
        # cells are so wide that each has rows of both sides
        cell = (slope * away[inside] / max(WIDTH, _ROWS * slope)).astype(int)
        count, within = np.maximum(np.bincount(cell), 1), 0.0
        for channel in colours[inside].T:
            mean = np.bincount(cell, weights=channel) / count
            within += float(np.sum((channel - mean[cell]) ** 2))
        return within / (len(cell) * float(colours[inside].var(axis=0).sum()))

    step = max(2.0 * WIDTH / slope, 0.5)
    tops = np.arange(rows.min(), rows.max() + step, step)
    tilts = np.tan(np.radians(np.linspace(-LARGEST_TILT, LARGEST_TILT, _TILTS)))
    best = np.array(min(product(tops, tilts), key=cost))
    near = best + np.array([[0.0, 0.0], [step, 0.0], [0.0, 0.02]])
    solution = minimize(cost, best, method="Nelder-Mead", options={"initial_simplex": near})
    if not solution.fun < _LARGEST_SCATTER:
        raise PhysicsError("colours_variance_left_one", fun=100 * solution.fun)
    grid = np.indices(signal.shape[:2]).astype(float)
    grid[1] -= 0.5 * (signal.shape[1] - 1)
    away = _away(grid, solution.x)
    return np.where(np.abs(away) < half, slope * np.abs(away), np.nan)


def _away(place: Array, line: Sequence[float]) -> Array:
    """Distance of (row, col from the middle) from a line of (row at the middle, rows a column)."""
    return np.asarray((place[0] - line[0] - line[1] * place[1]) / np.hypot(1.0, line[1]))


SAME = 0.05
"""Log of an exposure against the no-load frames that is none: a light's bands do not tell the
factor of all to better."""


def image_exposures(
    light: Sequence[Array], dark: Array, contrast: Array, orders: Sequence[Array], *, bright: bool
) -> Array:
    """Exposures e (images,) of a beam's images over the no-load frames', 1 where alike; NaN = not
    trusted or off the beam. PhysicsError where the images have no order in common.
    """
    cells = int(max(np.nanmax(order) for order in orders) / WIDTH) + 1
    # pixels, and sums of u and d, of each image in cells of one order
    sums = np.zeros((3, len(orders), cells, contrast.shape[-1]))
    for k, (one, order) in enumerate(zip(light, orders, strict=True)):
        for c in range(contrast.shape[-1]):
            known = np.isfinite(order) & np.isfinite(one[..., c])
            cell, size = (order[known] / WIDTH).astype(int), contrast[..., c][known]
            parts = np.ones(len(cell)), one[..., c][known] / size, dark[..., c][known] / size
            for total, part in zip(sums, parts, strict=True):
                total[k, :, c] = np.bincount(cell, weights=part, minlength=cells)
    count = sums[0]
    lit, low = sums[1:] / np.maximum(count, 1.0)
    total = np.maximum(count.sum(axis=0), 1.0)
    # factors f over that of the image with most light, by least squares
    size, back = count * lit, (count * low).sum(axis=0)
    matrix = np.diag((size * lit).sum(axis=(1, 2)))
    matrix -= np.einsum("ibc,jbc->ij", size / total, size)
    right = (size * (low - back / total)).sum(axis=(1, 2))
    first = int(np.argmax(np.diag(matrix)))
    others = np.arange(len(count)) != first
    factors = np.ones(len(count))
    inner = matrix[np.ix_(others, others)]
    factors[others] = np.linalg.solve(inner, (right - matrix[:, first])[others])
    if not (factors > 0.0).all():
        raise PhysicsError("images_colours_one_order")
    table = ((factors[:, None, None] * lit - low) * count).sum(axis=0) / total
    covered = count.sum(axis=0).all(axis=1)
    places = WIDTH * (np.flatnonzero(covered) + 0.5)
    away = np.log(band_scale(places, table[covered], bright=bright) / factors)
    nearest = away[np.argmin(np.abs(away))]
    if abs(nearest) < SAME:
        away = away - nearest
    return np.asarray(np.exp(away))


def read_colour_shots(given: ColourSet) -> tuple[ColourShots, int | None]:
    """A set's images, its no-load frames, and the bit depth. InputError names the unusable file."""
    images, depth = [], None
    for item in given.image:
        image, depth = _read(given, given.path(item.file), masked=True)
        images.append(image)
    shapes = {image[0].shape for image in images}
    if len(shapes) > 1:
        raise InputError("images_different_sizes_rows", name=given.name, shapes=sorted(shapes))
    ends: list[Array | None] = [None, None]
    for k, name in enumerate((given.frames.no_load_dark, given.frames.no_load_bright)):
        if name is None:
            continue
        path, shape = given.path(name), images[0][0].shape
        (end, *_), _ = _read(given, path, masked=False)
        if end.shape != shape:
            raise InputError(
                "rows_columns_channels_images", path=path, shape=end.shape, shape_2=shape
            )
        # its noise must not enter every pixel's model
        ends[k] = gaussian_filter(end, (SMOOTHING_PX, SMOOTHING_PX, 0.0))
    raw, noise, valid = (np.stack(part) for part in zip(*images, strict=True))
    return ColourShots(raw, noise, valid, ends[0], ends[1]), depth


def _read(
    given: ColourSet, path: Path | ArrayFrames, *, masked: bool
) -> tuple[tuple[Array, Array, Array], int | None]:
    """Grey levels of one image, 1 = full scale, with noise and trusted pixels."""
    channels, depth = [], None
    for name in CHANNELS:
        frame, reader = read_one_frame(
            path, given.frames, given.camera, in_colour=True, channel=name
        )
        depth = reader.bit_depth
        mask = load_mask(given, reader.shape, reader.full_shape) if masked else None
        linear = to_linear(
            frame, bit_depth=depth, name=f"{path}, {name}", allow_blank=not masked, mask=mask
        )
        noise = estimate_noise(frame, linear.valid, bit_depth=depth)
        level = gaussian_filter(np.nan_to_num(frame.astype(np.float32)), LEVEL_PX)
        sigma = noise.linear_sigma(level, bit_depth=depth)
        channels.append((linear.image, sigma, linear.valid))
    levels, sigma, valid = (np.stack(part, axis=-1) for part in zip(*channels, strict=True))
    return (levels, sigma, valid), depth


LARGEST_MOVE = 0.05
"""Change of the table in the last round, of full light, from which on it has not settled."""

LEAST_ORDER = 1.2
"""Order that the images must reach: before that, colours say little of the light."""

_BRIGHTEST = 0.95


@dataclass(frozen=True, repr=False, kw_only=True)
class ColourCalibration(Result):
    """A colour table and what was found beside it.

    Parameters
    ----------
    colour_table : ColourTable
        The table.
    way : str
        'beam' or 'own colours'.
    gamma : float
        The exponent that the table holds for.
    gamma_uncertainty : float, optional
        Its standard uncertainty, None where it was given.
    wavelength_nm : float
        Wavelength that the orders count at, nm.
    bands_nm, widths_nm : tuple of float, optional
        Middles and widths of the bands of red, green and blue, nm; None with a beam.
    residual : float
        Root mean square of what the table leaves, of full light.
    strange : float
        Share of pixels off by over 0.15.
    highest : float
        The order that the images reach.
    background, illumination : (rows, cols, 3) array, optional
        Light of the no-load frames as found, as the camera sees it, before frames.rotate_deg and
        frames.flip; None where they were given.
    bit_depth : int or None
        Bits of the images.
    exposures : tuple of float, optional
        Exposure of each image over that of the no-load frames, or of the first image without.
    warnings : tuple of str, optional
        What the user should know.
    """

    colour_table: ColourTable
    way: str
    gamma: float
    gamma_uncertainty: float | None = None
    wavelength_nm: float
    bands_nm: tuple[float, ...] | None = None
    widths_nm: tuple[float, ...] | None = None
    residual: float
    strange: float
    highest: float
    background: Array | None = None
    illumination: Array | None = None
    bit_depth: int | None
    exposures: tuple[float, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def columns(self) -> dict[str, Any]:
        """Those of colour_table.csv."""
        return table_columns(self.colour_table)

    @property
    def title(self) -> str:
        """What the table is from, and how far it goes."""
        return f"Colour table to N = {self.colour_table.highest:.2f} from {self.way}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """The tone curve, the bands of the light, and what the table leaves."""
        spread = self.gamma_uncertainty
        given = f"{self.gamma:.3f}, as given"
        yield "gamma", given if spread is None else with_uncertainty(self.gamma, spread)
        if self.bands_nm is not None:
            yield "bands_nm", ", ".join(f"{band:.1f}" for band in self.bands_nm)
        yield "residual", f"{self.residual:.3f} of full light"

    def figure(self) -> Figure:
        """The channels' signals over the order with their scatter, and the colours."""
        return panels_figure(replace(self.panels(), notes=()), _values(self))

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give the table for a paper; see `paper_figure`.

        A table has no frames: raises InputError where some are named.
        """
        if frames is not None:
            raise InputError("frames_figure_colour_table")

        table, label = self.colour_table, f"fringe order N at {self.wavelength_nm:g} nm (fringes)"

        def channels(axes: Axes) -> None:
            """The channels' signals over the order with their scatter."""
            for c, (name, colour) in enumerate(zip(CHANNELS, CHANNEL_COLOURS, strict=True)):
                signal, spread = table.signal[:, c], table.spread[c]
                line = LINE_STYLES[c]
                axes.plot(table.order, signal, color=colour, lw=BOLD_PT, ls=line, label=name)
                low, high = signal - spread, signal + spread
                axes.fill_between(table.order, low, high, color=colour, alpha=0.2, lw=0)
            axes.axvline(self.highest, color=GREY, ls="--", lw=LINE_PT, label=_SEEN)
            style_axes(axes, x_label=label, z_label="signal (1 = full light)")

        def strip(axes: Axes) -> None:
            """The colours over the order."""
            colours = np.clip(table.signal / table.signal.max(), 0.0, 1.0) ** (1.0 / 2.2)
            axes.imshow(colours[None], aspect="auto", extent=(0.0, table.highest, 0.0, 1.0))
            axes.set_yticks([])
            style_axes(axes, x_label=label)

        return PaperPanels(
            plots=[
                Plot(title="channels", draw=channels, height_mm=45.0),
                Plot(title="colours", draw=strip, height_mm=10.0),
            ],
            plots_across=1,
            legend=(*CHANNELS, _SEEN),
            notes=[f"{_values(self)}."],
        )

    def to_json(self) -> dict[str, Any]:
        """The calibration without its table and images, for calibration.json."""
        return {
            "way": self.way,
            "gamma": self.gamma,
            "gamma_standard_uncertainty": self.gamma_uncertainty,
            "wavelength_nm": self.wavelength_nm,
            "bands_nm": self.bands_nm and dict(zip(CHANNELS, self.bands_nm, strict=True)),
            "widths_nm": self.widths_nm and dict(zip(CHANNELS, self.widths_nm, strict=True)),
            "residual": self.residual,
            "spread": dict(zip(CHANNELS, map(float, self.colour_table.spread), strict=True)),
            "strange_share": self.strange,
            "highest_order_seen": self.highest,
            "highest_order_of_table": self.colour_table.highest,
            "exposures": list(self.exposures),
            **warnings_json(self.warnings),
        }  # fmt: skip


def calibrate_colour(source: ColourSetLike) -> ColourCalibration:
    """Calibrate a colour table from images of a beam, or from images' own colours.

    With [beam], its fringe value, loads and both no-load frames every pixel's order is known, and
    the table is measured. Without, the light's bands, their mixing in the camera, its tone curve
    and the illumination are found from the colours of the images, of any loaded specimen. Colours
    do not fix the orders' scale: they count at the middle of the green channel's band, which
    polariscope.wavelength_nm names.

    Parameters
    ----------
    source : str, Path, ColourSet or mapping
        A calibration set's file, a ColourSet, or the tables of such a file as dictionaries, in
        which images may be arrays.

    Returns
    -------
    ColourCalibration
        The table, signals of the channels over the order (fringes), with its uncertainty.

    Raises
    ------
    InputError
        Where the set or a file is wrong.
    PhysicsError
        Where the search does not settle, or the colours do not fit any table.

    Notes
    -----
    Source: Ajovalasit, Barone & Petrucci (1995), J. Strain Analysis 30, 29.

    Examples
    --------
    With colour images of one's own:

    >>> import isochrome
    >>> found = isochrome.calibrate_colour("colours/set.toml")  # doctest: +SKIP
    >>> found.table  # doctest: +SKIP
    """
    given = ColourSet.read(source)
    shots, depth = read_colour_shots(given)
    if given.beam is not None:
        return _of_beam(given, shots, depth)
    bright = given.polariscope.field == "bright"
    light = find_light(
        shots, gamma=given.gamma, bright_field=bright, highest_order=given.highest_order
    )
    check_light(light, given)
    return _of_light(light, given, shots, depth)


def _of_beam(given: ColourSet, shots: ColourShots, depth: int | None) -> ColourCalibration:
    """The table of pixels whose order the beam gives."""
    beam, pixel, gamma = given.beam, given.camera.pixel_mm, given.gamma or 1.0
    assert beam is not None and pixel is not None and given.polariscope.wavelength_nm is not None
    if shots.dark is None or shots.bright is None:
        raise InputError("beam_colours_need_frames", name=given.name)
    check_width(given.name, pixel, shots.raw[0].shape[:2], beam.height_mm, "the beam")
    low, bright = shots.dark**gamma, given.polariscope.field == "bright"
    contrast = shots.bright**gamma - low
    lit = contrast > 0.2 * np.nanpercentile(contrast, 95)
    lights = [
        np.where(valid & lit, np.maximum(raw, 0.0) ** gamma, np.nan)
        for raw, valid in zip(shots.raw, shots.valid, strict=True)
    ]
    contrast = np.where(lit, contrast, np.nan)
    orders = [
        known_beam_order((light - low) / contrast, beam, item.load_n or 0.0, pixel)
        for item, light in zip(given.image, lights, strict=True)
    ]
    factors = image_exposures(lights, low, contrast, orders, bright=bright)
    signal = np.concatenate(
        [(light / e - low) / contrast for light, e in zip(lights, factors, strict=True)]
    )
    order = np.concatenate(orders)
    table = measured_table(signal, order)
    known = np.isfinite(order) & np.isfinite(signal).all(axis=-1)
    away = signal[known] - table.signal[np.rint(order[known] / STEP).astype(int)]
    noise = np.median(np.abs(away), axis=0) * 1.4826
    residual = np.sqrt(np.maximum(np.mean(away**2, axis=0) - noise**2, 0.0))
    return ColourCalibration(
        colour_table=ColourTable(table.signal, residual), way="beam", gamma=gamma,
        wavelength_nm=given.polariscope.wavelength_nm, residual=float(np.sqrt(np.mean(away**2))),
        strange=float(np.mean(np.mean(away**2, axis=1) > STRANGE**2)), highest=table.highest,
        bit_depth=depth, exposures=tuple(map(float, factors)),
        warnings=tuple(exposure_messages(given, factors, "the no-load frames")),
    )  # fmt: skip


def exposure_messages(given: ColourSet, factors: Array, against: str) -> list[str]:
    """Say of each image whose exposure differs from another's that its factor is used."""
    return [
        message("exposed_times_long_lit", file=item.file, factor=factor, against=against)
        for item, factor in zip(given.image, factors, strict=True)
        if abs(np.log(factor)) > ALIKE
    ]


def check_light(light: OwnLight, given: ColourSet) -> None:
    """Refuse a light that was not found: raises PhysicsError that says by what it shows."""
    what = message("colours_light_not_found", name=given.name)
    advice, highest = message("give_images_up_more"), light.highest
    if highest < LEAST_ORDER:
        raise PhysicsError(
            "images_reach_least_needed", what=what, highest=highest, least_order=LEAST_ORDER
        )
    if max(light.strange, light.torn) >= LOST:
        strange, torn = 100 * light.strange, 100 * light.torn
        raise PhysicsError(
            "pixels_off_table_order", what=what, strange=strange, torn=torn, advice=advice
        )
    if light.moved > LARGEST_MOVE:
        raise PhysicsError("last_round_still_moved", what=what, moved=light.moved, advice=advice)


def _of_light(
    light: OwnLight, given: ColourSet, shots: ColourShots, depth: int | None
) -> ColourCalibration:
    wavelength = given.polariscope.wavelength_nm
    assert wavelength is not None
    bands = band_light(light.numbers)
    middle = wavelength / bands.ratio
    messages = [message("orders_count_nm_taken", wavelength=wavelength)]
    if light.residual > FOUND_ERROR:
        messages.append(message("table_leaves_full_light", residual=light.residual))
    ends = shots.dark is None or shots.bright is None
    standard = int(np.argmin(np.abs(np.log(light.brightness))))
    against = str(given.image[standard].file) if shots.bright is None else "the no-load frames"
    messages += exposure_messages(given, light.brightness, against)
    # where full light would saturate, a no-load frame cannot show it: less of it, and more signal
    full = float((light.background + light.illumination).max())
    scale = max(1.0, full / _BRIGHTEST) if ends else 1.0
    turn = given.frames.rotate_deg, given.frames.flip
    return ColourCalibration(
        colour_table=ColourTable(scale * light.table.signal, scale * light.table.spread),
        way="own colours", gamma=light.gamma,
        gamma_uncertainty=None if given.gamma is not None else light.gamma_uncertainty,
        wavelength_nm=wavelength, bands_nm=tuple(map(float, middle)),
        widths_nm=tuple(map(float, middle * bands.width)), residual=light.residual,
        strange=light.strange, highest=light.highest,
        background=as_captured(light.background, *turn) if ends else None,
        illumination=as_captured(light.illumination / scale, *turn) if ends else None,
        bit_depth=depth, exposures=tuple(map(float, light.brightness)), warnings=tuple(messages),
    )  # fmt: skip


_SEEN = "seen in the images"


def write_colours(calibration: ColourCalibration, folder: Path) -> None:
    """Write colour_table.csv and, where they were found, background.tif and illumination.tif."""
    write_csv(folder / "colour_table.csv", calibration.columns)
    if calibration.background is None or calibration.illumination is None:
        return
    bright, depth = calibration.background + calibration.illumination, calibration.bit_depth
    for name, light in (("background", calibration.background), ("illumination", bright)):
        # grey levels of the images' kind, below the level that counts as saturated
        raw = np.maximum(light, 0.0) ** (1.0 / calibration.gamma)
        levels = np.minimum(raw, 0.999).astype(np.float32)
        if depth is not None:
            full = 2**depth - 1
            levels = np.minimum(np.rint(full * raw), full - 1).astype(stored_type(depth))
        view = imagej_view(name, (0.0, 1.0), labels=[name])
        write_tiff(folder / f"{name}.tif", levels[None], photometric="rgb", metadata=view)


def _values(calibration: ColourCalibration) -> str:
    return (
        f"colour table from {calibration.way}: gamma = {calibration.gamma:.3g}, "
        f"residual {calibration.residual:.3f} of full light"
    )
