"""Captured frames in, fringe orders out: readers, fits and readings composed."""

from isochrome.process.result import ProcessedFrame
from isochrome.process.run import Processed, process

__all__ = ["Processed", "ProcessedFrame", "process"]
