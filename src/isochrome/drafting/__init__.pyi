from .api import draft_scene
from .known_values import KnownValues
from .scene_draft import DraftValue, OpenKey, SceneDraft

__all__ = [
    "DraftValue",
    "KnownValues",
    "OpenKey",
    "SceneDraft",
    "draft_scene",
]
