"""Fringe frames from a known pressure: stress, fringe order, polariscope and an ideal camera."""

from __future__ import annotations

import numpy as np

from isochrome.bench import Row
from isochrome.contact import SurfaceState, contact_grid
from isochrome.optics import expose
from isochrome.scene import load_scene
from isochrome.simulate import SceneState, make_picture, picture_signal, state_difference
from isochrome.stress import pixel_grid

from . import paper_procedure as paper
from .case_stress import TIMED_ROWS, closed_form, tractions
from .common import OURS, PAPER, timed, with_ratios


def frames(quick):
    """Rows for one 8-bit frame; the error is the largest of the fringe order in view (fringes)."""
    scene = load_scene("line-contact-wear")
    pixels = pixel_grid(scene)
    pixels = pixels.every(16) if quick else pixels
    grid = contact_grid(scene, largest_dose_mm_per_mpa=0.0)
    p, q = tractions(grid.x_mm)
    mu = scene.friction_at(0.0)
    surface = SurfaceState(grid, p, q, np.zeros_like(p), 0.0, mu, True, 0.0)
    state = SceneState("initial sliding", 0.0, surface)
    to_order = scene.specimen.thickness_mm / scene.specimen.fringe_value_n_per_mm
    here = pixels.x_mm, pixels.z_mm[::TIMED_ROWS], grid.left_mm, grid.spacing_mm, p, q

    def ours():
        picture = make_picture(scene, state_difference(scene, state, pixels), pixels)
        expose(picture_signal(scene, picture), scene.camera)
        return picture.order

    def papers():
        order = np.abs(paper.stress_by_lags(*here)) * to_order
        np.rint(255.0 * np.sin(np.pi * order) ** 2).astype(np.uint8)
        return order

    (direct, order), seconds = timed([papers, ours], repeats=1 if quick else 5)
    seconds[0] *= pixels.rows / len(direct)
    truth = np.abs(closed_form(pixels)) * to_order
    errors = np.abs(direct - truth[::TIMED_ROWS]).max(), np.abs(order - truth).max()
    case = f"fringe frame, {pixels.cols} x {pixels.rows}"
    notes = f", every {TIMED_ROWS}th row timed", ""
    return with_ratios(
        [
            Row(case, method, f"{1.0 / sec:.3g} frames/s{note}", float(error), sec)
            for method, sec, error, note in zip((PAPER, OURS), seconds, errors, notes, strict=True)
        ]
    )
