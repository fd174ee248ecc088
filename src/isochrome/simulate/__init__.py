"""The simulation: contact, wear, stress, optics and camera composed, from scene to frames."""

from isochrome.simulate.model import (
    Picture,
    SceneState,
    iter_scene_states,
    make_picture,
    no_model_sentence,
    picture_signal,
    scene_states,
    state_count,
    state_difference,
)
from isochrome.simulate.rendering import Rendered, render
from isochrome.simulate.run import Simulation, simulate

__all__ = [
    "Picture",
    "Rendered",
    "SceneState",
    "Simulation",
    "iter_scene_states",
    "make_picture",
    "no_model_sentence",
    "picture_signal",
    "render",
    "scene_states",
    "simulate",
    "state_count",
    "state_difference",
]
