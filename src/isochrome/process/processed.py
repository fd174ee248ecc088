"""What `process` finds in a whole set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from isochrome.fit.run import fitted_scene
from isochrome.fringes.residual import Residual
from isochrome.process.result import SPREAD, ProcessedFrame
from isochrome.scene import Scene
from isochrome.simulate import no_model_sentence

_NOTABLE = 0.02


@dataclass(frozen=True)
class Processed:
    """Processed frames: `table`, the columns of frames.csv; `frames`, None where streamed.

    `scene`, as given; `fitted`, with the frames' fitted values (means; friction over distance);
    `warnings` of the whole set; `model`, the scene's. Both are None where there is no model.
    `residual`, the residual stress that was taken out, None where nobody gave a no-load set.
    """

    scene: Scene
    model: str | None
    table: dict[str, list[Any]]
    frames: list[ProcessedFrame] | None
    fitted: Scene | None
    warnings: tuple[str, ...]
    residual: Residual | None = None


def collect(
    scene: Scene,
    rows: list[dict[str, Any]],
    frames: list[ProcessedFrame] | None,
    shape: tuple[int, int],
    residual: Residual | None = None,
) -> Processed:
    """Put the frames' rows together.

    Parameters: `scene`; `rows`, of frames.csv, one a frame; `frames`, None where they were
    streamed; `shape` (rows, cols) of the frames; `residual`, what was taken out of them. Returns
    Processed.
    """
    names = list(dict.fromkeys(name for row in rows for name in row))
    names.sort(key=lambda name: name == "warnings")
    table = {name: [row.get(name) for row in rows] for name in names}
    alone = bool(scene.polariscope.step) or scene.polariscope.several_wavelengths
    told = scene.model or alone or scene.frames.known_order
    warnings = [] if told else [no_model_sentence(scene)]
    warnings += _of_residual(scene, residual) if residual is not None else []
    warnings += [f"frame {row['frame']}: {row['warnings']}" for row in rows if row["warnings"]]
    fitted = _fitted(scene, rows, shape) if scene.model and not alone else None
    return Processed(scene, scene.model, table, frames, fitted, tuple(warnings), residual)


def _of_residual(scene: Scene, residual: Residual) -> list[str]:
    """What to say of the residual stress once, for all frames."""
    said = list(residual.warnings)
    if residual.largest > _NOTABLE:
        said.append(
            f"residual stress of up to {residual.largest:.2f} fringe ({scene.frames.no_load_steps})"
            " was taken out as a tensor: all maps are the load's alone"
        )
    return said


def _fitted(scene: Scene, rows: list[dict[str, Any]], shape: tuple[int, int]) -> Scene:
    """The scene with the means of the frames' fitted values."""
    own = [{k: {"value": row[k]} for k in row if f"{k} {SPREAD}" in row} for row in rows]
    grid = {
        "camera.pixel_mm": rows[0]["pixel_mm"],  # a disc's may come from its rim
        "camera.height_px": shape[0],
        "camera.width_px": shape[1],
    }
    return fitted_scene(scene.with_values(grid), {}, own)
