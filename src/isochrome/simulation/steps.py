"""What `simulate` does to a state, step by step: arrays with axes in, arrays with axes out."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.optics import expose
from isochrome.runs import Column, RunArray, RunDataset, make_dataset
from isochrome.scene import Scene
from isochrome.simulation.model import (
    SceneState,
    make_picture,
    picture_signal,
    refuse_too_fine,
    required_model,
    state_difference,
)
from isochrome.simulation.rendering import picture_array
from isochrome.stress import pixel_grid


def surface_tractions(state: SceneState) -> RunDataset:
    """Give the pressure, the shear and the worn depth along the surface of a contact's state.

    The first two are what acts on the specimen, and what `stress_map` takes the stress from.

    Parameters
    ----------
    state : SceneState
        One of `scene_states`.

    Returns
    -------
    RunDataset
        An xarray.Dataset over x_mm: pressure_mpa, shear_mpa (along +x) and wear_depth_um.

    Raises
    ------
    InputError
        Where the state is not a contact's.

    Examples
    --------
    >>> import isochrome
    >>> static, *_ = isochrome.scene_states(isochrome.load_scene("line-contact-wear"))
    >>> print(f"{isochrome.surface_tractions(static).pressure_mpa.max().item():.2f} MPa")
    18.76 MPa
    """
    surface = state.surface
    if surface is None:
        raise InputError(message("no_contact_state_has", label=state.label))
    values = {
        "pressure_mpa": (surface.pressure_mpa, "MPa", "pressure p"),
        "shear_mpa": (surface.shear_mpa, "MPa", "shear traction q along +x"),
        "wear_depth_um": (1e3 * surface.wear_depth_mm, "um", "worn depth h"),
    }
    columns = {
        name: Column(("x_mm",), along, {"units": units, "long_name": what})
        for name, (along, units, what) in values.items()
    }
    place = Column(("x_mm",), surface.grid.x_mm, {"units": "mm", "long_name": "along the surface"})
    return make_dataset(columns, {"x_mm": place}, {"label": state.label})


def stress_map(scene: Scene, state: SceneState) -> RunArray:
    """Compute the stress difference of a state on the pixels of the scene's camera.

    It is what photoelastic fringes show: sigma_1 - sigma_2, and the direction of sigma_1.

    Parameters
    ----------
    scene : Scene
        The scene, with [camera].
    state : SceneState
        One of its `scene_states`.

    Returns
    -------
    RunArray
        An xarray.DataArray of complex numbers over (z_mm, x_mm): (sigma_x - sigma_z) + 2i tau_xz,
        MPa; its size is sigma_1 - sigma_2. NaN where there is no specimen.

    Raises
    ------
    InputError
        Where the scene has no model, or no camera.

    Notes
    -----
    Source: Johnson (1985), Contact Mechanics, section 2.5, for the half-plane under tractions.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("line-contact-wear")
    >>> static, *_ = isochrome.scene_states(scene)
    >>> stress = isochrome.stress_map(scene, static)
    >>> print(f"{abs(stress).max().item():.2f} MPa")  # 0.6 p_max (Johnson, section 4.2)
    11.27 MPa
    """
    required_model(scene)
    pixels = pixel_grid(scene)
    values = state_difference(scene, state, pixels)
    attributes = {"units": "MPa", "long_name": "(sigma_x - sigma_z) + 2i tau_xz"}
    return picture_array(values, pixels, "stress_difference", attributes)


def polariscope_light(scene: Scene, stress: ArrayLike, *, step: int | None = None) -> RunArray:
    """Compute the light behind the scene's polariscope of a stress field.

    In the dark field it is sin²(πN), with the order N = t (sigma_1 - sigma_2)/f_sigma; a pixel
    shows the mean over its area.

    Parameters
    ----------
    scene : Scene
        The scene: thickness and fringe value, [polariscope] and [camera].
    stress : array_like of complex, shape (rows, cols)
        Stress difference, MPa, such as `stress_map` gives.
    step : int, optional
        Which of [[polariscope.step]]; by default the dark, bright or plane field.

    Returns
    -------
    RunArray
        An xarray.DataArray over (z_mm, x_mm), 1 for full light; of a colour camera over (z_mm,
        x_mm, channel).

    Raises
    ------
    InputError
        Where the field does not fit the camera, or thickness or fringe value are missing.
    PhysicsError
        Where the fringes are finer than the pixels.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("line-contact-wear")
    >>> static, *_ = isochrome.scene_states(scene)
    >>> light = isochrome.polariscope_light(scene, isochrome.stress_map(scene, static))
    >>> light.dims, bool(light.max() <= 1.0)
    (('z_mm', 'x_mm'), True)
    """
    pixels, values = pixel_grid(scene), np.asarray(stress)
    if values.shape != (pixels.rows, pixels.cols) or values.dtype.kind != "c":
        raise InputError(
            message(
                "stress_difference_shape_type",
                name=scene.name,
                shape=values.shape,
                dtype=values.dtype,
                rows=pixels.rows,
                cols=pixels.cols,
            )
        )
    for key in ("thickness_mm", "fringe_value_n_per_mm"):
        if getattr(scene.specimen, key) is None:
            raise InputError(message("specimen_missing_add", name=scene.name, key=key))
    if step is not None and step not in scene.polariscope.step_numbers:
        raise InputError(
            message(
                "step_polariscope_has_polariscope",
                name=scene.name,
                step=step,
                step_count=len(scene.polariscope.step),
            )
        )
    picture = make_picture(scene, values, pixels)
    refuse_too_fine(scene, picture)
    attributes = {"units": "1", "long_name": "light, 1 = full"}
    return picture_array(picture_signal(scene, picture, step), pixels, "light", attributes)


def camera_frame(
    scene: Scene, light: ArrayLike, *, rng: np.random.Generator | None = None
) -> RunArray:
    """Make the frame that the scene's camera stores of light.

    Background, vignette, blur, shot noise, gamma, read noise and bit depth are the scene's.

    Parameters
    ----------
    scene : Scene
        The scene, with [camera].
    light : array_like, shape (rows, cols) or (rows, cols, 3)
        Light, 1 for full light, such as `polariscope_light` gives.
    rng : numpy.random.Generator, optional
        Source of the noise; by default that of `simulate` for the scene's first state,
        ``numpy.random.default_rng([scene.camera.seed, 0])``. Number i has ``[seed, i]``, and the
        frames of its phase steps draw from it one after the other.

    Returns
    -------
    RunArray
        An xarray.DataArray of grey levels over (z_mm, x_mm): uint8 or uint16 by the bit depth,
        float32 without one.

    Raises
    ------
    InputError
        Where the scene has no camera, or the light is not of its size.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("line-contact-wear")
    >>> static, *_ = isochrome.scene_states(scene)
    >>> light = isochrome.polariscope_light(scene, isochrome.stress_map(scene, static))
    >>> frame = isochrome.camera_frame(scene, light)
    >>> frame.dtype, frame.shape
    (dtype('uint8'), (494, 659))
    """
    pixels, camera = pixel_grid(scene), scene.camera
    values: NDArray[np.floating] = np.asarray(light)
    channels = (3,) if camera is not None and camera.colour else ()
    if values.shape != (pixels.rows, pixels.cols, *channels) or values.dtype.kind != "f":
        raise InputError(
            message(
                "light_shape_type_give",
                name=scene.name,
                shape=values.shape,
                dtype=values.dtype,
                value=(pixels.rows, pixels.cols, *channels),
            )
        )
    assert camera is not None
    source = np.random.default_rng([camera.seed, 0]) if rng is None else rng
    attributes = {"units": "grey level", "long_name": "the camera's frame"}
    return picture_array(expose(values, camera, rng=source), pixels, "frame", attributes)
