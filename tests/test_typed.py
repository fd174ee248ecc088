"""A script of a user that goes through all of the front door passes a strict type check."""

import subprocess
import sys
from pathlib import Path

import pytest

import isochrome
from test_notebooks import NOTEBOOKS, code_cells

SCRIPT = """
from pathlib import Path
import numpy as np
import xarray as xr
from numpy.typing import NDArray
import isochrome

sample = isochrome.samples.line_contact_wear()
frames: NDArray[np.uint8] = sample.frames
scene: isochrome.Scene = isochrome.load_scene(sample.tables)
lazy = xr.DataArray(frames, dims=("frame", "row", "col"))
for given in (frames, list(frames), frames[0], lazy, "captured.tif", Path("a.tif"), ["a.tif"]):
    pass
processed = isochrome.process(frames, scene)
isochrome.process(list(frames), sample.tables)
isochrome.process(lazy, sample.scene)
isochrome.process([Path("a.tif"), Path("b.tif")], "ring", "out")
checked = isochrome.check(frames, sample.scene)
print(checked.ok, checked.table["text"])
fitted = isochrome.fit(frames, scene, ["load.normal_n"], per_frame=["camera.left_mm"])
tracked = isochrome.track(frames, scene, ["load.normal_n"])
print(fitted.scene.load_at(0.0) + 1.0, tracked.chi.mean())
simulated = isochrome.simulate(scene)
compared = isochrome.compare(processed, simulated)
isochrome.compare(frames, simulated)
isochrome.compare("experiment", Path("simulation"))
bending = isochrome.calibrate_bending(isochrome.samples.bending().tables)
value: float = bending.fringe_value_n_per_mm
isochrome.calibrate_disc(isochrome.samples.disc().set)
isochrome.calibrate_colour({"image": [{"file": frames[0]}]})
isochrome.calibrate_scale(frames[0], edges_mm=4.0)
maps: xr.Dataset = processed.dataset
drawn = maps.fringe_order[0].plot()
with isochrome.open_run("out") as run:
    print(run.load_normal_n_u.values, run.sizes["frame"])
states = isochrome.scene_states(scene)
pressure = isochrome.surface_tractions(states[0])
stress: xr.DataArray = isochrome.stress_map(scene, states[0])
light = isochrome.polariscope_light(scene, stress)
frame = isochrome.camera_frame(scene, light, rng=np.random.default_rng(0))
axes = isochrome.plot_frame(frame)
axes = isochrome.plot_order(processed.dataset.fringe_order[0], axes, lines=False)
axes = isochrome.plot_over_distance(processed, "friction.coefficient")
isochrome.plot_over_distance(fitted, "camera.left_mm", axes)
isochrome.plot_over_distance(tracked, "load.normal_n", axes).set_title("load")
isochrome.plot_pressure(states).grid(True)
isochrome.plot_scar(states[1])
left, middle, right = isochrome.plot_side_by_side(processed, simulated, frame=1)
right.set_title("left over")
compared.figure().savefig("side-by-side.png")
swept = isochrome.sweep(scene, {"load.normal_n": [40.0, 44.0]}, "grid")
print(swept.dataset.n_max.dims, swept.table)
planned = isochrome.plan(scene, {"load.normal_n": [40.0, 44.0]}, frames=(1, 25))
print(planned.now.values["load.normal_n"].relative, planned.sentences, planned.best.settings)
with isochrome.open_frames(frames, bit_depth=8) as reader:
    print(reader.count(), next(iter(reader)).image.mean())
try:
    isochrome.load_scene({"specimen": {"thickness_mm": -1.0}})
except (isochrome.InputError, isochrome.PhysicsError) as error:
    print(error.exit_code)
"""

WRONG = {
    'isochrome.process(frames, scene, folder="out")': "call-arg",
    "isochrome.process(3, scene)": "arg-type", 'isochrome.compare(1.0, "simulation")': "arg-type",
    "isochrome.plot_order(scene)": "arg-type", "isochrome.simulate(frames)": "arg-type",
    "isochrome.tracks": "attr-defined",
}  # fmt: skip
"""Mistakes that a type checker is to see, each with its code."""


AS_INSTALLED = "[mypy]\nstrict = True\n[mypy-isochrome.*]\nfollow_imports = silent\n"
"""Of an installed package the types are used, and its own modules are not judged."""


@pytest.mark.study
def test_a_script_of_the_whole_front_door_and_the_notebooks_pass_and_mistakes_are_seen(tmp_path):
    wrong = "\n".join(WRONG)
    texts = {"right": SCRIPT, "wrong": f"{SCRIPT}\n{wrong}\n"}
    for path in NOTEBOOKS:
        code = "\n".join("".join(cell["source"]) for cell in code_cells(path))
        texts[path.stem.replace("-", "_")] = code.replace("%matplotlib inline", "")
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text)
    (tmp_path / "mypy.ini").write_text(AS_INSTALLED)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--show-error-codes", "."], cwd=tmp_path,
        env={"MYPYPATH": str(Path(isochrome.__file__).parents[1])},
        capture_output=True, text=True, check=False,
    ).stdout  # fmt: skip
    lines = done.splitlines()
    first = len(SCRIPT.splitlines()) + 2
    for number, code in enumerate(WRONG.values(), first):
        seen = any(f"wrong.py:{number}: error" in line and f"[{code}]" in line for line in lines)
        assert seen, (number, code, done)
    assert lines[-1].startswith(f"Found {len(WRONG)} errors in 1 file"), done


def test_what_the_front_door_offers_is_shown():
    shown = dir(isochrome)
    assert set(isochrome.__all__) - {"__version__"} <= set(shown)
    assert {"process", "plot_order", "samples", "Scene"} <= set(shown)
    assert {"line_contact_wear", "bending", "disc"} <= set(dir(isochrome.samples))
