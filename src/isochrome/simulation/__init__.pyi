from .api import Simulation, simulate
from .dataset import picture_axes
from .model import (
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
from .rendering import Rendered, render

__all__ = [
    "Picture",
    "Rendered",
    "SceneState",
    "Simulation",
    "iter_scene_states",
    "make_picture",
    "no_model_sentence",
    "picture_axes",
    "picture_signal",
    "render",
    "scene_states",
    "simulate",
    "state_count",
    "state_difference",
]
