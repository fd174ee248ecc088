from .levelling import (
    LevelledTrace,
    Roughness,
    ScarShape,
    UnclearScarError,
    definite,
    fit_roughness,
    form_spread,
    levelled,
    make_bands,
    refine_place,
    student_factor_of,
    whitening,
)
from .trace import Trace, read_trace

__all__ = [
    "LevelledTrace",
    "Roughness",
    "ScarShape",
    "Trace",
    "UnclearScarError",
    "definite",
    "fit_roughness",
    "form_spread",
    "levelled",
    "make_bands",
    "read_trace",
    "refine_place",
    "student_factor_of",
    "whitening",
]
