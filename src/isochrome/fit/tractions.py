"""Surface tractions from a frame's fringes: pressure and shear where no contact model fits.

Nothing is assumed of the bodies in contact but that the specimen is a half-plane whose surface is
pressed and rubbed, p(x) >= 0 and |q| <= m p, and that what its far sides add is smooth. The stress
follows from these, and so do the principal stresses apart.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.fit.frame_data import FrameData
from isochrome.fit.tractions_basis import lattice_px, scaled_modes
from isochrome.fit.tractions_course import invert
from isochrome.fit.tractions_solve import Optics, field_grid
from isochrome.fit.tractions_stage import Setup, Stage, State
from isochrome.fit.tractions_told import what_to_say
from isochrome.optics import make_chain
from isochrome.scene import Scene
from isochrome.simulate import scene_states
from isochrome.simulate.model import regular_stress
from isochrome.stress import (
    PixelGrid,
    RegularStress,
    StressComponents,
    components_on_grid,
    pixel_grid,
)

Array = NDArray[Any]

FRICTION_LIMIT = 1.0
"""Largest |q|/p that is thought of: dry contacts of solids stay well below."""

DEGREE = 2
"""Degree of the regular stress: uniform, its slopes, and the next terms of far sides."""


@dataclass(frozen=True)
class Measured:
    """A value with its standard uncertainty."""

    value: float
    standard_uncertainty: float


@dataclass(frozen=True)
class Tractions:
    """What a frame says of its surface's tractions.

    `x_mm` (n,), nodes between which the tractions are linear, multiples of a step apart; they are
    zero a step beyond. `pressure_mpa`, `shear_mpa` (on the specimen, along +x) and their standard
    uncertainties (n,); `load_n`, `tangential_n`, the resultants; `regular`, the stress besides;
    `pixels`, the picture's place, its upper edge as found; `chi`, residual over noise;
    `regularisation`, the weight of ∫ p''² + q''² dx, mm³/MPa²; `warnings` in plain words;
    `lattice_mpa`, pressure and shear at nodes a pixel apart, see `field_grid`.
    """

    x_mm: Array
    pressure_mpa: Array
    pressure_standard_uncertainty_mpa: Array
    shear_mpa: Array
    shear_standard_uncertainty_mpa: Array
    load_n: Measured
    tangential_n: Measured
    regular: RegularStress
    pixels: PixelGrid
    chi: float
    regularisation: float
    warnings: tuple[str, ...]
    lattice_mpa: tuple[Array, Array]

    def to_json(self) -> dict[str, Any]:
        """The resultants and how sure they are, for the command's JSON."""
        return {
            "load_n": asdict(self.load_n),
            "tangential_n": asdict(self.tangential_n),
            "chi": self.chi,
            "top_mm": self.pixels.top_mm,
            "bulk_mpa": self.regular.series[0].real,
            "bulk_along_x_mpa_per_mm": self.regular.series[1].real,
            "bulk_along_z_mpa_per_mm": self.regular.series[1].imag,
            "regularisation_mm3_per_mpa2": self.regularisation,
            "warnings": list(self.warnings),
        }

    def sentence(self) -> str:
        """The resultants in one line."""
        parts = (("load_n", self.load_n), ("tangential_n", self.tangential_n))
        said = [f"{key} = {m.value:.6g} ± {m.standard_uncertainty:.2g}" for key, m in parts]
        return f"{', '.join(said)}, chi = {self.chi:.3f}"

    def components(self) -> StressComponents:
        """All three stress components at every pixel (rows, cols), MPa; zero above the surface."""
        return components_on_grid(field_grid(self.pixels), *self.lattice_mpa, regular=self.regular)


def invert_tractions(
    data: FrameData,
    scene: Scene,
    *,
    others: tuple[Scene, ...] = (),
    free_top: bool = False,
    friction_limit: float = FRICTION_LIMIT,
) -> Tractions:
    """Pressure and shear on the surface of a contact from one frame, without a contact model.

    Parameters: `data`; `scene`, one state, where the search starts, and which gives optics and
    pixels; `others`, where it starts again should it fail, such as the scene before it was fitted;
    `free_top`, whether the surface's place in the picture is found too (that along x goes into the
    tractions); `friction_limit` m of |q| <= m p. Returns Tractions. Raises InputError where the
    scene is no contact, PhysicsError where the frame shows no load.
    """
    refuse_without_contact(scene)
    specimen, camera = scene.specimen, scene.camera
    assert camera and specimen.thickness_mm and specimen.fringe_value_n_per_mm
    if scene.frames.stated_gamma != data.gamma:
        data = data.toned(scene.frames.stated_gamma)
    optics = Optics(
        make_chain(scene.polariscope),
        specimen.thickness_mm / specimen.fringe_value_n_per_mm,
        camera.blur_px,
    )
    shape = (data.light.shape[0], data.light.shape[1])
    starts = [_start(one, shape) for one in (scene, *others)]
    stage, begun = invert(Setup(data, optics, friction_limit, DEGREE, free_top), starts)
    return _result(stage, begun, specimen.thickness_mm)


def refuse_without_contact(scene: Scene) -> None:
    """Raise InputError where a scene has no contact on whose surface tractions could act."""
    if scene.model != "contact":
        raise InputError(
            f"{scene.name}: tractions act on the surface of a contact, and this scene has no "
            "[indenter]; add it, or leave out --tractions"
        )


def _start(scene: Scene, shape: tuple[int, int]) -> State:
    """The tractions of a scene's model, and the regular stress that the scene gives."""
    pixels = pixel_grid(scene, shape)
    surface = scene_states(scene)[-1].surface
    assert surface is not None
    places = pixels.left_mm + pixels.pixel_mm * lattice_px(pixels)
    pressure, shear = (
        np.interp(places, surface.grid.x_mm, traction, left=0.0, right=0.0)
        for traction in (surface.pressure_mpa, surface.shear_mpa)
    )
    series = regular_stress(scene, surface, pixels).series
    modes = []
    for mode in scaled_modes(pixels, DEGREE):
        unit = mode.series[-1]
        given = series[len(mode.series) - 1] if len(mode.series) <= len(series) else 0j
        modes.append((given * unit.conjugate()).real / abs(unit) ** 2)
    return State(pixels, pressure, shear, np.array(modes))


def _result(stage: Stage, begun: list[Stage], thickness_mm: float) -> Tractions:
    basis, solution, state = stage.basis, stage.solution, stage.state()
    pixels, n = state.pixels, basis.nodes
    pressure, shear = basis.tractions(solution.unknowns)
    to = basis.to_tractions
    spread = np.sqrt(np.diag(to @ stage.covariance(bound=False) @ to.T))
    cover = to @ stage.covariance(smooth=False) @ to.T
    width = basis.spacing_px * pixels.pixel_mm * thickness_mm
    load, tangential = (
        Measured(width * float(traction.sum()), width * float(np.sqrt(cover[part, part].sum())))
        for traction, part in ((pressure, slice(n)), (shear, slice(n, None)))
    )
    return Tractions(
        x_mm=pixels.left_mm + pixels.pixel_mm * basis.nodes_px,
        pressure_mpa=pressure,
        pressure_standard_uncertainty_mpa=spread[:n],
        shear_mpa=shear,
        shear_standard_uncertainty_mpa=spread[n:],
        load_n=load,
        tangential_n=tangential,
        regular=basis.regular(solution.unknowns),
        pixels=pixels,
        chi=solution.chi,
        regularisation=stage.strength,
        warnings=what_to_say(stage, begun, (load.value, load.standard_uncertainty)),
        lattice_mpa=(state.pressure, state.shear),
    )
