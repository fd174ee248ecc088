"""The parts of a scene: what stood in front of the camera, and nothing else.

Each part is one table of the scene file; an absent one is not modelled. The unit of every number
stands in its key; x is along the surface to the right, z into the specimen, downward; stress
positive in tension; angles counter-clockwise from the image's +x, as the camera sees them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from isochrome.messages import message
from isochrome.scene import imaging

Poisson = Annotated[float, Field(gt=-1, le=0.5, allow_inf_nan=False)]


@dataclass(frozen=True)
class Body:
    """What a specimen without a contact needs: keys; `height`, that of its size along z; `has_rim`,
    of that diameter; `only_with`, the key without which frames are read from the image alone."""

    needs: tuple[str, ...]
    height: str
    has_rim: bool = False
    only_with: str | None = None


BODIES = {
    "disc": Body(("specimen.diameter_mm",), "diameter_mm", has_rim=True),
    "ring": Body(("specimen.diameter_mm", "specimen.hole_mm"), "diameter_mm", True, "hole_mm"),
    "beam": Body(("specimen.height_mm", "load.inner_span_mm", "load.outer_span_mm"), "height_mm"),
}
"""The specimens without a contact that have a model, by their shape."""


class Specimen(imaging.ScenePart):
    """The transparent block, disc, ring or beam. Without `shape`, a half-plane under a contact.

    Parameters
    ----------
    shape : {'block', 'disc', 'beam', 'ring', 'other'}, optional
        Its shape.
    young_gpa : float, optional
        Young's modulus, GPa.
    poisson : float, optional
        Poisson's ratio.
    plane : {'strain', 'stress', 'unknown'}, default 'strain'
        Whether the specimen is in plane strain or plane stress; 'unknown', between them.
    plane_stress_share : float, optional
        Where between plane strain, 0, and plane stress, 1, a contact's plate of an unknown plane
        is; without it a fit finds it, to what its error takes beyond either.
    thickness_mm : float, optional
        Thickness, mm.
    fringe_value_n_per_mm : float, optional
        Material fringe value, N/mm per fringe.
    diameter_mm : float, optional
        Diameter of a disc or ring, mm.
    hole_mm : float, optional
        Diameter of the round hole in a ring's middle, mm.
    height_mm : float, optional
        Height of a beam or block, mm.
    width_mm : float, optional
        Width of a block, mm.
    left_mm : float, optional
        Left side of a block from the contact's centre, mm; absent: the contact is in the middle.
    support : {'fixed', 'sliding'}, default 'fixed'
        Whether a block's lower side is fixed or slides on its support.
    edge_stress_mpa : float, default 0.0
        Stress along a machined surface, as cutting leaves it: sigma_x at the surface, MPa.
    edge_depth_mm : float, default 0.3
        Depth over which the stress along a machined surface falls to 1/e, mm.
    caustic_constant_mm2_per_n : float, default 1e-4
        Change of the optical path over thickness and over sigma_1 + sigma_2, mm²/N, by which light
        is bent; 1e-4 is that of acrylics and epoxies, to some 20 %.
    """

    shape: Literal["block", "disc", "beam", "ring", "other"] | None = None
    young_gpa: imaging.Positive | None = None
    poisson: Poisson | None = None
    plane: Literal["strain", "stress", "unknown"] = "strain"
    plane_stress_share: Annotated[float, Field(ge=-1, le=2)] | None = None
    thickness_mm: imaging.Positive | None = None
    fringe_value_n_per_mm: imaging.Positive | None = None
    diameter_mm: imaging.Positive | None = None
    hole_mm: imaging.Positive | None = None
    height_mm: imaging.Positive | None = None
    width_mm: imaging.Positive | None = None
    left_mm: imaging.Finite | None = None
    support: Literal["fixed", "sliding"] = "fixed"
    edge_stress_mpa: imaging.Finite = 0.0
    edge_depth_mm: imaging.Positive = 0.3
    caustic_constant_mm2_per_n: imaging.Finite = 1e-4

    @model_validator(mode="after")
    def _hole_inside(self) -> Specimen:
        hole, diameter = self.hole_mm, self.diameter_mm
        if hole is not None and diameter is not None and hole >= diameter:
            raise ValueError(message("hole_mm_must_less_diameter_mm", hole=hole, diameter=diameter))
        if self.plane != "unknown" and self.plane_stress_share is not None:
            raise ValueError(message("plane_stress_share_needs_unknown", plane=self.plane))
        return self

    @property
    def share_of_plane_stress(self) -> float | None:
        """0 in plane strain, 1 in plane stress; None where nobody knows."""
        return {"strain": 0.0, "stress": 1.0}.get(self.plane, self.plane_stress_share)


Wavelength = Annotated[float, Field(ge=200, le=3000)]


class Indenter(imaging.ScenePart):
    """The sliding body: a cylinder, a flat with corners, or a profile (CSV), alone or added.

    Parameters
    ----------
    shape : {'cylinder', 'flat'}, default 'cylinder'
        Its shape.
    radius_mm : float, optional
        Radius of a cylinder, mm.
    half_width_mm : float, optional
        Half-width of a flat, mm.
    profile : str, optional
        CSV file of a measured profile.
    young_gpa : float
        Young's modulus, GPa.
    poisson : float
        Poisson's ratio.
    """

    shape: Literal["cylinder", "flat"] = "cylinder"
    radius_mm: imaging.Positive | None = None
    half_width_mm: imaging.Positive | None = None
    profile: imaging.FileName | None = None
    young_gpa: imaging.Positive
    poisson: Poisson

    @model_validator(mode="after")
    def _one_shape(self) -> Indenter:
        if self.profile is None:
            if self.shape == "cylinder" and self.radius_mm is None:
                raise ValueError(message("cylinder_needs_radius_mm_add"))
            if self.shape == "flat" and self.half_width_mm is None:
                raise ValueError(message("shape_flat_needs_half_width_mm"))
        return self


class Contact(imaging.ScenePart):
    """What lies between the bodies of a contact.

    Parameters
    ----------
    layer_um_per_mpa : float or NonNegativeTable, default 0.0
        Compliance of a soft or rough layer: how far a pressure of 1 MPa presses it together, um; a
        number, or a table over distance (wearing-in).
    roughness_um : float or NonNegativeTable, default 0.0
        Mean height lambda of exponential asperities, of both surfaces together, um: the pressure
        falls as exp(-separation/lambda). A number, or a table over distance (wearing-in).
    """

    layer_um_per_mpa: imaging.OverDistance[imaging.NonNegative, imaging.NonNegativeTable] = 0.0
    roughness_um: imaging.OverDistance[imaging.NonNegative, imaging.NonNegativeTable] = 0.0


class AddedTractions(imaging.ScenePart):
    """Tractions on a contact's surface besides its model's, linear between places, nought beyond.

    Parameters
    ----------
    x_mm : tuple of float
        Places from the contact's centre, mm, rising.
    pressure_mpa : tuple of float
        Pressure to add there, MPa. Its integral adds to the load.
    shear_mpa : tuple of float
        Shear along +x to add there, MPa.
    """

    samples: ClassVar[tuple[str, ...]] = ("x_mm", "pressure_mpa", "shear_mpa")
    x_mm: Annotated[tuple[imaging.Finite, ...], Field(min_length=2, max_length=1000)]
    pressure_mpa: Annotated[tuple[imaging.Finite, ...], Field(min_length=2, max_length=1000)]
    shear_mpa: Annotated[tuple[imaging.Finite, ...], Field(min_length=2, max_length=1000)]


class Load(imaging.ScenePart):
    """The forces: normal (diametral; or the whole bending load), tangential, bulk stress, spans.

    Parameters
    ----------
    normal_n : float or PositiveTable
        Normal load, N; of a contact a number, or a table over distance; or in its place `file`, a
        CSV file with the columns distance_m (or time_s) and normal_n, as for `Friction`.
    tangential_n : float, optional
        Tangential load of a stuck contact, N.
    bulk_mpa : float, optional
        Bulk stress along x at the contact's centre, MPa.
    bulk_along_x_mpa_per_mm : float, optional
        Change of the bulk stress along the surface, MPa/mm.
    bulk_along_z_mpa_per_mm : float, optional
        Change of the bulk stress with depth (bending), MPa/mm.
    tilt : float, default 0.0
        Change of a contact's line load through the thickness, of its mean, 1/mm: P'(y) = P'
        (1 + tilt y), y from the middle; where that is below nought the bodies do not touch.
    inner_span_mm : float, optional
        Distance between the inner rollers of a beam, mm.
    outer_span_mm : float, optional
        Distance between the outer rollers of a beam, mm.
    swing : float, default 0.0
        Relative amplitude by which a contact's load swings within an exposure, as a sine.
    added_tractions : AddedTractions, optional
        Tractions of a contact besides its model's, as a fit finds them.
    """

    normal_n: imaging.OverDistance[imaging.Positive, imaging.PositiveTable]
    tangential_n: imaging.Finite | None = None
    bulk_mpa: imaging.Finite | None = None
    bulk_along_x_mpa_per_mm: imaging.Finite | None = None
    bulk_along_z_mpa_per_mm: imaging.Finite | None = None
    tilt: Annotated[float, Field(ge=-100, le=100)] = 0.0
    inner_span_mm: imaging.Positive | None = None
    outer_span_mm: imaging.Positive | None = None
    swing: Annotated[float, Field(ge=0, lt=1)] = 0.0
    added_tractions: AddedTractions | None = None


class Friction(imaging.ScenePart):
    """Coulomb friction, q = mu p along +x.

    Parameters
    ----------
    coefficient : float or FrictionTable
        The coefficient mu, a number, or a table over distance; or in its place `file`, a CSV file
        with the columns distance_m (or time_s, which `sliding_speed_mm_per_s`, here or in [frames],
        makes distances of) and coefficient. Up to 200 rows are used as they are, and a longer
        file is followed by 200 points at most.
    static_state_first : bool, default False
        Whether one more state comes before sliding starts, without tangential traction.
    earlier_change : float, default 0.0
        How much larger the coefficient was before each state, while the block wore; beside a
        `coefficient` that is a number.
    """

    coefficient: imaging.OverDistance[imaging.Coefficient, imaging.FrictionTable]
    static_state_first: bool = False
    earlier_change: imaging.Coefficient = 0.0

    @model_validator(mode="after")
    def _one_course(self) -> Friction:
        if self.earlier_change and isinstance(self.coefficient, imaging.DistanceTable):
            raise ValueError(message("friction_earlier_change_stands_beside"))
        return self


class Wear(imaging.ScenePart):
    """Wear of the specimen, dh = kappa p ds.

    With `law` 'archard' kappa = k; 'sarkar', k sqrt(1 + 3 mu²); 'dissipated_energy', k |mu|, where
    k is the worn volume per dissipated energy (1 mm³/J is 1e-3 mm²/N).

    Parameters
    ----------
    coefficient_mm2_per_n : float or NonNegativeTable
        The coefficient k, mm²/N, a number, or a table over distance (running-in).
    law : {'archard', 'sarkar', 'dissipated_energy'}, default 'archard'
        The wear law.
    distances_m : tuple of float
        Distances at which frames are wanted, m.
    """

    coefficient_mm2_per_n: imaging.OverDistance[imaging.NonNegative, imaging.NonNegativeTable]
    law: Literal["archard", "sarkar", "dissipated_energy"] = "archard"
    distances_m: Annotated[tuple[imaging.NonNegative, ...], Field(min_length=1)]

    def coefficient_at(self, distance_m: imaging.Distance) -> imaging.Distance:
        """Coefficient k (mm²/N) at a sliding distance (m), linear between the table's points."""
        return imaging.value_at(self.coefficient_mm2_per_n, distance_m)


class MeasuredScar(imaging.ScenePart):
    """A profilometer's trace across the worn scar, see `isochrome.scars.read_trace`.

    Parameters
    ----------
    file : str
        The trace's file, relative to the scene's.
    distance_m : float
        Distance slid when it was measured, m; several traces may have the same.
    """

    file: imaging.FileName
    distance_m: imaging.Positive


class PolariscopeStep(imaging.ScenePart):
    """The elements' angles for one frame of a phase-stepped set; no plates: a plane polariscope.

    Parameters
    ----------
    polariser_deg : float
        Azimuth of the polariser, degrees.
    input_plate_deg : float, optional
        Fast axis of the first quarter-wave plate, degrees.
    output_plate_deg : float, optional
        Fast axis of the second quarter-wave plate, degrees.
    analyser_deg : float
        Azimuth of the analyser, degrees.
    """

    polariser_deg: imaging.Finite
    input_plate_deg: imaging.Finite | None = None
    output_plate_deg: imaging.Finite | None = None
    analyser_deg: imaging.Finite

    @model_validator(mode="after")
    def _both_plates(self) -> PolariscopeStep:
        if (self.input_plate_deg is None) != (self.output_plate_deg is None):
            raise ValueError(message("give_both_input_plate_deg_output_plate_deg"))
        return self


class Spectrum(imaging.ScenePart):
    """Power over wavelength: separate lines, or samples of a spectrum linear in between.

    Parameters
    ----------
    wavelength_nm : tuple of float
        Wavelengths, nm, rising.
    power : tuple of float
        Power at each of them, in any unit.
    """

    samples: ClassVar[tuple[str, ...]] = ("wavelength_nm", "power")
    wavelength_nm: Annotated[tuple[Wavelength, ...], Field(min_length=2)]
    power: Annotated[tuple[imaging.NonNegative, ...], Field(min_length=2)]

    @model_validator(mode="after")
    def _lit(self) -> Spectrum:
        if not any(self.power):
            raise ValueError(message("power_zero_every_wavelength"))
        return self


class Polariscope(imaging.ScenePart):
    """The light and the elements; plates are ideal unless `plate_wavelength_nm` is given.

    An element's error is added to its angle, in the field as in every step.

    Parameters
    ----------
    wavelength_nm : float, optional
        Wavelength of the light, nm; with several, the one for which the specimen's fringe value
        holds.
    field : {'dark', 'bright', 'plane'}, default 'dark'
        The field that the elements make.
    axis_deg : float, optional
        Azimuth of the polariser in the plane field, degrees; 90 when absent.
    bandwidth_nm : float, optional
        Width at half height of a filter's band about wavelength_nm, nm; contrast falls with order.
    plate_wavelength_nm : float, optional
        Wavelength at which the plates are a quarter of a wave, nm.
    polariser_error_deg : float, default 0.0
        Error of the polariser's angle, degrees.
    input_plate_error_deg : float, default 0.0
        Error of the first plate's angle, degrees.
    output_plate_error_deg : float, default 0.0
        Error of the second plate's angle, degrees.
    analyser_error_deg : float, default 0.0
        Error of the analyser's angle, degrees.
    light : {'white'}, optional
        White light.
    spectrum : Spectrum, optional
        A continuous spectrum.
    lines : Spectrum, optional
        Separate lines.
    step : tuple of PolariscopeStep, optional
        The frames of a phase-stepped set, in order.
    """

    wavelength_nm: Wavelength | None = None
    field: Literal["dark", "bright", "plane"] = "dark"
    axis_deg: imaging.Finite | None = None
    bandwidth_nm: Annotated[float, Field(ge=0, le=300)] | None = None
    plate_wavelength_nm: Wavelength | None = None
    polariser_error_deg: imaging.Finite = 0.0
    input_plate_error_deg: imaging.Finite = 0.0
    output_plate_error_deg: imaging.Finite = 0.0
    analyser_error_deg: imaging.Finite = 0.0
    light: Literal["white"] | None = None
    spectrum: Spectrum | None = None
    lines: Spectrum | None = None
    step: tuple[PolariscopeStep, ...] = ()

    @property
    def several_wavelengths(self) -> bool:
        """Whether the light is more than one wavelength."""
        return self.light is not None or self.spectrum is not None or self.lines is not None

    @property
    def continuous(self) -> bool:
        """Whether the light is a continuous spectrum, not one wavelength or separate lines."""
        return self.light is not None or self.spectrum is not None

    @property
    def tells_orders(self) -> bool:
        """Whether a state's frames tell its orders by themselves: by phase steps or colours."""
        return bool(self.step) or self.several_wavelengths

    @property
    def step_numbers(self) -> tuple[int | None, ...]:
        """The phase step of each of a state's frames; (None,), one frame, without steps."""
        return tuple(range(len(self.step))) or (None,)

    @property
    def frames_a_state(self) -> int:
        """Captured frames that make one state."""
        return len(self.step_numbers)

    @model_validator(mode="after")
    def _light_agrees(self) -> Polariscope:
        given = [k for k in ("light", "spectrum", "lines") if getattr(self, k) is not None]
        if len(given) > 1:
            raise ValueError(message("exclude_each_other_one", given=" and ".join(given)))
        if given and self.bandwidth_nm is not None:
            raise ValueError(message("bandwidth_nm_exclude_each_other", given=given[0]))
        for key in ("bandwidth_nm", "plate_wavelength_nm", *given):
            if getattr(self, key) is not None and self.wavelength_nm is None:
                what = "the light's" if not given else message("which_fringe_value_holds")
                raise ValueError(message("needs_wavelength_nm_add", key=key, what=what))
        return self

    @model_validator(mode="after")
    def _plane_agrees(self) -> Polariscope:
        if self.axis_deg is not None and (self.field != "plane" or self.step):
            raise ValueError(message("axis_deg_polariser_azimuth_field"))
        if self.field == "plane" and not self.step:
            for key in ("plate_wavelength_nm", "input_plate_error_deg", "output_plate_error_deg"):
                if getattr(self, key):
                    raise ValueError(message("needs_plates_field_plane", key=key))
        return self


class Numerics(imaging.ScenePart):
    """How finely the contact is computed; every default follows from the scene.

    Parameters
    ----------
    tolerance : float, default 1e-4
        Wanted relative error of pressure and depth.
    spacing_mm : float, optional
        Distance of the nodes, mm.
    window_mm : float, optional
        Width of the grid, mm.
    """

    tolerance: Annotated[float, Field(ge=1e-10, le=0.1)] = 1e-4
    spacing_mm: imaging.Positive | None = None
    window_mm: imaging.Positive | None = None
