"""The chain from scene to picture: states, stress, fringe order, signal. Each step on its own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import Grid, SurfaceState, iter_contact_states
from isochrome.errors import InputError, PhysicsError
from isochrome.optics import (
    camera_response,
    fringe_order,
    highest_visible,
    make_chain,
    make_light,
    pixel_visibility,
    polariscope_signal,
    spectral_signal,
)
from isochrome.scene import Camera, Scene
from isochrome.stress import (
    FieldGrid,
    PixelGrid,
    RegularStress,
    StressDifference,
    beam_difference,
    block_stress,
    disc_difference,
    field_dtype,
    make_field_grid,
    principal_direction,
    stress_difference,
)

Array = NDArray[np.floating]

_TOO_FINE_SHARE = 0.03
"""Share of the fringed pixels with fringes finer than two pixels at which a picture is refused: a
few at the edge of a contact or beside a disc's loads, where the stress is steep, are no harm."""

_FLOAT32_BITS = 10
"""Bits up to which single precision, 1e-5 of the signal at N = 50, is below half a grey level."""


@dataclass(frozen=True)
class SceneState:
    """One state of a scene: `label`, `distance_m`, and the `surface` (None for a disc or beam)."""

    label: str
    distance_m: float
    surface: SurfaceState | None


@dataclass(frozen=True)
class Picture:
    """What the camera would see, before the camera.

    `difference` (sigma_x - sigma_z) + 2i tau_xz, MPa; `order` N, fringes; `material`, False where
    there is no specimen (all (rows, cols)); `too_fine`, share of fringes finer than two pixels.
    """

    difference: StressDifference
    order: Array
    material: NDArray[np.bool_]
    visibility: Array
    too_fine: float


def scene_states(scene: Scene) -> list[SceneState]:
    """Solve a scene's mechanics: every state, in the scene's order.

    Raises InputError where the scene has no model, PhysicsError where it cannot be solved.
    """
    return list(iter_scene_states(scene))


def iter_scene_states(scene: Scene) -> Iterator[SceneState]:
    """The states of `scene_states`, each solved when it is asked for.

    Raises InputError at once where the scene has no model, PhysicsError as they come.
    """
    if scene.model is None:
        raise InputError(no_model_sentence(scene))
    if scene.model != "contact":
        return iter((SceneState(scene.model, 0.0, None),))
    return (SceneState(_label(s), s.distance_m, s) for s in iter_contact_states(scene))


def state_count(scene: Scene) -> int:
    """How many states a scene has, without solving them."""
    if scene.model != "contact":
        return 1
    static = scene.friction is not None and scene.friction.static_state_first
    if scene.load is not None and scene.load.tangential_n is not None:
        return 1
    return int(static) + (len(scene.wear.distances_m) if scene.wear else 1)


def no_model_sentence(scene: Scene) -> str:
    """Why a scene has no model, and what can be done with its frames all the same."""
    shape = scene.specimen.shape
    what = {None: "the scene has no [indenter] and no shape", "other": "this specimen has no model"}
    why = what.get(shape, f"a {shape} has no model yet")
    return (
        f"{scene.name}: {why}, so it cannot be simulated; `isochrome process` still gives the "
        "normalised frames, the fringe skeleton, and the order from [[frames.known_order]]"
    )


def _label(state: SurfaceState) -> str:
    if not state.sliding and state.distance_m == 0.0:
        return "static"
    if state.distance_m == 0.0:
        return "initial sliding"
    return f"{state.distance_m:g} m"


def state_difference(scene: Scene, state: SceneState, pixels: PixelGrid) -> StressDifference:
    """Stress difference of one state on a pixel grid, with what the scene adds to the contact's.

    Returns (sigma_x - sigma_z) + 2i tau_xz (rows, cols), MPa; NaN outside a disc or beam, 0 above
    a contact's surface.
    """
    if scene.model == "disc":
        return disc_difference(scene, pixels)
    if scene.model == "beam":
        return beam_difference(scene, pixels)
    surface = state.surface
    assert surface is not None
    grid = surface_field_grid(pixels, surface.grid, scene.numerics.tolerance)
    shear = surface.shear_mpa if surface.shear_mpa.any() else None
    field = stress_difference(grid, surface.pressure_mpa, shear)
    regular = regular_stress(scene, surface, pixels)
    if regular:
        field += regular.difference(pixels.x_mm[None, :], pixels.z_mm[:, None]).astype(field.dtype)
    return field


def regular_stress(scene: Scene, surface: SurfaceState, pixels: PixelGrid) -> RegularStress:
    """Stress in a contact's specimen besides a half-plane's: bulk stress, a block's sides.

    Parameters: `scene`; `surface`, what acts on it in one state; `pixels`, where it is wanted.
    Returns a RegularStress (MPa). Raises InputError for pixels too far off in a block.
    """
    load, block = scene.load, block_stress(scene, surface, pixels)
    if load is None:
        return block
    slope = complex(load.bulk_along_x_mpa_per_mm or 0.0, load.bulk_along_z_mpa_per_mm or 0.0)
    return block + RegularStress((complex(load.bulk_mpa or 0.0), slope))


@lru_cache(maxsize=1)
def surface_field_grid(pixels: PixelGrid, grid: Grid, tolerance: float) -> FieldGrid:
    """The kernels from a contact's nodes to the pixels, as precise as the scene's tolerance asks.

    The last ones are kept: the states of a scene share them. They take as much as ten pictures.
    """
    return make_field_grid(
        pixels,
        left_mm=grid.left_mm,
        spacing_mm=grid.spacing_mm,
        nodes=grid.nodes,
        dtype=field_dtype(tolerance),
    )


def make_picture(scene: Scene, difference: StressDifference, pixels: PixelGrid) -> Picture:
    """Fringe order, mask and visibility of a stress field. See Picture."""
    specimen = scene.specimen
    assert specimen.thickness_mm is not None and specimen.fringe_value_n_per_mm is not None
    order = fringe_order(
        difference,
        thickness_mm=specimen.thickness_mm,
        fringe_value_n_per_mm=specimen.fringe_value_n_per_mm,
    )
    material = np.isfinite(order)
    if scene.model == "contact":
        # a pixel that the surface cuts sees the indenter too: it is not the specimen's
        material &= (pixels.z_mm >= (0.5 - 1e-6) * pixels.pixel_mm)[:, None]
    order = order if material.all() else np.where(material, order, np.nan)
    visibility, too_fine = pixel_visibility(order)
    return Picture(difference, order, material, visibility, too_fine)


def picture_signal(scene: Scene, picture: Picture, step: int | None = None) -> Array:
    """Polariscope signal of a picture, 1 for full light; no specimen, no light.

    Parameters: `step`, which of the polariscope's phase steps (None: dark, bright or plane field).
    Returns (rows, cols) in 0..1, or (rows, cols, 3), red, green and blue, for a colour camera; in
    float64 where the camera stores more than 10 bits. Raises InputError on a response file that
    cannot be used, or a light that a channel does not see.
    """
    camera, polariscope = scene.camera, scene.polariscope
    order, whole = picture.order, picture.material.all()
    if not whole:
        order = np.where(picture.material, order, 0.0)
    if camera is None or camera.bit_depth is None or camera.bit_depth > _FLOAT32_BITS:
        order = order.astype(float)
    coloured = camera is not None and (camera.colour or camera.response is not None)
    if polariscope.several_wavelengths or coloured:
        signal = _spectral(scene, picture, order, step)
    else:
        chain = make_chain(polariscope, step)
        direction = None if chain.ideal else principal_direction(picture.difference)
        signal = polariscope_signal(
            order, chain, direction=direction, visibility=picture.visibility
        )
    if not whole:
        signal[~picture.material] = 0.0
    return signal


def _spectral(scene: Scene, picture: Picture, order: Array, step: int | None) -> Array:
    """The signal for several wavelengths, or in several channels."""
    camera, polariscope = scene.camera or Camera(), scene.polariscope
    path = scene.path(camera.response) if camera.response is not None else None
    response = camera_response(camera, path)
    highest = highest_visible(order, picture.visibility)
    light = make_light(polariscope, response, highest_order=highest)
    chains = [make_chain(polariscope, step, wavelength_nm=float(w)) for w in light.wavelength_nm]
    ideal = all(chain.ideal for chain in chains)
    assert polariscope.wavelength_nm is not None
    signal = spectral_signal(
        order,
        light,
        chains,
        reference_nm=polariscope.wavelength_nm,
        direction=None if ideal else principal_direction(picture.difference),
        visibility=picture.visibility,
    )
    return signal if camera.colour else signal[..., 0]


def refuse_too_fine(scene: Scene, picture: Picture) -> None:
    """Raise PhysicsError where too many fringes are finer than two pixels."""
    if picture.too_fine > _TOO_FINE_SHARE:
        pixel = scene.camera.pixel_mm if scene.camera else None
        raise PhysicsError(
            f"{scene.name}: fringes finer than two pixels in {100 * picture.too_fine:.1f} % of the "
            f"fringed picture (camera.pixel_mm = {pixel}); use smaller pixels, a lower "
            "load.normal_n or a thinner specimen"
        )
