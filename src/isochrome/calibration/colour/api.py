"""`calibrate_colour`: a colour table from the lab's own images, for light that nobody measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.colour.beam_exposure import ALIKE, image_exposures
from isochrome.calibration.colour.bending_order import known_beam_order
from isochrome.calibration.colour.colour_frames import read_colour_shots
from isochrome.calibration.colour.settings import ColourSet, ColourSetLike, load_colour_set
from isochrome.errors import InputError, PhysicsError
from isochrome.figures import PaperPanels
from isochrome.frames import as_captured
from isochrome.fringes import (
    STEP,
    ColourShots,
    ColourTable,
    OwnLight,
    band_light,
    find_light,
    measured_table,
    table_columns,
)
from isochrome.output import Result, with_uncertainty
from isochrome.scene import check_width

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[Any]

LARGEST_STRANGE = 0.03
"""Share of pixels whose colours are not the table's from which on a calibration is refused."""

LARGEST_TORN = 0.03
"""Share of pixels beside a jump of the order from which on it is refused."""

LARGEST_MOVE = 0.05
"""Change of the table in the last round, of full light, from which on it has not settled."""

LEAST_ORDER = 1.2
"""Order that the images must reach: before that, colours say little of the light."""

_POOR_RESIDUAL = 0.03
_BRIGHTEST = 0.95


@dataclass(frozen=True, repr=False, kw_only=True)
class ColourCalibration(Result):
    """A colour table and what was found beside it.

    Parameters
    ----------
    draw : callable, optional
        Makes the figure, of results that need more for it than they hold; not of this one.
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
        """See `colour_figure`."""
        from isochrome.calibration.colour.folder import colour_figure

        return colour_figure(self)

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give the table for a paper; see `paper_figure`.

        A table has no frames: raises InputError where some are named.
        """
        from isochrome.calibration.colour.folder import colour_panels

        return colour_panels(self, frames)

    def to_json(self) -> dict[str, Any]:
        """The calibration without its table and images, for calibration.json."""
        names = ("red", "green", "blue")
        return {
            "way": self.way,
            "gamma": self.gamma,
            "gamma_standard_uncertainty": self.gamma_uncertainty,
            "wavelength_nm": self.wavelength_nm,
            "bands_nm": self.bands_nm and dict(zip(names, self.bands_nm, strict=True)),
            "widths_nm": self.widths_nm and dict(zip(names, self.widths_nm, strict=True)),
            "residual": self.residual,
            "spread": dict(zip(names, map(float, self.colour_table.spread), strict=True)),
            "strange_share": self.strange,
            "highest_order_seen": self.highest,
            "highest_order_of_table": self.colour_table.highest,
            "exposures": list(self.exposures),
            "warnings": list(self.warnings),
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
    given = load_colour_set(source)
    shots, depth = read_colour_shots(given)
    if given.beam is not None:
        return _of_beam(given, shots, depth)
    light = find_light(
        shots,
        gamma=given.gamma,
        bright_field=given.polariscope.field == "bright",
        highest_order=given.highest_order,
    )
    check_light(light, given)
    return _of_light(light, given, shots, depth)


def _of_beam(given: ColourSet, shots: ColourShots, depth: int | None) -> ColourCalibration:
    """The table of pixels whose order the beam gives."""
    beam, pixel, gamma = given.beam, given.camera.pixel_mm, given.gamma or 1.0
    assert beam is not None and pixel is not None and given.polariscope.wavelength_nm is not None
    if shots.dark is None or shots.bright is None:
        raise InputError(
            f"{given.name}: a beam's colours need frames.no_load_dark and frames.no_load_bright; "
            "add them, or remove [beam] to use the images' own colours"
        )
    check_width(given.name, pixel, shots.raw[0].shape[:2], beam.height_mm, "the beam")
    low, contrast = shots.dark**gamma, shots.bright**gamma - shots.dark**gamma
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
    bright = given.polariscope.field == "bright"
    factors = image_exposures(lights, low, contrast, orders, bright=bright)
    signal = np.concatenate(
        [(light / e - low) / contrast for light, e in zip(lights, factors, strict=True)]
    )
    order = np.concatenate(orders)
    table = measured_table(signal, order)
    known = np.isfinite(order) & np.isfinite(signal).all(axis=-1)
    away = signal[known] - table.signal[np.rint(order[known] / STEP).astype(int)]
    noise = np.median(np.abs(away), axis=0) * 1.4826
    rest = np.sqrt(np.maximum(np.mean(away**2, axis=0) - noise**2, 0.0))
    return ColourCalibration(
        colour_table=ColourTable(table.signal, rest),
        way="beam",
        gamma=gamma,
        wavelength_nm=given.polariscope.wavelength_nm,
        residual=float(np.sqrt(np.mean(away**2))),
        strange=float(np.mean(np.mean(away**2, axis=1) > 0.15**2)),
        highest=table.highest,
        bit_depth=depth,
        exposures=tuple(map(float, factors)),
        warnings=tuple(exposure_messages(given, factors, "the no-load frames")),
    )


def exposure_messages(given: ColourSet, factors: Array, against: str) -> list[str]:
    """Say of each image whose exposure differs from another's that its factor is used."""
    return [
        f"{item.file} is exposed {factor:.3g} times as long as {against}, or lit so much more: "
        "that is used"
        for item, factor in zip(given.image, factors, strict=True)
        if abs(np.log(factor)) > ALIKE
    ]


def check_light(light: OwnLight, given: ColourSet) -> None:
    """Refuse a light that was not found: raises PhysicsError that says by what it shows."""
    what = f"{given.name}: the colours' light was not found: "
    advice = "give images up to N = 2 or more, no-load frames, a mask of the specimen, or [beam]"
    if light.highest < LEAST_ORDER:
        raise PhysicsError(
            f"{what}the images reach N = {light.highest:.2f}, and {LEAST_ORDER} at least is "
            "needed; load the specimen more"
        )
    if light.strange > LARGEST_STRANGE or light.torn > LARGEST_TORN:
        raise PhysicsError(
            f"{what}{100 * light.strange:.1f} % of the pixels are off the table, and the order "
            f"jumps beside {100 * light.torn:.1f} %; {advice}"
        )
    if light.moved > LARGEST_MOVE:
        raise PhysicsError(
            f"{what}the last round still moved the table by {light.moved:.3f} of full light; "
            f"{advice}"
        )


def _of_light(
    light: OwnLight, given: ColourSet, shots: ColourShots, depth: int | None
) -> ColourCalibration:
    """The found light as a calibration."""
    wavelength = given.polariscope.wavelength_nm
    assert wavelength is not None
    bands = band_light(light.numbers)
    middle = wavelength / bands.ratio
    messages = [
        f"orders count at {wavelength:g} nm, taken as the middle of the green channel's band"
    ]
    if light.residual > _POOR_RESIDUAL:
        messages.append(
            f"the table leaves {light.residual:.3f} of full light: use its orders with care"
        )
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
        way="own colours",
        gamma=light.gamma,
        gamma_uncertainty=None if given.gamma is not None else light.gamma_uncertainty,
        wavelength_nm=wavelength,
        bands_nm=tuple(map(float, middle)),
        widths_nm=tuple(map(float, middle * bands.width)),
        residual=light.residual,
        strange=light.strange,
        highest=light.highest,
        background=as_captured(light.background, *turn) if ends else None,
        illumination=as_captured(light.illumination / scale, *turn) if ends else None,
        bit_depth=depth,
        exposures=tuple(map(float, light.brightness)),
        warnings=tuple(messages),
    )
