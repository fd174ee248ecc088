from .camera_scale import MeasuredValue, ScaleCalibration, ScalePicture, calibrate_scale, fit_target
from .colour import ColourCalibration, calibrate_colour, check_light, read_colour_shots
from .disc.api import calibrate_disc, disc_from_shots
from .disc.disc_field import (
    Circle,
    LoadReading,
    Overlay,
    find_rim,
    fit_circle,
    lay_series,
    read_load,
)
from .four_point_bending import bending_from_shots, calibrate_bending
from .order_line import Input, cause_sentence, fit_line, uncertainty_budget, widened_to_held_out
from .result import BudgetItem, Calibration, ImageFit
from .saved import calibration_report, check_scene_file, save_calibration, write_into_scene
from .settings import Beam, CalibrationSet, ColourSet, Disc, LoadedImage, Uncertainty, load_set
from .shot import Shot, read_shots
from .wear_coefficient import WearCalibration, WornDistance, calibrate_wear
from .wear_set import TraceScar, WearSet, worn_volumes

__all__ = [
    "Beam",
    "BudgetItem",
    "Calibration",
    "CalibrationSet",
    "Circle",
    "ColourCalibration",
    "ColourSet",
    "Disc",
    "ImageFit",
    "Input",
    "LoadReading",
    "LoadedImage",
    "MeasuredValue",
    "Overlay",
    "ScaleCalibration",
    "ScalePicture",
    "Shot",
    "TraceScar",
    "Uncertainty",
    "WearCalibration",
    "WearSet",
    "WornDistance",
    "bending_from_shots",
    "calibrate_bending",
    "calibrate_colour",
    "calibrate_disc",
    "calibrate_scale",
    "calibrate_wear",
    "calibration_report",
    "cause_sentence",
    "check_light",
    "check_scene_file",
    "disc_from_shots",
    "find_rim",
    "fit_circle",
    "fit_line",
    "fit_target",
    "lay_series",
    "load_set",
    "read_colour_shots",
    "read_load",
    "read_shots",
    "save_calibration",
    "uncertainty_budget",
    "widened_to_held_out",
    "worn_volumes",
    "write_into_scene",
]
