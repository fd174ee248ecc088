"""The parts of a scene: what stood in front of the camera, and nothing else.

Each part is one table of the scene file. A part that is absent is not modelled. The unit of
every number stands in its key. Sources of the conventions: x along the surface to the right,
z into the specimen, downward; stress positive in tension; angles counter-clockwise from the
image's +x, as the camera sees them.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from isochrome.errors import InputError
from isochrome.scene.specimen import Poisson
from isochrome.scene.tables import (
    NUMBER,
    TABLE,
    Coefficient,
    Finite,
    FrictionTable,
    NonNegative,
    NonNegativeTable,
    Part,
    Positive,
    PositiveTable,
    as_dict,
    form,
)

Fraction = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Wavelength = Annotated[float, Field(ge=200, le=3000)]
Pixels = Annotated[int, Field(ge=1, le=100_000)]
Exponent = Annotated[float, Field(ge=0.1, le=10)]
FileName = Annotated[str, Field(min_length=1)]
Rows = Annotated[int, Field(ge=0, le=100_000)]


class Indenter(Part):
    """The sliding body: a cylinder, a flat with corners, or a profile (CSV), alone or added."""

    shape: Literal["cylinder", "flat"] = "cylinder"
    radius_mm: Positive | None = None
    half_width_mm: Positive | None = None
    profile: FileName | None = None
    young_gpa: Positive
    poisson: Poisson

    @model_validator(mode="after")
    def _one_shape(self) -> Indenter:
        if self.profile is None:
            if self.shape == "cylinder" and self.radius_mm is None:
                raise ValueError("a cylinder needs radius_mm; add it, or set shape = 'flat'")
            if self.shape == "flat" and self.half_width_mm is None:
                raise ValueError("shape = 'flat' needs half_width_mm; add it")
        return self


class Load(Part):
    """The forces: normal (diametral; or the whole bending load), tangential, bulk stress, spans.

    The normal load of a contact is a number, or a table over distance. The bulk stress acts along
    x at the contact's centre; `bulk_along_x_mpa_per_mm`, `bulk_along_z_mpa_per_mm` say how it
    changes from there along the surface and with depth (bending).
    """

    normal_n: Annotated[
        Annotated[Positive, Tag(NUMBER)]
        | Annotated[PositiveTable, BeforeValidator(as_dict), Tag(TABLE)],
        Discriminator(form),
    ]
    tangential_n: Finite | None = None
    bulk_mpa: Finite | None = None
    bulk_along_x_mpa_per_mm: Finite | None = None
    bulk_along_z_mpa_per_mm: Finite | None = None
    inner_span_mm: Positive | None = None
    outer_span_mm: Positive | None = None


class Friction(Part):
    """Coulomb friction, q = mu p along +x; a number, or a table over distance."""

    coefficient: Annotated[
        Annotated[Coefficient, Tag(NUMBER)]
        | Annotated[FrictionTable, BeforeValidator(as_dict), Tag(TABLE)],
        Discriminator(form),
    ]
    static_state_first: bool = False


class Wear(Part):
    """Wear of the specimen, dh = kappa p ds, with frames wanted at `distances_m`.

    The coefficient k is a number, or a table over distance (running-in). With `law` 'archard'
    kappa = k; 'sarkar', k sqrt(1 + 3 mu²); 'dissipated_energy', k |mu|, where k is the worn volume
    per dissipated energy (1 mm³/J is 1e-3 mm²/N).
    """

    coefficient_mm2_per_n: Annotated[
        Annotated[NonNegative, Tag(NUMBER)]
        | Annotated[NonNegativeTable, BeforeValidator(as_dict), Tag(TABLE)],
        Discriminator(form),
    ]
    law: Literal["archard", "sarkar", "dissipated_energy"] = "archard"
    distances_m: Annotated[tuple[NonNegative, ...], Field(min_length=1)]


class PolariscopeStep(Part):
    """The elements' angles for one frame of a phase-stepped set; no plates: a plane polariscope."""

    polariser_deg: Finite
    input_plate_deg: Finite | None = None
    output_plate_deg: Finite | None = None
    analyser_deg: Finite

    @model_validator(mode="after")
    def _both_plates(self) -> PolariscopeStep:
        if (self.input_plate_deg is None) != (self.output_plate_deg is None):
            raise ValueError(
                "give both input_plate_deg and output_plate_deg (circular) or neither (plane)"
            )
        return self


class Spectrum(Part):
    """Power over wavelength: separate lines, or samples of a spectrum linear in between."""

    wavelength_nm: Annotated[tuple[Wavelength, ...], Field(min_length=2)]
    power: Annotated[tuple[NonNegative, ...], Field(min_length=2)]

    @model_validator(mode="after")
    def _same_length_rising_and_lit(self) -> Spectrum:
        if len(self.wavelength_nm) != len(self.power):
            raise ValueError(
                f"wavelength_nm has {len(self.wavelength_nm)} numbers and power has "
                f"{len(self.power)}; give as many of each"
            )
        if any(b <= a for a, b in zip(self.wavelength_nm, self.wavelength_nm[1:], strict=False)):
            raise ValueError(f"wavelength_nm must rise, but is {list(self.wavelength_nm)}; sort it")
        if not any(self.power):
            raise ValueError("power is zero at every wavelength; give the light some")
        return self


class Polariscope(Part):
    """The light and the elements; plates are ideal unless `plate_wavelength_nm` is given.

    `axis_deg` is the polariser's azimuth in the plane field (90 when absent). An element's error
    is added to its angle, in the field as in every step. With several wavelengths
    `wavelength_nm` is the one for which the specimen's fringe value holds.
    """

    wavelength_nm: Wavelength | None = None
    field: Literal["dark", "bright", "plane"] = "dark"
    axis_deg: Finite | None = None
    plate_wavelength_nm: Wavelength | None = None
    polariser_error_deg: Finite = 0.0
    input_plate_error_deg: Finite = 0.0
    output_plate_error_deg: Finite = 0.0
    analyser_error_deg: Finite = 0.0
    light: Literal["white"] | None = None
    spectrum: Spectrum | None = None
    lines: Spectrum | None = None
    step: tuple[PolariscopeStep, ...] = ()

    @property
    def several_wavelengths(self) -> bool:
        """Whether the light is more than one wavelength."""
        return self.light is not None or self.spectrum is not None or self.lines is not None

    @model_validator(mode="after")
    def _light_agrees(self) -> Polariscope:
        given = [k for k in ("light", "spectrum", "lines") if getattr(self, k) is not None]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} exclude each other: one light; remove one")
        for key in ("plate_wavelength_nm", *given):
            if getattr(self, key) is not None and self.wavelength_nm is None:
                what = "the light's" if not given else "at which the fringe value holds"
                raise ValueError(f"{key} needs wavelength_nm, {what}; add it")
        return self

    @model_validator(mode="after")
    def _plane_agrees(self) -> Polariscope:
        if self.axis_deg is not None and (self.field != "plane" or self.step):
            raise ValueError(
                "axis_deg is the polariser's azimuth of field = 'plane' alone (without steps); "
                "remove it, or set field = 'plane'"
            )
        if self.field == "plane" and not self.step:
            for key in ("plate_wavelength_nm", "input_plate_error_deg", "output_plate_error_deg"):
                if getattr(self, key):
                    raise ValueError(f"{key} needs plates, and field = 'plane' has none; remove it")
        return self


class Camera(Part):
    """The pixel grid, and what the sensor does to the light; ideal where absent.

    `colour` gives red, green and blue channels. `response` names a CSV file with the sensor's
    response over wavelength: wavelength_nm, and red, green, blue (or grey without `colour`).
    """

    width_px: Pixels | None = None
    height_px: Pixels | None = None
    left_mm: Finite | None = None
    top_mm: Finite | None = None
    pixel_mm: Positive | None = None
    bit_depth: Annotated[int, Field(ge=1, le=16)] | None = None
    brightness: Annotated[float, Field(gt=0, le=10)] = 1.0
    background: Fraction = 0.0
    vignette: Annotated[float, Field(ge=0, lt=1)] = 0.0
    gamma: Exponent = 1.0
    blur_px: Annotated[float, Field(ge=0, le=100)] = 0.0
    noise_grey: Annotated[float, Field(ge=0, le=65535)] = 0.0
    full_well_electrons: Positive | None = None
    colour: bool = False
    response: FileName | None = None
    seed: Annotated[int, Field(ge=0)] = 0


class Roi(Part):
    """The part of the captured frame that the camera grid stands for, in pixels."""

    top_px: Rows = 0
    left_px: Rows = 0
    height_px: Pixels
    width_px: Pixels


class KnownOrder(Part):
    """A pixel of the region of interest whose fringe order the user knows."""

    row_px: Rows
    col_px: Rows
    order: NonNegative


class Frames(Part):
    """How the captured frames are to be read; paths are relative to the scene file.

    `mask` (an image of the frame's or the region's size, nonzero = specimen, or ImageJ rois drawn
    on the full frame) and `polygon_px`, corners (row, col) in the region of interest, pixel centres
    at whole numbers, say where the specimen is; where both are given, inside both. `no_load_steps`
    names a phase-stepped set of the unloaded specimen, one frame a [[polariscope.step]]: its
    residual stress is taken out. A `known_order` is that of the frame, residual stress included.
    An unknown `gamma` is found from the fringes of single frames.
    `colour_table` names a CSV file of the channels' signals against order, in place of a spectrum.
    """

    roi: Roi | None = None
    mask: FileName | None = None
    polygon_px: Annotated[tuple[tuple[Finite, Finite], ...], Field(min_length=3)] | None = None
    no_load_dark: FileName | None = None
    no_load_bright: FileName | None = None
    no_load_steps: FileName | None = None
    gamma: Annotated[
        Annotated[Exponent, Tag(NUMBER)] | Annotated[Literal["unknown"], Tag("unknown")],
        Discriminator(lambda value: value if value == "unknown" else NUMBER),
    ] = 1.0
    channel: Literal["red", "green", "blue", "mean"] | None = None
    colour_table: FileName | None = None
    sliding_speed_mm_per_s: Positive | None = None
    known_order: tuple[KnownOrder, ...] = ()

    @property
    def first_gamma(self) -> float:
        """The exponent to linearise by at first: 1 where it is unknown."""
        return 1.0 if isinstance(self.gamma, str) else self.gamma

    @property
    def stated_gamma(self) -> float:
        """The exponent, for those who cannot find it; InputError where it is unknown."""
        if isinstance(self.gamma, str):
            raise InputError(
                "frames.gamma = 'unknown': `process` and `fit` find it from single frames in light "
                "of one wavelength; here, give a number (2.2 for most photographs)"
            )
        return self.gamma


class Numerics(Part):
    """How finely the contact is computed; every default follows from the scene."""

    tolerance: Annotated[float, Field(ge=1e-10, le=0.1)] = 1e-4
    spacing_mm: Positive | None = None
    window_mm: Positive | None = None
