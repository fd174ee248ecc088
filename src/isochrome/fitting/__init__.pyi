from .api import fit
from .causes.freeing import Freed, fit_with_causes
from .causes.report import cause_messages, light_matters, opposite_shear
from .causes.rivals import rival_causes
from .folder import fit_report, restore_values
from .frame.frame_fit import FrameFit, cramer_rao_bound, fit_frame, placed, propagated
from .frame.frame_model import FrameModel
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
    LENS,
    LOAD,
    SMOOTH_KEYS,
    WEAR,
    fit_region,
    free_keys,
    stated_inputs,
    stated_pairs,
    taken_as_exact,
)
from .frame_set import CORRECT
from .joint.frame_sequence import make_sequence, over_distance
from .joint.joint_fit import fit_jointly
from .result import TOO_FAR, fitted_scene
from .search.picture_search import Lying, PictureStart, search_picture
from .tracking.api import refuse_shared, track
from .tracking.apparatus import Apparatus, find_apparatus
from .tracking.result import untracked_inputs
from .tracking.tracker import Tracked, Tracker, nothing_found
from .tracking.vain_search import VainSearch
from .wear_laws import (
    LawFit,
    WearLaws,
    compare_laws,
    marginal,
    mean_coefficients,
    nearest_point,
    segment_ends,
    segments,
)

__all__ = [
    "CORRECT",
    "EARLIER",
    "FRICTION",
    "GAMMA",
    "LENS",
    "LOAD",
    "SMOOTH_KEYS",
    "TOO_FAR",
    "WEAR",
    "Apparatus",
    "FrameFit",
    "FrameModel",
    "Freed",
    "LawFit",
    "Lying",
    "ModelFrame",
    "PictureStart",
    "SceneRenderer",
    "Tracked",
    "Tracker",
    "VainSearch",
    "WearLaws",
    "cause_messages",
    "compare_laws",
    "cramer_rao_bound",
    "evaluate_model",
    "find_apparatus",
    "fit",
    "fit_frame",
    "fit_jointly",
    "fit_region",
    "fit_report",
    "fit_with_causes",
    "fitted_scene",
    "frame_distance",
    "frame_scene",
    "free_keys",
    "light_matters",
    "make_sequence",
    "marginal",
    "mean_coefficients",
    "nearest_point",
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
    "segment_ends",
    "segments",
    "slid_until",
    "sliding_scene",
    "stated_inputs",
    "stated_pairs",
    "taken_as_exact",
    "timed_distance",
    "track",
    "untracked_inputs",
    "with_numerics",
]
