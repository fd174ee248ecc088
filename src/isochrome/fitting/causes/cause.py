"""What a scene may leave out, with the chance and the size that a bench has it."""

from dataclasses import dataclass, replace

from isochrome.fitting.frame.unknowns import (
    BETWEEN,
    BLUR,
    EARLIER,
    EDGE,
    FOCUS,
    GAMMA,
    LAYER,
    LEAST_BETWEEN,
    LENS,
    PIXEL,
    ROUGHNESS,
    SMOOTH_KEYS,
    SWING,
    TILT,
    StatedInputs,
)
from isochrome.scene import DistanceTable, Scene

PLATES = ("polariscope.input_plate_error_deg", "polariscope.output_plate_error_deg")
BAND = "polariscope.bandwidth_nm"
FRINGE_VALUE = "specimen.fringe_value_n_per_mm"
YOUNG = "specimen.young_gpa"

RARE = 0.1
"""Chance that a bench has a given defect, before its frame is looked at."""


@dataclass(frozen=True)
class Cause:
    """Something that a scene may leave out: its `name`, the `keys` that hold it. `sizes`, the
    standard deviations that usual benches have, in the keys' units; of a modulus, the fringe value
    and the pixel a share of it. `free`, False where the frame cannot tell it from what it is told:
    then it is a suspect, and stays as it is. `even`, whether it enters by its square. `values`,
    those of the scene where it states the keys itself, with the sizes as uncertainties.
    """

    name: str
    keys: tuple[str, ...]
    sizes: tuple[float, ...]
    free: bool = True
    even: bool = False
    values: tuple[float, ...] = ()

    @property
    def stated(self) -> bool:
        """Whether the scene states it."""
        return bool(self.values)

    @property
    def positive(self) -> bool:
        """Whether its amplitude cannot be negative."""
        return self.even or (self.keys[0] in BETWEEN and not self.stated)

    @property
    def starts(self) -> tuple[float, ...]:
        """Where a fit of the keys begins: an even cause has no slope at nought."""
        if self.even:
            return self.sizes
        return self.values or tuple(_STARTS.get(key, 0.0) for key in self.keys)


TINY = 1e-9
"""A lens that does nothing: its picture is made as that of one that does."""

_STARTS = dict.fromkeys(LENS, TINY) | {GAMMA: 1.0, LAYER: LEAST_BETWEEN, ROUGHNESS: 0.1}

# sizes: a tripod's and a mount's by eye; a plain lens's; a look that is 2 degrees off the normal
_ROLL, _DISTORTION, _SIDE, _ABOVE = LENS
ROLL = Cause("the camera's roll", (_ROLL,), (1.0,))
DISTORTION = Cause("the lens's distortion", (_DISTORTION,), (0.01,))
SIDE = Cause("a camera that looks from the side", (_SIDE,), (0.005,))
ABOVE = Cause("a camera that looks from above or below", (_ABOVE,), (0.005,))
TONE = Cause("the camera's tone curve", (GAMMA,), (0.1,))
BLURRED = Cause("blur", (BLUR,), (0.7,), even=True)
TURNED = Cause("quarter-wave plates that are turned", PLATES, (3.0, 3.0), even=True)
WIDE = Cause("the light's band of wavelengths", (BAND,), (10.0,), even=True)
SMOOTH = Cause("a smooth stress besides the contact's", SMOOTH_KEYS, (0.2, 0.05, 0.05))
PAST = Cause("another friction before", (EARLIER,), (0.1,))
# polymers creep and warm, and data sheets differ by as much
MODULUS = Cause(
    "another modulus of the specimen, or another radius of what presses on it", (YOUNG,), (0.1,)
)
# the asperities of a surface that was ground or milled
SOFT = Cause("a soft or rough layer between the bodies", (LAYER,), (0.05,))
ROUGH = Cause("rough surfaces", (ROUGHNESS,), (0.2,))
# cutters leave some tenths of a MPa; an objective's depth of field
MACHINED = Cause("stress along a machined surface", EDGE, (0.3, 0.15))
DEFOCUSED = Cause("a focus off the middle of the plate", (FOCUS,), (0.3,))
# a cylinder that is a twentieth of a degree off; a shaft's run-out
SLANTED = Cause("a load that is uneven through the thickness", (TILT,), (0.1,), even=True)
SWUNG = Cause("a load that swings within the exposure", (SWING,), (0.02,), even=True)
SCALE = Cause("the pixel's size", (PIXEL,), (0.003,), free=False)
STIFF = Cause("the fringe value", (FRINGE_VALUE,), (0.05,), free=False)

STATED = "what the scene states with an uncertainty"

CAUSES = (
    ROLL, DISTORTION, SIDE, ABOVE, TONE, BLURRED, TURNED, WIDE, SMOOTH, PAST, MODULUS, SOFT,
    ROUGH,     MACHINED, DEFOCUSED, SLANTED, SWUNG, SCALE, STIFF,
)  # fmt: skip

OF_PRESSURE = frozenset(cause.name for cause in (MODULUS, SOFT, ROUGH, SLANTED))
"""Causes that make a contact's pressure wider or narrower, as tractions of its own do."""


OF_SIZE = (YOUNG, PIXEL, FRINGE_VALUE)
"""Keys whose causes have a share of the value as their size."""


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
    sizes, values = tuple(held.spread.tolist()), tuple(held.values.tolist())
    return (*own, Cause(STATED, held.keys, sizes, values=values))


def _without(cause: Cause, keys: tuple[str, ...]) -> Cause:
    """A cause with fewer keys; the same where none of them is among `keys`."""
    if not set(cause.keys) & set(keys):
        return cause
    rows = zip(cause.keys, cause.sizes, strict=True)
    left = tuple(zip(*(row for row in rows if row[0] not in keys), strict=True)) or ((), ())
    return replace(cause, keys=left[0], sizes=left[1])


def _has(scene: Scene, key: str) -> bool:
    """Whether a key is a number, or may become one, in a scene."""
    polariscope = scene.polariscope
    if key in (*SMOOTH_KEYS, YOUNG, *EDGE, FOCUS):
        return scene.is_contact
    if key in (TILT, SWING):  # of an even one all is weighed: a stated one would be found again
        return scene.is_contact and not scene.get(key)
    if key in BETWEEN:
        return scene.is_contact and not isinstance(scene.get(key), DistanceTable)
    if key in (PIXEL, FRINGE_VALUE):  # in a contact they look like its modulus
        return not scene.is_contact
    if key == EARLIER:
        return bool(scene.wear and scene.friction and min(scene.wear.distances_m) > 0.0)
    if key in PLATES:
        return polariscope.field != "plane" and not polariscope.step
    if key == BLUR:
        return scene.camera is not None and not scene.camera.blur_px
    if key == BAND:
        return polariscope.wavelength_nm is not None and not polariscope.several_wavelengths
    return True
