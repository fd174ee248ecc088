from .levelling import (
    LevelledTrace,
    ScarShape,
    UnclearScarError,
    form_spread,
    levelled,
    refine_place,
    student_factor_of,
    whitening,
)
from .roughness import Roughness, fit_roughness, make_bands
from .trace import Trace, read_trace

__all__ = [
    "LevelledTrace",
    "Roughness",
    "ScarShape",
    "Trace",
    "UnclearScarError",
    "fit_roughness",
    "form_spread",
    "levelled",
    "make_bands",
    "read_trace",
    "refine_place",
    "student_factor_of",
    "whitening",
]
