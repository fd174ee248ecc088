"""A smooth stress besides the contact's, fitted where the contact's alone leaves too much.

A half-plane has no sides. A block's sides, its support and what clamps it add a stress that is
smooth under the contact: sigma_x along the surface, its change along it, and bending, the first
terms of the series in `half_plane.regular`. Left out, they go into the load: 0.13 MPa in the
paper's block, 0.035 fringe, read as 1.3 % of load. Their three values are not free at first, since
they widen the uncertainty of the others; they are freed where chi asks for them, kept where they
take away most of what chi is too large by, and always told.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import HALF, FrameData, is_explained
from isochrome.fitting.frame.fringe_optics import scene_optics
from isochrome.fitting.joint.frame_sequence import Unknown
from isochrome.fitting.joint.joint_fit import JointFit, fit_jointly
from isochrome.fitting.refusals import refuse_alike
from isochrome.scene import Scene
from isochrome.stress import RegularStress, pixel_grid

ALONG_X = "load.bulk_along_x_mpa_per_mm"
SMOOTH_KEYS = ("load.bulk_mpa", ALONG_X, "load.bulk_along_z_mpa_per_mm")
"""The scene's keys of a smooth stress besides the contact's."""

ASKED_CHI = 1.03
"""Residual over noise beyond which a smooth stress is tried: 1.00 to 1.01 is a right model's. At
1.03 a smooth stress that is left out shifts the load by some 0.1 %."""


def smooth_keys(scene: Scene, keys: Iterable[str], chi: float) -> tuple[str, ...]:
    """The smooth stress's keys that a fit should free beside `keys`; none where chi is right."""
    if scene.indenter is None or not chi > ASKED_CHI:
        return ()
    return tuple(key for key in SMOOTH_KEYS if key not in keys)


def with_zeros(scene: Scene, keys: tuple[str, ...]) -> Scene:
    """A scene with a number, 0 where it has none, under each of the smooth stress's `keys`."""
    return scene.with_values({key: scene.get(key) or 0.0 for key in keys})


def with_smooth_stress(
    frames: Iterable[FrameData],
    joint: JointFit,
    *,
    shape: tuple[int, int],
    progress: Callable[[], None],
) -> tuple[JointFit, tuple[str, ...]]:
    """The fit with a smooth stress freed, where its chi asks for one and it explains chi.

    All frames share it, but for its change along the surface: that follows the friction, and each
    frame has its own; where each has its own load, each has its own of all three.
    Parameters: `frames`, gone through once a pass; `joint`, their fit; `shape` (rows, cols) of a
    frame; `progress`, called with each frame of each pass. Returns that fit or the given one, and
    what is to be said of it.
    """
    sequence = joint.sequence
    keys = smooth_keys(sequence.scene, {u.key for u in joint.unknowns}, joint.chi)
    if not keys or joint.lost:
        return joint, ()
    scene, added = with_zeros(sequence.scene, keys), _unknowns(joint, keys)
    wider = replace(sequence, scene=scene, unknowns=(*joint.unknowns, *added))
    start = np.r_[joint.values, [float(scene.get(unknown.key)) for unknown in added]]
    try:
        smooth = fit_jointly(frames, wider, start, shape=shape, progress=progress)
        assert smooth.covariance is not None
        refuse_alike(tuple(u.key for u in smooth.unknowns), smooth.covariance, smooth.known)
    except PhysicsError:
        return joint, ()  # the frames cannot tell it from the other unknowns: chi stays and is told
    if not is_explained(joint.chi, smooth.chi, HALF):
        return joint, ()
    loads = [
        (before, after)
        for unknown, before, after in zip(joint.unknowns, joint.values, smooth.values, strict=False)
        if unknown.key == "load.normal_n" and unknown.shared
    ]
    most = max(
        smooth_fringes(after, before, shape)
        for after, before in zip(smooth.scenes, joint.scenes, strict=True)
    )
    return smooth, (
        smooth_sentence(keys, (joint.chi, smooth.chi), most, loads[0] if loads else None),
    )


def _unknowns(joint: JointFit, keys: tuple[str, ...]) -> tuple[Unknown, ...]:
    every = tuple(range(joint.sequence.count))
    own_load = any(u.key == "load.normal_n" and not u.shared for u in joint.unknowns)
    added: list[Unknown] = []
    for key in keys:
        if own_load or (key == ALONG_X and len(every) > 1):
            added += [Unknown(key, (i,), False) for i in every]
        else:
            added.append(Unknown(key, every, True))
    return tuple(added)


def smooth_fringes(scene: Scene, other: Scene, shape: tuple[int, int]) -> float:
    """Largest difference of two scenes' smooth stresses in a picture (rows, cols), in fringes."""
    pixels = pixel_grid(scene, shape)
    change = _of_load(scene) + _of_load(other).times(-1.0)
    x, z = pixels.x_mm[[0, -1]], np.maximum(pixels.z_mm[[0, -1]], 0.0)
    # linear in the place: largest in a corner
    return float(scene_optics(scene).order(change.difference(x[None, :], z[:, None])).max())


def _of_load(scene: Scene) -> RegularStress:
    flat, along_x, along_z = (float(scene.get(key) or 0.0) for key in SMOOTH_KEYS)
    return RegularStress((complex(flat), complex(along_x, along_z)))


def smooth_sentence(
    keys: tuple[str, ...],
    chi: tuple[float, float],
    fringes: float,
    load_n: tuple[float, float] | None,
) -> str:
    """What was freed, how large it is, and what it did.

    Parameters: `keys` that were freed; `chi` before and after; `fringes`, the largest change in the
    picture; `load_n`, the load before and after where one load was fitted.
    """
    moved = ""
    if load_n is not None:
        share = 100.0 * (load_n[0] / load_n[1] - 1.0)
        moved = f"; without it load.normal_n would come out {share:+.2f} % off"
    return (
        f"chi = {chi[0]:.2f} without a smooth stress besides the contact's, as a block's sides or "
        f"a clamp make; fitted too ({', '.join(keys)}), it is up to {fringes:.3f} fringe in the "
        f"picture and leaves chi = {chi[1]:.2f}{moved}"
    )
