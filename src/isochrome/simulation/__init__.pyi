from .api import Simulation, simulate
from .figure import plot_pressure, plot_scar
from .folder import simulation_report
from .model import (
    Picture,
    SceneState,
    iter_scene_states,
    make_picture,
    no_model_sentence,
    picture_signal,
    required_model,
    scene_states,
    state_count,
    state_difference,
)
from .rendering import Rendered, RenderWork, picture_axes, render
from .steps import camera_frame, polariscope_light, stress_map, surface_tractions

__all__ = [
    "Picture",
    "RenderWork",
    "Rendered",
    "SceneState",
    "Simulation",
    "camera_frame",
    "iter_scene_states",
    "make_picture",
    "no_model_sentence",
    "picture_axes",
    "picture_signal",
    "plot_pressure",
    "plot_scar",
    "polariscope_light",
    "render",
    "required_model",
    "scene_states",
    "simulate",
    "simulation_report",
    "state_count",
    "state_difference",
    "stress_map",
    "surface_tractions",
]
