"""What a scene's polariscope makes of a stress difference: fringes, and the light behind it."""

from __future__ import annotations

from dataclasses import dataclass

from isochrome.fitting.arrays import Array
from isochrome.optics import Chain, fringe_order, make_chain, polariscope_signal
from isochrome.scene import Scene
from isochrome.stress import principal_direction


@dataclass(frozen=True)
class FringeOptics:
    """The polariscope's `chain`; the specimen's `thickness_mm` d and fringe value f_sigma.

    `blur_px`, standard deviation of the camera's blur.
    """

    chain: Chain
    thickness_mm: float
    fringe_value_n_per_mm: float
    blur_px: float

    @property
    def order_per_mpa(self) -> float:
        """Fringes of a stress difference of 1 MPa, d/f_sigma."""
        return self.thickness_mm / self.fringe_value_n_per_mm

    def order(self, difference: Array) -> Array:
        """Fringe orders N of stress differences (sigma_x - sigma_z) + 2i tau_xz, MPa."""
        return fringe_order(
            difference,
            thickness_mm=self.thickness_mm,
            fringe_value_n_per_mm=self.fringe_value_n_per_mm,
        )

    def signal(
        self, difference: Array, *, order: Array | None = None, visibility: Array | float = 1.0
    ) -> Array:
        """The polariscope's signal, 0..1; `order`, where it is not that of the difference alone."""
        order = self.order(difference) if order is None else order
        direction = None if self.chain.ideal else principal_direction(difference)
        return polariscope_signal(order, self.chain, direction=direction, visibility=visibility)


def scene_optics(scene: Scene) -> FringeOptics:
    """A scene's optics; of a phase-stepped set, those of its first step."""
    specimen, polariscope = scene.specimen, scene.polariscope
    assert specimen.thickness_mm is not None and specimen.fringe_value_n_per_mm is not None
    chain = make_chain(polariscope, 0 if polariscope.step else None)
    blur_px = scene.camera.blur_px if scene.camera else 0.0
    return FringeOptics(chain, specimen.thickness_mm, specimen.fringe_value_n_per_mm, blur_px)
