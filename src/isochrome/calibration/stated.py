"""Uncertainties that stand beside a calibration set's values, as inputs of its budget."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import BaseModel

from isochrome.scene import plain_value, split_uncertainties

_INPUTS = {
    "beam.thickness_mm": "thickness_mm",
    "beam.height_mm": "height_mm",
    "disc.thickness_mm": "thickness_mm",
    "disc.diameter_mm": "diameter_mm",
    "camera.pixel_mm": "pixel_mm",
}
"""Keys of a set, and those of [uncertainty] that mean the same."""

_SPANS = ("beam.inner_span_mm", "beam.outer_span_mm")
_LOAD = "image.load_n"


def with_stated(model: type[BaseModel], data: dict[str, Any]) -> dict[str, Any]:
    """A set's tables with plain values, and what stood beside them under [uncertainty].

    Parameters: `model` of the set; `data`, its tables. Raises ValueError for what is stated twice,
    and for a key that is no input of the budget.
    """
    plain, stated = split_uncertainties(model, data)
    images, loads = _loads(plain.get("image"))
    found = {}
    for key, spread in stated.items():
        if key not in _INPUTS and key not in _SPANS:
            raise ValueError(
                f"{key} is no input of a calibration's budget; only {', '.join(_INPUTS)}, "
                f"{', '.join(_SPANS)} and {_LOAD} have a standard_uncertainty; give a plain value"
            )
        if key in _INPUTS:
            found[_INPUTS[key]] = spread
    spans = [stated[key] for key in _SPANS if key in stated]
    if spans:
        # of each span, such that both together are as uncertain as stated
        found["span_mm"] = float(np.sqrt(np.sum(np.square(spans)) / len(_SPANS)))
    if loads:
        found["load_percent"] = 100.0 * float(np.sqrt(np.mean(np.square(loads))))
    if not found:
        return plain
    own = plain.get("uncertainty")
    given = own if isinstance(own, dict) else own.model_dump(exclude_none=True) if own else {}
    for key in found:
        if key in given:
            raise ValueError(f"uncertainty.{key} is stated beside its value too; remove one")
    return plain | {"uncertainty": given | found, "image": images}


def _loads(images: Any) -> tuple[Any, list[float]]:
    """The images with plain loads, and the loads' relative uncertainties where they are stated."""
    if not isinstance(images, list | tuple):
        return images, []
    plain, found = [], []
    for number, image in enumerate(images, start=1):
        load = image.get("load_n") if isinstance(image, dict) else None
        if isinstance(load, dict):
            value, spread = plain_value(f"image[{number}].load_n", load)
            image = image | {"load_n": value}
            if isinstance(value, int | float) and value > 0:
                found.append(spread / value)
        plain.append(image)
    return plain, found
