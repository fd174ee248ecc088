from .beam.api import bending_from_shots, calibrate_bending
from .colour.api import ColourCalibration, calibrate_colour
from .colour.settings import ColourSet
from .disc.api import calibrate_disc, disc_from_shots
from .disc.disc_rim import Circle, find_rim, fit_circle
from .load_reading import LoadReading, LoadSeries, lay_series, read_load
from .result import Calibration, ImageFit
from .saved.calibration_report import calibration_report
from .saved.folder import save_calibration
from .saved.scene_file import check_scene_file, write_into_scene
from .scale.api import calibrate_scale
from .scale.result import MeasuredValue, ScaleCalibration, ScalePicture
from .settings import Beam, CalibrationSet, Disc, LoadedImage, Uncertainty, load_set
from .shot import Shot, as_shots
from .wear.api import calibrate_wear
from .wear.result import WearCalibration, WornDistance
from .wear.settings import WearSet
from .whole_set.set_result import cause_sentence

__all__ = [
    "Beam",
    "Calibration",
    "CalibrationSet",
    "Circle",
    "ColourCalibration",
    "ColourSet",
    "Disc",
    "ImageFit",
    "LoadReading",
    "LoadSeries",
    "LoadedImage",
    "MeasuredValue",
    "ScaleCalibration",
    "ScalePicture",
    "Shot",
    "Uncertainty",
    "WearCalibration",
    "WearSet",
    "WornDistance",
    "as_shots",
    "bending_from_shots",
    "calibrate_bending",
    "calibrate_colour",
    "calibrate_disc",
    "calibrate_scale",
    "calibrate_wear",
    "calibration_report",
    "cause_sentence",
    "check_scene_file",
    "disc_from_shots",
    "find_rim",
    "fit_circle",
    "lay_series",
    "load_set",
    "read_load",
    "save_calibration",
    "write_into_scene",
]
