"""Colour frames of a scene in its own light."""

import numpy as np

from isochrome.optics import expose
from isochrome.simulation import make_picture, picture_signal, scene_states, state_difference
from isochrome.stress import pixel_grid


def colour_frames(scene, seed):
    """A colour frame of a scene's last state, its two no-load frames, dark and bright, and its
    order, NaN off the specimen."""
    grid = pixel_grid(scene)
    picture = make_picture(scene, state_difference(scene, scene_states(scene)[-1], grid), grid)
    lit = np.repeat(picture.material[..., None].astype(float), 3, axis=2)
    frames = [
        expose(signal, scene.camera, rng=np.random.default_rng([seed, i]))
        for i, signal in enumerate((picture_signal(scene, picture), 0.0 * lit, lit))
    ]
    return frames, np.where(picture.material, picture.order, np.nan)
