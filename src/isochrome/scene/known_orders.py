"""Where in a frame the user knows the fringe order: points, fringe lines, free boundaries."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import acos, degrees, hypot
from typing import Annotated, Literal

from pydantic import Field, model_validator

from isochrome.scene.scene_values import NonNegative, ScenePart

Rows = Annotated[int, Field(ge=0, le=100_000)]
Place = Annotated[float, Field(ge=0, le=100_000, allow_inf_nan=False)]
"""A row or column, px, pixel centres at whole numbers."""
Outline = Annotated[float, Field(ge=-1, le=100_000, allow_inf_nan=False)]
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
                f"row_px has {len(rows)} numbers and col_px has {len(cols)}; give as many of each"
            )
        places = self.places
        same = next((i for i in range(1, len(places)) if places[i] == places[i - 1]), None)
        if same is not None:
            raise ValueError(f"points {same} and {same + 1} are the same; remove one")
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
            raise ValueError(
                f"ends where it starts after {len(self.places) - 1} points, and an outline has "
                "three corners at least; add some, or remove the last point"
            )
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
