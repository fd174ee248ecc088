"""`fit`: a scene's unknowns from captured frames, each with its standard uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.fit.figure import fit_figure
from isochrome.fit.frame_data import FrameData, prepare_frame
from isochrome.fit.frame_fit import placed
from isochrome.fit.joint import JointFit, fit_jointly
from isochrome.fit.one_state import frame_scene
from isochrome.frames import load_no_load, open_scene_frames
from isochrome.output import provenance, staged, write_csv, write_figure, write_json, write_text
from isochrome.progress import Progress
from isochrome.scene import DistanceTable, Scene, dump_scene, load_scene
from isochrome.simulate import no_model_sentence

_SAME_EFFECT = {
    "specimen.fringe_value_n_per_mm": "only load over fringe value sets the fringe order",
    "specimen.thickness_mm": "only load and thickness together set the fringe order",
    "camera.pixel_mm": "a larger pixel and a larger load spread the fringes alike",
}
"""Keys that cannot be told from the load, and why."""

_ALIKE = 0.9995
_PLACE = ("camera.left_mm", "camera.top_mm")


@dataclass(frozen=True)
class Fit:
    """Fitted unknowns.

    `shared`, key to {value, standard_uncertainty} of what all frames share; `frames`, the same for
    each frame's own; `chi`, residual over noise over all frames; `scene`, with the fitted values;
    `warnings` in plain words.
    """

    shared: dict[str, dict[str, float]]
    frames: list[dict[str, dict[str, float]]]
    chi: float
    scene: Scene
    warnings: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """The result as `--json` prints it; a single frame's own unknowns stand at the top too."""
        top: dict[str, Any] = dict(self.shared)
        if len(self.frames) == 1:
            top |= self.frames[0]
        top |= {"chi": self.chi, "warnings": list(self.warnings)}
        return top | {"frames": [{"frame": i, **own} for i, own in enumerate(self.frames)]}


def fit(
    frames: str | Path,
    scene: str | Path | Scene,
    free: list[str] | tuple[str, ...],
    *,
    per_frame: list[str] | tuple[str, ...] = (),
    out: str | Path | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fit unknowns of a scene, named by their keys, to the intensities of captured frames.

    Parameters: `frames`, one a state; `scene`, where the fit starts; `free`, keys that all frames
    share, such as 'load.normal_n'; `per_frame`, keys with a value a frame; `out`, a folder for
    fit.csv, scene.toml (fitted), provenance.json and fit.png; `progress`, called with (done, all).
    Returns a Fit. Raises InputError for unknown keys and those that cannot be told apart,
    PhysicsError where the frames do not hold the scene's fringes.
    """
    scene = load_scene(scene)
    shared, own = tuple(free), tuple(per_frame)
    _refuse(scene, shared, own)
    data, scenes = _read(frames, scene)
    if progress is not None:
        progress(0, 1)
    joint = (
        fit_jointly(data, scenes, shared, own)
        if shared or len(data) == 1
        else _merged([fit_jointly([d], [s], (), own) for d, s in zip(data, scenes, strict=True)])
    )
    _refuse_alike(joint)
    result = _result(scene, joint, len(data))
    if out is not None:
        with staged(out) as folder:
            write_csv(folder / "fit.csv", _table(result))
            write_text(folder / "scene.toml", dump_scene(result.scene))
            write_json(folder / "fit.json", result.to_json())
            write_json(folder / "provenance.json", provenance(dump_scene(scene), [Path(frames)]))
            write_figure(folder / "fit.png", fit_figure(scene.name, data, list(joint.scenes)))
    if progress is not None:
        progress(1, 1)
    return result


def _refuse(scene: Scene, shared: tuple[str, ...], own: tuple[str, ...]) -> None:
    """Refuse keys that are unknown, doubled, or have the same effect as the load."""
    if scene.model is None:
        raise InputError(no_model_sentence(scene))
    keys = shared + own
    if not keys:
        raise InputError("nothing to fit; name a key with --free, such as --free load.normal_n")
    for key in keys:
        _refuse_unfitted(scene, key)
        if keys.count(key) > 1:
            raise InputError(f"{key} is named twice; name it once, shared or per frame")
    for key, reason in _SAME_EFFECT.items():
        if key in keys and "load.normal_n" in keys:
            raise InputError(
                f"load.normal_n and {key} cannot both be free: {reason}; fix one of them"
            )


def _refuse_unfitted(scene: Scene, key: str) -> None:
    """Refuse a key that is no number, or that does not change the simulated fringes."""
    value = scene.get(key)
    if key in _PLACE:
        return
    if isinstance(value, DistanceTable) and key != "friction.coefficient":
        raise InputError(
            f"{key} cannot be fitted: it is a table over distance in this scene; give it as a "
            "number, or leave it out"
        )
    law = scene.wear.law if scene.wear else "archard"
    if key in ("friction.coefficient", "wear.coefficient_mm2_per_n") and law != "archard":
        _refuse_unfitted_law(scene, key, law)
    if key.split(".")[0] in ("camera", "frames", "numerics") and key != "camera.pixel_mm":
        raise InputError(
            f"{key} cannot be fitted: the fringes' orders do not follow it; of the camera only "
            f"{', '.join(_PLACE)} can be free"
        )
    if key == "camera.pixel_mm" and scene.model == "contact":
        raise InputError(
            "camera.pixel_mm of a contact cannot be fitted: the surface grid is made for it; "
            "measure it on a scale in the picture's plane"
        )
    if isinstance(value, bool) or not isinstance(value, int | float | DistanceTable):
        raise InputError(
            f"{key} = {value!r} cannot be fitted: it is no number in this scene; give it one, or "
            "leave it out"
        )


def _refuse_unfitted_law(scene: Scene, key: str, law: str) -> None:
    """Refuse a key where the depth follows a course of friction that no single frame tells."""
    if scene.friction and isinstance(scene.friction.coefficient, DistanceTable):
        raise InputError(
            f"{key} cannot be fitted: with wear.law = '{law}' the depth follows the whole course "
            "of friction.coefficient; give that as a number, or set wear.law = 'archard'"
        )


def _refuse_alike(joint: JointFit) -> None:
    """Refuse unknowns that the frames cannot tell apart, by their correlation."""
    spread = np.sqrt(np.diag(joint.covariance))
    if not np.all(spread > 0.0):
        return
    correlation = joint.covariance / np.outer(spread, spread)
    np.fill_diagonal(correlation, 0.0)
    i, j = np.unravel_index(int(np.abs(correlation).argmax()), correlation.shape)
    if abs(correlation[i, j]) > _ALIKE:
        raise PhysicsError(
            f"{joint.unknowns[i].key} and {joint.unknowns[j].key} cannot be told apart in these "
            f"frames (correlation {correlation[i, j]:.4f}); fix one of them"
        )


def _read(frames: str | Path, scene: Scene) -> tuple[list[FrameData], list[Scene]]:
    with open_scene_frames(frames, scene) as reader:
        no_load = load_no_load(scene, full_shape=reader.full_shape)
        data = [
            prepare_frame(frame, scene, bit_depth=reader.bit_depth, no_load=no_load)
            for frame in reader
        ]
    first = bool(scene.friction and scene.friction.static_state_first)
    states = (len(scene.wear.distances_m) if scene.wear else 1) + first
    if len(data) > 1 and scene.model == "contact" and states not in (1, len(data)):
        raise InputError(
            f"{frames}: {len(data)} frames, and the scene has {states} states; give one frame a "
            "state, or correct wear.distances_m"
        )
    shape = data[0].light.shape
    return data, [placed(frame_scene(scene, i), shape) for i in range(len(data))]


def _merged(parts: list[JointFit]) -> JointFit:
    """Fits of frames on their own, as one."""
    from dataclasses import replace

    from scipy.linalg import block_diag

    unknowns = tuple(replace(u, frame=i) for i, part in enumerate(parts) for u in part.unknowns)
    return JointFit(
        unknowns,
        np.concatenate([part.values for part in parts]),
        np.concatenate([part.standard_uncertainty for part in parts]),
        block_diag(*[part.covariance for part in parts]),
        float(np.sqrt(np.mean([part.chi**2 for part in parts]))),
        tuple(part.scenes[0] for part in parts),
        all(part.converged for part in parts),
    )


def _result(scene: Scene, joint: JointFit, count: int) -> Fit:
    shared: dict[str, dict[str, float]] = {}
    own: list[dict[str, dict[str, float]]] = [{} for _ in range(count)]
    for unknown, value, spread in zip(
        joint.unknowns, joint.values, joint.standard_uncertainty, strict=True
    ):
        found = {"value": float(value), "standard_uncertainty": float(spread)}
        (shared if unknown.frame is None else own[unknown.frame])[unknown.key] = found
    warnings = []
    if joint.chi > 1.3:
        warnings.append(
            f"chi = {joint.chi:.2f}: the model does not describe these frames within their noise; "
            "the uncertainties are widened by it, but a bias may remain"
        )
    if not joint.converged:
        warnings.append("the fit did not converge fully")
    return Fit(shared, own, joint.chi, fitted_scene(scene, shared, own), tuple(warnings))


def fitted_scene(
    scene: Scene,
    shared: dict[str, dict[str, float]],
    own: list[dict[str, dict[str, float]]],
) -> Scene:
    """The scene with fitted values: means of per-frame ones, friction as a table over distance."""
    values: dict[str, Any] = {key: found["value"] for key, found in shared.items()}
    for key in dict.fromkeys(key for frame in own for key in frame):
        series = [
            (i, frame[key]["value"])
            for i, frame in enumerate(own)
            if key in frame and np.isfinite(frame[key]["value"])
        ]
        if not series:
            continue
        values[key] = float(np.mean([value for _, value in series]))
        if key == "friction.coefficient" and scene.wear and len(series) > 1:
            points = {
                (s.wear.distances_m[0] if (s := frame_scene(scene, i)).wear else 0.0): value
                for i, value in series
            }
            if len(points) > 1:
                rising = sorted(points)
                values[key] = {"distance_m": rising, "value": [points[d] for d in rising]}
    return scene.with_values(values)


def _table(result: Fit) -> dict[str, list[Any]]:
    rows = [("all", key, found) for key, found in result.shared.items()]
    rows += [(str(i), key, f) for i, own in enumerate(result.frames) for key, f in own.items()]
    return {
        "frame": [row[0] for row in rows],
        "key": [row[1] for row in rows],
        "value": [row[2]["value"] for row in rows],
        "standard_uncertainty": [row[2]["standard_uncertainty"] for row in rows],
        "chi": [result.chi] * len(rows),
    }
