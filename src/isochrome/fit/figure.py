"""The picture that `fit` leaves: frame, fitted model, and what is left over."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.figures import DIFFERENCE_MAP, FRAME_MAP, new_figure, plain_name, show_image
from isochrome.fit.explain import explain_frame
from isochrome.fit.frame_set import FrameSet
from isochrome.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = 6


def fit_figure(name: str, frames: FrameSet, scenes: tuple[Scene, ...]) -> Figure:
    """Captured light, fitted light, and their difference over the noise, for up to six frames.

    Parameters: `name` of the scene; `frames`; their fitted one-state `scenes`. Returns a Figure.
    """
    shown = np.unique(np.linspace(0, len(scenes) - 1, min(_SHOWN, len(scenes))).round().astype(int))
    wanted = {i: frames[i] for i in shown.tolist()}
    rows, cols = wanted[0].light.shape
    figure = new_figure(13.0, (3.9 * min(rows / cols, 1.6) + 0.75) * len(shown) + 0.5)
    axes: Any = figure.subplots(len(shown), 3, squeeze=False)
    for row, k in zip(axes, shown, strict=True):
        data, seen = wanted[k], explain_frame(wanted[k], scenes[k])
        model = seen.background + seen.illumination * seen.signal
        left = np.where(seen.mask, (data.light - model) / data.sigma, np.nan)
        place: dict[str, Any] = {
            "pixel_mm": seen.pixels.pixel_mm,
            "left_mm": seen.pixels.left_mm,
            "top_mm": seen.pixels.top_mm,
        }
        top = float(np.percentile(data.light[data.valid], 99.8))
        frame = np.where(data.valid, data.light, np.nan)
        show_image(
            row[0], frame, cmap=FRAME_MAP, vmin=0, vmax=top, title=f"frame {k}: captured", **place
        )
        fitted = np.where(seen.picture.material, model, np.nan)
        show_image(row[1], fitted, cmap=FRAME_MAP, vmin=0, vmax=top, title="fitted model", **place)
        show_image(
            row[2], left, cmap=DIFFERENCE_MAP, vmin=-5, vmax=5, title=f"chi = {seen.chi:.2f}",
            colour_label="(captured - fitted) / noise", **place,
        )  # fmt: skip
    figure.suptitle(f"{plain_name(name)}: fit to the intensity", fontsize=11)
    return figure
