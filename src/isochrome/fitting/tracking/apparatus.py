"""What does not change from frame to frame of a video, asked of a few of them before the track."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import FrameData, prepare_frame
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.causes.cause import BAND, PLATES, SMOOTH
from isochrome.fitting.causes.freeing import Freed, free_causes
from isochrome.fitting.causes.report import cause_messages
from isochrome.fitting.causes.score import LightTerms
from isochrome.fitting.causes.slips import is_lost
from isochrome.fitting.frame.frame_fit import FrameFit, fit_with_model, placed
from isochrome.fitting.frame.single_state import scene_at, slid_until
from isochrome.fitting.frame.unknowns import BLUR, GAMMA, LENS, inputs_of_rows
from isochrome.fitting.frame_set import FrameSet
from isochrome.fitting.joint.frame_sequence import make_sequence
from isochrome.fitting.joint.joint_fit import JointSolution, solve_jointly
from isochrome.fitting.joint.separate_fits import starting_values
from isochrome.frames import Frame, FrameReader, Linear, SequentialFrames
from isochrome.messages import message
from isochrome.output import named_frames
from isochrome.scene import Scene

APPARATUS = (*LENS, GAMMA, BLUR, *PLATES, BAND)
"""Keys of the camera, the light and the polariscope that frames may ask for."""

NoLoad = tuple[Linear | None, Linear | None]


@dataclass(frozen=True, kw_only=True)
class Apparatus:
    """What a video's frames have in common besides what their scene says.

    Parameters
    ----------
    scene : Scene
        The scene, with what was found.
    keys : tuple of str, (m,), optional
        The keys that were found.
    covariance : ndarray, (m, m), optional
        Of their values.
    terms : tuple of tuple, (2,), optional
        Polynomial products of illumination and background, where they are richer.
    outside : ndarray of bool, (rows, cols), optional
        Pixels that are left out.
    warnings : tuple of str, optional
        What is said of it.
    """

    scene: Scene
    keys: tuple[str, ...] = ()
    covariance: Array | None = None
    terms: LightTerms | None = None
    outside: Mask | None = None
    warnings: tuple[str, ...] = ()

    @property
    def stated(self) -> Scene:
        """The scene, that states the uncertainties of what was found too."""
        return self.scene.with_values(
            {key: {"value": v, "standard_uncertainty": u} for key, (v, u) in self.values.items()}
        )

    @property
    def values(self) -> dict[str, tuple[float, float]]:
        """Value and standard uncertainty of what was found, by key."""
        if self.covariance is None:
            return {}
        spread = np.sqrt(np.diag(self.covariance)).tolist()
        return {key: (self.scene.get(key), u) for key, u in zip(self.keys, spread, strict=True)}

    def seen(self, data: FrameData) -> FrameData:
        """A frame with the light and the pixels that are taken."""
        if self.terms is not None:
            data = replace(data, lamp=data.lamp.of(self.terms))
        if self.outside is not None:
            data = replace(data, valid=data.valid & ~self.outside)
        return data


def find_apparatus(
    reader: FrameReader,
    scene: Scene,
    keys: tuple[str, ...],
    *,
    count: int,
    no_load: NoLoad = (None, None),
) -> Apparatus:
    """Ask the first, the middle and the last frame of a video for what belongs to the apparatus.

    Of a contact that wears only the first is asked: what has worn the others is not known yet.

    Parameters
    ----------
    reader : FrameReader
        The video.
    scene : Scene
        A contact, where its first frame's search starts.
    keys : tuple of str
        The keys that are tracked.
    count : int
        Number of the video's frames.
    no_load : tuple of Linear or None, (2,), optional
        The dark and the bright frame without load.

    Returns
    -------
    Apparatus
        What was found; the scene as it is where the frames ask for nothing, or show nothing.
    """
    scene = placed(scene, reader.shape)
    if isinstance(scene.frames.gamma, str):
        return Apparatus(scene=scene)  # each whole frame finds its own
    bare = scene.model_copy(update={"stated_uncertainty": ()})  # a track has no priors
    places = (0,) if scene.wear is not None else tuple(sorted({0, count // 2, count - 1}))
    frames = list(_frames_at(reader, places))
    if not frames:
        return Apparatus(scene=scene)
    one = scene_at(bare, slid_until(bare, frames[0]) or 0.0)
    own = tuple(key for key in keys if one.wear is not None or not key.startswith("wear."))
    asked: dict[int, tuple[FrameData, FrameFit]] = {}
    for frame in frames:
        try:
            data = prepare_frame(frame, one, bit_depth=reader.bit_depth, no_load=no_load)
        except InputError:
            continue  # a blank frame is refused in its turn, or left out
        fit = _alone(data, one, own)
        if fit is not None:
            asked[frame.index] = data, fit
    try:
        freed = _asked(reader.shape, list(asked.values()), one, own)
    except PhysicsError:
        return Apparatus(scene=scene)
    return _held(freed, scene, list(asked))


def _frames_at(reader: FrameReader, places: tuple[int, ...]) -> Iterator[Frame]:
    """The frames at some places that can be read: a video may end before its head says."""
    frames = SequentialFrames(reader)
    for place in places:
        try:
            yield frames.frame(place)
        except InputError:
            continue


def _alone(data: FrameData, scene: Scene, keys: tuple[str, ...]) -> FrameFit | None:
    """A frame's own fit, None where the scene's fringes are not in it."""
    try:
        fitted = fit_with_model(data, scene, keys, stated=inputs_of_rows(()))
    except PhysicsError:
        return None
    return None if is_lost(fitted) or fitted.fit.plain else fitted.fit


def _asked(
    shape: tuple[int, int],
    asked: list[tuple[FrameData, FrameFit]],
    scene: Scene,
    keys: tuple[str, ...],
) -> Freed[JointSolution]:
    """Frames with their own values, asked together. Raises PhysicsError where they show nothing."""
    if not asked:
        raise PhysicsError("frames_do_not_show", name=scene.name)
    data = FrameSet(shape, [frame for frame, _ in asked])
    sequence = make_sequence(scene, len(asked), (), keys)
    start = starting_values(sequence, [fit for _, fit in asked])
    return free_causes(solve_jointly(data, sequence, start, lambda: None))


def _held(freed: Freed[JointSolution], scene: Scene, places: list[int]) -> Apparatus:
    """What was found in some frames of a video, to be held in all of them."""
    said = cause_messages(freed)
    if not said:
        return Apparatus(scene=scene)
    fit = freed.now.fit
    at = [k for k, unknown in enumerate(fit.unknowns) if unknown.key in APPARATUS]
    keys = tuple(fit.unknowns[k].key for k in at)
    assert fit.covariance is not None
    asked = named_frames(places)
    held = "" if freed.is_plain else message("held_all_frames")
    if SMOOTH in freed.causes:
        held += message("but_smooth_stress_which")
    return Apparatus(
        scene=scene.with_values(dict(zip(keys, fit.values[at].tolist(), strict=True))),
        keys=keys,
        covariance=fit.covariance[np.ix_(at, at)],
        terms=freed.now.terms if freed.light else None,
        outside=freed.now.data.outside,
        warnings=tuple(f"asked of {asked}{held}: " + text for text in said),
    )
