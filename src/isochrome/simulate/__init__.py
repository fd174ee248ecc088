"""The simulation: contact, wear, stress, optics and camera composed, from scene to frames."""

from isochrome.simulate.model import (
    Picture,
    SceneState,
    make_picture,
    no_model_sentence,
    picture_signal,
    scene_states,
    state_difference,
)
from isochrome.simulate.run import Rendered, Simulation, render, simulate

__all__ = [
    "Picture",
    "Rendered",
    "SceneState",
    "Simulation",
    "make_picture",
    "no_model_sentence",
    "picture_signal",
    "render",
    "scene_states",
    "simulate",
    "state_difference",
]
