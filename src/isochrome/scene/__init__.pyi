from .array_frames import ArrayFrames, FramesLike, ImageFile, frames_of
from .editing.edited_text import (
    toml_text,
    with_list_value,
    with_table_list,
    with_value,
    without_value,
)
from .imaging import Camera, FileName, Frames, Roi
from .known_orders import FreeBoundary, FreeCorner, KnownLine, KnownOrder
from .parts import (
    Friction,
    Indenter,
    Load,
    MeasuredScar,
    Numerics,
    Polariscope,
    PolariscopeStep,
    Spectrum,
    Wear,
)
from .pixel_scale import STIFFEST_GPA, UNDOUBTED_MM, check_moduli, check_pixel, check_width
from .scene_values import DistanceTable, NonNegative, Positive, ScenePart
from .specimen import Specimen
from .toml import (
    LIBRARY,
    SceneLike,
    as_tables,
    dump_scene,
    load_scene,
    parse_scene,
    parse_toml,
    read_text,
    scene_names,
)
from .uncertain import plain_value, split_uncertainties
from .validation import check_reach, validate
from .whole import Scene

__all__ = [
    "LIBRARY",
    "STIFFEST_GPA",
    "UNDOUBTED_MM",
    "ArrayFrames",
    "Camera",
    "DistanceTable",
    "FileName",
    "Frames",
    "FramesLike",
    "FreeBoundary",
    "FreeCorner",
    "Friction",
    "ImageFile",
    "Indenter",
    "KnownLine",
    "KnownOrder",
    "Load",
    "MeasuredScar",
    "NonNegative",
    "Numerics",
    "Polariscope",
    "PolariscopeStep",
    "Positive",
    "Roi",
    "Scene",
    "SceneLike",
    "ScenePart",
    "Specimen",
    "Spectrum",
    "Wear",
    "as_tables",
    "check_moduli",
    "check_pixel",
    "check_reach",
    "check_width",
    "dump_scene",
    "frames_of",
    "load_scene",
    "parse_scene",
    "parse_toml",
    "plain_value",
    "read_text",
    "scene_names",
    "split_uncertainties",
    "toml_text",
    "validate",
    "with_list_value",
    "with_table_list",
    "with_value",
    "without_value",
]
