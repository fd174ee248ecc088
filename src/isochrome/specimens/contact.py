"""The specimen of a contact: a half-plane under the tractions on its surface."""

from functools import lru_cache

import numpy as np

from isochrome import stress
from isochrome.contact import ContactGrid, SurfaceState
from isochrome.scene import Scene
from isochrome.specimens.interface import Acting, Floats, Mask, SpecimenModel
from isochrome.stress import PixelGrid, RegularStress, ShearPeak, StressComponents, StressDifference

_SPLINE_PX = 2.0
"""Depth that a field seen through a lens loses: its spline knows nothing above the surface."""


class HalfPlane(SpecimenModel):
    """A half-plane: its stress is that of the contact's tractions, and of a bulk stress."""

    def components(self, scene: Scene, surface: Acting, pixels: PixelGrid) -> StressComponents:
        """Stress components below the surface."""
        assert surface is not None
        grid, places = self._looked_at(scene, surface, pixels)
        trace = stress.stress_trace(grid, surface.pressure_mpa, surface.shear_mpa)
        if grid.pixels != pixels:
            trace = stress.seen_by(trace, grid.pixels, places)
        added = self.added_stress(scene, surface, pixels)
        if added:
            trace += added.trace(*places).astype(trace.dtype)
        return StressComponents.from_invariants(self.difference(scene, surface, pixels), trace)

    def difference(self, scene: Scene, surface: Acting, pixels: PixelGrid) -> StressDifference:
        """The stress difference alone, which takes half the work."""
        assert surface is not None
        grid, places = self._looked_at(scene, surface, pixels)
        shear = surface.shear_mpa if surface.shear_mpa.any() else None
        field = stress.stress_difference(grid, surface.pressure_mpa, shear)
        if grid.pixels != pixels:
            field = stress.seen_by(field, grid.pixels, places)
        added = self.added_stress(scene, surface, pixels)
        if added:
            field += added.difference(*places).astype(field.dtype)
        return field

    def _looked_at(
        self, scene: Scene, surface: SurfaceState, pixels: PixelGrid
    ) -> tuple[stress.FieldGrid, stress.Places]:
        """Kernels to a plain grid, of the pixels or around them, and the places that are seen."""
        bend = scene.bend_mm2_per_mpa
        plain = pixels.around(bent=bend != 0.0)
        grid = surface_field_grid(plain, surface.grid, scene.numerics.tolerance)
        if not bend:
            return grid, pixels.places
        gradient = stress.trace_gradient(grid, surface.pressure_mpa, surface.shear_mpa)
        return grid, stress.bent_places(gradient, plain, pixels, bend)

    def inside(self, pixels: PixelGrid) -> Mask:
        """Below the surface: a pixel that it cuts sees the indenter too."""
        return np.asarray(pixels.places[1] >= (0.5 - 1e-6) * pixels.pixel_mm)

    def trusted(self, scene: Scene, pixels: PixelGrid, hidden_mm: float) -> Mask:
        """From `hidden_mm` below the surface on: above it the stress is steep."""
        if pixels.lens is not None or scene.bend_mm2_per_mpa:
            hidden_mm += _SPLINE_PX * pixels.pixel_mm
        return np.asarray(pixels.places[1] >= hidden_mm)

    def peak(
        self, scene: Scene, surface: Acting, difference: Floats, pixels: PixelGrid
    ) -> ShearPeak:
        """Largest shear between the pixels' centres too, the surface included."""
        assert surface is not None
        x, p, q = surface.grid.x_mm, surface.pressure_mpa, surface.shear_mpa
        added = self.added_stress(scene, surface, pixels)
        return stress.largest_shear(x, p, q, within=pixels.window, regular=added)

    def added_stress(self, scene: Scene, surface: SurfaceState, pixels: PixelGrid) -> RegularStress:
        """The bulk stress, a machined edge's, and what sides add."""
        load, sides = scene.load, self.side_stress(scene, surface, pixels)
        edge = scene.specimen.edge_stress_mpa, scene.specimen.edge_depth_mm
        sides += RegularStress(edges=(edge,) if edge[0] else ())
        if load is None:
            return sides
        slope = complex(load.bulk_along_x_mpa_per_mm or 0.0, load.bulk_along_z_mpa_per_mm or 0.0)
        return sides + RegularStress((complex(load.bulk_mpa or 0.0), slope))


MODEL = HalfPlane()


@lru_cache(maxsize=1)
def surface_field_grid(pixels: PixelGrid, grid: ContactGrid, tolerance: float) -> stress.FieldGrid:
    """The kernels from a contact's nodes to the pixels, ten pictures large; the last are kept."""
    left, step, nodes = grid.left_mm, grid.spacing_mm, grid.nodes
    kind = stress.field_dtype(tolerance)
    return stress.make_field_grid(pixels, left_mm=left, spacing_mm=step, nodes=nodes, dtype=kind)
