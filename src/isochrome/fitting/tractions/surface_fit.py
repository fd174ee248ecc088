"""Surface tractions from a frame's fringes: pressure and shear where no contact model fits.

Nothing is assumed of the bodies in contact but that the specimen is a half-plane whose surface is
pressed and rubbed, p(x) >= 0 and |q| <= m p, and that what its far sides add is smooth. The stress
follows from these, and so do the principal stresses apart. Warnings say where they may be wrong.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from isochrome.errors import InputError
from isochrome.estimation import FrameData
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.frame_set import refuse_bent
from isochrome.fitting.tractions.continuation import GOOD_CHI, invert
from isochrome.fitting.tractions.traction_basis import (
    DEGREE,
    lattice_px,
    picture_unit,
    scaled_modes,
)
from isochrome.fitting.tractions.traction_solver import field_grid
from isochrome.fitting.tractions.traction_stage import Setup, Stage, State
from isochrome.messages import message, warnings_json
from isochrome.output import with_uncertainty
from isochrome.scene import Scene
from isochrome.simulation import scene_states
from isochrome.specimens import specimen_model
from isochrome.stress import (
    PixelGrid,
    RegularStress,
    StressComponents,
    components_on_grid,
    pixel_grid,
)

_BLOCK = 32
_FEW = 60
"""Bins in a block below which its chi is too uncertain."""

_LOCAL_CHI = 1.5
"""Chi of a block of 60 bins has a standard deviation of 0.09: this one is no noise."""

_NEARLY = 1.1
_SAME_LOAD = 0.005
_UNCERTAIN = 0.01
_LIMITED = 0.1


@dataclass(frozen=True)
class Measured:
    """A value with its standard uncertainty."""

    value: float
    standard_uncertainty: float


@dataclass(frozen=True, kw_only=True)
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
            **warnings_json(self.warnings),
        }

    def sentence(self) -> str:
        """The resultants in one line."""
        parts = (("load_n", self.load_n), ("tangential_n", self.tangential_n))
        values = [
            f"{key} = {with_uncertainty(m.value, m.standard_uncertainty)}" for key, m in parts
        ]
        return f"{', '.join(values)}, chi = {self.chi:.3f}"

    def components(self) -> StressComponents:
        """All three stress components at every pixel (rows, cols), MPa; zero above the surface."""
        return components_on_grid(field_grid(self.pixels), *self.lattice_mpa, regular=self.regular)


def invert_tractions(
    data: FrameData, scene: Scene, *, others: tuple[Scene, ...] = (), free_top: bool = False
) -> Tractions:
    """Pressure and shear on the surface of a contact from one frame, without a contact model.

    Parameters: `data`; `scene`, one state, where the search starts, and which gives optics and
    pixels; `others`, where it starts again should it fail, such as the scene before it was fitted;
    `free_top`, whether the surface's place in the picture is found too (that along x goes into the
    tractions). Returns Tractions. Raises InputError where the scene is no contact, PhysicsError
    where the frame shows no load.
    """
    refuse_without_contact(scene)
    if scene.frames.stated_gamma != data.gamma:
        data = data.toned(scene.frames.stated_gamma)
    optics = scene_optics(scene)
    starts = [_start(one, data.shape) for one in (scene, *others)]
    stage, begun = invert(Setup(data, optics, free_top), starts)
    return _result(stage, begun, optics.thickness_mm)


def refuse_without_contact(scene: Scene) -> None:
    """Raise InputError where a scene has no contact on whose surface tractions could act."""
    if scene.indenter is None:
        raise InputError("tractions_act_surface_contact", name=scene.name)
    refuse_bent(scene, message("inverted_tractions_leave_out"))


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
    series = specimen_model(scene).added_stress(scene, surface, pixels).series
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


def what_to_say(stage: Stage, begun: list[Stage], load: tuple[float, float]) -> tuple[str, ...]:
    """Warnings about an inversion.

    Parameters: `stage`, the last; `begun`, the first stages from all beginnings, the one that was
    followed first; `load`, the resultant and its standard uncertainty (N). Returns sentences.
    """
    result = []
    chi, worst = stage.solution.chi, local_chi(stage)
    if chi > GOOD_CHI:
        result.append(message("chi_no_tractions_half", chi=chi))
    elif worst > _LOCAL_CHI:
        result.append(message("chi_one_place_near", worst=worst))
    if not stage.solution.converged:
        result.append(message("inversion_did_not_converge"))
    rivals = [one for one in begun[1:] if one.solution.chi < _NEARLY * begun[0].solution.chi]
    if any(_differ(one, begun[0]) for one in rivals):
        result.append(message("other_resultants_explain_deep"))
    if load[1] > _UNCERTAIN * load[0]:
        result.append(message("load_determined_only_more", load=100 * load[1] / load[0]))
    return (*result, *_of_the_surface(stage))


def _of_the_surface(stage: Stage) -> list[str]:
    """What to say where the tractions touch their limits."""
    basis, c, pixels = stage.basis, stage.solution.unknowns, stage.problem.pixels
    pressure, shear = basis.tractions(c)
    result = []
    touching = np.abs(shear) > (1.0 - 1e-9) * basis.limit * pressure
    share = pressure[touching & (pressure > 0.0)].sum() / max(pressure.sum(), 1e-300)
    if share > _LIMITED:
        result.append(
            message("largest_friction_allowed_over", limit=basis.limit, share=100 * share)
        )
    reach = 2 * basis.spacing_px
    pressed = basis.nodes_px[pressure > 0.0]
    if len(pressed) and (pressed[0] < reach or pressed[-1] > pixels.cols - reach):
        result.append(message("pressure_reaches_picture_side"))
    return result


def _differ(one: Stage, other: Stage) -> bool:
    loads = [float(s.basis.tractions(s.solution.unknowns)[0].sum()) for s in (one, other)]
    return abs(loads[0] - loads[1]) > _SAME_LOAD * max(loads)


def local_chi(stage: Stage) -> float:
    """The largest chi of a block of 32 x 32 bins; 0 where no block has enough of them."""
    bins, unit = stage.problem.bins, picture_unit(stage.problem.pixels)
    size = _BLOCK * unit * bins.side
    place = np.stack([bins.side, bins.row // size, bins.col // size])
    block = np.unique(place, axis=1, return_inverse=True)[1].ravel()
    count = np.bincount(block)
    square = np.bincount(block, weights=np.square(stage.solution.residual))
    enough = count >= _FEW
    return float(np.sqrt((square[enough] / count[enough]).max())) if enough.any() else 0.0
