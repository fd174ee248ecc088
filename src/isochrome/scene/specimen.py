"""The specimen's table of a scene: the transparent body, its shape and its material."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, model_validator

from isochrome.scene.scene_values import Finite, Positive, ScenePart

Poisson = Annotated[float, Field(gt=-1, le=0.5, allow_inf_nan=False)]


@dataclass(frozen=True)
class Body:
    """What a specimen without a contact needs in its scene; its model is in `isochrome.specimens`.

    `needs`, the scene's keys; `height`, the specimen's key of its size along z, by which a picture
    shows it whole; `has_rim`, whether its outline is a circle of that size; `only_with`, the
    specimen's key without which frames are read from the image alone.
    """

    needs: tuple[str, ...]
    height: str
    has_rim: bool = False
    only_with: str | None = None


BODIES = {
    "disc": Body(("specimen.diameter_mm",), "diameter_mm", has_rim=True),
    "ring": Body(
        ("specimen.diameter_mm", "specimen.hole_mm"),
        "diameter_mm",
        has_rim=True,
        only_with="hole_mm",
    ),
    "beam": Body(("specimen.height_mm", "load.inner_span_mm", "load.outer_span_mm"), "height_mm"),
}
"""The specimens without a contact that have a model, by their shape."""


class Specimen(ScenePart):
    """The transparent block, disc, ring or beam. Without `shape`, a half-plane under a contact.

    Parameters
    ----------
    shape : {'block', 'disc', 'beam', 'ring', 'other'}, optional
        Its shape.
    young_gpa : float, optional
        Young's modulus, GPa.
    poisson : float, optional
        Poisson's ratio.
    plane : {'strain', 'stress'}, default 'strain'
        Whether the specimen is in plane strain or plane stress.
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
    """

    shape: Literal["block", "disc", "beam", "ring", "other"] | None = None
    young_gpa: Positive | None = None
    poisson: Poisson | None = None
    plane: Literal["strain", "stress"] = "strain"
    thickness_mm: Positive | None = None
    fringe_value_n_per_mm: Positive | None = None
    diameter_mm: Positive | None = None
    hole_mm: Positive | None = None
    height_mm: Positive | None = None
    width_mm: Positive | None = None
    left_mm: Finite | None = None
    support: Literal["fixed", "sliding"] = "fixed"

    @model_validator(mode="after")
    def _hole_inside(self) -> Specimen:
        hole, diameter = self.hole_mm, self.diameter_mm
        if hole is not None and diameter is not None and hole >= diameter:
            raise ValueError(
                f"hole_mm = {hole:g} must be less than diameter_mm = {diameter:g}; are they "
                "swapped?"
            )
        return self
