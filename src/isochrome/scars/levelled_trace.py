"""What levelling gives of a trace: depths, edges, worn area, each with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.scars.roughness import Roughness

Array = NDArray[Any]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class LevelledTrace:
    """A trace whose unworn surface is level, at 0; depth is positive into the specimen.

    Arrays are (n,), in equal bins; every `..._uncertainty` is a standard uncertainty.
    """

    name: str
    x_mm: Array  # middles of the bins, in the trace's own coordinate
    depth_um: Array  # with roughness: negative where it stands above its level
    level_um: Array  # the form that was taken off
    unworn: Mask  # the shoulders that it was fitted to
    edges_mm: tuple[float, float]  # left and right edge of the scar
    edge_uncertainty_mm: tuple[float, float]
    window_mm: tuple[float, float]  # what the area is taken over: the edges with a guard
    worn_area_mm2: float  # below zero where little is worn
    # by roughness and levelling, with what is not known of the roughness's spectrum itself
    # (`student_factor`)
    worn_area_uncertainty_mm2: float
    degrees_of_freedom: float  # those of the spectrum's part in it
    levelling_uncertainty_mm2: float  # the part of it that is the level's, by the shoulders alone
    depth_covariance_um2: Array = field(repr=False)  # (n, n), by roughness and levelling
    roughness: Roughness  # from the shoulders
    deepest_um: float  # of the smooth shape that its place was found with
    clear: float  # depth over its ±: below `STANDS_OUT` no scar stands out
    ridges_mm2: tuple[float, float] = (0.0, 0.0)  # area that stands up beside either edge
    ridge_uncertainty_mm2: float = 0.0  # of either
    spikes: int = 0  # points that were left out
    messages: tuple[str, ...] = ()  # what the user should know

    @property
    def student_factor(self) -> float:
        """What its variances are more by than the spectrum's own: ν/(ν-2), that of Student's t."""
        return student_factor_of(self.degrees_of_freedom)

    @property
    def width_mm(self) -> float:
        """Distance of the edges, mm."""
        return self.edges_mm[1] - self.edges_mm[0]

    @property
    def centre_mm(self) -> float:
        """Middle between the edges, mm."""
        return 0.5 * (self.edges_mm[0] + self.edges_mm[1])


def student_factor_of(degrees_of_freedom: float) -> float:
    """Variance of Student's t over the normal one's, ν/(ν - 2), of ν = 3 at least; 1 at infinity.

    It is also the mean of the true variance over one that is estimated with ν degrees of freedom.
    Source: JCGM 101:2008, 6.4.9.3.
    """
    freedom = max(degrees_of_freedom, 3.0)
    return freedom / (freedom - 2.0) if np.isfinite(freedom) else 1.0
