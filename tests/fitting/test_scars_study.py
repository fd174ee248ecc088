"""Frames and measured scars together in sixty drawn cases: pulls, and what each adds. The frames
are rendered by the package; the scars are `worn_scars`' truths, of another solution. Seeds are
[number, 18], and number of the noise. One state or two, noise 1 to 20 grey levels, Ra .05 to .8 µm,
four traces."""

from dataclasses import dataclass

import numpy as np
import pytest

import isochrome
import worn_scars
from isochrome.scars import levelled, read_trace
from scene_texts import SMALL_CAMERA, WORN_CONTACT

LOAD, FRICTION, WEAR = "load.normal_n", "friction.coefficient", "wear.coefficient_mm2_per_n"
KEYS = [LOAD, FRICTION, WEAR]
AT = (77.0, 77.0, 155.0, 155.0)
"""Distances of the four traces, m."""


@dataclass(frozen=True)
class Case:
    """By the keys: error over uncertainty with scars; uncertainties with them and by frames alone.
    `by_scars`, uncertainty of k by the scars alone, at a load that is known."""

    pulls: np.ndarray
    both: np.ndarray
    frames: np.ndarray
    by_scars: float


def drawn(folder, number):
    """A case: true values, the folder of its frames, and its scene's text and traces' text."""
    rng = np.random.default_rng([number, 18])
    truth = {
        LOAD: rng.uniform(35.0, 55.0),
        FRICTION: rng.uniform(0.1, 0.35),
        WEAR: rng.uniform(1e-9, 3e-9),
    }
    ra = np.exp(rng.uniform(np.log(0.05), np.log(0.8)))
    noise = np.exp(rng.uniform(0.0, np.log(20.0)))
    distances = [31.0, 77.0] if number % 2 else [77.0]
    text = WORN_CONTACT + SMALL_CAMERA + f"noise_grey = {noise:.3f}\n"
    own = {"wear.distances_m": distances, "camera.seed": number}  # noise of its own
    scene = isochrome.parse_scene(text).with_values(own | truth)
    isochrome.simulate(scene, folder / "sim")
    listed = ""
    for i, distance in enumerate(AT):
        finish = str(rng.choice(worn_scars.FINISHES))
        coefficient = truth[WEAR] * truth[LOAD] / worn_scars.LOAD_N
        x, z, _ = worn_scars.rough_trace(rng, distance, coefficient, ra, finish)
        worn_scars.write_trace(folder / f"{i}.csv", x, z)
        listed += f'\n[[scar]]\nfile = "{i}.csv"\ndistance_m = {distance}\n'
    off = dict(zip(KEYS, rng.uniform([0.95, 0.9, 0.8], [1.05, 1.1, 1.25]), strict=True))
    start = scene.with_values({key: truth[key] * off[key] for key in KEYS})
    return np.array([truth[key] for key in KEYS]), isochrome.dump_scene(start), listed


def judged(folder, number):
    folder.mkdir()
    truth, text, listed = drawn(folder, number)
    found = []
    for name, content in (("frames", text), ("both", text + listed)):
        (folder / f"{name}.toml").write_text(content, "utf-8")
        table = isochrome.fit(folder / "sim" / "frames.tif", folder / f"{name}.toml", KEYS).table
        rows = table.set_index("key").loc[KEYS]
        found.append((rows["value"].to_numpy(), rows["standard_uncertainty"].to_numpy()))
    (_, frames), (values, both) = found
    areas = [levelled(read_trace(folder / f"{i}.csv")) for i in range(len(AT))]
    shares = np.array([a.worn_area_uncertainty_mm2 / a.worn_area_mm2 for a in areas])
    by_scars = values[2] * float(np.sum(shares**-2.0) ** -0.5)
    return Case((values - truth) / both, both, frames, by_scars)


@pytest.mark.study
def test_frames_and_scars_together_are_as_sure_as_they_say(tmp_path):
    """Pulls .8 to 1.3, and no uncertainty above that of either alone. The frames' own uncertainty
    is that of a fit that ends elsewhere within its noise, and goes with its residual's chi: two in
    a hundred between the two fits are chance."""
    cases = [judged(tmp_path / str(number), number) for number in range(60)]
    pulls = np.array([case.pulls for case in cases])
    share = np.array([case.both / case.frames for case in cases])
    of_scars = np.array([case.both[2] / case.by_scars for case in cases])
    spread = np.sqrt(np.mean(pulls**2, axis=0))
    print(
        f"pulls {spread}; u over the frames' own: {share.max(axis=0)} at most; u of k over the "
        f"scars' own: {of_scars.max():.2f} at most"
    )
    assert (spread > 0.8).all() and (spread < 1.3).all()
    assert (share < 1.02).all() and (of_scars < 1.0).all()
