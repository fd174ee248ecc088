"""Whether the camera's pixel, sizes and moduli are in their keys' units.

A slip is a factor of a thousand.
"""

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.scene.imaging import DistanceTable
from isochrome.scene.whole import Scene

NARROWEST = 0.01
"""Width of a picture over that of what it shows, at least: a fringe is wider than that."""

FINEST_MM = 1e-4
"""A fifth of the wavelength of light: no camera resolves less, and what is less may be a slip."""

UNDOUBTED_MM = 1e3 * FINEST_MM
"""A pixel up to this is in mm, however small the contact: a slip from µm would be finer than light
resolves."""

WIDEST = 200
"""Contacts across a picture, at most, where its pixel may be a slip: frames are of a few."""

STIFFEST_GPA = 1000.0
"""No body is stiffer: a larger modulus has another unit."""

LARGEST_MM = {
    "specimen.thickness_mm": 1e3,
    "specimen.diameter_mm": 1e3,
    "specimen.hole_mm": 1e3,
    "specimen.height_mm": 1e3,
    "specimen.width_mm": 1e3,
    "indenter.half_width_mm": 1e3,
    "indenter.radius_mm": 1e4,
}
"""Nothing under a polariscope is larger, and no cylinder flatter: a larger size is in µm."""

MOST = 10_000
"""Pixels as fine as that across a contact: its surface has hardly more nodes."""


def check_pixel(scene: Scene, shape: tuple[int, int] | None) -> None:
    """Refuse a camera.pixel_mm in which the scene's specimen cannot be seen, before any work.

    A pixel is no wider than the contact (disc, beam), a picture no narrower than a hundredth of it,
    and no wider than 200 contacts; sizes beyond a metre (a radius, ten) are refused too. A measured
    profile's contact is held to this when it is solved. `shape` None: a picture that may show as
    small a part as one likes, whose size is the camera's.
    """
    _check_sizes(scene)
    camera, shown = scene.camera, _width(scene)
    if camera is None or camera.pixel_mm is None or shown is None:
        return
    pixel = camera.pixel_mm
    width, what = shown
    check_width(scene.name, pixel, shape, width, what)
    if scene.indenter is None or pixel <= UNDOUBTED_MM:
        return
    across = shape or (camera.height_px or 0, camera.width_px or 0)
    picture = max(across) * pixel
    if picture > WIDEST * width:
        raise InputError(
            "camera_pixel_mm_makes_picture",
            name=scene.name,
            pixel=pixel,
            picture=picture,
            width=picture / width,
            what=what,
            width_2=width,
            by=_by(what),
            widest=WIDEST,
        )


def check_moduli(scene: Scene) -> None:
    """Refuse a Young's modulus that no solid has, over 1000 GPa, before any work.

    Where frames are at hand, a fit tells whether another unit explains them; this is for the rest.
    """
    bodies = {"specimen.young_gpa": scene.specimen, "indenter.young_gpa": scene.indenter}
    for key, body in bodies.items():
        young = body.young_gpa if body else None
        if young is not None and young > STIFFEST_GPA:
            raise InputError(
                "over_gpa_which_no",
                name=scene.name,
                key=key,
                young=young,
                stiffest_gpa=STIFFEST_GPA,
                young_2=1e-3 * young,
            )


def _check_sizes(scene: Scene) -> None:
    """Refuse sizes that are beyond all benches."""
    for key, most in LARGEST_MM.items():
        part, _, name = key.partition(".")
        size = getattr(getattr(scene, part), name, None)
        if size is not None and size > most:
            raise InputError(
                "over_mm_give_mm",
                name=scene.name,
                key=key,
                size=size,
                most=most,
                size_2=1e-3 * size,
            )


def check_width(
    name: str, pixel: float, shape: tuple[int, ...] | None, width: float, what: str
) -> None:
    """Refuse a camera.pixel_mm, side `pixel`, in which what the picture shows cannot be seen.

    InputError where it is wider than that, or the picture narrower than a hundredth of it. `width`,
    mm, is that of `what`, such as 'the beam'; `shape` None: a picture may show as small a part as
    one likes.
    """
    if pixel > max(width, UNDOUBTED_MM):
        raise InputError(
            "camera_pixel_mm_wider_mm", name=name, pixel=pixel, what=what, width=width, by=_by(what)
        )
    least = NARROWEST * width / max(shape) if shape else 0.0
    if pixel < FINEST_MM:
        least = max(least, width / MOST)
    if pixel < least:
        raise InputError(
            "camera_pixel_mm_too_little",
            name=name,
            pixel=pixel,
            what=what,
            width=width,
            least=least,
        )


def _by(what: str) -> str:
    """Where a width comes from, if no key says it."""
    return message("load_normal_n_radius") if what == "the contact" else ""


def _width(scene: Scene) -> tuple[float, str] | None:
    """How wide is what the picture shows (mm), and what that is; None where nobody knows."""
    specimen, indenter, load = scene.specimen, scene.indenter, scene.load
    if scene.body_height_mm is not None:
        return scene.body_height_mm, f"the {scene.model}"
    if indenter is None or indenter.profile is not None:
        return None
    if indenter.shape == "flat" and indenter.half_width_mm is not None:
        return 2.0 * indenter.half_width_mm, "the flat"
    if indenter.radius_mm is None or load is None or specimen.young_gpa is None:
        return None
    from isochrome.reference import contact_modulus, hertz_half_width

    assert specimen.thickness_mm is not None and specimen.poisson is not None
    normal = load.normal_n
    largest = max(normal.value) if isinstance(normal, DistanceTable) else normal
    # plane stress widens it by a tenth at most, which is nothing beside a thousand
    modulus = contact_modulus(
        1e3 * specimen.young_gpa, specimen.poisson, 1e3 * indenter.young_gpa, indenter.poisson
    )
    half = hertz_half_width(largest / specimen.thickness_mm, indenter.radius_mm, modulus)
    return 2.0 * half, "the contact"
