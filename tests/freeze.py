"""Run every command with an earlier package and with today's, and compare all that they leave.

    python tests/freeze.py COMMIT [--only WORDS] [--keep FOLDER]

COMMIT is an earlier one, by any name that git knows. Both packages run on this machine side by
side, one thread each, on today's sample images and what today's package draws: bytes differ from
one processor to another, so none are stored. A file is the same when its bytes are, the keys that
name the code aside. Of one that is not, the table gives the largest difference of its numbers. The
exit code is 1 where anything differs.
"""

import argparse
import csv
import difflib
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import tifffile
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

import isochrome

ROOT = Path(__file__).resolve().parents[1]

VOLATILE = ("code_sha256", "isochrome", "provenance.json", "record_crc32c", ".of")
"""Last parts of JSON keys that name the code, not what it computed; the third, an input's name."""
COMPARED = (".outputs.", ".outputs_crc32c.")
"""In JSON keys: sizes and checksums of files that are compared themselves."""

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
    "process one frame": f"process {WEAR}/unworn.tif --scene {WEAR}/one-state.toml --out OUT",
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
    " --per-frame friction.coefficient --per-frame camera.left_mm --as-stated --out OUT",
    "fit small": "fit drawn/small.tif --scene drawn/small.toml --free load.normal_n"
    " --per-frame friction.coefficient --per-frame camera.left_mm --csv excel --out OUT",
    "fit follow": "fit drawn/small.tif --scene drawn/small.toml --follow"
    " --per-frame load.normal_n --per-frame camera.left_mm --out OUT",
    "fit track": f"fit FROM/film/out/frames.tif --scene {FILM} --track"
    " --per-frame load.normal_n --per-frame friction.coefficient --out OUT",
    "fit tractions": "fit drawn/small.tif --scene drawn/small.toml --tractions"
    " --per-frame load.normal_n --out OUT",
    "check": f"check {WEAR}/captured.tif --scene {WEAR}/scene.toml",
    "sweep": f"sweep {SHORT_WEAR} --vary load.normal_n=40,44 --out OUT",
    "simulate paper figures": f"simulate {SHORT_WEAR} --width 85mm --format svg,png --dpi 100"
    " --csv excel --out OUT",
    "simulate block": "simulate drawn/block.toml --out OUT",
    "simulate ring": "simulate ring --out OUT",
    "simulate steps": "simulate drawn/steps.toml --components --out OUT",
    "simulate colour": "simulate drawn/colour.toml --out OUT",
    "process paper figures": f"process {WEAR}/captured.tif --scene {WEAR}/scene.toml --as-stated"
    " --width 85mm --frames 0,2 --format svg,pdf --numbers --csv excel --out OUT",
    "process steps": "process FROM/simulate_steps/out/frames.tif --scene drawn/steps.toml"
    " --out OUT",
    "process colour": "process FROM/simulate_colour/out/frames.tif --scene drawn/colour.toml"
    " --out OUT",
    "process from zero load": "process drawn/rising.tif --scene drawn/rising.toml --out OUT",
    "process known orders": "process drawn/swaying.tif --scene drawn/swaying.toml --track"
    " --every 4 --out OUT",
    "process known loads": "process drawn/known-loads.tif --scene drawn/known-loads.toml --out OUT",
    "process block": "process FROM/simulate_block/out/frames.tif --scene drawn/block.toml"
    " --out OUT",
    "process maps of key frames": f"process FROM/film/out/frames.tif --scene {FILM} --track"
    " --every 10 --maps key --preview --out OUT",
    "compare paper figures": "compare FROM/process/out FROM/simulate/out --width 174mm"
    " --format svg --csv excel --out OUT",
    "compare scars": "compare sample_images/wear/set.toml FROM/simulate/out --out OUT",
    "calibrate colour": "calibrate colour drawn/colours.toml --width 85mm --format svg --out OUT",
    "calibrate scale": "calibrate scale drawn/board.tif --target chessboard --columns 11 --rows 8"
    " --spacing-mm 0.62 --width 85mm --format svg --out OUT",
    "calibrate scale by edges": "calibrate scale drawn/bar.tif --edges-mm 4.003"
    " --edges-uncertainty-mm 0.002 --out OUT",
    "calibrate wear": "calibrate wear sample_images/wear/set.toml --width 85mm --format svg"
    " --csv excel --into drawn/small.toml --out OUT",
    "calibrate bending paper figures": "calibrate bending sample_images/bending/set.toml"
    " --width 85mm --format svg --csv excel --out OUT",
    "init": f"init {WEAR}/captured.tif --shape contact --thickness-mm 4 --young-gpa 2.1"
    " --poisson 0.4 --fringe-value-n-per-mm 14.6 --radius-mm 24.61 --indenter-young-gpa 210"
    " --indenter-poisson 0.3 --load-n 40 --pixel-mm 0.00607"
    " --wavelength-nm 589 --out OUT",
    "init disc": "init sample_images/disc/disc-560N.png --shape disc --diameter-mm 30"
    " --thickness-mm 6 --fringe-value-n-per-mm 7 --load-n 500 --wavelength-nm 587 --out OUT",
    "check colour": "check FROM/simulate_colour/out/frames.tif --scene drawn/colour.toml",
    "report process": "report FROM/process/out --out OUT",
    "report simulate": "report FROM/simulate/out --out OUT",
    "report fit": "report FROM/fit/out --out OUT",
    "report calibration": "report FROM/calibrate_disc/out --out OUT",
    "verify": "verify FROM/process/out",
    "guide": "guide messages",
    "wrong scene": f"process {WEAR}/captured.tif --scene drawn/wrong.toml --out OUT",
    "no frames": f"process nowhere.tif --scene {WEAR}/scene.toml --out OUT",
}
COMMANDS |= {
    f"export {name} {to}": f"export FROM/{name}/out --to {to} --out OUT"
    for name in ("process", "process_track", "process_steps", "sweep")
    for to in ("netcdf", "tiff", "csv", "excel")
}
"""Name to command line; OUT is its folder of results, FROM/NAME/out that of an earlier command,
with _ for the blanks in its name."""

GIVEN = {
    "specimen.thickness_mm": 4.0, "specimen.fringe_value_n_per_mm": 14.6,
    "specimen.young_gpa": 2.1, "specimen.poisson": 0.4, "indenter.radius_mm": 24.61,
    "indenter.young_gpa": 210.0, "indenter.poisson": 0.3, "load.normal_n": 40.0,
    "polariscope.wavelength_nm": 589.0, "polariscope.field": "dark",
    "camera.pixel_mm": 0.00607, "camera.bit_depth": 8,
}  # fmt: skip
REQUESTS = (
    ("tool", {"tool": "new", "kind": "contact", "values": GIVEN}),
    ("tool", {"tool": "contact", "point": [30.0, 320.0]}),
    ("tool", {"tool": "region", "points": [[5.0, 10.0], [480.0, 640.0]]}),
    ("tool", {"tool": "values", "values": {"frames.gamma": 1.4}}), ("tool", {"tool": "undo"}),
    ("model", {"frame": 0, "values": {}}), ("fit", {"frame": 0}), ("check", {}),
    ("tool", {"tool": "known_order", "points": [{"row": 400, "col": 300, "order": 1.2}]}),
    ("map", {"frame": 0}), ("preview", {"frame": 0, "row_px": 200, "col_px": 300}),
    ("tool", {"tool": "save"}),
)  # fmt: skip
"""What the set-up page asks for, one after the other, on the contact's frames."""

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

DISC = {
    "specimen": {
        "shape": "disc", "diameter_mm": 30.0, "thickness_mm": 6.0, "fringe_value_n_per_mm": 7.0,
    },
    "load": {"normal_n": 120.0},
    "polariscope": {"wavelength_nm": 587.0},
    "camera": {
        "width_px": 256, "height_px": 256, "pixel_mm": 0.13, "bit_depth": 8, "brightness": 0.85,
        "background": 0.05, "noise_grey": 1.0,
    },
}  # fmt: skip
STEPS = [
    (90, 45, -45, 0), (90, 45, -45, 90), (90, 45, 0, 0),
    (90, 45, 45, 45), (90, 45, 90, 90), (90, 45, 135, 135),
]  # fmt: skip
PLATES = ("polariser_deg", "input_plate_deg", "output_plate_deg", "analyser_deg")
RISING = """\
[specimen]
shape = "other"

[camera]
bit_depth = 8
pixel_mm = 0.15

[frames]
mask = "beam.tif"
"""
COLOURS = """\
[polariscope]
wavelength_nm = 540.0
light = "white"

[camera]
colour = true
bit_depth = 8

[frames]
mask = "beam.tif"

[[image]]
file = "colour-0.tif"

[[image]]
file = "colour-1.tif"
"""


def draw_inputs(place: Path) -> None:
    """Scenes of other kinds than the samples', and frames of them by today's package."""
    place.mkdir()

    def keep(name: str, scene: isochrome.Scene) -> None:
        (place / f"{name}.toml").write_text(isochrome.dump_scene(scene), "utf-8")

    def film(scene: isochrome.Scene, loads: Iterable[float]) -> NDArray[Any]:
        states = [scene.with_values({"load.normal_n": float(load)}) for load in loads]
        return np.concatenate([isochrome.simulate(state).frames for state in states])

    disc = isochrome.load_scene(DISC)
    (place / "beam.toml").write_text(BEAM, "utf-8")
    beam = isochrome.load_scene(place / "beam.toml").with_values({
        "camera.width_px": 160, "camera.height_px": 150, "camera.pixel_mm": 0.15,
        "camera.noise_grey": 1.0,
    })  # fmt: skip
    steps = [dict(zip(PLATES, map(float, four), strict=True)) for four in STEPS]
    keep(
        "steps", isochrome.load_scene(DISC | {"polariscope": DISC["polariscope"] | {"step": steps}})
    )
    contact = isochrome.load_scene("line-contact-wear").model_dump(exclude_unset=True)
    fewer = {"width_px": 220, "height_px": 165, "pixel_mm": 0.01821, "noise_grey": 2.0}
    at_rest = {k: v for k, v in contact.items() if k not in ("friction", "wear", "frames")}
    at_rest["camera"] = at_rest["camera"] | fewer
    white = {"light": "white", "wavelength_nm": 587.0}
    keep("colour", isochrome.load_scene(at_rest | {
        "polariscope": white, "camera": at_rest["camera"] | {"colour": True, "brightness": 0.9},
    }))  # fmt: skip
    block = {"shape": "block", "width_mm": 20.0, "height_mm": 15.0, "left_mm": -9.0}
    keep("block", isochrome.load_scene(at_rest | {"specimen": at_rest["specimen"] | block}))
    small = isochrome.load_scene(contact | {"camera": contact["camera"] | fewer})
    keep("small", small)
    frames = isochrome.simulate(small).frames
    tifffile.imwrite(place / "small.tif", frames, photometric="minisblack")
    order = isochrome.simulate(beam).dataset.fringe_order[0].values
    unloaded = isochrome.camera_frame(beam, np.zeros_like(order), rng=np.random.default_rng(1))
    rising = [unloaded.values[None], film(beam, np.linspace(8.0, 184.0, 23))]
    tifffile.imwrite(place / "rising.tif", np.concatenate(rising), photometric="minisblack")
    swaying = 150.0 + 20.0 * np.sin(np.arange(12) / 2)
    tifffile.imwrite(place / "swaying.tif", film(beam, swaying), photometric="minisblack")
    known = [60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0]
    tifffile.imwrite(place / "known-loads.tif", film(disc, known), photometric="minisblack")
    keep("known-loads", disc)
    text = (place / "known-loads.toml").read_text("utf-8")
    (place / "known-loads.toml").write_text(f"{text}\n[frames]\nknown_loads_n = {known}\n", "utf-8")
    tifffile.imwrite(place / "beam.tif", np.isfinite(order).astype(np.uint8) * 255)
    (place / "rising.toml").write_text(RISING + "starts_unloaded = true\n", "utf-8")
    loaded = isochrome.simulate(beam.with_values({"load.normal_n": 150.0})).dataset.fringe_order[0]
    row = int(np.nanargmin(np.abs(loaded[:75, 80].values - 0.75)))
    point = f"row_px = {row}\ncol_px = 80\norder = {loaded[row, 80].item():.2f}\n"
    (place / "swaying.toml").write_text(f"{RISING}\n[[frames.known_order]]\n{point}", "utf-8")
    tables = beam.model_dump(exclude_unset=True)
    tables["polariscope"] = white | {"wavelength_nm": 540.0}
    coloured = isochrome.load_scene(tables | {"camera": tables["camera"] | {"colour": True}})
    for number, frame in enumerate(film(coloured, (120.0, 200.0))):
        tifffile.imwrite(place / f"colour-{number}.tif", frame, photometric="rgb")
    (place / "colours.toml").write_text(COLOURS, "utf-8")
    squares = np.indices((9, 12)).sum(axis=0) % 2
    board = np.pad(np.kron(squares, np.ones((40, 40))), 30, constant_values=1.0)
    tifffile.imwrite(place / "board.tif", (30 + 180 * gaussian_filter(board, 1.0)).astype(np.uint8))
    bar = np.full((300, 400), 1.0)
    bar[:, 80:310] = 0.0
    tifffile.imwrite(place / "bar.tif", (30 + 180 * gaussian_filter(bar, 1.0)).astype(np.uint8))
    (place / "wrong.toml").write_text('[load]\nnormal_n = -1\nnormal_kn = "much"\n', "utf-8")


def write_inputs(home: Path) -> None:
    """Today's sample images, and scenes made from theirs: fewer states, a single one, no model."""
    subprocess.run(["cp", "-r", str(ROOT / "sample_images"), str(home)], check=True)
    scene = (home / WEAR / "scene.toml").read_text("utf-8")
    wear = scene[scene.index("[wear]") : scene.index("[polariscope]")]
    (home / SHORT_WEAR).write_text(scene.replace("31.0, 77.0, 155.0, 233.0", "31.0"), "utf-8")
    film = scene.replace(wear, FILM_WEAR).replace("static_state_first = true\n", "")
    (home / FILM).write_text(film[: film.index("[frames]")] + FILM_FRAMES, "utf-8")
    (home / WEAR / "one-state.toml").write_text(scene.replace(wear, ""), "utf-8")
    unworn = tifffile.imread(home / WEAR / "captured.tif")[0]
    tifffile.imwrite(home / WEAR / "unworn.tif", unworn, photometric="minisblack")
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


def environment_of(source: Path) -> dict[str, str]:
    """The environment in which a package runs: with one thread, and a terminal of its own width."""
    own = {"PYTHONPATH": str(source), "OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg", "COLUMNS": "80"}
    return os.environ | own | {"PYTHONUNBUFFERED": "1"}


def run_command(name: str, source: Path, home: Path) -> Path:
    """Run a command of COMMANDS with a package. Returns the folder of what it printed and left."""
    own = name.replace(" ", "_")
    folder = home / "runs" / own
    folder.mkdir(parents=True)
    words = COMMANDS[name].split()
    words = [w.replace("OUT", f"runs/{own}/out").replace("FROM", "runs") for w in words]
    done = subprocess.run(
        [sys.executable, "-m", "isochrome", *words, "--json"], cwd=home, env=environment_of(source),
        stdin=subprocess.DEVNULL, capture_output=True,
    )  # fmt: skip
    (folder / "printed.json").write_bytes(done.stdout)
    (folder / "exit.txt").write_text(str(done.returncode))
    if done.returncode not in (0, 2, 3):
        (folder / "error.txt").write_bytes(done.stderr)
    return folder


def run_setup(source: Path, home: Path) -> Path:
    """What the set-up page of a package answers to REQUESTS, and the scene that it saves."""
    folder = home / "runs" / "setup"
    folder.mkdir(parents=True)
    shutil.copy(home / WEAR / "captured.tif", folder)
    page = subprocess.Popen(
        [sys.executable, "-m", "isochrome", "setup", "captured.tif", "--no-browser"], cwd=folder,
        env=environment_of(source), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        assert page.stdout is not None
        url = next(w for line in page.stdout for w in line.split() if w.startswith("http://"))
        host = "/".join(url.split("/")[:3])
        for number, (route, asked) in enumerate((("", None), ("state", None), *REQUESTS)):
            data = None if asked is None else json.dumps(asked).encode()
            head = {"Origin": host, "Content-Type": "application/json"}
            try:
                with urllib.request.urlopen(urllib.request.Request(url + route, data, head)) as got:
                    answer = got.read()
            except urllib.error.HTTPError as error:
                answer = error.read()
            (folder / f"{number:02}-{route or 'page'}.txt").write_bytes(answer)
    finally:
        page.kill()
        page.wait()
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
        own = re.match("[0-9a-f]{8}\n", text)  # a chunk's record begins with its checksum
        return dict(leaves(json.loads(text[own.end() if own else 0 :] or "null")))
    rows = list(csv.reader(line for line in text.splitlines() if not line.startswith("#")))
    head = dict(enumerate(rows[0] if rows else []))
    return {f"{head.get(c, c)} {r}": v for r, row in enumerate(rows[1:]) for c, v in enumerate(row)}


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
        {
            k: v
            for k, v in c.items()
            if not k.endswith(VOLATILE) and not any(part in k for part in COMPARED)
        }
        for c in (before, after)
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
    if old.suffix == ".html":
        return describe_pages(old, new)
    return f"bytes differ ({old.stat().st_size} -> {new.stat().st_size})"


def describe_pages(old: Path, new: Path) -> str:
    """How many lines of two pages' words differ; pictures are to be looked at."""
    pages = [re.sub("[0-9a-f]{64}", "", path.read_text("utf-8")) for path in (old, new)]
    if pages[0] == pages[1]:  # but for the sum that names the code; those of inputs are in the JSON
        return ""
    before, after = map(words_of, pages)
    apart = [line for line in difflib.ndiff(before, after) if line[:1] in "+-"]
    if not apart:
        return "pictures differ, and no words"
    return f"{len(apart)} lines of words differ: " + "; ".join(apart[:3])[:300]


def words_of(page: str) -> list[str]:
    """The words of a page as lines, without its pictures and its style."""
    bare = re.sub(r"<(style|script|svg)\b.*?</\1>|<[^>]*>", "\n", page, flags=re.DOTALL)
    return [line.strip() for line in bare.splitlines() if line.strip()]


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
            draw_inputs(home / side / "drawn")
        same = True
        chosen = [name for name in COMMANDS if options.only in name]
        for name in reversed(COMMANDS):  # and what these begin from
            if any(f"FROM/{name.replace(' ', '_')}/" in COMMANDS[c] for c in chosen):
                chosen += [name] if name not in chosen else []
        runs = {n: partial(run_command, n) for n in COMMANDS if n in chosen}
        runs |= {"setup": run_setup} if options.only in "setup" else {}
        with ThreadPoolExecutor(2) as pool:
            for name, run in runs.items():
                began = time.perf_counter()
                folders = list(pool.map(run, sources.values(), (home / side for side in sources)))
                rows = compare(*folders)
                code = folders[1] / "exit.txt"
                left = f"exit {code.read_text()}" if code.exists() else "the page"
                took = time.perf_counter() - began
                print(
                    f"{'differs' if rows else 'same':8} {name} ({left}, {took:.0f} s)", flush=True
                )
                print("".join(f"{row}\n" for row in rows), end="")
                same &= not rows
    return 0 if same else 1


if __name__ == "__main__":
    raise SystemExit(main())
