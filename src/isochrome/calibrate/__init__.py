"""The material fringe value from a beam or a disc, and colour tables from colour images."""

from isochrome.calibrate.bending import bending_from_images, bending_from_shots, calibrate_bending
from isochrome.calibrate.colour import ColourCalibration, calibrate_colour
from isochrome.calibrate.colour_save import save_colour_calibration
from isochrome.calibrate.colour_settings import ColourSet, load_colour_set
from isochrome.calibrate.disc import calibrate_disc, disc_from_images, disc_from_shots
from isochrome.calibrate.into_scene import check_scene_file, write_into_scene
from isochrome.calibrate.result import BudgetItem, Calibration, ImageFit, View
from isochrome.calibrate.save import save_calibration
from isochrome.calibrate.settings import (
    Beam,
    CalibrationSet,
    Disc,
    LoadedImage,
    Uncertainty,
    load_set,
)
from isochrome.calibrate.shot import Shot, as_shots

__all__ = [
    "Beam",
    "BudgetItem",
    "Calibration",
    "CalibrationSet",
    "ColourCalibration",
    "ColourSet",
    "Disc",
    "ImageFit",
    "LoadedImage",
    "Shot",
    "Uncertainty",
    "View",
    "as_shots",
    "bending_from_images",
    "bending_from_shots",
    "calibrate_bending",
    "calibrate_colour",
    "calibrate_disc",
    "check_scene_file",
    "disc_from_images",
    "disc_from_shots",
    "load_colour_set",
    "load_set",
    "save_calibration",
    "save_colour_calibration",
    "write_into_scene",
]
