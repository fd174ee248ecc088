"""Fringe frames from a known pressure."""

import numpy as np

from isochrome.contact import SurfaceState, contact_grid
from isochrome.optics import expose
from isochrome.scene import load_scene
from isochrome.simulation import SceneState, make_picture, picture_signal, state_difference
from isochrome.stress import pixel_grid

from . import paper_procedure as paper
from .case_stress import TIMED_ROWS, closed_form, tractions
from .common import OURS, PAPER, plain, timed, with_ratios
from .rows import Row

IN_A_ROW = 10
"""Frames that are rendered one after the other, as a history's are."""


def frames(quick):
    """Rows for one 8-bit frame; the error is the largest of the fringe order in view (fringes)."""
    scene = load_scene("line-contact-wear")
    if quick:
        small = {"width_px": 41, "height_px": 31, "pixel_mm": 16 * scene.camera.pixel_mm}
        scene = scene.with_values({f"camera.{key}": value for key, value in small.items()})
    pixels = pixel_grid(scene)
    grid = contact_grid(scene, largest_dose_mm_per_mpa=0.0)
    p, q = tractions(grid.x_mm)
    mu = scene.friction_at(0.0)
    surface = SurfaceState(
        grid=grid, pressure_mpa=p, shear_mpa=q, wear_depth_mm=np.zeros_like(p), distance_m=0.0,
        friction=mu, sliding=True, residual=0.0,
    )  # fmt: skip
    state = SceneState("initial sliding", 0.0, surface)
    to_order = scene.specimen.thickness_mm / scene.specimen.fringe_value_n_per_mm
    here = pixels.x_mm, pixels.z_mm[::TIMED_ROWS], grid.left_mm, grid.spacing_mm, p, q

    def ours():
        for _ in range(IN_A_ROW):
            picture = make_picture(scene, state_difference(scene, state, pixels), pixels)
            expose(picture_signal(scene, picture), scene.camera)
        return picture.order

    def papers():
        order = np.abs(paper.stress_by_lags(*here)) * to_order
        np.rint(255.0 * np.sin(np.pi * order) ** 2).astype(np.uint8)
        return order

    (direct, order), seconds = timed([papers, ours], repeats=1 if quick else 5)
    seconds[0] *= pixels.rows / len(direct)
    seconds[1] /= IN_A_ROW
    truth = np.abs(closed_form(pixels)) * to_order
    errors = np.abs(direct - truth[::TIMED_ROWS]).max(), np.abs(order - truth).max()
    case = f"fringe frame, {pixels.cols} x {pixels.rows}"
    notes = f" (every {TIMED_ROWS}th row)", ""
    compared = [
        Row(case, method, f"{plain(1.0 / sec)} frames/s{note}", float(error), sec)
        for method, sec, error, note in zip((PAPER, OURS), seconds, errors, notes, strict=True)
    ]
    return with_ratios(compared)
