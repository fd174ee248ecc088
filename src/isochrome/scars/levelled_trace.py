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

    Parameters
    ----------
    name : str
        The trace's name in messages.
    x_mm : ndarray, shape (n,)
        Middles of equal bins along the trace, mm, in the trace's own coordinate.
    depth_um : ndarray, shape (n,)
        Worn depth there, with roughness: negative where the surface stands above its level, µm.
    level_um : ndarray, shape (n,)
        The form that was taken off, µm.
    unworn : ndarray of bool, shape (n,)
        The shoulders that it was fitted to.
    edges_mm : tuple of float
        The scar's left and right edge, mm.
    edge_uncertainty_mm : tuple of float
        Their standard uncertainties, mm.
    window_mm : tuple of float
        What the area is taken over: the edges with a guard, mm.
    worn_area_mm2 : float
        The worn area; it may be below zero where little is worn, mm².
    worn_area_uncertainty_mm2 : float
        Its standard uncertainty by roughness and levelling, with what is not known of the
        roughness's spectrum itself (`student_factor`), mm².
    degrees_of_freedom : float
        Those of the spectrum's part in it.
    levelling_uncertainty_mm2 : float
        The part of it that is the level's, by the shoulders alone, mm².
    depth_covariance_um2 : ndarray, shape (n, n)
        Covariance of `depth_um` by roughness and levelling, µm².
    roughness : Roughness
        The roughness's spectrum, from the shoulders.
    deepest_um : float
        Depth of the smooth shape that its place was found with, µm.
    clear : float
        Depth over its standard uncertainty: below `STANDS_OUT` no scar stands out.
    ridges_mm2 : tuple of float
        Area that stands up beside the left and the right edge, mm².
    ridge_uncertainty_mm2 : float
        Standard uncertainty of either, mm².
    spikes : int
        Points that were left out.
    messages : tuple of str
        What the user should know.
    """

    name: str
    x_mm: Array
    depth_um: Array
    level_um: Array
    unworn: Mask
    edges_mm: tuple[float, float]
    edge_uncertainty_mm: tuple[float, float]
    window_mm: tuple[float, float]
    worn_area_mm2: float
    worn_area_uncertainty_mm2: float
    degrees_of_freedom: float
    levelling_uncertainty_mm2: float
    depth_covariance_um2: Array = field(repr=False)
    roughness: Roughness
    deepest_um: float
    clear: float
    ridges_mm2: tuple[float, float] = (0.0, 0.0)
    ridge_uncertainty_mm2: float = 0.0
    spikes: int = 0
    messages: tuple[str, ...] = ()

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
    """Variance of Student's t over that of the normal distribution.

    Equation: ν/(ν - 2), of ν = 3 at least. It is also the mean of the true variance over one that
    is estimated. Source: JCGM 101:2008, 6.4.9.3.

    Parameters
    ----------
    degrees_of_freedom : float
        Those with which a variance is estimated, ν.

    Returns
    -------
    float
        The factor; 1 for infinitely many.

    Examples
    --------
    >>> student_factor_of(12.0)
    1.2
    """
    freedom = max(degrees_of_freedom, 3.0)
    return freedom / (freedom - 2.0) if np.isfinite(freedom) else 1.0
