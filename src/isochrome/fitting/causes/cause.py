"""The causes that are known for a frame to differ from its scene, and what mends each."""

from dataclasses import dataclass, replace

from isochrome.fitting.frame.unknowns import (
    BLUR,
    EARLIER,
    GAMMA,
    LENS,
    PIXEL,
    SMOOTH_KEYS,
    StatedInputs,
)
from isochrome.scene import Scene

PLATES = ("polariscope.input_plate_error_deg", "polariscope.output_plate_error_deg")
BAND = "polariscope.bandwidth_nm"
FRINGE_VALUE = "specimen.fringe_value_n_per_mm"


@dataclass(frozen=True)
class Cause:
    """Something that a scene may leave out: its `name`, the `keys` that hold it.

    `starts`, where a fit of the keys begins: an even cause, which looks the same with either sign,
    has no slope at nought. `least`, what is too little to be worth an unknown: some 1e-3 of a
    fringe, ten times what the model itself errs by. `free`, False where the frame cannot tell it
    from what it is told: then it is a suspect, stays as it is, and `least` is a share of it.
    `weight`, 1/u² of keys that the scene states with their uncertainties, which are their priors.
    """

    name: str
    keys: tuple[str, ...]
    starts: tuple[float, ...] = (0.0,)
    least: float = 0.0
    free: bool = True
    weight: tuple[float, ...] = ()


TINY = 1e-9
"""A lens that does nothing: its picture is made as that of one that does."""

ROLL = Cause("the camera's roll", LENS[:1], (TINY,), 0.01)
DISTORTION = Cause("the lens's distortion", LENS[1:2], (TINY,), 1e-4)
SIDE = Cause("a camera that looks from the side", LENS[2:3], (TINY,), 1e-4)
ABOVE = Cause("a camera that looks from above or below", LENS[3:], (TINY,), 1e-4)
TONE = Cause("the camera's tone curve", (GAMMA,), (1.0,), 0.001)
# less blur than that is not told from what the pixels' own area takes
BLURRED = Cause("blur", (BLUR,), (0.7,), 0.6)
TURNED = Cause("quarter-wave plates that are turned", PLATES, (3.0, 3.0), 0.5)
WIDE = Cause("the light's band of wavelengths", (BAND,), (10.0,), 3.0)
SMOOTH = Cause("a smooth stress besides the contact's", SMOOTH_KEYS, (0.0, 0.0, 0.0), 0.004)
# 2e-4 of a fringe; what is less makes the values less sure, see `_undecided`
PAST = Cause("another friction before", (EARLIER,), least=0.005)
SCALE = Cause("the pixel's size", (PIXEL,), least=1e-3, free=False)
STIFF = Cause(
    "the fringe value, the indenter's radius or the moduli", (FRINGE_VALUE,), least=1e-3, free=False
)

STATED = "what the scene states with an uncertainty"

GEOMETRY = (ROLL, DISTORTION, SIDE, ABOVE)
LOOK = Cause("how the camera looks", LENS, (TINY,) * len(LENS))
"""All of the geometry at once: where it is far off, one part looks like another."""

CAUSES = (*GEOMETRY, TONE, BLURRED, TURNED, WIDE, SMOOTH, PAST, SCALE, STIFF)


def candidates(
    scene: Scene, keys: tuple[str, ...], held: StatedInputs, *, past: bool = False
) -> tuple[Cause, ...]:
    """The causes that a scene can have, with those of their keys that are not unknowns already.

    What is `held` and has a stated uncertainty is one cause, its values together: a frame that the
    stated values contradict tells which combinations of them are right, and the priors the others.
    `past`, whether nothing else than a frame says what friction there was before.
    """
    left = (_without(cause, keys + held.keys) for cause in CAUSES if past or cause is not PAST)
    own = tuple(c for c in left if c.keys and all(_has(scene, key) for key in c.keys))
    if not held.keys:
        return own
    weight = tuple((held.spread**-2.0).tolist())
    return (*own, Cause(STATED, held.keys, tuple(held.values.tolist()), weight=weight))


def _without(cause: Cause, keys: tuple[str, ...]) -> Cause:
    """A cause with fewer keys; the same where none of them is among `keys`."""
    if not set(cause.keys) & set(keys):
        return cause
    left = [(k, s) for k, s in zip(cause.keys, cause.starts, strict=True) if k not in keys]
    return replace(cause, keys=tuple(k for k, _ in left), starts=tuple(s for _, s in left))


def _has(scene: Scene, key: str) -> bool:
    """Whether a key is a number, or may become one, in a scene."""
    polariscope = scene.polariscope
    if key in SMOOTH_KEYS:
        return scene.indenter is not None
    if key == EARLIER:
        return bool(scene.wear and scene.friction and min(scene.wear.distances_m) > 0.0)
    if key in PLATES:
        return polariscope.field != "plane" and not polariscope.step
    if key == BAND:
        return polariscope.wavelength_nm is not None and not polariscope.several_wavelengths
    return True
