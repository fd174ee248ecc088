"""Calibration sets, regions and what earlier runs have left, damaged or forged."""

import atexit
import json
import os
import shutil
import tempfile
import zipfile
from functools import cache
from pathlib import Path

import numpy as np

from hostile.attack import Case, after, case, hostile
from hostile.bombs import with_mask
from hostile.given import (
    BENDING,
    CONTACT,
    PLAIN,
    image,
    picture,
    process,
    roi,
    simulate,
    stack,
    write_scene,
)

SETS: list[Case] = []


def calibrate(place: Path, old: str, new: str) -> list[str]:
    """A calibration set of a beam with a line changed, and its image."""
    assert BENDING.count(old) == 1, old
    image(place / "a.png")
    write_scene(place, BENDING.replace(old, new), "set.toml")
    return ["calibrate", "bending", "set.toml", "--out", "out"]


def wrong_set(name: str, old: str, new: str, *says: str, code: int = 2) -> None:
    SETS.append(Case(lambda place: calibrate(place, old, new), says, code=code, label=name))


wrong_set("set whose image is missing", "a.png", "gone.png", "gone.png", "no such file")
wrong_set("set whose image is a device", "a.png", "/dev/zero", "/dev/zero", "cannot be read")
wrong_set("set of an image of no name", "a.png", "", "file", "correct it")
wrong_set("set of an infinite load", "load_n = 150.0", "load_n = inf", "load_n", "correct it")
wrong_set("set of a load of 1e308", "load_n = 150.0", "load_n = 1e308", "load_n", "correct it")
wrong_set("set of spans swapped", "inner_span_mm = 40.0", "inner_span_mm = 140.0", "swapped")
wrong_set("set of a height of 1e-300", "height_mm = 20.0", "height_mm = 1e-300", "height_mm")
wrong_set("set of a height of 1e300", "height_mm = 20.0", "height_mm = 1e300", "height_mm")
wrong_set("set of 5000 digits", "load_n = 150.0", f"load_n = {'9' * 5000}", "set.toml")
wrong_set("set that is no beam", "[beam]", "[beem]", "beem", "beam")
wrong_set("set of a pixel as large as the beam", "= 0.5", "= 50.0", "camera.pixel_mm", "in mm")


@hostile(SETS, "a.png", "constant")
def set_whose_image_is_constant(place: Path) -> list[str]:
    arguments = calibrate(place, "a.png", "a.png")
    image(place / "a.png", np.full((48, 64), 90, np.uint8))
    return arguments


@hostile(SETS, "set.toml", "larger than", "settings file")
def set_of_a_hundred_megabytes(place: Path) -> list[str]:
    with open(place / "set.toml", "wb") as file:
        file.truncate(100_000_001)
    return ["calibrate", "disc", "set.toml", "--out", "out"]


case(SETS, "region file of garbage",
     after(lambda p: (p / "m.roi").write_bytes(os.urandom(500)), lambda p: with_mask(p, "m.roi")),
     "m.roi", "not a readable ImageJ ROI", "save it again")  # fmt: skip


@hostile(SETS, "m.roi", "save it again")
def region_file_that_claims_more_corners_than_it_has(place: Path) -> list[str]:
    data = bytearray(roi())
    data[16:18] = (60_000).to_bytes(2, "big")
    (place / "m.roi").write_bytes(data)
    return with_mask(place, "m.roi")


@hostile(SETS, "m.zip", "not a readable ImageJ ROI", "save it again")
def region_archive_cut_in_half(place: Path) -> list[str]:
    with zipfile.ZipFile(place / "m.zip", "w") as archive:
        archive.writestr("a.roi", roi())
    data = (place / "m.zip").read_bytes()
    (place / "m.zip").write_bytes(data[: len(data) // 2])
    return with_mask(place, "m.zip")


case(SETS, "region archive of nothing",
     after(lambda p: zipfile.ZipFile(p / "m.zip", "w").close(), lambda p: with_mask(p, "m.zip")),
     "m.zip", "holds no ROI", "ROI manager")  # fmt: skip
case(SETS, "region archive that is a pipe",
     after(lambda p: os.mkfifo(p / "m.zip"), lambda p: with_mask(p, "m.zip")), "m.zip",
     "no such file", "check its name")  # fmt: skip
case(SETS, "mask of the whole frame",
     after(lambda p: image(p / "m.png", np.full((48, 64), 255, np.uint8)),
     lambda p: with_mask(p, "m.png")), "m.png", "no pixel that is 0", "remove the key")  # fmt: skip
case(SETS, "mask of another size",
     after(lambda p: image(p / "m.png", (picture(rows=20) > 128).astype(np.uint8)),
     lambda p: with_mask(p, "m.png")), "m.png", "make the mask of one of these sizes")  # fmt: skip


PROFILED = CONTACT.replace("radius_mm = 24.61", "profile = 'p.csv'")


def profile(name: str, text: str, *says: str) -> None:
    def make(place: Path) -> list[str]:
        (place / "p.csv").write_text(text, "utf-8")
        write_scene(place, PROFILED)
        return simulate()

    SETS.append(Case(make, says, label=name))


profile("profile of no rows", "x_mm,gap_mm\n", "p.csv", "three rows or more")
profile("profile of NaN", "x_mm,gap_mm\n0,nan\n1,0\n2,1\n", "p.csv", "finite")
profile("profile of text", "x_mm,gap_mm\n0,a\n1,b\n2,c\n", "p.csv", "gap_mm = 'a'")
profile("profile that goes back", "x_mm,gap_mm\n0,1\n2,0\n1,1\n", "p.csv", "rising x_mm")
profile("profile of NULs", "\0" * 500, "p.csv", "no text")
case(SETS, "profile that is a pipe",
     after(lambda p: (os.mkfifo(p / "p.csv"), write_scene(p, PROFILED)), simulate()),
     "p.csv", "is not a file", "itself")  # fmt: skip


def finished(place: Path) -> Path:
    """What a run of `process` has left in `old`, and a scene and frames for another."""
    shutil.copytree(_finished(), place, dirs_exist_ok=True)
    return place / "old"


@cache
def _finished() -> Path:
    """A folder with the frames and `old`, made once."""
    from hostile.attack import run

    place = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    (place / "plain.toml").write_text(PLAIN, "utf-8")
    stack(place / "f.tif", picture(rows=32, cols=32)[None])
    ended = run(place, [*process("f.tif")[:-1], "old"])
    assert ended.code == 0, ended.err
    return place


def compare(place: Path) -> list[str]:
    return ["compare", "old", "old", "--out", "out"]


def export(place: Path) -> list[str]:
    return ["export", "old", "--to", "csv", "--out", "out"]


case(SETS, "export of a run without its store",
     after(lambda p: shutil.rmtree(finished(p) / "run.zarr"), lambda p: export(p)), "old",
     "run.zarr", "is missing")  # fmt: skip


def garbled(place: Path, name: str, data: bytes) -> None:
    """A run one of whose files is other bytes."""
    (finished(place) / name).write_bytes(data)


RUN_AGAIN = ("run.zarr", "run the command that left")
case(SETS, "export of a run whose store is garbage",
     lambda p: garbled(p, "run.zarr/zarr.json", b"\xff{garbage") or export(p),
     *RUN_AGAIN)  # fmt: skip
case(SETS, "export of a run one of whose columns is garbage",
     lambda p: garbled(p, "run.zarr/chi/zarr.json", b"[]") or export(p), *RUN_AGAIN)  # fmt: skip


@hostile(SETS, "run.zarr", "run the command that left")
def export_of_a_run_one_of_whose_chunks_is_cut(place: Path) -> list[str]:
    file = finished(place) / "run.zarr" / "normalised" / "c" / "0" / "0" / "0"
    file.write_bytes(file.read_bytes()[:50])
    return ["export", "old", "--to", "tiff", "--out", "out"]


@hostile(SETS, "run.zarr", "run the command that left")
def export_of_a_run_that_claims_a_thousand_million_frames(place: Path) -> list[str]:
    store = finished(place) / "run.zarr"
    for name in ("normalised", "chi", "frame"):
        file = store / name / "zarr.json"
        found = json.loads(file.read_text("utf-8"))
        found["shape"][0] = 10**9
        file.write_text(json.dumps(found), "utf-8")
    return ["export", "old", "--to", "csv", "--out", "out"]


@hostile(SETS, "normalised.tif", "were left", "run the command that left")
def comparison_with_a_run_whose_maps_are_garbage(place: Path) -> list[str]:
    for file in finished(place).glob("*.tif"):
        file.write_bytes(b"II*\0garbage")
    return compare(place)


def results_over(place: Path, record: bytes) -> list[str]:
    garbled(place, "provenance.json", record)
    write_scene(place, "[specimen]\nthickness_mm = 4.0\n")
    return [*process("f.tif", "wrong.toml")[:-1], "old"]


NO_RECORD = ("old/", "no provenance.json", "move it away")
case(SETS, "results over a run whose record is garbage", lambda p: results_over(p, b"\xff["),
     *NO_RECORD)  # fmt: skip
case(SETS, "results over a run whose record names no files",
     lambda p: results_over(p, b'{"outputs": [1, {"a": 2}]}'), *NO_RECORD)  # fmt: skip
