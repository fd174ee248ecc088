from .api import check_scene, process
from .checking import check
from .processed import Processed
from .result import SPREAD, ProcessedFrame

__all__ = ["SPREAD", "Processed", "ProcessedFrame", "check", "check_scene", "process"]
