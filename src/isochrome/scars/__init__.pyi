from .levelling import LevelledTrace, UnclearScarError, levelled, student_factor_of
from .roughness import Roughness
from .trace import Trace, read_trace

__all__ = [
    "LevelledTrace",
    "Roughness",
    "Trace",
    "UnclearScarError",
    "levelled",
    "read_trace",
    "student_factor_of",
]
