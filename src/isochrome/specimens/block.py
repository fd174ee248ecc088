r"""Stress in a block of finite size: a half-plane's, and what its sides and its support add.

Below a contact that is small against its distance from the block's sides, these feel its
tractions by their resultants and first moments alone,

    P = ∫ p dx,  Q = ∫ q dx,  ∫ x p dx,  ∫ x q dx,

each times a regular stress found once for a block by finite elements and kept as a power series
(see `stress.half_plane`). What is left out is of the order (half-width/clearance)² of it. The
contact is solved as a half-plane's: the correction bends the surface by its bending stress over
Young's modulus, in the paper's block by 1e-4 of the cylinder's curvature.
"""

from functools import lru_cache

import numpy as np

from isochrome import stress
from isochrome.contact import SurfaceState
from isochrome.errors import InputError, PhysicsError
from isochrome.scene import Scene
from isochrome.specimens.contact import HalfPlane

FORCES = tuple(
    stress.PointForce(p, q, dipole) for dipole in (False, True) for p, q in np.eye(2).tolist()
)
"""Unit normal and tangential force, and their unit first moments."""

REACH = 0.6
"""Radius over the clearance within which the series stands for the block's correction."""
_DEGREE = 10
_WIDEST = 0.1
"""Largest half-width over the clearance: what is left out is below its square, 1 %."""


class BlockModel(HalfPlane):
    """A half-plane with sides and a support."""

    def side_stress(
        self, scene: Scene, surface: SurfaceState, pixels: stress.PixelGrid
    ) -> stress.RegularStress:
        """What sides and support add; InputError: a pixel too far; PhysicsError: too wide."""
        specimen = scene.specimen
        assert specimen.width_mm is not None and specimen.height_mm is not None
        assert specimen.poisson is not None
        left_mm = -0.5 * specimen.width_mm if specimen.left_mm is None else specimen.left_mm
        sides = stress.Sides(
            left_mm, left_mm + specimen.width_mm, specimen.height_mm, specimen.poisson,
            specimen.support == "sliding",
        )  # fmt: skip
        # no more of the block is shown than its corrections hold for
        x1, x2, z1, z2 = map(abs, pixels.window)
        far = float(np.hypot(max(x1, x2), max(z1, z2)))
        reach = REACH * sides.clearance
        if far > reach:
            raise InputError("picture_reaches_mm_from", name=scene.name, farthest=far, reach=reach)
        half, clearance = float(np.max(np.abs(surface.edges_mm))), sides.clearance
        if half > _WIDEST * clearance:
            raise PhysicsError(
                "contact_reaches_mm_from", name=scene.name, half_width=half, clearance=clearance
            )
        x, dx = surface.grid.x_mm, surface.grid.spacing_mm
        p, q = surface.pressure_mpa, surface.shear_mpa
        moments = (p.sum(), q.sum(), x @ p, x @ q)
        units = block_series(sides)
        parts = (s.times(dx * float(m)) for s, m in zip(units, moments, strict=True))
        return sum(parts, stress.NO_STRESS)


MODEL = BlockModel()


@lru_cache(maxsize=8)
def block_series(sides: stress.Sides) -> tuple[stress.RegularStress, ...]:
    """Corrections to a half-plane's stress under each of FORCES; InputError without scikit-fem."""
    reach = REACH * sides.clearance
    return tuple(_fitted(s, reach) for s in stress.corrections(sides, FORCES, within_mm=reach))


def _fitted(sample: stress.Sampled, reach: float) -> stress.RegularStress:
    """The power series of least squares over the Gauss points."""
    x, z, weight = sample.x / reach, sample.z / reach, np.sqrt(sample.area)

    def weighted(difference: np.ndarray, trace: np.ndarray) -> np.ndarray:
        return np.concatenate([weight * difference.real, weight * difference.imag, weight * trace])

    modes = stress.regular_modes(_DEGREE)
    matrix = np.stack([weighted(m.difference(x, z), m.trace(x, z)) for m in modes], axis=1)
    known = sample.stress
    wanted = weighted(known.difference, known.sigma_x + known.sigma_z)
    coefficients = np.linalg.lstsq(matrix, wanted, rcond=None)[0]
    # the modes are Re s_0, and then the real and the imaginary part of each s_n
    series = np.r_[coefficients[0], coefficients[1::2] + 1j * coefficients[2::2]]
    return stress.RegularStress(tuple((series / reach ** np.arange(_DEGREE + 1)).tolist()))
