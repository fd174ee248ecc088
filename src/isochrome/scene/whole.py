"""The scene: its parts together, what they must have in common, and slips of 1000 in a unit."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import Field, ValidationInfo, model_validator

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.scene import parts
from isochrome.scene.array_frames import ArrayFrames
from isochrome.scene.imaging import Camera, Distance, DistanceTable, Frames, ScenePart, value_at
from isochrome.scene.validation import DATE_FIELD, DATED, NO_KEYS, validate, with_pairs, with_tables


class Scene(ScenePart):
    """What stood in front of the camera.

    The parts are the tables of a scene's TOML file. Absent parts are not modelled and cost nothing.
    A scene does not change: `with_values` gives a changed copy, checked again. Any measured number
    may be given as {'value': 14.6, 'standard_uncertainty': 0.066}; its part then holds the plain
    value, and `uncertainties` the rest.

    Parameters
    ----------
    specimen : Specimen
        Shape, sizes (mm), Young's modulus (GPa), Poisson's ratio and fringe value (N/mm per
        fringe).
    indenter : Indenter, optional
        The sliding body of a contact.
    contact : Contact, optional
        What lies between the bodies.
    load : Load, optional
        The forces, N.
    friction : Friction, optional
        Coulomb friction, q = mu p.
    wear : Wear, optional
        Wear of the specimen, dh = kappa p ds, with frames wanted at its distances (m).
    polariscope : Polariscope, optional
        The light and the optical elements.
    camera : Camera, optional
        The pixel grid (mm), and what the sensor does to the light.
    frames : Frames, optional
        How captured frames are to be read.
    scar : tuple of MeasuredScar, optional
        Measured traces of the worn scar, which `compare` sets beside the simulated ones.
    numerics : Numerics, optional
        How finely the contact is computed.
    folder : Path, optional
        Folder to which paths in the scene are relative.
    name : str, default 'scene'
        Name of the scene, in titles and messages.
    stated_uncertainty : tuple of tuple of (str, float), optional
        What `uncertainties` holds, as pairs.
    fringe_value_date : str, optional
        The day of the fringe value's calibration, such as '2026-11-25', which stands beside its
        uncertainty as 'date'.
    table_files : tuple of str, optional
        The files from which friction and load were read: their parts hold the tables.

    Raises
    ------
    ValidationError
        Where parts do not fit together; `load_scene` and `parse_scene` raise InputError for it.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("line-contact-wear")
    >>> scene.get("load.normal_n")
    44.0
    >>> scene.with_values({"load.normal_n": 50.0}).load_at(0.0)
    50.0
    """

    specimen: parts.Specimen
    indenter: parts.Indenter | None = None
    contact: parts.Contact = parts.Contact()
    load: parts.Load | None = None
    friction: parts.Friction | None = None
    wear: parts.Wear | None = None
    polariscope: parts.Polariscope = parts.Polariscope()
    camera: Camera | None = None
    frames: Frames = Frames()
    scar: tuple[parts.MeasuredScar, ...] = ()
    numerics: parts.Numerics = parts.Numerics()
    folder: Path | None = Field(default=None, exclude=True, repr=False)
    name: str = Field(default="scene", exclude=True, repr=False)
    stated_uncertainty: tuple[tuple[str, float], ...] = Field(default=(), exclude=True, repr=False)
    fringe_value_date: str | None = Field(default=None, exclude=True, repr=False)
    table_files: tuple[str, ...] = Field(default=(), exclude=True, repr=False)

    @model_validator(mode="before")
    @classmethod
    def _plain_values(cls, data: Any, info: ValidationInfo) -> Any:
        given = data.get("folder") if isinstance(data, dict) else None
        return with_pairs(cls, with_tables(data, given or info.context))

    @model_validator(mode="after")
    def _parts_agree(self) -> Scene:
        self._check_needed()
        rules = {**self._rules_of_contacts(), **self._rules_of_loads()}
        for code, is_broken in rules.items():
            if is_broken:
                raise ValueError(message(code))
        specimen, load = self.specimen, self.load
        width, left_mm = specimen.width_mm or 0.0, specimen.left_mm
        if specimen.shape == "block" and left_mm is not None and not -width < left_mm < 0.0:
            raise ValueError(message("specimen_left_mm_block_left", left_mm=left_mm, width=width))
        if load is not None and load.tangential_n is not None:
            held, tangential_n = abs(self.friction_at(0.0)) * self.load_at(0.0), load.tangential_n
            if abs(tangential_n) > held:
                raise ValueError(
                    message("load_tangential_n_more_friction", tangential_n=tangential_n, held=held)
                )
        if load is not None and specimen.shape == "beam":
            inner, outer = load.inner_span_mm or 0.0, load.outer_span_mm or 0.0
            if inner >= outer:
                raise ValueError(message("load_inner_span_mm_must_less", inner=inner, outer=outer))
        return self

    def _rules_of_contacts(self) -> dict[str, Any]:
        """By the message that says it, whether a rule of contacts is broken."""
        contact, wear, rubs = self.indenter is not None, self.wear, self.friction is not None
        block, slides = self.specimen.shape == "block", self.specimen.support == "sliding"
        energy = wear is not None and wear.law == "dissipated_energy"
        return {
            "contact_needs_indenter": not contact and self.contact != parts.Contact(),
            "edge_stress_needs_contact": not contact and self.specimen.edge_stress_mpa,
            "focus_needs_contact": not contact and self.bend_mm2_per_mpa,
            "swing_needs_contact": not contact and self.load is not None and self.load.swing,
            "friction_wear_need_indenter": not contact and (rubs or wear),
            "scar_needs_wear_which": self.scar and wear is None,
            "wear_law_dissipated_energy_needs": energy and not rubs,
            "specimen_shape_block_block": block and not contact,
            "specimen_support_liding_holds": block and slides and rubs,
        }

    def _rules_of_loads(self) -> dict[str, Any]:
        """The same of frames and loads."""
        bare, frames, light = self.indenter is None, self.frames, self.polariscope
        table = self.load is not None and isinstance(self.load.normal_n, DistanceTable)
        stuck = self.load is not None and self.load.tangential_n is not None
        single = self.model == "disc" and not light.tells_orders
        return {
            "frames_known_line_single_frames": light.step and frames.known_line,
            "frames_known_loads_n_single_frames": frames.known_loads_n and not single,
            "load_added_tractions_need_contact": self.added_tractions and bare,
            "load_tilt_needs_contact": self.load is not None and self.load.tilt and bare,
            "load_normal_n_table_over": table and bare,
            "load_normal_n_table_over_sliding": table and stuck,
            "load_tangential_n_needs_friction": stuck and self.friction is None,
            "load_tangential_n_stuck_contact": stuck and self.wear,
        }

    def _check_needed(self) -> None:
        shape, contact = self.specimen.shape, self.indenter is not None
        if contact and shape not in (None, "block"):
            raise ValueError(message("indenter_specimen_shape_exclude", shape=shape))
        optics = ("specimen.thickness_mm", "specimen.fringe_value_n_per_mm", "load.normal_n")
        needed = (*self._body.needs, *optics) if self._body else ()
        if contact:
            size = ("specimen.width_mm", "specimen.height_mm") if shape == "block" else ()
            needed = ("specimen.young_gpa", "specimen.poisson", *optics, *size)
        what = "a contact" if contact and shape is None else f"a {shape}"
        for key in needed:
            part, name = key.split(".")
            if getattr(getattr(self, part), name, None) is None:
                raise ValueError(message("missing_needs_add", key=key, what=what))

    @property
    def _body(self) -> parts.Body | None:
        """What is known of a specimen that stands by itself; None for a contact or no model."""
        body = parts.BODIES.get(self.specimen.shape or "")
        incomplete = body is not None and body.only_with
        return None if incomplete and getattr(self.specimen, incomplete) is None else body

    @property
    def model(self) -> str | None:
        """Which model renders this scene: 'contact', 'disc', 'ring', 'beam', or None: no model."""
        if self.indenter is not None:
            return "contact"
        return self.specimen.shape if self._body else None

    @property
    def has_model(self) -> bool:
        """Whether there is a model that renders this scene."""
        return self.model is not None

    @property
    def is_contact(self) -> bool:
        """Whether a body is pressed on a half-plane or a block, which has a surface and slides."""
        return self.indenter is not None

    @property
    def pressed_body(self) -> parts.Indenter:
        """The indenter, of a contact alone."""
        assert self.indenter is not None
        return self.indenter

    @property
    def is_bare(self) -> bool:
        """Whether nothing lies between the bodies of a contact."""
        return self.contact == parts.Contact()

    def layer_at(self, distance_m: Distance) -> Distance:
        """Compliance of what lies between the bodies of a contact at a distance (m), mm/MPa."""
        return 1e-3 * value_at(self.contact.layer_um_per_mpa, distance_m)

    def roughness_at(self, distance_m: Distance) -> Distance:
        """Mean of the exponential heights between the bodies at a distance (m), mm."""
        return 1e-3 * value_at(self.contact.roughness_um, distance_m)

    @property
    def bend_mm2_per_mpa(self) -> float:
        """How far light is seen beside its place over the gradient of sigma_1 + sigma_2: d C h."""
        focus = self.camera.focus_mm if self.camera else 0.0
        specimen = self.specimen
        return focus * specimen.caustic_constant_mm2_per_n * (specimen.thickness_mm or 0.0)

    @property
    def added_tractions(self) -> parts.AddedTractions | None:
        """Tractions of a contact besides its model's; None without any."""
        return self.load.added_tractions if self.load else None

    @property
    def profile_file(self) -> str | None:
        """The file of a contact's measured profile; None without one."""
        return self.indenter.profile if self.indenter else None

    @property
    def orders_are_read(self) -> bool:
        """Whether fringe orders are read of its frames: else they are normalised alone."""
        fitted = self.model and not self.frames.known_loads_n
        return bool(fitted or self.polariscope.tells_orders or self.frames.orders_known)

    @property
    def no_model_reason(self) -> str:
        """Why a scene without a model has none."""
        shape = self.specimen.shape
        if shape is None:
            return message("scene_has_no_indenter")
        if shape in parts.BODIES:
            only_with = parts.BODIES[shape].only_with
            return message("has_no_model_without", shape=shape, only_with=only_with)
        return message("specimen_shape_has_no", shape=shape)

    @property
    def body_height_mm(self) -> float | None:
        """Height of a specimen that a picture shows whole; None for a contact or no model."""
        return getattr(self.specimen, self._body.height) if self._body else None

    @property
    def rim_diameter_mm(self) -> float | None:
        """Diameter of a specimen with a round outline, which tells its place; None without one."""
        return self.body_height_mm if self._body and self._body.has_rim else None

    @property
    def uncertainties(self) -> Mapping[str, float]:
        """Standard uncertainties that the scene states, by dotted key, in the keys' units."""
        return MappingProxyType(dict(self.stated_uncertainty))

    def friction_at(self, distance_m: Distance) -> Distance:
        """Friction coefficient mu at a sliding distance, linear between the table's points.

        Parameters: `distance_m`, the distance slid (m), a number or an array of any shape.
        Returns mu of that shape, 0 where the scene has none.
        """
        return value_at(self.friction.coefficient if self.friction else 0.0, distance_m)

    def load_at(self, distance_m: Distance) -> Distance:
        """Normal load P at a sliding distance, linear between the table's points.

        Parameters: `distance_m`, the distance slid (m), a number or an array of any shape.
        Returns P (N) of that shape, 0 where the scene has none.
        """
        return value_at(self.load.normal_n if self.load else 0.0, distance_m)

    def wear_coefficient_at(self, distance_m: Distance) -> Distance:
        """Wear coefficient k at a sliding distance, linear between the table's points.

        Parameters: `distance_m`, the distance slid (m), a number or an array of any shape.
        Returns k (mm²/N) of that shape, 0 where the scene has none.
        """
        return value_at(self.wear.coefficient_mm2_per_n if self.wear else 0.0, distance_m)

    def path(self, name: Any) -> Any:
        """A path named in the scene, relative to the scene's own file; an array as it is."""
        return name if isinstance(name, ArrayFrames) else (self.folder or Path()) / name

    def files(self, *, of_frames: bool) -> list[Path | ArrayFrames]:
        """The files, and arrays in place of files, that the scene names and results depend on.

        Parameters: `of_frames`, whether those of [frames] and [[scar]] are among them, which a
        simulation does not read.
        """
        response = self.camera.response if self.camera else None
        named: list[str | ArrayFrames | None] = [*self.table_files, response, self.profile_file]
        if of_frames:
            frames = self.frames
            named += [frames.no_load_dark, frames.no_load_bright, frames.no_load_steps]
            named += [frames.mask, frames.colour_table, *(scar.file for scar in self.scar)]
        return [self.path(name) for name in named if name is not None]

    def get(self, key: str) -> Any:
        """The value of a dotted key such as 'load.normal_n'; InputError on an unknown one."""
        part, _, name = key.partition(".")
        table = getattr(self, part, None)
        if part not in type(self).model_fields or part in NO_KEYS or not name:
            raise InputError("scene_has_no_such", key=key)
        if table is None:
            raise InputError("scene_has_no_add", key=key, part=part)
        if name not in type(table).model_fields:
            raise InputError(
                "has_no_such_key", key=key, part=part,
                model_fields=", ".join(type(table).model_fields),
            )  # fmt: skip
        return getattr(table, name)

    def with_values(self, values: dict[str, Any]) -> Scene:
        """A copy with some dotted keys changed and checked again; raises InputError.

        Parameters: `values`, by dotted key; {'value': v, 'standard_uncertainty': u} states an
        uncertainty too, and a plain number keeps the one that is stated. The date of a fringe value
        stays with the value that it belongs to.
        """
        changes: dict[str, dict[str, Any]] = {}
        for key, value in values.items():
            self.get(key)
            part, _, name = key.partition(".")
            changes.setdefault(part, {})[name] = value
        data = {name: getattr(self, name) for name in self.model_fields_set}
        if DATED in values and values[DATED] != self.get(DATED):
            data.pop(DATE_FIELD, None)
        for part, update in changes.items():
            table = getattr(self, part)
            data[part] = {n: getattr(table, n) for n in table.model_fields_set} | update
        return validate(Scene, data, self.name)


NARROWEST = 0.01
"""Width of a picture over that of what it shows, at least: a fringe is wider than that."""

FINEST_MM = 1e-4
"""A fifth of the wavelength of light: no camera resolves less, and what is less may be a slip."""

UNDOUBTED_MM = 1e3 * FINEST_MM
"""A pixel up to this is in mm for any contact: a slip from µm were finer than light resolves."""

WIDEST = 200
"""Contacts across a picture, at most, where its pixel may be a slip: frames are of a few."""

STIFFEST_GPA = 1000.0
"""No body is stiffer: a larger modulus has another unit."""

LARGEST_MM = dict.fromkeys(
    (*(f"specimen.{k}_mm" for k in ("thickness", "diameter", "hole", "height", "width")),
     "indenter.half_width_mm"), 1e3,
) | {"indenter.radius_mm": 1e4}  # fmt: skip
"""Nothing under a polariscope is larger, and no cylinder flatter: a larger size is in µm."""

MOST = 10_000
"""Pixels as fine as that across a contact: its surface has hardly more nodes."""


def check_pixel(scene: Scene, shape: tuple[int, int] | None) -> None:
    """Refuse a camera.pixel_mm in which the specimen cannot be seen: a picture over 200 contacts
    wide, a size over a metre (a radius, ten); see `check_width`. A profile's contact: when it is
    solved."""
    for key, most in LARGEST_MM.items():
        part, _, name = key.partition(".")
        size = getattr(getattr(scene, part), name, None)
        if size is not None and size > most:  # beyond all benches
            raise InputError(
                "over_mm_give_mm", name=scene.name, key=key, size=size, most=most,
                size_2=1e-3 * size,
            )  # fmt: skip
    camera, shown = scene.camera, _width(scene)
    if camera is None or camera.pixel_mm is None or shown is None:
        return
    pixel = camera.pixel_mm
    width, what = shown
    check_width(scene.name, pixel, shape, width, what)
    if scene.indenter is None or pixel <= UNDOUBTED_MM:
        return
    picture = max(shape or (camera.height_px or 0, camera.width_px or 0)) * pixel
    if picture > WIDEST * width:
        raise InputError(
            "camera_pixel_mm_makes_picture", name=scene.name, pixel=pixel, picture=picture,
            width=picture / width, what=what, width_2=width, by=_by(what), widest=WIDEST,
        )  # fmt: skip


def check_moduli(scene: Scene) -> None:
    """Refuse a Young's modulus that no solid has, over 1000 GPa, where no fit tells its unit."""
    bodies = {"specimen.young_gpa": scene.specimen, "indenter.young_gpa": scene.indenter}
    for key, body in bodies.items():
        young = body.young_gpa if body else None
        if young is not None and young > STIFFEST_GPA:
            raise InputError(
                "over_gpa_which_no", name=scene.name, key=key, young=young,
                stiffest_gpa=STIFFEST_GPA, young_2=1e-3 * young,
            )  # fmt: skip


def check_width(
    name: str, pixel: float, shape: tuple[int, ...] | None, width: float, what: str
) -> None:
    """Refuse a camera.pixel_mm wider than `what` is, mm, or a picture under a hundredth of it.
    `shape` None: a picture may show as small a part as one likes."""
    if pixel > max(width, UNDOUBTED_MM):
        raise InputError(
            "camera_pixel_mm_wider_mm", name=name, pixel=pixel, what=what, width=width, by=_by(what)
        )
    least = NARROWEST * width / max(shape) if shape else 0.0
    if pixel < FINEST_MM:
        least = max(least, width / MOST)
    if pixel < least:
        raise InputError(
            "camera_pixel_mm_too_little", name=name, pixel=pixel, what=what, width=width,
            least=least,
        )  # fmt: skip


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
