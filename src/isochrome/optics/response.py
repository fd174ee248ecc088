"""The sensor's response over wavelength: a measured one from a file, or a generic one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.output import read_given_table
from isochrome.scene import Camera

Array = NDArray[np.floating]

COLOURS = ("red", "green", "blue")
GREY = ("grey",)

GENERIC_PEAK_NM = (600.0, 540.0, 460.0)
GENERIC_WIDTH_NM = (35.0, 33.0, 30.0)
"""Peaks and standard deviations of three Gaussians: of the kind of a colour sensor behind an
infrared filter, and of no sensor in particular. Who wants colours to compare measures theirs."""


@dataclass(frozen=True)
class Response:
    """Response of each channel of a camera over wavelength: linear in its table, zero beyond.

    Without a table: generic Gaussians for three channels, and an equal response for one.
    """

    names: tuple[str, ...]
    wavelength_nm: Array | None = None  # (m,), rising
    value: Array | None = None  # (channels, m)

    def at(self, wavelength_nm: Array) -> Array:
        """Response (channels, n) at wavelengths (n,), nm."""
        if self.wavelength_nm is not None and self.value is not None:
            table = [
                np.interp(wavelength_nm, self.wavelength_nm, v, left=0, right=0) for v in self.value
            ]
            return np.array(table)
        if len(self.names) == 1:
            return np.ones((1, len(wavelength_nm)))
        peak, width = np.array(GENERIC_PEAK_NM), np.array(GENERIC_WIDTH_NM)
        return np.asarray(np.exp(-0.5 * ((wavelength_nm - peak[:, None]) / width[:, None]) ** 2))


def camera_response(camera: Camera, path: Path | None = None) -> Response:
    """Response of three channels where the scene's camera sees colour, of one where it does not.

    `path` is its response file, None for the generic one; InputError names the file and the fix.
    """
    names = COLOURS if camera.colour else GREY
    return Response(names) if path is None else read_response(path, names)


def read_response(path: Path, names: tuple[str, ...]) -> Response:
    """A measured response: a CSV file with the column wavelength_nm and one for each channel.

    Parameters: `path`; `names` of the channels' columns. Returns a Response. Raises InputError.
    """
    given = read_given_table(path, "the camera's response")
    columns = ("wavelength_nm", *names)
    if not set(columns) <= set(given.names):
        raise InputError(
            f"{path}: a camera's response needs the columns {', '.join(columns)}, and has "
            f"{given.header}; for one grey column set camera.colour = false, for three set it true"
        )
    table = np.stack([given.column(name) for name in columns], axis=1)
    if len(table) < 2 or (np.diff(table[:, 0]) <= 0.0).any():
        raise InputError(
            f"{path}: a camera's response needs two rows or more, with rising wavelength_nm"
        )
    if (table[:, 1:] < 0.0).any() or not (table[:, 1:] > 0.0).any(axis=0).all():
        raise InputError(
            f"{path}: a response must not be negative, nor zero all over a channel; correct it"
        )
    return Response(names, table[:, 0], table[:, 1:].T.copy())
