from . import reference, samples
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
from .comparison import compare, plot_side_by_side
from .demonstration import demo
from .drafting import init
from .errors import InputError, PhysicsError
from .figures import FigureStyle, paper_figure, plot_frame, plot_over_distance, save_figure
from .fitting import fit, track
from .folder_report import report
from .frames import open_frames
from .planning import plan
from .processing import check, plot_order, process
from .runs import export, open_run, verify
from .scene import Scene, dump_scene, load_scene, parse_scene, scene_names
from .setup_page import setup
from .simulation import (
    camera_frame,
    plot_pressure,
    plot_scar,
    polariscope_light,
    scene_states,
    simulate,
    stress_map,
    surface_tractions,
)
from .stress import stress_components
from .sweeps import sweep

__version__: str

__all__ = [
    "FigureStyle",
    "InputError",
    "PhysicsError",
    "Scene",
    "__version__",
    "bench",
    "calibrate_bending",
    "calibrate_colour",
    "calibrate_disc",
    "calibrate_scale",
    "calibrate_wear",
    "camera_frame",
    "check",
    "compare",
    "demo",
    "dump_scene",
    "export",
    "fit",
    "init",
    "load_scene",
    "open_frames",
    "open_run",
    "paper_figure",
    "parse_scene",
    "plan",
    "plot_frame",
    "plot_order",
    "plot_over_distance",
    "plot_pressure",
    "plot_scar",
    "plot_side_by_side",
    "polariscope_light",
    "process",
    "process_campaign",
    "reference",
    "report",
    "samples",
    "save_figure",
    "scene_names",
    "scene_states",
    "setup",
    "simulate",
    "stress_components",
    "stress_map",
    "surface_tractions",
    "sweep",
    "track",
    "verify",
    "write_into_scene",
]
