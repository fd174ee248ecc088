from .api import check_scene, process
from .processed import Processed
from .result import SPREAD, ProcessedFrame

__all__ = ["SPREAD", "Processed", "ProcessedFrame", "check_scene", "process"]
