"""Run every command with an earlier package and with today's, and compare all that they leave.

    python tests/freeze.py COMMIT [--only WORDS] [--keep FOLDER]

COMMIT is an earlier one, by any name that git knows. Both packages run on this machine, one
thread each, on today's sample images: bytes differ from one processor to another, so none are
stored. A file is the same when its bytes are, the keys that name the code aside. Of one
that is not, the table gives the largest difference of its numbers. The exit code is 1 where
anything differs.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import tifffile

ROOT = Path(__file__).resolve().parents[1]

VOLATILE = ("code_sha256", "isochrome", "provenance.json")
"""Last parts of JSON keys that name the code, not what it computed; the last is an input's name."""

WEAR = "sample_images/line-contact-wear"
SHORT_WEAR = f"{WEAR}/short.toml"
FILM = f"{WEAR}/film.toml"

COMMANDS = {
    "simulate": f"simulate {WEAR}/scene.toml --out OUT",
    "film": f"simulate {FILM} --out OUT",
    "simulate components": f"simulate {SHORT_WEAR} --components --out OUT",
    "simulate disc": "simulate sample_images/disc/scene.toml --out OUT",
    "simulate beam": "simulate sample_images/bending/beam.toml --out OUT",
    "process": f"process {WEAR}/captured.tif --scene {WEAR}/scene.toml --rois --out OUT",
    "process one frame": f"process {WEAR}/captured.tif --scene {WEAR}/one-state.toml --out OUT",
    "process track": f"process FROM/film/out/frames.tif --scene {FILM} --track --every 10"
    " --out OUT",
    "process no model": f"process {WEAR}/captured.tif --scene {WEAR}/no-model.toml --out OUT",
    "process disc": "process sample_images/disc/disc-560N.png"
    " --scene sample_images/disc/scene.toml --out OUT",
    "process beam": "process sample_images/bending/bending-150N.png"
    " --scene sample_images/bending/beam.toml --out OUT",
    "process campaign": f"process FROM/film/out/frames.tif {WEAR}/captured.tif --scene {FILM}"
    " --keep-going --out OUT",
    "compare": "compare FROM/process/out FROM/simulate/out --out OUT",
    "calibrate bending": "calibrate bending sample_images/bending/set.toml --out OUT",
    "calibrate disc": "calibrate disc sample_images/disc/set.toml --out OUT",
    "fit": f"fit {WEAR}/captured.tif --scene {WEAR}/scene.toml --free load.normal_n"
    " --per-frame friction.coefficient --per-frame camera.left_mm --out OUT",
    "fit follow": f"fit {WEAR}/captured.tif --scene {WEAR}/scene.toml --follow"
    " --per-frame load.normal_n --per-frame camera.left_mm --out OUT",
    "fit track": f"fit FROM/film/out/frames.tif --scene {FILM} --track"
    " --per-frame load.normal_n --per-frame friction.coefficient --out OUT",
    "fit tractions": f"fit {WEAR}/captured.tif --scene {WEAR}/scene.toml --tractions"
    " --per-frame load.normal_n --out OUT",
    "check": f"check {WEAR}/captured.tif --scene {WEAR}/scene.toml",
    "sweep": f"sweep {SHORT_WEAR} --vary load.normal_n=40,44 --out OUT",
    "export netcdf": "export FROM/process/out --to netcdf --out OUT",
    "export tiff": "export FROM/process/out --to tiff --out OUT",
    "export csv": "export FROM/process/out --to csv --out OUT",
}
"""Name to command line; OUT is its folder of results, FROM/NAME/out that of an earlier command."""

BEAM = """\
[specimen]
shape = "beam"
height_mm = 20.0
thickness_mm = 6.0
fringe_value_n_per_mm = 14.6

[load]
normal_n = 150.0
inner_span_mm = 40.0
outer_span_mm = 100.0

[polariscope]
wavelength_nm = 587.0
field = "dark"

[camera]
width_px = 480
height_px = 440
pixel_mm = 0.05
bit_depth = 8
"""


FILM_WEAR = f"""\
[wear]
coefficient_mm2_per_n = 2e-9
distances_m = {[0.5 * i for i in range(20)]}

"""
FILM_FRAMES = """\
noise_grey = 0.5

[frames]
gamma = 1.0
"""


def write_inputs(home: Path) -> None:
    """Today's sample images, and scenes made from theirs: fewer states, a single one, no model."""
    subprocess.run(["cp", "-r", str(ROOT / "sample_images"), str(home)], check=True)
    scene = (home / WEAR / "scene.toml").read_text("utf-8")
    wear = scene[scene.index("[wear]") : scene.index("[polariscope]")]
    (home / SHORT_WEAR).write_text(scene.replace("31.0, 77.0, 155.0, 233.0", "31.0"), "utf-8")
    film = scene.replace(wear, FILM_WEAR).replace("static_state_first = true\n", "")
    (home / FILM).write_text(film[: film.index("[frames]")] + FILM_FRAMES, "utf-8")
    (home / WEAR / "one-state.toml").write_text(scene.replace(wear, ""), "utf-8")
    no_model = scene[scene.index("[polariscope]") :]
    specimen = "[specimen]\nthickness_mm = 4.0\nfringe_value_n_per_mm = 14.6\n\n"
    (home / WEAR / "no-model.toml").write_text(specimen + no_model, "utf-8")
    (home / "sample_images" / "bending" / "beam.toml").write_text(BEAM, "utf-8")


def package_of(commit: str, home: Path) -> Path:
    """The source folder of a commit."""
    archive = subprocess.run(
        ["git", "archive", commit, "src"], cwd=ROOT, check=True, capture_output=True
    ).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        tar.extractall(home, filter="data")
    return home / "src"


def run_command(name: str, source: Path, home: Path) -> Path:
    """Run a command of COMMANDS with a package. Returns the folder of what it printed and left."""
    folder = home / "runs" / name
    folder.mkdir(parents=True)
    words = COMMANDS[name].split()
    words = [w.replace("OUT", f"runs/{name}/out").replace("FROM", "runs") for w in words]
    own = {"PYTHONPATH": str(source), "OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg", "COLUMNS": "80"}
    done = subprocess.run(
        [sys.executable, "-m", "isochrome", *words, "--json"],
        cwd=home,
        env=os.environ | own,
        stdin=subprocess.DEVNULL,
        capture_output=True,
    )
    (folder / "printed.json").write_bytes(done.stdout)
    (folder / "exit.txt").write_text(str(done.returncode))
    if done.returncode not in (0, 2, 3):
        (folder / "error.txt").write_bytes(done.stderr)
    return folder


def leaves(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Every value of a JSON document with its path."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from leaves(inner, f"{key}.{name}")
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            yield from leaves(inner, f"{key}[{number}]")
    else:
        yield key, value


def cells(path: Path) -> dict[str, Any]:
    """The values of a table or a JSON file by place."""
    text = path.read_text("utf-8")
    if path.suffix == ".json":
        return dict(leaves(json.loads(text or "null")))
    rows = list(csv.reader(line for line in text.splitlines() if not line.startswith("#")))
    head = rows[0] if rows else []
    return {f"{head[c]} {r}": v for r, row in enumerate(rows[1:]) for c, v in enumerate(row)}


def relative(old: Any, new: Any) -> float:
    """How far two values are apart, as a share of the first; infinite where one is no number."""
    try:
        first, second = float(old), float(new)
    except (TypeError, ValueError):
        return 0.0 if old == new else np.inf
    if first == second or (np.isnan(first) and np.isnan(second)):
        return 0.0
    return abs(second - first) / max(abs(first), 1e-300)


def describe_tables(old: Path, new: Path) -> str:
    """The places of two tables that differ most."""
    before, after = cells(old), cells(new)
    before, after = (
        {k: v for k, v in c.items() if not k.endswith(VOLATILE)} for c in (before, after)
    )
    if set(before) != set(after):
        names = sorted(set(before) ^ set(after))
        return f"{len(names)} values stand in one only: {', '.join(names[:3])}"
    apart = {k: relative(before[k], after[k]) for k in before}
    apart = {k: v for k, v in apart.items() if v > 0}
    if not apart:
        return ""
    worst = sorted(apart, key=lambda k: -apart[k])[:3]
    return f"{len(apart)} values differ: " + "; ".join(
        f"{k.strip()} {before[k]} -> {after[k]}" for k in worst
    )


def describe_images(old: Path, new: Path) -> str:
    """How many pixels of two TIFF files differ, and by how much at most."""
    before, after = (tifffile.imread(p).astype(float) for p in (old, new))
    if before.shape != after.shape:
        return f"shape {before.shape} -> {after.shape}"
    known = np.isfinite(before) & np.isfinite(after)
    turned = int(np.count_nonzero(np.isfinite(before) != np.isfinite(after)))
    apart = np.abs(after - before)[known]
    most = apart.max(initial=0.0)
    return f"{np.count_nonzero(apart)} pixels differ, by {most:.3g} at most; {turned} known in one"


def describe(old: Path, new: Path) -> str:
    """What differs between two files; nothing where they are the same."""
    if not (old.exists() and new.exists()):
        return "only before" if old.exists() else "only now"
    if old.read_bytes() == new.read_bytes():
        return ""
    if old.suffix in (".json", ".csv"):
        return describe_tables(old, new)
    if old.suffix == ".tif":
        return describe_images(old, new)
    if old.suffix == ".nc":
        return describe_netcdf(old, new)
    return f"bytes differ ({old.stat().st_size} -> {new.stat().st_size})"


def describe_netcdf(old: Path, new: Path) -> str:
    """The names whose arrays or attributes differ in two netCDF files."""
    before, after = (contents(path) for path in (old, new))
    names = [n for n in sorted(set(before) | set(after)) if before.get(n) != after.get(n)]
    return f"{len(names)} things differ: {', '.join(names[:3])}" if names else ""


def contents(path: Path) -> dict[str, bytes]:
    """The bytes of every array and attribute of a netCDF file by name."""
    found: dict[str, bytes] = {}

    def add(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            values = np.asarray(item[()])
            texts = values.dtype == object  # whose bytes are addresses
            found[name] = repr(values.tolist()).encode() if texts else values.tobytes()
        kept = {k: v for k, v in item.attrs.items() if not k.endswith(VOLATILE)}
        noted = {k: v for k, v in kept.items() if "LIST" not in k}  # references by address
        found.update({f"{name}@{k}": np.asarray(v).tobytes() for k, v in noted.items()})

    with h5py.File(path) as file:
        add("", file)
        file.visititems(add)
    return found


def compare(old: Path, new: Path) -> list[str]:
    """The files that differ between two folders, each with how."""
    names = {p.relative_to(f) for f in (old, new) for p in f.rglob("*") if p.is_file()}
    rows = [(str(name), describe(old / name, new / name)) for name in sorted(names)]
    return [f"  {name}: {how}" for name, how in rows if how]


def main() -> int:
    parser = argparse.ArgumentParser(description="Compare all outputs with an earlier package's.")
    parser.add_argument("commit")
    parser.add_argument("--only", default="", help="words of a command's name")
    parser.add_argument("--keep", type=Path, help="folder for what was compared")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        home = options.keep or Path(temporary)
        now = shutil.copytree(ROOT / "src", home / "now-package")  # nobody edits a copy
        sources = {"before": package_of(options.commit, home / "package"), "now": now}
        for side in sources:
            (home / side).mkdir(parents=True)
            write_inputs(home / side)
        same = True
        for name in COMMANDS:
            needed = any(f"FROM/{name}/" in c for k, c in COMMANDS.items() if options.only in k)
            if options.only in name or needed:
                folders = [run_command(name, s, home / side) for side, s in sources.items()]
                rows = compare(*folders)
                code = (folders[1] / "exit.txt").read_text()
                print(f"{'differs' if rows else 'same':8} {name} (exit {code})", flush=True)
                print("".join(f"{row}\n" for row in rows), end="")
                same &= not rows
    return 0 if same else 1


if __name__ == "__main__":
    raise SystemExit(main())
