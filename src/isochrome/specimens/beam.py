"""The beam in four-point bending: its span of pure bending, mid-span at x = 0, its top at z = 0."""

import numpy as np

from isochrome.reference import beam_stress
from isochrome.scene import Scene
from isochrome.specimens.interface import Acting, Floats, SpecimenModel
from isochrome.stress import PixelGrid, ShearPeak, StressComponents


class BeamModel(SpecimenModel):
    """A beam between its inner rollers; see `isochrome.reference.beam_stress`."""

    unknowns = ("load.normal_n", "camera.top_mm")  # it is the same all along

    def components(self, scene: Scene, surface: Acting, pixels: PixelGrid) -> StressComponents:
        """sigma_x alone; NaN outside the inner span too, where bending is not pure."""
        assert scene.load is not None and scene.load.inner_span_mm is not None
        x, z = pixels.places
        inside = np.where(np.abs(x) <= 0.5 * scene.load.inner_span_mm, 1.0, np.nan)
        sigma_x = _bending(scene, z) * inside
        nothing = np.where(np.isfinite(sigma_x), 0.0, np.nan)
        return StressComponents(sigma_x, nothing, nothing)

    def peak(
        self, scene: Scene, surface: Acting, difference: Floats, pixels: PixelGrid
    ) -> ShearPeak:
        """Bending is linear over the height: the largest is at an end of what is in view."""
        height = scene.specimen.height_mm
        assert height is not None
        _, _, top, bottom = pixels.window
        ends = np.array([max(top, 0.0), min(bottom, height)])
        shear = 0.5 * np.abs(_bending(scene, ends))
        end = int(np.nan_to_num(shear, nan=-1.0).argmax())
        middle = pixels.left_mm + 0.5 * pixels.cols * pixels.pixel_mm
        return ShearPeak(float(shear[end]), middle, float(ends[end]))


MODEL = BeamModel()


def _bending(scene: Scene, z_mm: Floats) -> Floats:
    """sigma_x (MPa) at depths below the beam's top, of their shape; NaN outside."""
    specimen, load = scene.specimen, scene.load
    assert load is not None and load.inner_span_mm is not None and load.outer_span_mm is not None
    assert specimen.height_mm is not None and specimen.thickness_mm is not None
    assert isinstance(load.normal_n, float)  # only a contact's load varies with distance
    return beam_stress(
        z_mm - 0.5 * specimen.height_mm,
        load_n=load.normal_n,
        inner_span_mm=load.inner_span_mm,
        outer_span_mm=load.outer_span_mm,
        height_mm=specimen.height_mm,
        thickness_mm=specimen.thickness_mm,
    )
