"""From frames of `outside_camera` to values and a figure by the commands of the guide's *your first
own video*, each in a process of its own."""

import csv
import os
import re
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import tifffile

from isochrome.benchmarks import load_benchmarks
from isochrome.guide import guide_page
from isochrome.scene import parse_scene

OUTSIDE = load_benchmarks("outside_camera")
ROOT = Path(__file__).parents[1]
PAGE = guide_page("first-video")
SCENE = re.search(r"```toml\n(.*?)```", PAGE, re.S).group(1)
COMMANDS = [
    line for body in re.findall(r"```bash\n(.*?)```", PAGE, re.S) for line in body.split("\n")
]
NOT_GIVEN = ("left_mm", "top_mm", "no_load_dark", "no_load_bright", "sliding_speed_mm_per_s")
"""Lines of the page's scene that the newcomer cannot fill in."""

ROWS, COLS, FRAMES = 124, 166, 2
PIXEL_MM = 4.0 / COLS
MOST_COMMANDS = 10
WITHIN = 3.0
"""Standard uncertainties of a single frame's value."""

VALUES = ("load.normal_n", "friction.coefficient")


@dataclass
class Newcomer:
    """Somebody in a folder, who runs commands that stand in the guide and counts them."""

    folder: Path
    count: int = 1
    """`pip install .` was the first."""

    def write(self, lines: list[str]) -> None:
        """The page's scene without what is not known, with lines that a command named."""
        known = [x for x in SCENE.split("\n") if not x.startswith(NOT_GIVEN)]
        text = "\n".join(known).replace("pixel_mm = 0.00607", f"pixel_mm = {PIXEL_MM!r}")
        assert text.rstrip().endswith("[frames]")  # where the lines belong
        scene = text.rstrip() + "\n" + "".join(f"{x}\n" for x in lines)
        (self.folder / "scene.toml").write_text(scene, "utf-8")

    def run(self, line: str) -> subprocess.CompletedProcess[str]:
        assert line in COMMANDS
        self.count += 1
        command = [sys.executable, "-m", *line.split()]
        return subprocess.run(
            command, cwd=self.folder, env=dict(os.environ), capture_output=True, text=True
        )

    def mended(self, said: str, lines: list[str]) -> list[str]:
        """The lines of [frames] with those that were named, which take the place of older ones."""
        named = re.search(
            r"(?:with|give) (frames\.\S+ = .*?)(?: the scene explains|, else| \()", said
        )
        assert named, said
        pairs = dict(x.split(" = ") for x in lines)
        for part in named.group(1).split(" and "):
            key, value = part.removeprefix("frames.").split(" = ")
            pairs[key] = value
        return [f"{key} = {value}" for key, value in pairs.items() if value != "0"]


@dataclass
class Truth:
    """What stood before the camera, drawn by chance; every eighth seed lies the same way."""

    seed: int
    values: dict[str, float] = field(init=False)
    gamma: float = field(init=False)

    def __post_init__(self) -> None:
        rng = np.random.default_rng([self.seed, 19])
        drawn = rng.uniform((36.0, 0.12, -2.4, -0.2), (54.0, 0.28, -1.6, 0.1))
        self.values = dict(
            zip((*VALUES, "camera.left_mm", "camera.top_mm"), drawn.tolist(), strict=True)
        )
        self.gamma = float(rng.uniform(0.7, 2.3))

    def save(self, folder: Path) -> None:
        size = {"camera.width_px": COLS, "camera.height_px": ROWS, "camera.pixel_mm": PIXEL_MM}
        plain = re.sub(r"(?m)^no_load.*\n", "", SCENE)
        scene = parse_scene(plain).with_values(size | self.values)
        folder.mkdir()
        for number in range(FRAMES):
            defects = OUTSIDE.Defects(gamma=self.gamma)
            image = OUTSIDE.frame(scene, defects, FRAMES * self.seed + number)
            image = image[:, ::-1] if self.seed % 8 > 3 else image
            image = np.ascontiguousarray(np.rot90(image, self.seed % 4))
            tifffile.imwrite(folder / f"frame-{number}.tif", image)


def test_the_page_has_the_commands_and_the_readme_links_it():
    readme = (ROOT / "README.md").read_text("utf-8")
    assert "(src/isochrome/guide/first-video.md)" in readme and "pip install ." in readme
    for name in ("check", "process", "simulate", "compare"):
        assert sum(line.startswith(f"isochrome {name} ") for line in COMMANDS) == 1


@pytest.mark.long
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(s, marks=pytest.mark.study) for s in range(1, 16))]
)
def test_ten_minutes_of_a_newcomer(tmp_path, seed):
    truth, me = Truth(seed), Newcomer(tmp_path)
    truth.save(tmp_path / "captured")
    check, process, simulate, compare = (
        next(line for line in COMMANDS if line.startswith(f"isochrome {name} "))
        for name in ("check", "process", "simulate", "compare")
    )
    lines: list[str] = []
    me.write(lines)
    while True:
        done = me.run(check)
        slip = re.search(r"error: .* the scene explains the frame", done.stdout)
        mirrored = re.search(r"warning: .*if it is mirrored, give .*", done.stdout)
        assert done.returncode == (2 if slip else 0), done.stdout + done.stderr
        if not (slip or mirrored):
            break
        lines = me.mended((slip or mirrored).group(), lines)
        me.write(lines)
        assert me.count < MOST_COMMANDS, done.stdout
    for line in (process, simulate, compare):
        done = me.run(line)
        assert done.returncode == 0, done.stderr
        if line == process:
            assert re.search(r"load \S+ ± \S+ N.* friction \S+ ± \S+", done.stdout)
    assert me.count < MOST_COMMANDS
    assert (tmp_path / "comparison" / "comparison.png").stat().st_size > 10_000
    with (tmp_path / "experiment" / "frames.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == FRAMES
    pulls = [
        (float(row[key]) - truth.values[key]) / float(row[f"{key} standard_uncertainty"])
        for row in rows
        for key in VALUES
    ]
    print(seed, f"gamma {truth.gamma:.2f}", lines, f"{me.count} commands", np.round(pulls, 2))
    assert max(map(abs, pulls)) < WITHIN, pulls
