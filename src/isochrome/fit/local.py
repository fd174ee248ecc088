r"""A scene's unknowns about one set of values: signal, derivatives, and the steps they allow.

With the weighted derivatives J of the model at trusted pixels, less what illumination and
background explain of them, J⊥, a residual r moves the unknowns by (J⊥ᵀ J⊥)⁻¹ J⊥ᵀ r. Once near
enough the derivatives may stay as they are: only the residual must be exact for the fit to end
where it should (Kaufman's variable projection, BIT 15, 1975, 49-57; Gauss and Newton).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, PhysicsError
from isochrome.fit.frame_data import FrameData
from isochrome.fit.intensity import STEP, UNDETERMINED
from isochrome.fit.linear import LinearPart, Problem, scaled_inverse
from isochrome.fit.renderer import SceneRenderer
from isochrome.fit.tone import (
    Pixels,
    Toned,
    clear_of_ends,
    gamma_slope,
    solve_toned,
    some_pixels,
    trusted_pixels,
)
from isochrome.fit.unknowns import bounds, scales
from isochrome.scene import Scene

Array = NDArray[Any]

GAMMA, BLUR = "frames.gamma", "camera.blur_px"

_SMOOTH_PX, _DIMMEST = 5.0, 0.05
"""What is smoothed off an illumination whose slope is wanted; the least of it, over its most."""

ENOUGH = 0.25
"""Share of pixels that must be clear of black and white for the others to be left out."""


class FrameModel:
    """One frame's pixels, and the scene that is rendered on them as its unknowns move."""

    def __init__(
        self,
        data: FrameData,
        scene: Scene,
        keys: tuple[str, ...],
        region: Array,
        *,
        stride: int = 1,
        hidden_px: float = 0.0,
        rough: bool = False,
    ) -> None:
        """`data`, whole; `scene`, one state, numbers at `keys`; `region` (rows, cols), strided.

        `hidden_px`, depth above which the region shows nothing; `rough`, whether the pixels' area
        may be left out.
        """
        self.scene, self.keys = scene, keys
        self.renderer = SceneRenderer(
            scene, data.light.shape[:2], stride=stride, hidden_px=hidden_px, rough=rough
        )
        self.pixels: Pixels = trusted_pixels(data.every(stride) if stride > 1 else data, region)
        self.steps = STEP * scales(scene, keys)
        limits = bounds(scene, keys)
        self.low, self.high = limits["lower"], limits["upper"]
        self._light_slopes: tuple[Array, Array] | None = None

    def keep_clear(self, values: Array) -> Toned | None:
        """Leave out the pixels whose model at some values is near black or white.

        Returns the linear solution there, None where the values make no scene.
        """
        toned = self.at(values)
        if toned is None:
            return None
        clear = clear_of_ends(self.pixels, toned.model, self.gamma(values))
        if clear.all() or np.count_nonzero(clear) <= ENOUGH * clear.size:
            return toned
        self.pixels = some_pixels(self.pixels, clear)
        return self.solved(toned.part.signal[clear], values, toned.model[clear])

    def follow_light(self, data: FrameData, toned: Toned) -> None:
        """Blur the light with its fall-off A, and not the signal s alone.

        Equation: G * (A s) = A (G * s) + b² ∇A·∇(G * s) for a Gaussian G of standard deviation b
        and an A that is linear over it; ∇A/A from the solution `toned` of the frame `data`.
        """
        from scipy.ndimage import gaussian_filter

        coefficients = toned.part.coefficients[: len(data.illumination)]
        light = np.tensordot(coefficients.astype(np.float32), data.illumination, 1)
        light = np.maximum(gaussian_filter(light, _SMOOTH_PX), _DIMMEST * float(light.max()))
        down, across = np.gradient(np.log(light))
        self._light_slopes = down, across

    def gamma(self, values: Array) -> float:
        """The exponent of the tone curve at some values."""
        return float(values[self.keys.index(GAMMA)]) if GAMMA in self.keys else self.pixels.gamma

    def signal(self, values: Array, *, visibility: Array | None = None) -> Array | None:
        """The signal at the pixels (n,), None where the values make no scene that can be solved.

        `visibility` (rows, cols), where it is known well enough.
        """
        try:
            scene = self._moved(values)
            image = self.renderer.signal(scene, visibility=visibility)
        except (InputError, PhysicsError):
            return None
        assert scene.camera is not None
        if self._light_slopes is not None and scene.camera.blur_px > 0.0:
            down, across = np.gradient(image)
            down *= self._light_slopes[0]
            across *= self._light_slopes[1]
            image = image + np.float32(scene.camera.blur_px**2) * (down + across)
        return np.asarray(image[self.pixels.keep], dtype=np.float32)

    def _moved(self, values: Array) -> Scene:
        given = zip(self.keys, np.asarray(values, float).tolist(), strict=True)
        return self.scene.with_values(dict(given))

    def at(self, values: Array, *, near: Array | None = None) -> Toned | None:
        """The linear solution at some values (p,); `near` (n,), a model that is not far off."""
        signal = self.signal(values)
        return None if signal is None else self.solved(signal, values, near)

    def solved(self, signal: Array, values: Array, near: Array | None = None) -> Toned | None:
        """The linear solution for a signal (n,)."""
        return solve_toned(self.pixels, signal, self.gamma(values), near=near)

    def linearise(self, values: Array, toned: Toned) -> LocalModel:
        """Derivatives at some values, where the linear solution is known.

        Raises PhysicsError where the scene cannot be solved beside them.
        """
        rows = np.empty((len(self.keys), self.pixels.size), np.float32)
        # what the pixels' area takes changes little: it is not rendered for every derivative
        _, visibility = self.renderer.order_field(self._moved(values))
        for j, key in enumerate(self.keys):
            if key == GAMMA:
                rows[j] = gamma_slope(toned, self.gamma(values))
                continue
            step = self.steps[j] if values[j] + self.steps[j] <= self.high[j] else -self.steps[j]
            for signed in (step, -step):
                moved = np.array(values, dtype=float)
                moved[j] += signed
                signal = self.signal(moved, visibility=None if key == BLUR else visibility)
                if signal is not None:
                    break
            else:
                raise PhysicsError(f"{key} = {values[j]:g}: the scene cannot be solved beside it")
            np.subtract(signal, toned.part.signal, out=rows[j])
            rows[j] *= toned.part.amplitude / np.float32(signed)
        squares = np.array([np.sum(np.square(row), dtype=float) for row in rows])
        project(rows, toned.problem, toned.part)
        return LocalModel(self.keys, np.array(values, float), toned, rows, squares)


@dataclass(frozen=True)
class LocalModel:
    """A frame's model about `values` (p,) of `keys`: what steps and uncertainties need.

    `toned`, the linear solution there; `rows` (p, n), the weighted derivatives less what the linear
    unknowns explain; `squares` (p,), their sums of squares before that.
    """

    keys: tuple[str, ...]
    values: Array
    toned: Toned
    rows: Array
    squares: Array

    @cached_property
    def normal(self) -> Array:
        """Fisher information of the unknowns, the linear ones eliminated, (p, p)."""
        return (self.rows @ self.rows.T).astype(float)

    @cached_property
    def inverse(self) -> Array:
        """Covariance that this information allows at best, (p, p)."""
        return scaled_inverse(self.normal, 1e-12)

    @property
    def determined(self) -> NDArray[np.bool_]:
        """Which unknowns leave an effect that illumination and background cannot take up."""
        return np.asarray(np.diag(self.normal) > UNDETERMINED * self.squares)

    @property
    def bound(self) -> Array:
        """Cramér-Rao bound of each unknown (p,), inf where it is not determined."""
        found = np.sqrt(np.maximum(np.diag(self.inverse), 0.0))
        found[~self.determined] = np.inf
        return found

    def step(self, residual: Array) -> Array:
        """Newton's step for a residual over noise (n,), from wherever that was taken."""
        return np.asarray(self.inverse @ (self.rows @ residual).astype(float))


def project(rows: Array, problem: Problem, part: LinearPart) -> None:
    """Take off what illumination and background explain of derivatives (p, n), in place."""
    split = len(problem.light)
    light = np.multiply(problem.light, part.signal, out=problem.scratch)
    cross = np.concatenate((light @ rows.T, problem.dark @ rows.T)).astype(float)
    known = (part.inverse @ cross).astype(rows.dtype)
    rows -= known[:split].T @ light
    rows -= known[split:].T @ problem.dark
