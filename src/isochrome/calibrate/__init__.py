"""The material fringe value from a beam in four-point bending or a disc under compression."""

from isochrome.calibrate.bending import bending_from_images, bending_from_shots, calibrate_bending
from isochrome.calibrate.disc import calibrate_disc, disc_from_images, disc_from_shots
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
    "calibrate_disc",
    "disc_from_images",
    "disc_from_shots",
    "load_set",
    "save_calibration",
]
