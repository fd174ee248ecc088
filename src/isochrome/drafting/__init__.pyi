from .api import draft_scene, init
from .scene_draft import (
    NEEDED,
    QUANTITIES,
    DraftValue,
    KnownValues,
    OpenKey,
    Quantity,
    SceneDraft,
    known_values,
    not_among_frames,
    open_questions,
)

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
