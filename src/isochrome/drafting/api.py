"""`init`: a commented scene from captured frames and what is known besides."""

from __future__ import annotations

from isochrome.drafting.known_values import KnownValues
from isochrome.drafting.scene_draft import SceneDraft
from isochrome.frames import FrameReader


def draft_scene(frames: FrameReader, given: KnownValues) -> SceneDraft:
    """Draft a scene from opened frames and what is known besides; nothing is written.

    Parameters
    ----------
    frames : FrameReader
        The frames as they were captured: not turned, without a region of interest.
    given : KnownValues
        What the user knows.

    Returns
    -------
    SceneDraft
        The scene's text, its values with their uncertainties, what is open, warnings.

    Raises
    ------
    InputError
        Where something is not known without which nothing can be found: it names the option.
    PhysicsError
        Where no contact's or disc's fringes are in the frames.
    """
    raise NotImplementedError("being built on this branch")
