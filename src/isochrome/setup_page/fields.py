"""The values that the page asks for: their words, units and usual ranges."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

KINDS = {
    "contact": "a block under a cylinder",
    "disc": "a disc under two opposite loads",
    "ring": "a ring under two opposite loads",
    "beam": "a beam in four-point bending",
    "other": "something else: read from the image alone",
}
"""What may stand in front of the camera, by the page's words."""

STATED_SHAPES = ("disc", "ring", "beam", "other")
"""Kinds that the scene names in specimen.shape."""

_ALL = tuple(KINDS)
_MODELS = ("contact", "disc", "ring", "beam")
_SLIDING = ("contact",)


@dataclass(frozen=True, kw_only=True)
class SceneField:
    """A value that the page asks for.

    Parameters
    ----------
    key : str
        Its key of the scene.
    label : str
        What the page calls it.
    group : str
        Under which head it stands.
    kinds : tuple of str
        For which of KINDS it is asked.
    unit : str, default ''
        Its unit.
    usual : str, default ''
        A value that is usual, as it stands in the field at first; empty where only the user
        knows it.
    hint : str, default ''
        A usual range, or where it is known from.
    needed : bool, default False
        Whether a scene of this kind needs it.
    choices : tuple of str, default ()
        What may be chosen; empty for a number or a list of them.
    """

    key: str
    label: str
    group: str
    kinds: tuple[str, ...]
    unit: str = ""
    usual: str = ""
    hint: str = ""
    needed: bool = False
    choices: tuple[str, ...] = ()


_SPECIMEN, _INDENTER, _LOAD, _SLIDE = "Specimen", "Cylinder", "Load", "Sliding and wear"
_CAMERA, _SELDOM = "Light and camera", "Seldom needed"

FIELDS = (
    SceneField(
        key="specimen.diameter_mm", label="Diameter", group=_SPECIMEN, kinds=("disc", "ring"),
        unit="mm", hint="measured with a calliper", needed=True,
    ),
    SceneField(
        key="specimen.hole_mm", label="Diameter of the hole", group=_SPECIMEN, kinds=("ring",),
        unit="mm", hint="measured with a calliper", needed=True,
    ),
    SceneField(
        key="specimen.height_mm", label="Height", group=_SPECIMEN, kinds=("beam",),
        unit="mm", hint="measured with a calliper", needed=True,
    ),
    SceneField(
        key="specimen.thickness_mm", label="Thickness", group=_SPECIMEN, kinds=_MODELS,
        unit="mm", hint="along the light; usually 3 to 10", needed=True,
    ),
    SceneField(
        key="specimen.fringe_value_n_per_mm", label="Material fringe value f_sigma",
        group=_SPECIMEN, kinds=_MODELS, unit="N/mm per fringe",
        hint="from calibrate; epoxy 10 to 15, polycarbonate 6 to 8, PMMA 100 to 200", needed=True,
    ),
    SceneField(
        key="specimen.young_gpa", label="Young's modulus of the specimen", group=_SPECIMEN,
        kinds=("contact",), unit="GPa", usual="3.0",
        hint="epoxy 2 to 4, polycarbonate 2.2 to 2.5", needed=True,
    ),
    SceneField(
        key="specimen.poisson", label="Poisson's ratio of the specimen", group=_SPECIMEN,
        kinds=("contact",), usual="0.38", hint="polymers 0.35 to 0.42", needed=True,
    ),
    SceneField(
        key="indenter.radius_mm", label="Radius", group=_INDENTER, kinds=("contact",),
        unit="mm", hint="of the cylinder, not its diameter", needed=True,
    ),
    SceneField(
        key="indenter.young_gpa", label="Young's modulus of the cylinder", group=_INDENTER,
        kinds=("contact",), unit="GPa", usual="210.0", hint="steel 210", needed=True,
    ),
    SceneField(
        key="indenter.poisson", label="Poisson's ratio of the cylinder", group=_INDENTER,
        kinds=("contact",), usual="0.3", hint="steel 0.3", needed=True,
    ),
    SceneField(
        key="load.normal_n", label="Load", group=_LOAD, kinds=_MODELS, unit="N",
        hint="about: a fit finds it", needed=True,
    ),
    SceneField(
        key="load.inner_span_mm", label="Distance of the inner rollers", group=_LOAD,
        kinds=("beam",), unit="mm", needed=True,
    ),
    SceneField(
        key="load.outer_span_mm", label="Distance of the outer rollers", group=_LOAD,
        kinds=("beam",), unit="mm", needed=True,
    ),
    SceneField(
        key="friction.coefficient", label="Friction coefficient", group=_SLIDE, kinds=_SLIDING,
        hint="about; empty where nothing slides. Positive: the cylinder slides to the right",
    ),
    SceneField(
        key="friction.static_state_first", label="The first frame stands still", group=_SLIDE,
        kinds=_SLIDING, choices=("false", "true"),
    ),
    SceneField(
        key="wear.distances_m", label="Distance slid at each sliding frame", group=_SLIDE,
        kinds=_SLIDING, unit="m", hint="numbers with a space between; empty without wear",
    ),
    SceneField(
        key="wear.coefficient_mm2_per_n", label="Wear coefficient", group=_SLIDE, kinds=_SLIDING,
        unit="mm²/N", usual="1e-9",
        hint="about; 1e-9 mm²/N is 1e-6 mm³/(N m)",
    ),
    SceneField(
        key="frames.sliding_speed_mm_per_s", label="Sliding speed of a video", group=_SLIDE,
        kinds=_SLIDING, unit="mm/s", hint="in place of the distances",
    ),
    SceneField(
        key="polariscope.wavelength_nm", label="Wavelength", group=_CAMERA, kinds=_ALL,
        unit="nm", usual="589.0", hint="sodium 589, green mercury 546", needed=False,
    ),
    SceneField(
        key="polariscope.field", label="Field", group=_CAMERA, kinds=_ALL, usual="dark",
        choices=("dark", "bright"),
    ),
    SceneField(
        key="camera.pixel_mm", label="Side of a pixel", group=_CAMERA, kinds=_ALL, unit="mm",
        hint="or by two points on the picture",
    ),
    SceneField(
        key="camera.bit_depth", label="Bits of the sensor", group=_CAMERA, kinds=_ALL,
        hint="8; 10 and 12 bits are stored in 16-bit files",
    ),
    SceneField(
        key="frames.gamma", label="Gamma", group=_CAMERA, kinds=_ALL,
        hint="1 for a measuring camera, 2.2 for a photograph, or unknown",
    ),
    SceneField(
        key="frames.channel", label="Colour channel", group=_SELDOM, kinds=_ALL,
        choices=("", "red", "green", "blue", "mean"),
    ),
    SceneField(
        key="frames.rotate_deg", label="Quarter turns of the picture", group=_SELDOM, kinds=_ALL,
        unit="degrees", choices=("0", "90", "180", "270"),
    ),
    SceneField(
        key="frames.flip", label="Mirrored", group=_SELDOM, kinds=_ALL,
        choices=("", "horizontal", "vertical"),
    ),
    SceneField(
        key="camera.left_mm", label="Left edge, from the middle of the contact",
        group=_SELDOM, kinds=_MODELS, unit="mm", hint="or by the contact point on the picture",
    ),
    SceneField(
        key="camera.top_mm", label="Upper edge, below the surface", group=_SELDOM,
        kinds=_MODELS, unit="mm", hint="or by the contact point on the picture",
    ),
    SceneField(
        key="camera.roll_deg", label="Roll of the camera", group=_SELDOM, kinds=_MODELS,
        unit="degrees", hint="or by the surface line on the picture",
    ),
)  # fmt: skip
"""All of them, in the order of the page. Ranges: Dally & Riley (1991), table 12.1, and the
catalogues of epoxy and polycarbonate sheet."""


def field_rows() -> list[dict[str, Any]]:
    """List the fields as plain dictionaries, as the page takes them.

    Returns
    -------
    list of dict
        One for each.
    """
    return [asdict(field) for field in FIELDS]
