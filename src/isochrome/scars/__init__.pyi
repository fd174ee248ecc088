from .levelled_trace import LevelledTrace, student_factor_of
from .levelling import UnclearScarError, levelled
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
