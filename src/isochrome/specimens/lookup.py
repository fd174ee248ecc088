"""From a scene to the model of its specimen, by the shape's name."""

from __future__ import annotations

from importlib import import_module

from isochrome.scene import Scene
from isochrome.specimens.interface import SpecimenModel


def specimen_model(scene: Scene) -> SpecimenModel:
    """The model of a scene's specimen; without a shape it is the half-plane of a contact.

    Only that specimen's module is imported.
    """
    shape = scene.specimen.shape or "contact"
    model: SpecimenModel = import_module(f"isochrome.specimens.{shape}").MODEL
    return model
