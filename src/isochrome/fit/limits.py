"""The limit of what a frame can tell: the Cramér-Rao bound of a scene's unknowns."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from isochrome.errors import PhysicsError
from isochrome.fit.frame_data import FrameData
from isochrome.fit.frame_fit import placed, values_of
from isochrome.fit.local import FrameModel, LocalModel
from isochrome.fit.one_state import with_own_numerics
from isochrome.fit.unknowns import fit_region
from isochrome.scene import Scene

Array = NDArray[Any]

_SURFACE_PX = 0.5


def cramer_rao_bound(data: FrameData, scene: Scene, keys: tuple[str, ...]) -> Array:
    """The least standard uncertainty that any unbiased estimate of a frame's unknowns can have.

    Equation: sqrt(diag(F⁻¹)), F = Σ j jᵀ over all trusted pixels of the specimen, j the derivative
    of the stored level over its noise, less what illumination and background explain of it, which
    nobody knows either. The noise is the frame's own, its rounding included; what its variance
    would tell by changing with the level is left out.
    Parameters: `data`, for its noise, its trusted pixels and its light's smoothness; `scene`, one
    state, with the true values (or the fitted ones); `keys`, the unknowns (p,).
    Returns the bounds (p,), in the keys' units, inf for what the frame does not tell. Raises
    PhysicsError where the scene cannot be solved. Source: Kay (1993), Fundamentals of Statistical
    Signal Processing I, section 3.7; Golub & Pereyra (1973) for the linear unknowns.
    """
    return local_model(data, scene, keys).bound


def local_model(data: FrameData, scene: Scene, keys: tuple[str, ...]) -> LocalModel:
    """A frame's model about its scene's own values, at every trusted pixel of the specimen.

    Parameters as in `cramer_rao_bound`. Returns a LocalModel, whose `normal` is F above.
    """
    shape = (data.light.shape[0], data.light.shape[1])
    scene = with_own_numerics(placed(scene, shape))
    values = values_of(scene, keys)
    model = FrameModel(data, scene, keys, fit_region(scene, shape, 1, _SURFACE_PX))
    toned = model.at(values)
    if toned is None:
        raise PhysicsError(f"{scene.name}: the scene cannot be solved at its own values")
    return model.linearise(values, toned)
