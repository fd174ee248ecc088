from .beam.api import bending_from_shots, calibrate_bending
from .camera_scale import calibrate_scale
from .colour import ColourCalibration, calibrate_colour, read_colour_shots
from .disc.api import calibrate_disc, disc_from_shots
from .disc.disc_rim import Circle, find_rim, fit_circle
from .load_reading import LoadReading, LoadSeries, lay_series, read_load
from .loading import read_shots
from .result import Calibration, ImageFit
from .saved import calibration_report, check_scene_file, save_calibration, write_into_scene
from .scale_result import MeasuredValue, ScaleCalibration, ScalePicture
from .settings import Beam, CalibrationSet, ColourSet, Disc, LoadedImage, Uncertainty, load_set
from .shot import Shot, as_shots
from .wear_coefficient import calibrate_wear
from .wear_result import WearCalibration, WornDistance
from .wear_set import WearSet
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
    "read_colour_shots",
    "read_load",
    "read_shots",
    "save_calibration",
    "write_into_scene",
]
