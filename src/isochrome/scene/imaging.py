"""What the parts of a scene are made of; its camera, and how its captured frames are to be read."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import acos, degrees, hypot
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar, cast

import numpy as np
import pydantic
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.scene.array_frames import ImageFile, no_escape, takes_arrays

Distance = TypeVar("Distance", float, NDArray[np.floating])
"""A distance (m), or an array of them of any shape; what is asked there has the same shape."""

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[pydantic.PositiveFloat, Field(allow_inf_nan=False)]
NonNegative = Annotated[pydantic.NonNegativeFloat, Field(allow_inf_nan=False)]
STRONGEST = 5.0
"""Friction coefficient of nothing that slides, to either side."""
Coefficient = Annotated[float, Field(ge=-STRONGEST, le=STRONGEST, allow_inf_nan=False)]


class ScenePart(BaseModel):
    """A table of the scene file: frozen, and closed to unknown keys."""

    model_config = pydantic.ConfigDict(frozen=True, extra="forbid", strict=False)
    samples: ClassVar[tuple[str, ...]] = ()
    """Keys of places, which rise, and of as many numbers there."""

    @pydantic.field_validator("*", mode="before")
    @classmethod
    def _truth_is_no_number(cls, value: Any, info: pydantic.ValidationInfo) -> Any:
        if type(value) in (float, int, str) or isinstance(value, ScenePart):
            return value  # most are: a fit checks its scene again at every step
        annotation = cls.model_fields[str(info.field_name)].annotation
        if not takes_arrays(annotation):
            value = _of_numpy(value)
        if isinstance(value, bool) and annotation is not bool:
            raise PydanticCustomError("truth", message("input_should_not_true"))
        return value

    @model_validator(mode="after")
    def _same_length_rising(self) -> Self:
        if not self.samples:
            return self
        place, *names = self.samples
        places = getattr(self, place)
        for name in names:
            count = len(getattr(self, name))
            if len(places) != count:
                text = message(
                    "has_numbers_has_give", place=place, places_count=len(places), value=name,
                    values_count=count,
                )  # fmt: skip
                raise ValueError(text)
        if any(b <= a for a, b in pairwise(places)):
            raise ValueError(message("must_rise_but_sort", place=place, places=list(places)))
        return self


def _of_numpy(value: Any) -> Any:
    """A number or array of numpy, pandas or xarray in plain Python; all else as it is."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, list | tuple):
        return type(value)(map(_of_numpy, value)) if type(value) in (list, tuple) else value
    return value.values.tolist() if hasattr(value, "dims") else value


class DistanceTable(ScenePart):
    """Values over sliding distance, linear in between and constant beyond the ends.

    Parameters
    ----------
    distance_m : tuple of float
        Distances, m, rising.
    value : tuple of float
        The values there, in the unit of the key.
    """

    samples: ClassVar[tuple[str, ...]] = ("distance_m", "value")
    distance_m: Annotated[tuple[NonNegative, ...], Field(min_length=2)]
    value: Annotated[tuple[Finite, ...], Field(min_length=2)]


class PositiveTable(DistanceTable):
    """A table of values above zero."""

    value: Annotated[tuple[Positive, ...], Field(min_length=2)]


class FrictionTable(DistanceTable):
    """A table of friction coefficients."""

    value: Annotated[tuple[Coefficient, ...], Field(min_length=2)]


class NonNegativeTable(DistanceTable):
    """A table of values of zero or more."""

    value: Annotated[tuple[NonNegative, ...], Field(min_length=2)]


NUMBER, TABLE = "<number>", "<table>"
"""Tags of the two forms of a value over distance; they do not show in a mistake's key."""


Number = TypeVar("Number")
Table = TypeVar("Table")
OverDistance = Annotated[
    Annotated[Number, Tag(NUMBER)]
    | Annotated[
        Table,
        BeforeValidator(lambda v: v.model_dump() if isinstance(v, DistanceTable) else v),
        Tag(TABLE),
    ],
    Discriminator(lambda v: TABLE if isinstance(v, dict | DistanceTable) else NUMBER),
]
"""A number, or a table of such numbers over sliding distance, which the key's own kind checks."""


def value_at(value: float | DistanceTable, distance_m: Distance) -> Distance:
    """A number, or a table's linear interpolation at a distance (m), of any shape."""
    at_distance: Any
    if isinstance(value, DistanceTable):
        at_distance = np.interp(distance_m, value.distance_m, value.value)
    else:
        at_distance = np.full(np.shape(distance_m), value, dtype=float)
    return cast(Distance, at_distance if np.ndim(distance_m) else float(at_distance))


_MOST_PX = 100_000
"""Rows or columns of a picture."""
Rows = Annotated[pydantic.NonNegativeInt, Field(le=_MOST_PX)]
Place = Annotated[NonNegative, Field(le=_MOST_PX)]
"""A row or column, px, pixel centres at whole numbers."""
Outline = Annotated[Finite, Field(ge=-1, le=_MOST_PX)]
"""The same of an outline, which may run along the picture's edge."""
_BLUNTEST_DEG = 110.0
"""Interior angle below which a corner of an outline is sharp; drawn round, a disc has larger ones.
Below 126 degrees stress falls to nought at a free corner faster than the distance from it."""
_SHORTEST_SIDE_PX = 26.0
"""Of a sharp corner, two patches: shorter ones are steps of a traced outline."""


class KnownOrder(ScenePart):
    """A pixel of the region of interest whose fringe order the user knows.

    Parameters
    ----------
    row_px : int
        Its row, px.
    col_px : int
        Its column, px.
    order : float
        The order, fringes.
    extremum : {'maximum', 'minimum'}, optional
        Whether it is the highest or the lowest of its surroundings, such as in the middle of closed
        rings: on a fringe line no light can tell.
    """

    row_px: Rows
    col_px: Rows
    order: NonNegative
    extremum: Literal["maximum", "minimum"] | None = None


class _Path(ScenePart):
    """Two or more places in the region of interest, in order."""

    @model_validator(mode="after")
    def _pairs_apart(self) -> _Path:
        rows, cols = self.row_px, self.col_px
        if len(rows) != len(cols):
            raise ValueError(
                message("row_px_has_numbers_col_px", rows_count=len(rows), cols_count=len(cols))
            )
        places = self.places
        same = next((i for i in range(1, len(places)) if places[i] == places[i - 1]), None)
        if same is not None:
            raise ValueError(message("points_same_remove_one", same=same, same_2=same + 1))
        return self

    row_px: tuple[float, ...]
    col_px: tuple[float, ...]

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """The places as (row, col), px."""
        return tuple(zip(self.row_px, self.col_px, strict=True))


class KnownLine(_Path):
    """A fringe line whose order the user knows: the order along it, and not which side is higher.

    Parameters
    ----------
    row_px : tuple of float
        Rows of places on it, px.
    col_px : tuple of float
        Their columns, px.
    order : float
        The order, whole or half, fringes.
    """

    row_px: Annotated[tuple[Place, ...], Field(min_length=2)]
    col_px: Annotated[tuple[Place, ...], Field(min_length=2)]
    order: Annotated[float, Field(ge=0, multiple_of=0.5, allow_inf_nan=False)]


@dataclass(frozen=True)
class FreeCorner:
    """A sharp outward corner of a free outline, where every stress and so the order is nought.

    Parameters
    ----------
    row : float
        Its row, px.
    col : float
        Its column, px.
    inward : tuple of float
        The unit vector (row, col) along its bisector, into the specimen.
    angle_deg : float
        The specimen's angle, degrees.
    """

    row: float
    col: float
    inward: tuple[float, float]
    angle_deg: float


class FreeBoundary(_Path):
    """A part of the specimen's outline on which nothing presses; closed where it ends at its start.

    No stress acts across it: the order along it is the tangential stress's, and is not known. At a
    sharp outward corner two sides leave none, and N = 0 (Williams (1952), J. Appl. Mech. 19, 526).
    Pixels outside of a closed one are no specimen.

    Parameters
    ----------
    row_px : tuple of float
        Rows of its corners, px.
    col_px : tuple of float
        Their columns, px.
    """

    row_px: Annotated[tuple[Outline, ...], Field(min_length=2)]
    col_px: Annotated[tuple[Outline, ...], Field(min_length=2)]

    @model_validator(mode="after")
    def _closed_area(self) -> FreeBoundary:
        if self.is_closed and len(self.places) < 4:
            raise ValueError(message("ends_where_starts_after", places_count=len(self.places) - 1))
        return self

    @property
    def is_closed(self) -> bool:
        """Whether it is the whole outline."""
        return self.places[0] == self.places[-1]

    @property
    def corners(self) -> tuple[FreeCorner, ...]:
        """Its sharp outward corners; of an open one the specimen lies inside the sharp angle."""
        places = self.places
        ring = [*places, places[1]] if self.is_closed else places
        pairs = pairwise(places)
        area = sum(a[0] * b[1] - a[1] * b[0] for a, b in pairs) if self.is_closed else 0.0
        sharp = []
        for before, at, after in zip(ring, ring[1:], ring[2:], strict=False):
            a, b = ((p[0] - at[0], p[1] - at[1]) for p in (before, after))
            size = hypot(*a), hypot(*b)
            inward = a[0] / size[0] + b[0] / size[1], a[1] / size[0] + b[1] / size[1]
            cosine = (a[0] * b[0] + a[1] * b[1]) / (size[0] * size[1])
            angle = degrees(acos(max(-1.0, min(1.0, cosine))))
            into_specimen = area * (b[0] * a[1] - b[1] * a[0]) < 0.0
            if angle >= _BLUNTEST_DEG or min(size) < _SHORTEST_SIDE_PX or into_specimen:
                continue
            length = hypot(*inward)
            sharp.append(FreeCorner(*at, (inward[0] / length, inward[1] / length), angle))
        return tuple(sharp)


Pixels = Annotated[int, Field(ge=1, le=_MOST_PX)]
Exponent = Annotated[float, Field(ge=0.1, le=10)]
Bend = Annotated[float, Field(ge=-0.1, le=0.1)]
FileName = Annotated[str, Field(min_length=1), pydantic.AfterValidator(no_escape)]


class Camera(ScenePart):
    """The pixel grid, and what the sensor does to the light; ideal where absent.

    Parameters
    ----------
    width_px : int, optional
        Columns.
    height_px : int, optional
        Rows.
    left_mm : float, optional
        Outer edge of the first column, from the middle of the contact or specimen, mm.
    top_mm : float, optional
        Outer edge of the first row, below the surface (a disc's, ring's or beam's top), mm.
    pixel_mm : float, optional
        Side of a square pixel, mm.
    roll_deg : float, default 0.0
        How far the picture is turned about its middle, counter-clockwise, degrees.
    distortion : float, default 0.0
        Displacement in the corners by the lens over their distance from the middle; barrel < 0.
    keystone_x : float, default 0.0
        Displacement at the middle of the right edge over its distance, by a camera that looks from
        the side.
    keystone_z : float, default 0.0
        The same at the middle of the lower edge, by one that looks from above or below.
    focus_mm : float, default 0.0
        Distance of the plane in focus from that in which light seems to come from the stress that
        it met, near the middle of the plate, towards the camera, mm: else bent light comes from
        another place.
    bit_depth : int, optional
        Bits of a grey level.
    brightness : float, default 1.0
        Full light, as a part of full scale.
    background : float, default 0.0
        Stray light, as a part of full scale.
    vignette : float, default 0.0
        Part of the light that is lost in the corners.
    gamma : float, default 1.0
        The camera stores light^(1/gamma).
    blur_px : float, default 0.0
        Standard deviation of the Gaussian blur, px.
    noise_grey : float, default 0.0
        Standard deviation of the noise, grey levels.
    full_well_electrons : float, optional
        Electrons at full scale, for shot noise.
    colour : bool, default False
        Whether there are red, green and blue channels.
    response : str, optional
        CSV file with the sensor's response over wavelength: wavelength_nm, and red, green, blue (or
        grey without `colour`).
    seed : int, default 0
        Seed of the noise.
    """

    width_px: Pixels | None = None
    height_px: Pixels | None = None
    left_mm: Finite | None = None
    top_mm: Finite | None = None
    pixel_mm: Positive | None = None
    roll_deg: Annotated[float, Field(ge=-45, le=45)] = 0.0
    distortion: Bend = 0.0
    keystone_x: Bend = 0.0
    keystone_z: Bend = 0.0
    focus_mm: Finite = 0.0
    bit_depth: Annotated[int, Field(ge=1, le=16)] | None = None
    brightness: Annotated[float, Field(gt=0, le=10)] = 1.0
    background: Annotated[NonNegative, Field(le=1)] = 0.0
    vignette: Annotated[float, Field(ge=0, lt=1)] = 0.0
    gamma: Exponent = 1.0
    blur_px: Annotated[float, Field(ge=0, le=100)] = 0.0
    noise_grey: Annotated[float, Field(ge=0, le=65535)] = 0.0
    full_well_electrons: Positive | None = None
    colour: bool = False
    response: FileName | None = None
    seed: Annotated[int, Field(ge=0)] = 0


class Roi(ScenePart):
    """The part of the captured frame that the camera grid stands for.

    Parameters
    ----------
    top_px : int, default 0
        First row, px.
    left_px : int, default 0
        First column, px.
    height_px : int
        Rows, px.
    width_px : int
        Columns, px.
    """

    top_px: Rows = 0
    left_px: Rows = 0
    height_px: Pixels
    width_px: Pixels


class Frames(ScenePart):
    """How the captured frames are to be read; paths are relative to the scene file.

    In Python an image may be given as an array in place of its file.

    A picture that lies otherwise than the scene is turned, then mirrored, before anything else:
    roi, mask, known orders and the angles of plates are those of the turned picture, and no-load
    frames are turned alike. Where both `mask` and `polygon_px` are given, the specimen is inside
    both.

    Parameters
    ----------
    rotate_deg : {0, 90, 180, 270}, default 0
        Quarter turns of the captured picture, counter-clockwise as it is seen, degrees.
    flip : {'horizontal', 'vertical'}, optional
        How the turned picture is mirrored: left to right, or top to bottom.
    roi : Roi, optional
        The part of the frame that the camera's grid stands for.
    mask : str or array_like, optional
        An image of the frame's or the region's size, nonzero = specimen, or ImageJ rois drawn on
        the full frame.
    polygon_px : tuple of tuple of float, optional
        Corners (row, col) of the specimen in the region of interest, pixel centres at whole
        numbers.
    no_load_dark : str or array_like, optional
        The unloaded specimen in the dark field: the background.
    no_load_bright : str or array_like, optional
        The unloaded specimen in the bright field: the illumination.
    no_load_exposure : {'unknown', 'same'}, default 'unknown'
        Whether both are exposed and lit as the frames are: 'same'; else a frame's fringes tell, or
        it is said.
    no_load_steps : str or array_like, optional
        A phase-stepped set of the unloaded specimen, one frame a [[polariscope.step]]: its residual
        stress is taken out.
    gamma : float or {'unknown'}, default 1.0
        The camera stored light^(1/gamma); an unknown one is found from the fringes of single
        frames.
    channel : {'red', 'green', 'blue', 'mean'}, optional
        The channel of colour frames that is read.
    colour_table : str, optional
        CSV file of the channels' signals against order, in place of a spectrum.
    sliding_speed_mm_per_s : float, optional
        Sliding speed of a video, mm/s: distance from the frames' times.
    starts_unloaded : bool, default False
        Whether the first frame of a film without a model shows the specimen without load: orders
        are then counted from zero, pixel by pixel, through its frames.
    known_order : tuple of KnownOrder, optional
        Orders that the user knows, those of the frame, residual stress included.
    known_line : tuple of KnownLine, optional
        Fringe lines whose order the user knows, of single frames.
    free_boundary : tuple of FreeBoundary, optional
        Parts of the outline that are free of load: their sharp corners are of order 0, and outside
        of a closed one there is no specimen.
    known_loads_n : tuple of float, optional
        Of a disc that holds stress without load: the measured load of each frame (N), in their
        order, 0 where it is not known. A frame's load is read against the others of known load.
    """

    # angles are written with a point elsewhere: 90.0 is 90
    rotate_deg: Annotated[
        Literal[0, 90, 180, 270],
        BeforeValidator(lambda v: int(v) if isinstance(v, float) and v.is_integer() else v),
    ] = 0
    flip: Literal["horizontal", "vertical"] | None = None
    roi: Roi | None = None
    mask: ImageFile | None = None
    polygon_px: Annotated[tuple[tuple[Finite, Finite], ...], Field(min_length=3)] | None = None
    no_load_dark: ImageFile | None = None
    no_load_bright: ImageFile | None = None
    no_load_exposure: Literal["unknown", "same"] = "unknown"
    no_load_steps: ImageFile | None = None
    gamma: Annotated[
        Annotated[Exponent, Tag(NUMBER)] | Annotated[Literal["unknown"], Tag("unknown")],
        Discriminator(lambda value: value if value == "unknown" else NUMBER),
    ] = 1.0
    channel: Literal["red", "green", "blue", "mean"] | None = None
    colour_table: FileName | None = None
    sliding_speed_mm_per_s: Positive | None = None
    starts_unloaded: bool = False
    known_order: tuple[KnownOrder, ...] = ()
    known_line: tuple[KnownLine, ...] = ()
    free_boundary: tuple[FreeBoundary, ...] = ()
    known_loads_n: tuple[NonNegative, ...] = ()

    @property
    def stated_orders(self) -> tuple[float, ...]:
        """The orders that are known somewhere in the frames: points, lines, free corners."""
        points, lines = self.known_order, self.known_line
        corners = (0.0,) if any(b.corners for b in self.free_boundary) else ()
        return (*(k.order for k in points), *(k.order for k in lines), *corners)

    @property
    def orders_known(self) -> bool:
        """Whether an order is known anywhere in the frames."""
        return self.starts_unloaded or bool(self.stated_orders)

    @property
    def has_known_loads(self) -> bool:
        """Whether each frame's load is read against others of known load."""
        return bool(self.known_loads_n)

    @property
    def first_gamma(self) -> float:
        """The exponent to linearise by at first: 1 where it is unknown."""
        return 1.0 if isinstance(self.gamma, str) else self.gamma

    @property
    def stated_gamma(self) -> float:
        """The exponent, for those who cannot find it; InputError where it is unknown."""
        if isinstance(self.gamma, str):
            raise InputError("frames_gamma_unknown_process")
        return self.gamma
