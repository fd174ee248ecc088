"""The undeformed gap between indenter and specimen: a cylinder, a flat, a measured profile."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from isochrome.contact.surface import Floats
from isochrome.errors import InputError
from isochrome.output import read_given_table
from isochrome.scene import Scene

FAR_MM = 1e3
"""Gap beyond a flat's corners: nothing touches there."""


def undeformed_gap(scene: Scene, x_mm: Floats) -> Floats:
    """Gap between the unloaded bodies, up to a constant.

    Equation: x²/(2R) for a cylinder, 0 between a flat's corners, and what the profile file adds.
    Parameters: `scene`, with an indenter; `x_mm` (n,). Returns (n,), mm. Raises InputError on a
    profile file that cannot be used.
    """
    indenter = scene.indenter
    assert indenter is not None
    gap = np.zeros_like(x_mm)
    if indenter.radius_mm is not None and indenter.shape == "cylinder":
        gap += x_mm**2 / (2.0 * indenter.radius_mm)
    if indenter.half_width_mm is not None and indenter.shape == "flat":
        gap[np.abs(x_mm) > indenter.half_width_mm * (1.0 + 1e-12)] = FAR_MM
    if indenter.profile is not None:
        x, height = read_profile(scene.path(indenter.profile))
        gap += np.interp(x_mm, x, height)
        gap[(x_mm < x[0]) | (x_mm > x[-1])] = FAR_MM
    return gap


def read_profile(path: Path) -> tuple[Floats, Floats]:
    """A measured profile: a CSV file with the columns x_mm and gap_mm (or gap_um).

    A profile may be measured from anywhere: its smallest gap is taken as 0, since the rounding of a
    datum would be felt as roughness.
    Returns x (m,) rising and the gap (m,), mm. Raises InputError that names the file and the fix.
    """
    try:
        stat = path.stat()
    except OSError as error:
        raise InputError(f"{path}: the profile cannot be read ({error}); check its name") from error
    return _read_version(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=4)
def _read_version(path: Path, changed_ns: int, size: int) -> tuple[Floats, Floats]:
    """One version of a profile's file: every state of a scene asks for it, several times."""
    given = read_given_table(path, "the profile")
    name = "gap_um" if "gap_um" in given.names else "gap_mm"
    if not {"x_mm", name} <= set(given.names):
        raise InputError(
            f"{path}: a profile needs the columns x_mm and gap_mm (or gap_um), and has "
            f"{given.header}; name them so"
        )
    x, gap = given.column("x_mm"), given.column(name)
    if len(x) < 3 or (np.diff(x) <= 0.0).any():
        raise InputError(f"{path}: a profile needs three rows or more, with rising x_mm")
    gap = (gap - gap.min()) * (1e-3 if name == "gap_um" else 1.0)
    for shared in (x, gap):
        shared.flags.writeable = False
    return x, gap
