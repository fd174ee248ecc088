"""Contacts as a laboratory might photograph them, drawn at random, and what is known of each."""

from dataclasses import dataclass

import numpy as np

from benchmarks.outside_camera import Defects, _sampled, _stored, lit
from isochrome.errors import PhysicsError
from isochrome.scene import Scene, parse_scene
from scene_texts import camera_text

TURNS, FLIPS = (0, 90, 180, 270), (None, "horizontal", "vertical")
GAMMAS, LOADS = (0.45, 2.2), (1.0 / 3.0, 3.0)
WIDTH_MM, ROWS, COLS = 4.0, 494, 659
HIGHEST = 8.0
"""Fringe order that the pixels of a whole picture resolve."""

_SCENE = """
[specimen]
young_gpa = {young}
poisson = {poisson}
thickness_mm = {thickness}
fringe_value_n_per_mm = {fringe_value}
[indenter]
radius_mm = {radius}
young_gpa = 210.0
poisson = 0.3
[load]
normal_n = {load}
[friction]
coefficient = {friction}
[polariscope]
wavelength_nm = 587.0
"""
_SCENE += camera_text("{cols}", "{rows}", "{pixel}", left_mm="{left}", top_mm="{top}", bit_depth=8)


@dataclass(frozen=True, kw_only=True)
class DrawnContact:
    """A captured picture and its truth.
    `captured`, grey levels as the camera gives them; `true`, the scene of the picture that lies as
    a scene wants it; `turn`, `flip`, what brings the captured one there; `field`, `gamma`;
    `about_n`, the load as the user knows it; `order`, that most pixels stay below."""

    captured: np.ndarray
    true: Scene
    turn: int
    flip: str | None
    field: str
    gamma: float
    about_n: float
    order: float


def drawn_contact(seed: int, *, shrunk: int = 1) -> DrawnContact:
    """The contact of a seed: order 1 to 8 in the picture, noise of 1 to 4 grey levels of 255.
    `shrunk`, how many times fewer pixels a side it has, and lower orders."""
    rng = np.random.default_rng([seed, 2020])
    while True:
        true = _random_scene(rng, shrunk)
        try:
            order, _ = _sampled(true, Defects(), -1)
        except PhysicsError:
            continue  # too wide for the picture
        highest = float(np.nanpercentile(order, 99.5))
        if 1.0 < highest < HIGHEST / shrunk**0.5:
            break
    field = str(rng.choice(["dark", "bright"]))
    gamma = float(np.exp(rng.uniform(*np.log(GAMMAS))))
    turn = int(rng.choice(TURNS))
    flip = FLIPS[rng.integers(3)]
    defects = Defects(
        gamma=gamma, fall_off=float(rng.uniform(0.0, 0.4)),
        background=float(rng.uniform(0.02, 0.08)), noise=float(rng.uniform(1.0, 4.0)),
    )  # fmt: skip
    dark = np.sin(np.pi * order) ** 2
    signal = np.nan_to_num(
        dark if field == "dark" else 1.0 - dark
    )  # the cylinder lets none through
    picture = _stored(lit(signal, defects), defects, rng)
    return DrawnContact(
        captured=laid_back(picture, turn, flip), true=true, turn=turn, flip=flip, field=field,
        gamma=gamma, order=highest,
        about_n=true.load.normal_n * float(np.exp(rng.uniform(*np.log(LOADS)))),
    )  # fmt: skip


def laid_back(picture: np.ndarray, turn: int, flip: str | None) -> np.ndarray:
    """The picture as it was before it was turned counter-clockwise and mirrored then."""
    before = {None: picture, "horizontal": picture[:, ::-1], "vertical": picture[::-1]}[flip]
    return np.ascontiguousarray(np.rot90(before, -(turn // 90)))


def _random_scene(rng: np.random.Generator, shrunk: int) -> Scene:
    rows, cols = ROWS // shrunk, COLS // shrunk
    pixel = WIDTH_MM / cols
    width, height = WIDTH_MM, rows * pixel
    return parse_scene(_SCENE.format(
        rows=rows, cols=cols, pixel=pixel,
        young=rng.uniform(1.5, 3.5), poisson=rng.uniform(0.33, 0.42),
        thickness=rng.uniform(2.5, 8.0), fringe_value=rng.uniform(10.0, 16.0),
        radius=np.exp(rng.uniform(*np.log([8.0, 40.0]))),
        load=np.exp(rng.uniform(*np.log([12.0, 160.0]))),
        friction=rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.5),
        left=-rng.uniform(0.25, 0.75) * width,
        # from two fifths of the picture above the surface to the surface out of view
        top=rng.uniform(-0.4, 0.1) * height,
    ))  # fmt: skip
