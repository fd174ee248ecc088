from .benchmarks import bench
from .calibration import (
    calibrate_bending,
    calibrate_colour,
    calibrate_disc,
    calibrate_scale,
    calibrate_wear,
    write_into_scene,
)
from .campaigns import process_campaign
from .comparison import compare
from .demonstration import demo
from .fitting import fit, track
from .frames import open_frames
from .processing import check, process
from .runs import export, open_run
from .scene import Scene, dump_scene, load_scene, parse_scene, scene_names
from .simulation import simulate
from .sweeps import sweep

__version__: str

__all__ = [
    "Scene",
    "__version__",
    "bench",
    "calibrate_bending",
    "calibrate_colour",
    "calibrate_disc",
    "calibrate_scale",
    "calibrate_wear",
    "check",
    "compare",
    "demo",
    "dump_scene",
    "export",
    "fit",
    "load_scene",
    "open_frames",
    "open_run",
    "parse_scene",
    "process",
    "process_campaign",
    "scene_names",
    "simulate",
    "sweep",
    "track",
    "write_into_scene",
]
