"""The chain from scene to picture: states, stress, fringe order, signal. Each step on its own."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import SurfaceState, iter_contact_states
from isochrome.errors import InputError, PhysicsError
from isochrome.messages import message
from isochrome.optics import (
    camera_response,
    fringe_order,
    highest_visible,
    make_chain,
    make_light,
    mean_order,
    pixel_visibility,
    polariscope_signal,
    spectral_signal,
)
from isochrome.scene import Camera, Scene
from isochrome.specimens import specimen_model
from isochrome.stress import PixelGrid, StressDifference, principal_direction

Array = NDArray[np.floating]

_TOO_FINE_SHARE = 0.03
"""Share of the fringed pixels with fringes finer than two pixels at which a picture is refused: a
few at the edge of a contact or beside point loads, where the stress is steep, are no harm."""

_FLOAT32_BITS = 10
"""Bits up to which single precision, 1e-5 of the signal at N = 50, is below half a grey level."""


@dataclass(frozen=True)
class SceneState:
    """One state of a scene.

    Parameters
    ----------
    label : str
        Its name, such as 'static' or '31 m'.
    distance_m : float
        Distance slid, m.
    surface : SurfaceState or None
        What acts on the surface; None but in a contact.
    """

    label: str
    distance_m: float
    surface: SurfaceState | None


@dataclass(frozen=True)
class Picture:
    """What the camera would see (rows, cols), before the camera."""

    difference: StressDifference  # (sigma_x - sigma_z) + 2i tau_xz, MPa
    order: Array  # in the pixels' middles, fringes
    mean_order: Array  # that the pixels show, the mean over their area
    material: NDArray[np.bool_]  # False: no specimen
    visibility: Array  # of the fringes in a pixel's area
    too_fine: float  # share of the fringed pixels with fringes finer than two pixels


def scene_states(scene: Scene) -> list[SceneState]:
    """Solve a scene's mechanics: every state, in the scene's order.

    With `stress_map`, `polariscope_light` and `camera_frame` it is the way of `simulate`, step by
    step.

    Parameters
    ----------
    scene : Scene
        The scene.

    Returns
    -------
    list of SceneState
        The states; those of a contact have what acts on its surface, see `surface_tractions`.

    Raises
    ------
    InputError
        Where the scene has no model.
    PhysicsError
        Where it cannot be solved.

    Notes
    -----
    Source: Johnson (1985), Contact Mechanics, sections 4.2 and 5.4; Archard (1953), J. Appl. Phys.
    24, 981, for the wear.

    Examples
    --------
    >>> import isochrome
    >>> states = isochrome.scene_states(isochrome.load_scene("line-contact-wear"))
    >>> [state.label for state in states][:3]
    ['static', 'initial sliding', '31 m']
    """
    return list(iter_scene_states(scene))


def iter_scene_states(scene: Scene) -> Iterator[SceneState]:
    """The states of `scene_states`, each solved when it is asked for; InputError at once."""
    model = required_model(scene)
    if not scene.is_contact:
        return iter((SceneState(model, 0.0, None),))
    return (
        SceneState(
            f"{s.distance_m:g} m" if s.distance_m else "initial sliding" if s.sliding else "static",
            s.distance_m,
            with_added_tractions(scene, s),
        )
        for s in iter_contact_states(scene)
    )


def with_added_tractions(scene: Scene, surface: SurfaceState) -> SurfaceState:
    """A surface with the scene's added tractions; PhysicsError outside the contact's window."""
    added = scene.added_tractions
    if added is None:
        return surface
    grid, x = surface.grid, surface.grid.x_mm
    beyond = np.array([x[0] - added.x_mm[0], added.x_mm[-1] - x[-1]])
    if beyond.max() > x[-1] - x[0]:
        raise PhysicsError(
            "load_added_tractions_outside_window",
            first=added.x_mm[0],
            last=added.x_mm[-1],
            left_mm=float(x[0]),
            right=float(x[-1]),
        )
    before, behind = np.ceil(np.maximum(0.0, beyond) / grid.spacing_mm).astype(int).tolist()
    wider = replace(
        grid, left_mm=grid.left_mm - before * grid.spacing_mm, nodes=grid.nodes + before + behind
    )
    pressure, shear, depth = (
        np.pad(values, (before, behind))
        for values in (surface.pressure_mpa, surface.shear_mpa, surface.wear_depth_mm)
    )
    more = (
        np.interp(wider.x_mm, added.x_mm, values, left=0.0, right=0.0)
        for values in (added.pressure_mpa, added.shear_mpa)
    )
    return replace(
        surface, grid=wider, pressure_mpa=pressure + next(more), shear_mpa=shear + next(more),
        wear_depth_mm=depth, scar_edges_mm=surface.edges_mm,
    )  # fmt: skip


def state_count(scene: Scene) -> int:
    """Number of states of a scene, without solving them."""
    if not scene.is_contact:
        return 1
    if scene.load is not None and scene.load.tangential_n is not None:
        return 1
    static = scene.friction is not None and scene.friction.static_state_first
    return int(static) + (len(scene.wear.distances_m) if scene.wear else 1)


def required_model(scene: Scene) -> str:
    """The name of a scene's model; InputError where it has none."""
    if scene.model is None:
        raise InputError(no_model_sentence(scene))
    return scene.model


def no_model_sentence(scene: Scene) -> str:
    """Why a scene has no model, and what can be done with its frames all the same."""
    return message(
        "so_cannot_simulated_isochrome", name=scene.name, no_model_reason=scene.no_model_reason
    )


def state_difference(scene: Scene, state: SceneState, pixels: PixelGrid) -> StressDifference:
    """(sigma_x - sigma_z) + 2i tau_xz (rows, cols), MPa, of a state; NaN: no specimen."""
    return specimen_model(scene).difference(scene, state.surface, pixels)


def make_picture(scene: Scene, difference: StressDifference, pixels: PixelGrid) -> Picture:
    """Fringe order, mask and visibility of a stress field (sigma_x - sigma_z) + 2i tau_xz, MPa."""
    specimen = scene.specimen
    assert specimen.thickness_mm is not None and specimen.fringe_value_n_per_mm is not None
    order = fringe_order(
        difference,
        thickness_mm=specimen.thickness_mm,
        fringe_value_n_per_mm=specimen.fringe_value_n_per_mm,
    )
    material = np.isfinite(order)
    if scene.model:  # of any other specimen the field itself says where it is
        material &= specimen_model(scene).inside(pixels)
    order = order if material.all() else np.where(material, order, np.nan)
    visibility, too_fine = pixel_visibility(order)
    return Picture(difference, order, mean_order(order), material, visibility, too_fine)


def picture_signal(scene: Scene, picture: Picture, step: int | None = None) -> Array:
    """A picture's signal, 1 for full light: (rows, cols), of a colour camera (rows, cols, 3).

    `step`: phase step, None: the field. InputError: a response or a light that cannot be used.
    """
    camera, polariscope = scene.camera, scene.polariscope
    order, covered = picture.mean_order, picture.material.all()
    if not covered:
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
    if not covered:
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
        share, pixel = 100 * picture.too_fine, scene.camera.pixel_mm if scene.camera else None
        raise PhysicsError("fringes_finer_two_pixels", name=scene.name, too_fine=share, pixel=pixel)
