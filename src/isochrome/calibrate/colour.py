"""`calibrate_colour`: a colour table from the lab's own images, for light that nobody measured."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibrate.colour_bending import beam_order
from isochrome.calibrate.colour_load import read_colour_shots
from isochrome.calibrate.colour_settings import ColourSet, load_colour_set
from isochrome.errors import InputError, PhysicsError
from isochrome.fringes.colour_model import band_light
from isochrome.fringes.colour_own import OwnLight, find_light
from isochrome.fringes.colour_table import STEP, ColourTable, measured_table
from isochrome.fringes.colour_unknowns import ColourShots

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


@dataclass(frozen=True)
class ColourCalibration:
    """A colour table and what was found beside it.

    `table`; `way`, 'beam' or 'own colours'; `gamma` that the table holds for, and its standard
    uncertainty, None where it was given; `wavelength_nm` that the orders count at; `bands_nm` and
    `widths_nm`, of red, green and blue, None with a beam; `residual`, root mean square of what the
    table leaves, of full light, and `strange`, the share of pixels off by over 0.15; `highest`,
    the order that the images reach; `background`, `illumination` (rows, cols, 3), light of the
    no-load frames as found, None where they were given; `bit_depth` of the images.
    """

    table: ColourTable
    way: str
    gamma: float
    gamma_uncertainty: float | None
    wavelength_nm: float
    bands_nm: tuple[float, ...] | None
    widths_nm: tuple[float, ...] | None
    residual: float
    strange: float
    highest: float
    background: Array | None
    illumination: Array | None
    bit_depth: int | None
    warnings: tuple[str, ...]

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
            "spread": dict(zip(names, map(float, self.table.spread), strict=True)),
            "strange_share": self.strange,
            "highest_order_seen": self.highest,
            "highest_order_of_table": self.table.highest,
            "warnings": list(self.warnings),
        }  # fmt: skip


def calibrate_colour(source: str | Path | ColourSet) -> ColourCalibration:
    """Calibrate a colour table from images of a beam, or from images' own colours.

    With [beam], its fringe value, loads and both no-load frames every pixel's order is known, and
    the table is measured. Without, the light's bands, their mixing in the camera, its tone curve
    and the illumination are found from the colours of the images, of any loaded specimen. Colours
    do not tell the orders' scale: they count at the middle of the green channel's band, which
    polariscope.wavelength_nm names.
    Parameters: `source`, a calibration set's file, or a ColourSet. Returns a ColourCalibration.
    Raises InputError on what cannot be read, PhysicsError where the search does not settle or the
    colours stay strange.
    Source: Ajovalasit, Barone & Petrucci (1995), J. Strain Analysis 30, 29.
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
    low, full = shots.dark**gamma, shots.bright**gamma
    orders, signals = [], []
    for item, raw, valid in zip(given.image, shots.raw, shots.valid, strict=True):
        lit = valid & (full - low > 0.2 * np.nanpercentile(full - low, 95))
        signal = np.full(raw.shape, np.nan)
        np.divide(np.maximum(raw, 0.0) ** gamma - low, full - low, out=signal, where=lit)
        orders.append(beam_order(signal, beam, item.load_n or 0.0, pixel))
        signals.append(signal)
    order, signal = np.concatenate(orders), np.concatenate(signals)
    table = measured_table(signal, order)
    known = np.isfinite(order) & np.isfinite(signal).all(axis=-1)
    away = signal[known] - table.signal[np.rint(order[known] / STEP).astype(int)]
    noise = np.median(np.abs(away), axis=0) * 1.4826
    rest = np.sqrt(np.maximum(np.mean(away**2, axis=0) - noise**2, 0.0))
    return ColourCalibration(
        ColourTable(table.signal, rest), "beam", gamma, None, given.polariscope.wavelength_nm,
        None, None, float(np.sqrt(np.mean(away**2))),
        float(np.mean(np.mean(away**2, axis=1) > 0.15**2)),
        table.highest, None, None, depth, (),
    )  # fmt: skip


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
    said = [f"orders count at {wavelength:g} nm, taken as the middle of the green channel's band"]
    if light.residual > _POOR_RESIDUAL:
        said.append(
            f"the table leaves {light.residual:.3f} of full light: use its orders with care"
        )
    if np.ptp(light.brightness) > 0.1:
        said.append("the images differ in brightness by over 10 %: keep the exposure fixed")
    ends = shots.dark is None or shots.bright is None
    # where full light would saturate, a no-load frame cannot show it: less of it, and more signal
    scale = max(1.0, float((light.background + light.illumination).max()) / _BRIGHTEST)
    if not ends:
        scale = 1.0
    return ColourCalibration(
        ColourTable(scale * light.table.signal, scale * light.table.spread),
        "own colours",
        light.gamma,
        None if given.gamma is not None else light.gamma_uncertainty,
        wavelength,
        tuple(float(b) for b in middle),
        tuple(float(w) for w in middle * bands.width),
        light.residual,
        light.strange,
        light.highest,
        light.background if ends else None,
        light.illumination / scale if ends else None,
        depth,
        tuple(said),
    )
