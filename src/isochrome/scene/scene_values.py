"""What the parts of a scene are made of: the table, its numbers, and values over distance."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, cast

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from isochrome.messages import message
from isochrome.scene.array_frames import takes_arrays

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.floating]

Distance = TypeVar("Distance", float, "Floats")
"""A distance (m), or an array of them of any shape; what is asked there has the same shape."""

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Coefficient = Annotated[float, Field(ge=-5, le=5, allow_inf_nan=False)]


class ScenePart(BaseModel):
    """A table of the scene file: frozen, and closed to unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)

    @field_validator("*", mode="before")
    @classmethod
    def _truth_is_no_number(cls, value: Any, info: ValidationInfo) -> Any:
        annotation = cls.model_fields[str(info.field_name)].annotation
        wants_truth = annotation is bool
        if not takes_arrays(annotation):
            value = _of_numpy(value)
        if isinstance(value, bool) and not wants_truth:
            raise PydanticCustomError("truth", message("input_should_not_true"))
        return value


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

    distance_m: Annotated[tuple[NonNegative, ...], Field(min_length=2)]
    value: Annotated[tuple[Finite, ...], Field(min_length=2)]

    @model_validator(mode="after")
    def _same_length_rising(self) -> DistanceTable:
        check_samples(self, "distance_m", "value")
        return self


class PositiveTable(DistanceTable):
    """A table of values above zero."""

    value: Annotated[tuple[Positive, ...], Field(min_length=2)]


class FrictionTable(DistanceTable):
    """A table of friction coefficients."""

    value: Annotated[tuple[Coefficient, ...], Field(min_length=2)]


class NonNegativeTable(DistanceTable):
    """A table of values of zero or more."""

    value: Annotated[tuple[NonNegative, ...], Field(min_length=2)]


def check_samples(part: ScenePart, place: str, value: str) -> None:
    """Refuse samples of which one number has no partner, or whose places do not rise."""
    places, values = getattr(part, place), getattr(part, value)
    if len(places) != len(values):
        raise ValueError(
            message(
                "has_numbers_has_give",
                place=place,
                places_count=len(places),
                value=value,
                values_count=len(values),
            )
        )
    if any(b <= a for a, b in pairwise(places)):
        raise ValueError(message("must_rise_but_sort", place=place, places=list(places)))


NUMBER, TABLE = "<number>", "<table>"
"""Tags of the two forms of a value over distance; they do not show in a mistake's key."""


def form(value: Any) -> str:
    """Which of the two forms a value over distance has."""
    return TABLE if isinstance(value, dict | DistanceTable) else NUMBER


def as_dict(value: Any) -> Any:
    """Any table as a dictionary, so that the key's own kind of table checks its values."""
    return value.model_dump() if isinstance(value, DistanceTable) else value


Number = TypeVar("Number")
Table = TypeVar("Table")
OverDistance = Annotated[
    Annotated[Number, Tag(NUMBER)] | Annotated[Table, BeforeValidator(as_dict), Tag(TABLE)],
    Discriminator(form),
]
"""A number, or a table of such numbers over sliding distance."""


def value_at(value: float | DistanceTable, distance_m: Distance) -> Distance:
    """A number, or a table's linear interpolation at a distance (m), constant beyond its ends.

    Of any shape. A search puts an array of its own rows for the number, and asks at as many
    distances.
    """
    import numpy as np

    at_distance: Any
    if isinstance(value, DistanceTable):
        at_distance = np.interp(distance_m, value.distance_m, value.value)
    else:
        at_distance = np.full(np.shape(distance_m), value, dtype=float)
    return cast(Distance, at_distance if np.ndim(distance_m) else float(at_distance))
