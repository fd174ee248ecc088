from .api import FrameWork, fit
from .causes.cause import CAUSES, RARE
from .causes.freeing import Freed, fit_with_causes
from .causes.report import (
    NAMED,
    SUSPECTED,
    cause_messages,
    light_matters,
    opposite_shear,
    rival_causes,
)
from .causes.score import LIGHT, LIGHT_FALLS, ORDER, light_sizes
from .figure import over_distance_figure
from .folder import fit_report, restore_fit, restore_values
from .frame.frame_fit import FrameFit, cramer_rao_bound, fit_frame, placed, propagated
from .frame.frame_model import FrameModel, Pixels, clear_of_ends, local_model, solve_with_gamma
from .frame.model_frame import ModelFrame, evaluate_model
from .frame.renderer import SceneRenderer
from .frame.single_state import (
    frame_distance,
    frame_scene,
    scene_at,
    slid_until,
    sliding_scene,
    state_scene,
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
    inputs_of_rows,
    stated_inputs,
    stated_pairs,
    taken_as_exact,
)
from .frame_set import CORRECT, PreparedFrames, refuse_alike
from .joint.frame_sequence import (
    MeasuredArea,
    SharedRun,
    alone_scene,
    local_values,
    make_sequence,
    over_distance,
    stepwise,
)
from .joint.joint_fit import JointProblem
from .joint.measured_scars import scar_equations
from .joint.normal_equations import add_up, linearise_frame, make_renderer
from .joint.separate_fits import fit_of_each, is_each, refuse_undetermined, with_scars
from .result import PARTS, TOO_FAR, Fit, KeyBudget, fitted_scene, make_result
from .search.picture_search import Lying, PictureStart, search_picture
from .tracking.api import refuse_shared, track
from .tracking.apparatus import Apparatus, find_apparatus
from .tracking.result import untracked_inputs
from .tracking.tracker import Tracked, Tracker, nothing_found
from .tracking.vain_search import VainSearch
from .wear_laws import (
    CLEAR,
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
    "CAUSES",
    "CLEAR",
    "CORRECT",
    "EARLIER",
    "FRICTION",
    "GAMMA",
    "LENS",
    "LIGHT",
    "LIGHT_FALLS",
    "LOAD",
    "NAMED",
    "ORDER",
    "PARTS",
    "RARE",
    "SMOOTH_KEYS",
    "SUSPECTED",
    "TOO_FAR",
    "WEAR",
    "Apparatus",
    "Fit",
    "FrameFit",
    "FrameModel",
    "FrameWork",
    "Freed",
    "JointProblem",
    "KeyBudget",
    "LawFit",
    "Lying",
    "MeasuredArea",
    "ModelFrame",
    "PictureStart",
    "Pixels",
    "PreparedFrames",
    "SceneRenderer",
    "SharedRun",
    "Tracked",
    "Tracker",
    "VainSearch",
    "WearLaws",
    "add_up",
    "alone_scene",
    "cause_messages",
    "clear_of_ends",
    "compare_laws",
    "cramer_rao_bound",
    "evaluate_model",
    "find_apparatus",
    "fit",
    "fit_frame",
    "fit_of_each",
    "fit_region",
    "fit_report",
    "fit_with_causes",
    "fitted_scene",
    "frame_distance",
    "frame_scene",
    "free_keys",
    "inputs_of_rows",
    "is_each",
    "light_matters",
    "light_sizes",
    "linearise_frame",
    "local_model",
    "local_values",
    "make_renderer",
    "make_result",
    "make_sequence",
    "marginal",
    "mean_coefficients",
    "nearest_point",
    "nothing_found",
    "opposite_shear",
    "over_distance",
    "over_distance_figure",
    "placed",
    "propagated",
    "refuse_alike",
    "refuse_shared",
    "refuse_undetermined",
    "restore_fit",
    "restore_values",
    "rival_causes",
    "scar_equations",
    "scene_at",
    "search_picture",
    "segment_ends",
    "segments",
    "slid_until",
    "sliding_scene",
    "solve_with_gamma",
    "state_scene",
    "stated_inputs",
    "stated_pairs",
    "stepwise",
    "taken_as_exact",
    "timed_distance",
    "track",
    "untracked_inputs",
    "with_numerics",
    "with_scars",
]
