"""The beam in four-point bending: its span of pure bending, mid-span at x = 0, its top at z = 0."""

import numpy as np

from isochrome.reference import beam_stress
from isochrome.scene import Scene
from isochrome.specimens.interface import Acting, Floats, SpecimenModel, centred, form_sizes
from isochrome.stress import PixelGrid, ShearPeak, StressComponents


class BeamModel(SpecimenModel):
    """A beam between its inner rollers; see `isochrome.reference.beam_stress`."""

    unknowns = ("load.normal_n", "camera.top_mm")  # it is the same all along

    def components(self, scene: Scene, surface: Acting, pixels: PixelGrid) -> StressComponents:
        """sigma_x alone; NaN outside the inner span too, where bending is not pure."""
        (x, eta), sizes = centred(scene, pixels), form_sizes(scene)
        inside = np.where(np.abs(x) <= 0.5 * sizes["inner_span_mm"], 1.0, np.nan)
        sigma_x = beam_stress(eta, **sizes) * inside
        nothing = np.where(np.isfinite(sigma_x), 0.0, np.nan)
        return StressComponents(sigma_x, nothing, nothing)

    def peak(
        self, scene: Scene, surface: Acting, difference: Floats, pixels: PixelGrid
    ) -> ShearPeak:
        """Bending is linear over the height: the largest is at an end of what is in view."""
        sizes = form_sizes(scene)
        _, _, top, bottom = pixels.window
        ends = np.array([max(top, 0.0), min(bottom, sizes["height_mm"])])
        shear = 0.5 * np.abs(beam_stress(ends - 0.5 * sizes["height_mm"], **sizes))
        end = int(np.nan_to_num(shear, nan=-1.0).argmax())
        middle = pixels.left_mm + 0.5 * pixels.cols * pixels.pixel_mm
        return ShearPeak(float(shear[end]), middle, float(ends[end]))


MODEL = BeamModel()
