"""The scene: what stood in front of the camera, as frozen parts that are read from TOML."""

from isochrome.scene.parts import (
    Camera,
    Frames,
    Friction,
    Indenter,
    KnownOrder,
    Load,
    Numerics,
    Polariscope,
    PolariscopeStep,
    Roi,
    Spectrum,
    Wear,
)
from isochrome.scene.pixel import UNDOUBTED_MM, check_pixel
from isochrome.scene.scene import Scene
from isochrome.scene.specimen import Specimen
from isochrome.scene.tables import DistanceTable
from isochrome.scene.toml import dump_scene, load_scene, parse_scene, scene_names

__all__ = [
    "UNDOUBTED_MM",
    "Camera",
    "DistanceTable",
    "Frames",
    "Friction",
    "Indenter",
    "KnownOrder",
    "Load",
    "Numerics",
    "Polariscope",
    "PolariscopeStep",
    "Roi",
    "Scene",
    "Specimen",
    "Spectrum",
    "Wear",
    "check_pixel",
    "dump_scene",
    "load_scene",
    "parse_scene",
    "scene_names",
]
