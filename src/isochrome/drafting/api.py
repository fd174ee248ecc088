"""`init`: a commented scene from captured frames and what is known besides."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from isochrome.drafting.body_draft import draft_disc, draft_without_model
from isochrome.drafting.contact_draft import draft_contact
from isochrome.drafting.scene_draft import (
    SCENE_FILE,
    KnownValues,
    SceneDraft,
    known_values,
    not_among_frames,
)
from isochrome.errors import InputError
from isochrome.frames import FrameReader, open_frames
from isochrome.messages import message
from isochrome.output import staged, write_figure, write_text
from isochrome.runs import single_threaded
from isochrome.scene import FramesLike

PREVIEW_FILE = "scene.png"


def draft_scene(frames: FrameReader, given: KnownValues) -> SceneDraft:
    """Draft a scene from opened frames and what is known besides; nothing is written.

    Frames are as captured: not turned, without a region of interest. InputError names the option
    without which nothing can be found; PhysicsError where no contact's or disc's fringes are seen.
    """
    drafts = {"contact": draft_contact, "disc": draft_disc, "other": draft_without_model}
    with single_threaded():
        return drafts[given.shape](frames, given)


def init(
    frames: FramesLike,
    known: KnownValues | Mapping[str, Any],
    out: str | Path | None = None,
    *,
    replace: bool = False,
) -> SceneDraft:
    """Write a commented scene from captured frames and what is known of the bench.

    Of a sliding contact the load, friction and its side, the place of surface and contact, the
    polariscope's field, the camera's gamma and how the picture lies are found in one frame; its
    size, bits and scale are the file's. A disc's place and scale are its rim's. What nobody knows
    is a line to fill in.

    Parameters
    ----------
    frames : str, Path, sequence of them, array or sequence of arrays
        The frames, as for `open_frames`. Files of a folder that its scene.toml names besides, or
        whose names say that they are no-load frames, are none of them.
    known : KnownValues or mapping
        What is known, by the names of the fields of `isochrome.drafting.KnownValues`; of a contact
        young_gpa, poisson, thickness_mm, fringe_value_n_per_mm, radius_mm, indenter_young_gpa,
        indenter_poisson, and load_n within a factor of three.
    out : str or Path, optional
        Folder for scene.toml and scene.png, a preview of what was found.
    replace : bool, default False
        Whether a scene.toml that is there is replaced.

    Returns
    -------
    SceneDraft
        The scene, its text, its values with where they come from, what is open, and warnings.

    Raises
    ------
    InputError
        Where the frames cannot be read, something must be known besides, or a scene is there.
    PhysicsError
        Where no contact or disc explains any frame that was looked at, or two do.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("line-contact-wear").with_values({
    ...     "wear.distances_m": [0.0], "friction.static_state_first": False, "camera.width_px": 164,
    ...     "camera.height_px": 123, "camera.pixel_mm": 0.0243, "camera.noise_grey": 1.0})
    >>> simulated = isochrome.simulate(scene, "simulated")
    >>> known = {
    ...     "young_gpa": 2.1, "poisson": 0.4, "thickness_mm": 4.0, "fringe_value_n_per_mm": 14.6,
    ...     "radius_mm": 24.61, "indenter_young_gpa": 210.0, "indenter_poisson": 0.3,
    ...     "load_n": 60.0}
    >>> found = isochrome.init("simulated/frames.tif", known, "bench")
    >>> round(found.scene.load.normal_n, 1), found.scene.polariscope.field
    (44.0, 'dark')
    """
    given = known_values(known)
    if out is not None and not replace:
        _refuse_existing(Path(out))
    with open_frames(
        frames,
        channel=given.channel,
        wavelength_nm=given.wavelength_nm,
        bit_depth=given.bit_depth,
        leave_out=not_among_frames(frames),
    ) as reader:
        draft = draft_scene(reader, given)
    if out is not None:
        if not replace:
            _refuse_existing(Path(out))  # somebody may have written one meanwhile
        with staged(out) as folder:
            write_text(folder / SCENE_FILE, draft.text)
            write_figure(folder / PREVIEW_FILE, draft.figure())
    return draft


def _refuse_existing(folder: Path) -> None:
    """Refuse to write over a scene."""
    path = folder / SCENE_FILE
    if os.path.lexists(path):
        raise InputError(message("there_already_name_another", path=path))
