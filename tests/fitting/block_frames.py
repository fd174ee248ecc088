"""Frames of a block of finite size as finite elements know it."""

import numpy as np

from finite_block import LINE_LOAD, THICKNESS, block_difference
from isochrome.optics import expose
from isochrome.output import write_tiff
from isochrome.scene import parse_scene
from isochrome.simulation import make_picture, picture_signal
from isochrome.stress import pixel_grid
from scene_texts import PAPER_CONTACT

CAMERA = """
[camera]
width_px = {cols}
height_px = {rows}
left_mm = -2.0
top_mm = 0.0
pixel_mm = {pixel}
bit_depth = 8
brightness = 0.85
background = 0.05
vignette = 0.3
noise_grey = 3.0
seed = 5
"""
SMALL = CAMERA.format(cols=220, rows=165, pixel=0.01821)
WHOLE = CAMERA.format(cols=659, rows=494, pixel=0.00607)
LOAD = LINE_LOAD * THICKNESS
PLACE = {"camera.left_mm": -1.98, "camera.top_mm": 0.01}
FREE = ["load.normal_n", "camera.left_mm", "camera.top_mm"]
SMOOTH = ["load.bulk_mpa", "load.bulk_along_x_mpa_per_mm", "load.bulk_along_z_mpa_per_mm"]
SIZE = {"specimen.shape": "block", "specimen.width_mm": 60.0, "specimen.height_mm": 40.0}


def scene_of(solid, camera, *, friction=None):
    sliding = solid.friction if friction is None else friction
    text = PAPER_CONTACT + camera
    return parse_scene(text + f"\n[friction]\ncoefficient = {sliding}\n" if sliding else text)


def photographed(solid, camera, path):
    """A frame of the block as finite elements know it; returns its fringe order (rows, cols)."""
    scene = scene_of(solid, camera)
    pixels = pixel_grid(scene)
    stress = block_difference(solid, pixels.x_mm, pixels.z_mm)
    picture = make_picture(scene, stress, pixels)
    frame = expose(picture_signal(scene, picture), scene.camera, rng=np.random.default_rng(7))
    write_tiff(path, frame[None], pixel_mm=scene.camera.pixel_mm)
    return picture.order
