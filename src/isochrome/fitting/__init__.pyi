from .api import fit
from .causes.freeing import Freed, fit_with_causes
from .causes.report import cause_messages, light_matters, opposite_shear
from .causes.rivals import rival_causes
from .folder import fit_report, restore_values
from .frame.frame_fit import FrameFit, fit_frame, placed, propagated
from .frame.model_frame import ModelFrame, evaluate_model
from .frame.renderer import SceneRenderer
from .frame.single_state import (
    frame_distance,
    frame_scene,
    scene_at,
    slid_until,
    sliding_scene,
    timed_distance,
    with_numerics,
)
from .frame.unknowns import (
    EARLIER,
    FRICTION,
    GAMMA,
    LOAD,
    SMOOTH_KEYS,
    WEAR,
    free_keys,
    stated_pairs,
    taken_as_exact,
)
from .frame_set import CORRECT, PreparedFrames
from .joint.frame_sequence import over_distance
from .result import TOO_FAR, fitted_scene
from .search.picture_search import Lying, PictureStart, search_picture
from .tracking.api import refuse_shared, track
from .tracking.apparatus import Apparatus, find_apparatus
from .tracking.result import untracked_inputs
from .tracking.tracker import Tracked, Tracker, nothing_found
from .tracking.vain_search import VainSearch

__all__ = [
    "CORRECT",
    "EARLIER",
    "FRICTION",
    "GAMMA",
    "LOAD",
    "SMOOTH_KEYS",
    "TOO_FAR",
    "WEAR",
    "Apparatus",
    "FrameFit",
    "Freed",
    "Lying",
    "ModelFrame",
    "PictureStart",
    "PreparedFrames",
    "SceneRenderer",
    "Tracked",
    "Tracker",
    "VainSearch",
    "cause_messages",
    "evaluate_model",
    "find_apparatus",
    "fit",
    "fit_frame",
    "fit_report",
    "fit_with_causes",
    "fitted_scene",
    "frame_distance",
    "frame_scene",
    "free_keys",
    "light_matters",
    "nothing_found",
    "opposite_shear",
    "over_distance",
    "placed",
    "propagated",
    "refuse_shared",
    "restore_values",
    "rival_causes",
    "scene_at",
    "search_picture",
    "slid_until",
    "sliding_scene",
    "stated_pairs",
    "taken_as_exact",
    "timed_distance",
    "track",
    "untracked_inputs",
    "with_numerics",
]
