"""Unknowns from intensities: separable least squares, its bases and its starts."""

from isochrome.fit.basis import polynomial_basis, stride_mask
from isochrome.fit.intensity import IntensityFit, fit_intensity
from isochrome.fit.linear import Evaluation, evaluate
from isochrome.fit.starts import Minimum, SeveralStarts, several_starts

__all__ = [
    "Evaluation",
    "IntensityFit",
    "Minimum",
    "SeveralStarts",
    "evaluate",
    "fit_intensity",
    "polynomial_basis",
    "several_starts",
    "stride_mask",
]
