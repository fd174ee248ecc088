"""Long runs: chunk by chunk, kept as they go, by one process or many; results in one store.

What is computed is somebody else's business: here are the order of the work, what is kept of it,
and the files. Heavy libraries are imported inside the functions that need them.
"""

from isochrome.runs.chunks import Bench
from isochrome.runs.identity import environment
from isochrome.runs.job import Job, Layer, Layout, Results, chunk_size
from isochrome.runs.run import Means, Stopped, run_job
from isochrome.runs.store import STORE, WORKING, open_run
from isochrome.runs.threads import single_threaded

__all__ = [
    "STORE",
    "WORKING",
    "Bench",
    "Job",
    "Layer",
    "Layout",
    "Means",
    "Results",
    "Stopped",
    "chunk_size",
    "environment",
    "open_run",
    "run_job",
    "single_threaded",
]
