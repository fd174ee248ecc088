from .api import CLEAR_CHI, draft_scene, init
from .fields import FIELDS, KINDS, OPTIONS, QUANTITIES, SET_KINDS, STATED_SHAPES
from .scene_draft import (
    NEEDED,
    DraftValue,
    KnownValues,
    OpenKey,
    SceneDraft,
    known_values,
    not_among_frames,
    open_questions,
    scene_text,
)

__all__ = [
    "CLEAR_CHI",
    "FIELDS",
    "KINDS",
    "NEEDED",
    "OPTIONS",
    "QUANTITIES",
    "SET_KINDS",
    "STATED_SHAPES",
    "DraftValue",
    "KnownValues",
    "OpenKey",
    "SceneDraft",
    "draft_scene",
    "init",
    "known_values",
    "not_among_frames",
    "open_questions",
    "scene_text",
]
