from .api import draft_scene, init
from .captured_set import not_among_frames, open_questions
from .known_values import NEEDED, QUANTITIES, KnownValues, Quantity, known_values
from .scene_draft import DraftValue, OpenKey, SceneDraft

__all__ = [
    "NEEDED",
    "QUANTITIES",
    "DraftValue",
    "KnownValues",
    "OpenKey",
    "Quantity",
    "SceneDraft",
    "draft_scene",
    "init",
    "known_values",
    "not_among_frames",
    "open_questions",
]
