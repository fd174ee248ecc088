"""Fit a scene's unknowns to the intensity of one frame, wherever the scene starts."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import (
    STEP,
    BudgetInput,
    FrameData,
    LinearPart,
    Minimum,
    Prior,
    block_correlation,
    budgets_of,
    less_explained,
    local_noise,
    standard_uncertainty,
)
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.frame_model import FrameModel, RefinedFit, refine_fit
from isochrome.fitting.frame.single_state import with_numerics
from isochrome.fitting.frame.unknowns import (
    BLUR,
    GAMMA,
    PLANE,
    SWING,
    TILT,
    StatedInputs,
    fit_region,
    free_keys,
    inputs_of_rows,
    moved_scene,
    scales,
    stated_inputs,
    values_of,
)
from isochrome.fitting.search import CLOSE_CHI, search_frame
from isochrome.scene import Scene
from isochrome.stress import pixel_grid


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Values (p,) of unknowns, and how well they are known, in the keys' units. `covariance` and
    `standard_uncertainty` (inf: not told) are of the noise and of all stated `inputs` (m,), priors
    first, of which `sensitivity` (p, m) is d value/d input; `information`, of the pixels; `chi`,
    residual over noise.
    """

    values: Array
    standard_uncertainty: Array
    covariance: Array
    noise_uncertainty: Array
    inputs: StatedInputs
    sensitivity: Array
    cramer_rao_bound: Array
    information: Array
    freedom: int
    chi: float
    converged: bool

    @property
    def cost(self) -> float:
        """Sum of the squared residuals over noise."""
        return self.chi**2 * self.freedom

    @property
    def budget(self) -> tuple[tuple[BudgetInput, ...], ...]:
        """The uncertainty budget of each value, empty ones without stated inputs."""
        return budgets_of(self.noise_uncertainty, self.inputs.rows, self.sensitivity)

    def less_sure(self, more: Array) -> Self:
        """The same with a covariance that is larger by `more` (p, p), as if by noise."""
        variance = np.diag(more)
        return replace(
            self,
            covariance=self.covariance + more,
            standard_uncertainty=np.sqrt(self.standard_uncertainty**2 + variance),
            noise_uncertainty=np.sqrt(self.noise_uncertainty**2 + variance),
        )


def uncertainties(
    noise: Array, inputs: StatedInputs, sensitivity: Array, determined: Mask
) -> dict[str, Any]:
    """What an `Estimate` says of them, from the covariance by noise, and which are determined."""
    by_inputs = sensitivity * inputs.spread
    covariance = noise + by_inputs @ by_inputs.T
    return {
        "covariance": covariance,
        "standard_uncertainty": standard_uncertainty(covariance, determined),
        "noise_uncertainty": standard_uncertainty(noise, determined),
        "inputs": inputs,
        "sensitivity": sensitivity,
    }


@dataclass(frozen=True, kw_only=True)
class FrameFit(Estimate):
    """What one frame says of its scene, whose unknowns are `keys` (p,). `others`, minima by rising
    chi; `plain`, one amplitude had to do for all the light; not `positive`: the scene's fringes are
    not in the frame; `noise_ratio`, the noise over what the finest part shows, as compression takes
    it.
    """

    scene: Scene
    keys: tuple[str, ...]
    others: tuple[Minimum, ...]
    plain: bool
    positive: bool
    noise_ratio: float = 1.0


EDGE_PX = 0.75
"""Depth above which no pixel is fitted: there the surface's place decides what is seen."""
_HALO = 2.5
"""Standard deviations of a blur by which that depth grows (measured at 1.5 px: friction errs by 16
of its uncertainties without, by less than one with)."""

_LEAST = {SWING: 0.01} | dict.fromkeys((BLUR, TILT), 0.3)
"""Where what enters by its square starts at least (px, 1/mm): from nought it has no slope."""

_CHANCE = 100.0
"""Wald's statistic of an illumination that noise alone does not reach: it leaves up to 21 where
values are searched for (18 frames), and fringes of a single grey level in 20 000 pixels 384."""

PHOTOGRAPHS = 2.2
"""Exponent of most photographs; a sensor's own is 1."""


def fit_frame(
    data: FrameData,
    scene: Scene,
    keys: tuple[str, ...] | None = None,
    *,
    cold: bool = True,
    stated: StatedInputs | None = None,
) -> FrameFit:
    """Fit the unknowns of a one-state scene, by default `free_keys`, to one frame: from the scene's
    own values on a thinned frame, else, if `cold`, by a search over a factor of four in load; then
    on every trusted pixel. `stated`: priors and inputs, by default the scene's. InputError for a
    key that cannot be free, PhysicsError where no values give fringes of the right contrast.
    """
    return fit_with_model(data, scene, keys, cold=cold, stated=stated).fit


@dataclass(frozen=True)
class Fitted:
    """A fit, its `model`, where the steps ended, what is `held`, and derivatives by that (m, n)."""

    fit: FrameFit
    model: FrameModel
    final: RefinedFit
    held: StatedInputs
    held_rows: Array
    stated: StatedInputs


def fit_with_model(
    data: FrameData,
    scene: Scene,
    keys: tuple[str, ...] | None = None,
    *,
    cold: bool = True,
    stated: StatedInputs | None = None,
    rested: bool = False,
) -> Fitted:
    """`fit_frame` with its model; `rested`: from where a fit came to rest few pixels lead away."""
    keys = free_keys(scene) if keys is None else keys
    stated = stated_inputs(scene) if stated is None else stated
    if _has_open_plane(scene):
        keys = tuple(dict.fromkeys((*keys, PLANE)))
    scene = begun_scene(scene, data.shape)
    made = _fit_toned(data, scene, keys, stated, cold=cold, rested=rested)
    ratio = local_noise(
        made.model.pixels.keep,
        made.final.gamma_fit.residual,
        made.model.pixels.raw * made.model.pixels.weight,
    )
    if ratio == 1.0 or not made.fit.positive:  # what has no light may be anywhere
        return made
    again = _fit_toned(data.with_noise(ratio), made.fit.scene, keys, stated, rested=True)
    return replace(again, fit=replace(again.fit, others=made.fit.others))


def _fit_toned(
    data: FrameData,
    scene: Scene,
    keys: tuple[str, ...],
    stated: StatedInputs,
    *,
    cold: bool = False,
    rested: bool,
) -> Fitted:
    """The fit, from each exponent in turn where that is unknown until one explains the frame."""
    known = scene.frames.gamma
    if isinstance(known, str) and GAMMA not in keys:
        keys = (*keys, GAMMA)
    if GAMMA not in keys:
        return _fit_begun(data, scene, keys, stated, cold, rested)
    best: Fitted | None = None
    gammas = [1.0, PHOTOGRAPHS] if isinstance(known, str) else [known, 1.0, PHOTOGRAPHS]
    if rested:  # at the first
        del gammas[1:]
    for gamma in dict.fromkeys(gammas):
        begun = scene.with_values({GAMMA: gamma})
        made = _fit_begun(data.toned(gamma), begun, keys, stated, cold, rested)
        fit = made.fit
        if best is None or (fit.positive, -fit.chi) > (best.fit.positive, -best.fit.chi):
            best = made
        if best.fit.positive and best.fit.chi <= CLOSE_CHI:
            break
    assert best is not None
    return best


def _fit_begun(
    data: FrameData,
    scene: Scene,
    keys: tuple[str, ...],
    stated: StatedInputs,
    cold: bool,
    rested: bool,
) -> Fitted:
    """The fit from one scene's start, and others about it."""
    others: tuple[Minimum, ...] = ()
    prior = stated.prior(keys)
    scene = _with_some(scene, keys)
    best = scene
    if not rested:
        first, *rest = search_frame(data, scene, keys, prior, cold=cold)
        best, others = first.scene, tuple(Minimum(s.values, s.chi) for s in rest if s.positive)
    best = _with_some(best, keys)  # few pixels do not show a little one
    fine = with_numerics(best.model_copy(update={"numerics": scene.numerics}))
    model, final = _final(data, fine, keys, prior, rested)
    plain = not final.positive
    if plain:
        model, final = _final(data.plain(), fine, keys, prior, rested)
    fitted = moved_scene(fine, keys, final.values).model_copy(update={"numerics": scene.numerics})
    determined = final.local.determined
    known, held = (stated.some(keys, free=free) for free in (True, False))
    rows = np.empty((0, model.pixels.size), np.float32)
    if held.keys:
        rows = model.input_rows(final.values, final.gamma_fit, held.keys)
    unexplained = less_explained(
        final.gamma_fit.residual, final.local.rows, final.local.inverse, rows, held.spread
    )
    noise = final.local.covariance(final.gamma_fit, unexplained)
    inputs = inputs_of_rows([*known.rows, *held.rows])
    sensitivity = final.local.sensitivity(known.keys, rows)
    fit = FrameFit(
        scene=fitted, keys=keys, values=final.values, chi=final.chi, freedom=final.freedom,
        **uncertainties(noise, inputs, sensitivity, determined), others=others, plain=plain,
        cramer_rao_bound=final.local.bound, information=final.local.information,
        converged=final.converged and bool(determined.all()), noise_ratio=data.noise_ratio,
        positive=final.positive and is_seen(final.gamma_fit),
    )  # fmt: skip
    return Fitted(fit, model, final, held, rows, stated)


def _with_some(scene: Scene, keys: tuple[str, ...]) -> Scene:
    """The scene with some of what has no slope at nought, where that is an unknown; either sign of
    a tilt is one."""
    some = {key: max(abs(scene.get(key)), least) for key, least in _LEAST.items() if key in keys}
    return scene.with_values(some) if some else scene


def is_seen(gamma_fit: LinearPart) -> bool:
    """Whether more light follows the fringes than noise alone does: Wald's statistic of the
    illumination, aᵀ cov(a)⁻¹ a, over the noise that the residuals show.
    """
    count = gamma_fit.problem.light.split
    light = gamma_fit.coefficients[:count]
    gain = float(light @ np.linalg.pinv(gamma_fit.inverse[:count, :count]) @ light)
    # fringes of something else are no noise, though neighbours share them
    near = block_correlation(gamma_fit.problem.keep, gamma_fit.residual, most_px=4)
    return gain > _CHANCE * gamma_fit.noise * near


def _final(
    data: FrameData, scene: Scene, keys: tuple[str, ...], prior: Prior, rested: bool
) -> tuple[FrameModel, RefinedFit]:
    """Every trusted pixel, a fine contact, derivatives where the search ended."""
    start = values_of(scene, keys)
    region = fit_region(scene, data.shape, 1, hidden_px(scene))
    model = FrameModel(data, scene, keys, region, prior=prior)
    gamma_fit = model.keep_clear(start)
    assert scene.camera is not None
    if gamma_fit is not None and (scene.camera.blur_px > 0.0 or BLUR in keys):
        model.follow_light(data, gamma_fit)
        gamma_fit = model.at(start, near=gamma_fit.model)
    final = refine_fit(model, start, gamma_fit=gamma_fit)
    if final is None:
        raise PhysicsError("scene_cannot_solved_where", name=data.name)
    other = None if rested else turned_over(keys, final.values)
    if other is not None:
        turned = refine_fit(model, other)
        if turned is not None and not turned.cost > final.cost:
            final = turned
    return model, final


def turned_over(keys: tuple[str, ...], values: Array) -> Array | None:
    """Values (p,) with plates turned over, nearly a mirror picture; None without any."""
    plates = [j for j, key in enumerate(keys) if key.endswith("plate_error_deg")]
    if not plates:
        return None
    other = values.copy()
    other[plates] *= -1.0
    return other


def hidden_px(scene: Scene) -> float:
    """Depth (px) above which no pixel of a scene is fitted: a blur brings the surface down."""
    assert scene.camera is not None
    return EDGE_PX + _HALO * scene.camera.blur_px


def _has_open_plane(scene: Scene) -> bool:
    """Whether a fit is to tell plane strain from plane stress."""
    return scene.is_contact and scene.specimen.share_of_plane_stress is None


def begun_scene(scene: Scene, shape: tuple[int, int]) -> Scene:
    """The scene that a frame's fit begins with: `placed`, an open plane half-way."""
    scene = placed(scene, shape)
    return scene.with_values({PLANE: 0.5}) if _has_open_plane(scene) else scene


def placed(scene: Scene, shape: tuple[int, int]) -> Scene:
    """The scene with its picture's place written out; InputError for a camera of other pixels."""
    grid = pixel_grid(scene, shape)
    if (grid.rows, grid.cols) != shape:
        raise InputError(
            "frames_their_frames_roi", name=scene.name, shape=shape[0], shape_2=shape[1],
            rows=grid.rows, cols=grid.cols,
        )  # fmt: skip
    return scene.with_values({"camera.left_mm": grid.left_mm, "camera.top_mm": grid.top_mm})


def propagated(fit: FrameFit, numbers: Callable[[Scene], Array]) -> tuple[Array, Array]:
    """Numbers (m,) of a fitted scene and their u² = g C gᵀ + Σ (g c + h)² u_i², roots of it, inf
    where not told: g, h their derivatives by unknowns and held inputs, C the covariance by noise, c
    the sensitivity. PhysicsError beside unsolvable scenes. Source: JCGM 102:2011, 6.2.
    """
    keys = tuple(dict.fromkeys((*fit.keys, *fit.inputs.keys)))
    values, steps = values_of(fit.scene, keys), STEP * scales(fit.scene, keys)
    here = numbers(fit.scene)
    slopes = np.zeros((len(here), len(keys)))
    for column, key, value, step in zip(slopes.T, keys, values, steps, strict=True):
        for one in (step, -step):  # to whichever side there is a scene
            with suppress(InputError, PhysicsError):
                there = numbers(moved_scene(fit.scene, (key,), np.array([value + one])))
                column[:] = (there - here) / one
                break
        else:
            raise PhysicsError("scene_cannot_solved_beside", key=key, value=value)
    fitted, held = slopes[:, : len(fit.keys)], np.zeros((len(here), len(fit.inputs.keys)))
    for k, key in enumerate(fit.inputs.keys):
        if key not in fit.keys:
            held[:, k] = slopes[:, keys.index(key)]
    by_inputs = fit.sensitivity * fit.inputs.spread
    noise = fit.covariance - by_inputs @ by_inputs.T
    by_inputs = (fitted @ fit.sensitivity + held) * fit.inputs.spread
    variance = np.einsum("ij,jk,ik->i", fitted, noise, fitted) + (by_inputs**2).sum(axis=1)
    untold = (fitted[:, ~np.isfinite(fit.standard_uncertainty)] != 0.0).any(axis=1)
    return here, np.where(untold, np.inf, np.sqrt(np.maximum(variance, 0.0)))
