"""What the other rooms ask of a specimen, and its model by the shape's name."""

from abc import ABC, abstractmethod
from importlib import import_module

import numpy as np
from numpy.typing import NDArray

from isochrome import stress
from isochrome.contact import SurfaceState
from isochrome.scene import BODIES, Scene
from isochrome.stress import PixelGrid, RegularStress, ShearPeak, StressComponents, StressDifference

Floats = NDArray[np.floating]
Mask = NDArray[np.bool_]
Acting = SurfaceState | None
"""What acts on a specimen's surface in one state; None but in a contact."""


class SpecimenModel(ABC):
    """A kind of specimen; x from its middle (or the contact's), z down from its top."""

    unknowns: tuple[str, ...] = ("load.normal_n", "camera.left_mm", "camera.top_mm")
    """What a frame can tell of any such scene; what its other parts add is not here."""

    @abstractmethod
    def components(self, scene: Scene, surface: Acting, pixels: PixelGrid) -> StressComponents:
        """Stress components (rows, cols), MPa; NaN outside the specimen."""

    def difference(self, scene: Scene, surface: Acting, pixels: PixelGrid) -> StressDifference:
        """(sigma_x - sigma_z) + 2i tau_xz (rows, cols), MPa; NaN outside the specimen."""
        return self.components(scene, surface, pixels).difference

    def inside(self, pixels: PixelGrid) -> Mask:
        """Where the stress is the specimen's alone (rows, cols or 1); NaN in it says the rest."""
        return np.ones((pixels.rows, 1), dtype=bool)

    def trusted(self, scene: Scene, pixels: PixelGrid, hidden_mm: float) -> Mask:
        """Where a fit compares (rows, cols or 1): away from where place or load is no ideal one.
        `hidden_mm`, the depth below a contact's surface that is left out."""
        return self.inside(pixels)

    def peak(
        self, scene: Scene, surface: Acting, difference: Floats, pixels: PixelGrid
    ) -> ShearPeak:
        """Largest shear in the material in view, here at the pixels' centres, and its place.
        `difference`, sigma_1 - sigma_2 (rows, cols), MPa; NaN outside the material."""
        shear = 0.5 * np.nan_to_num(difference, nan=-1.0)
        row, col = np.unravel_index(int(shear.argmax()), shear.shape)
        return ShearPeak(float(shear[row, col]), *pixels.place(int(row), int(col)))

    def added_stress(self, scene: Scene, surface: SurfaceState, pixels: PixelGrid) -> RegularStress:
        """Stress (MPa) in a contact's specimen besides a half-plane's by the tractions."""
        return stress.NO_STRESS

    def side_stress(self, scene: Scene, surface: SurfaceState, pixels: PixelGrid) -> RegularStress:
        """What the sides add to a half-plane's stress under the same contact."""
        return stress.NO_STRESS


def centred(scene: Scene, pixels: PixelGrid) -> tuple[Floats, Floats]:
    """Places (mm) that the pixels look at, from the middle of a specimen that is shown whole."""
    x, z = pixels.places
    return x, z - 0.5 * (scene.body_height_mm or 0.0)


def form_sizes(scene: Scene) -> dict[str, float]:
    """What the closed form of a scene's specimen asks of it, by the names of its arguments."""
    keys = (*BODIES[scene.specimen.shape or ""].needs, "specimen.thickness_mm")
    # only a contact's load varies with distance
    return {"load_n": scene.load_at(0.0)} | {k.partition(".")[2]: scene.get(k) for k in keys}


def specimen_model(scene: Scene) -> SpecimenModel:
    """The model of a scene's specimen, by default a contact's; only its module is imported."""
    shape = scene.specimen.shape or "contact"
    model: SpecimenModel = import_module(f"isochrome.specimens.{shape}").MODEL
    return model
