"""The specimen's table of a scene: the transparent body, its shape and its material."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from isochrome.scene.tables import Finite, Part, Positive

Poisson = Annotated[float, Field(gt=-1, le=0.5, allow_inf_nan=False)]

WITHOUT_MODEL = ("ring", "other")
"""Specimen shapes that the image-only commands take, but that have no closed form here."""


class Specimen(Part):
    """The transparent block, disc or beam. Without `shape` it is a half-plane under a contact.

    A block is `width_mm` by `height_mm`, its left side at x = `left_mm` from the contact's centre
    (absent: in the middle), its lower side fixed or on a `support` that it slides on.
    """

    shape: Literal["block", "disc", "beam", "ring", "other"] | None = None
    young_gpa: Positive | None = None
    poisson: Poisson | None = None
    plane: Literal["strain", "stress"] = "strain"
    thickness_mm: Positive | None = None
    fringe_value_n_per_mm: Positive | None = None
    diameter_mm: Positive | None = None
    height_mm: Positive | None = None
    width_mm: Positive | None = None
    left_mm: Finite | None = None
    support: Literal["fixed", "sliding"] = "fixed"
