"""One captured frame: the scene's model fitted to it, and its fringe order read."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, PhysicsError
from isochrome.fit.explain import explain_frame
from isochrome.fit.frame_data import prepare_frame
from isochrome.fit.frame_fit import LOAD_FACTORS, PLACE_PX, FrameFit, fit_frame
from isochrome.frames import Frame, Linear, estimate_noise, normalise, to_linear
from isochrome.fringes.branch import OrderReading, read_order
from isochrome.fringes.skeleton import Skeleton, skeletons
from isochrome.process.place import placed_disc
from isochrome.scene import Scene
from isochrome.stress import pixel_grid

Array = NDArray[Any]

POOR_CHI = 1.3
"""Residual over noise beyond which the model does not describe the frame within its noise."""

SPREAD = "standard_uncertainty"
"""What follows a key in the name of the column that holds its uncertainty."""

LOST = 0.12
"""Residual over contrast beyond which a model cannot name the branch of a pixel: nothing is read.
A right model leaves the noise, about 0.02; one that is 3 % off in load 0.05; wrong ones 0.15 on."""

_DISC_LOADS = tuple(np.geomspace(0.3, 3.0, 47).tolist())


@dataclass(frozen=True)
class ProcessedFrame:
    """What was found in one frame; maps are (rows, cols), NaN = not known.

    `normalised`, the signal 0..1 with background and illumination out; `reading`, the fringe order
    (None without a model); `fit` and the fitted `scene` (None without one); `lines`, the fringe
    skeleton (without a model); `noise` of the signal; `chi`, residual over noise of the whole
    frame; `warnings` in plain words.
    """

    index: int
    name: str
    label: str
    distance_m: float
    normalised: Array
    reading: OrderReading | None
    fit: FrameFit | None
    lines: list[Skeleton]
    noise: float
    chi: float
    pixel_mm: float | None
    warnings: tuple[str, ...]

    def maps(self) -> dict[str, Array]:
        """The maps that are written to disk, by the name of their file."""
        if self.reading is None:
            return {"normalised": self.normalised}
        return {
            "normalised": self.normalised,
            "fringe_order": self.reading.order,
            "confidence": self.reading.confidence,
        }

    def _largest(self, order: Array) -> dict[str, float]:
        """The largest fringe order that is known, and its place (mm)."""
        assert self.fit is not None
        if not np.isfinite(order).any():
            return dict.fromkeys(("n_max", "n_max_x_mm", "n_max_z_mm"), float("nan"))
        row, col = np.unravel_index(int(np.nanargmax(order)), order.shape)
        grid = pixel_grid(self.fit.scene, (order.shape[0], order.shape[1]))
        return {
            "n_max": float(order[row, col]),
            "n_max_x_mm": float(grid.x_mm[col]),
            "n_max_z_mm": float(grid.z_mm[row]),
        }

    def row(self) -> dict[str, Any]:
        """The frame's row of frames.csv."""
        row: dict[str, Any] = {
            "frame": self.index,
            "name": self.name,
            "label": self.label,
            "distance_m": self.distance_m,
            "chi": self.chi,
            "noise": self.noise,
            "pixel_mm": self.pixel_mm,
        }
        if self.fit is None or self.reading is None:
            return row | {"fringe_lines": len(self.lines), "warnings": "; ".join(self.warnings)}
        row |= {"kept_share": self.reading.kept, **self._largest(self.reading.order)}
        for key, value, spread in zip(
            self.fit.keys, self.fit.values, self.fit.standard_uncertainty, strict=True
        ):
            row |= {key: float(value), f"{key} {SPREAD}": float(spread)}
        return row | {"warnings": "; ".join(self.warnings)}


def process_with_model(
    frame: Frame,
    scene: Scene,
    *,
    bit_depth: int | None,
    no_load: tuple[Linear | None, Linear | None],
    label: str,
    distance_m: float,
) -> ProcessedFrame:
    """Fit a one-state scene to a frame, and read the fringe order on the branch it names.

    Parameters: `frame`; `scene`, see `isochrome.fit.renderer.frame_scene`; `bit_depth` of the
    sensor; `no_load`, dark and bright; `label`, `distance_m` of the state. Returns ProcessedFrame.
    Raises InputError on a blank frame, PhysicsError where the scene's fringes are not in it.
    """
    data = prepare_frame(frame, scene, bit_depth=bit_depth, no_load=no_load)
    notes: list[str] = []
    factors: tuple[float, ...] = LOAD_FACTORS
    places: tuple[float, ...] = PLACE_PX
    if scene.model == "disc":
        scene, notes = placed_disc(scene, data)
        factors, places = _DISC_LOADS, (0.0,)
    try:
        fit = fit_frame(data, scene, load_factors=factors, place_px=places)
    except PhysicsError as error:
        raise PhysicsError(f"frame {frame.index} ({frame.name}): {error}") from error
    if fit.plain:
        data = data.plain()
    seen = explain_frame(data, fit.scene)
    gain = np.where(seen.illumination > 0.0, seen.illumination, np.nan)
    noise = float(np.nanmedian((data.sigma / gain)[seen.mask])) if fit.positive else float("nan")
    lost = not fit.positive or fit.chi * noise > LOST
    reading = read_order(
        data.light,
        seen.picture.order,
        seen.response,
        illumination=seen.illumination,
        background=seen.background,
        sigma=data.sigma,
        valid=seen.mask & (seen.illumination > 0.0) & (not lost),
    )
    if lost:
        # the place that the lost fit ended at says nothing: the specimen is where it began
        inside = explain_frame(data, scene).picture.material
        rest = process_image_only(frame, scene, bit_depth=bit_depth, no_load=no_load, inside=inside)
        return replace(
            rest,
            label=label,
            distance_m=distance_m,
            reading=reading,
            fit=_without_values(fit, scene),
            chi=fit.chi,
            pixel_mm=seen.pixels.pixel_mm,
            warnings=(*notes, *_warnings(fit, reading, lost), *rest.warnings),
        )
    inside = data.valid & seen.picture.material
    signal = np.where(inside, (data.light - seen.background) / gain, np.nan)
    return ProcessedFrame(
        frame.index,
        frame.name,
        label,
        distance_m,
        signal.astype(np.float32),
        reading,
        fit,
        [],
        noise,
        fit.chi,
        seen.pixels.pixel_mm,
        (*notes, *_warnings(fit, reading, lost)),
    )


def _without_values(fit: FrameFit, scene: Scene) -> FrameFit:
    """A fit that was lost: only the place it began with is left of it, and its chi."""
    values = [scene.get(key) if key.startswith("camera.") else None for key in fit.keys]
    kept = np.array([np.nan if value is None else value for value in values], dtype=float)
    return replace(fit, scene=scene, values=kept, standard_uncertainty=np.full(len(kept), np.nan))


def _warnings(fit: FrameFit, reading: OrderReading, lost: bool) -> list[str]:
    found = []
    if fit.chi > POOR_CHI:
        found.append(
            f"chi = {fit.chi:.2f}: the model does not describe this frame within its noise "
            "(another load, residual stress, gamma, or a wrong basin); use its orders with care"
        )
    if not fit.positive:
        found.append("the scene's fringes are not in this frame")
    elif fit.plain:
        found.append(
            "no smooth illumination fits with this model, so that one amplitude stands for all the "
            "frame; give no-load frames"
        )
    near = [m for m in fit.others if m.chi < 1.05 * fit.chi]
    if near:
        found.append(
            f"{len(near)} other solution(s) fit nearly as well; give the load more closely"
        )
    if not fit.converged:
        found.append("the fit did not converge fully")
    if lost:
        found.append("the model is too far off to name the branches: no order was read")
    elif reading.kept < 0.5:
        found.append(f"only {100 * reading.kept:.0f} % of the specimen's pixels could be read")
    return found


def process_image_only(
    frame: Frame,
    scene: Scene,
    *,
    bit_depth: int | None,
    no_load: tuple[Linear | None, Linear | None],
    inside: NDArray[np.bool_] | None = None,
) -> ProcessedFrame:
    """Normalise a frame without a model, and find its fringe skeleton.

    Parameters as in `process_with_model`; `inside`, True on the specimen where that is known.
    Returns a ProcessedFrame without a reading. A frame in
    which no fringe shows (an unloaded specimen) is kept as it is, and says so.
    """
    linear = to_linear(frame.image, bit_depth=bit_depth, gamma=scene.frames.gamma, name=frame.name)
    if inside is not None:
        linear = replace(linear, valid=linear.valid & inside)
    dark, bright = no_load
    notes: tuple[str, ...] = ()
    try:
        done = normalise(linear, dark, bright, field=scene.polariscope.field)
        model = estimate_noise(frame.image, linear.valid, bit_depth=bit_depth)
        sigma = model.linear_sigma(frame.image, bit_depth=bit_depth, gamma=scene.frames.gamma)
        signal = done.signal
        noise = float(np.median(sigma[done.valid] / done.contrast[done.valid]))
        if done.blind:
            notes = ("normalised blind, without both no-load frames: rough where fringes are few",)
        lines = skeletons(np.clip(signal, 0.0, 1.0))
    except InputError as error:
        signal, lines, noise = np.where(linear.valid, linear.image, np.nan), [], float("nan")
        notes = (f"not normalised: {error}",)
    return ProcessedFrame(
        frame.index,
        frame.name,
        frame.name,
        float("nan"),
        signal.astype(np.float32),
        None,
        None,
        lines,
        noise,
        float("nan"),
        scene.camera.pixel_mm if scene.camera else None,
        notes,
    )
