from .chunks import RunFolder, parts, picture, rows
from .datasets import RunArray, RunDataset, make_dataset, stored_map
from .execution import WORTH_WORKERS_S, RunOptions, Stopped, refuse_without_folder, run_job
from .exporting import export
from .identity import environment, run_identity
from .job import CHUNK_BYTES, Compact, Job, Layer, Results, RunLayout, chunk_size
from .lock import locked
from .memory import trim_heap
from .store import (
    STORE,
    WORKING,
    Column,
    add_columns,
    attributes,
    column,
    column_values,
    identifier,
    named_units,
    open_run,
    texts,
)
from .work_folder import PROVENANCE, REPORT, has_run, holds_results, wipe, working_folder
from .workers import (
    NoCluster,
    WorkersLost,
    in_flight,
    processors,
    single_threaded,
    waiting_workers,
    worker_pool,
)

__all__ = [
    "CHUNK_BYTES",
    "PROVENANCE",
    "REPORT",
    "STORE",
    "WORKING",
    "WORTH_WORKERS_S",
    "Column",
    "Compact",
    "Job",
    "Layer",
    "NoCluster",
    "Results",
    "RunArray",
    "RunDataset",
    "RunFolder",
    "RunLayout",
    "RunOptions",
    "Stopped",
    "WorkersLost",
    "add_columns",
    "attributes",
    "chunk_size",
    "column",
    "column_values",
    "environment",
    "export",
    "has_run",
    "holds_results",
    "identifier",
    "in_flight",
    "locked",
    "make_dataset",
    "named_units",
    "open_run",
    "parts",
    "picture",
    "processors",
    "refuse_without_folder",
    "rows",
    "run_identity",
    "run_job",
    "single_threaded",
    "stored_map",
    "texts",
    "trim_heap",
    "waiting_workers",
    "wipe",
    "worker_pool",
    "working_folder",
]
