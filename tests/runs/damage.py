"""Finished folders of every command, and faults that may happen to them on a disk."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tifffile

import isochrome
from isochrome.calibration import save_calibration
from isochrome.scene import dump_scene, load_scene

SMALL = {"camera.width_px": 96, "camera.height_px": 96, "camera.pixel_mm": 0.48,
         "camera.noise_grey": 1.0}  # fmt: skip
BOMB = 2**41
"""Bytes of a file that claims to be as large, and takes no room."""


@dataclass(frozen=True)
class Command:
    """A command whose folder is `name`: what is run `again`, and the folders that it `needs`."""

    name: str
    again: Callable[[], object]
    needs: tuple[str, ...] = ()


def ring(load=60.0, **values):
    """The package's ring in small pictures."""
    return load_scene("ring").with_values(SMALL | {"load.normal_n": load} | values)


def write_input(place: Path) -> None:
    """Frames of a ring at nine loads and of a contact that is followed; traces of worn scars."""
    frames = np.concatenate([isochrome.simulate(ring(60.0 + k)).frames for k in range(9)])
    tifffile.imwrite(place / "ring.tif", frames, photometric="minisblack")
    tifffile.imwrite(place / "first.tif", frames[0], photometric="minisblack")
    (place / "ring.toml").write_text(dump_scene(ring(62.0)), "utf-8")
    (place / "one.toml").write_text(dump_scene(ring()), "utf-8")
    contact = load_scene("line-contact-wear").model_copy(update={"friction": None, "wear": None})
    contact = contact.with_values({
        "camera.width_px": 120, "camera.height_px": 80, "camera.pixel_mm": 0.033,
        "camera.left_mm": -1.9, "camera.noise_grey": 2.0,
    })  # fmt: skip
    rng = np.random.default_rng(5)
    loads = 44.0 + rng.normal(0.0, 0.2, 7)
    film = [isochrome.simulate(contact.with_values({"load.normal_n": p})).frames for p in loads]
    tifffile.imwrite(place / "film.tif", np.concatenate(film), photometric="minisblack")
    (place / "film.toml").write_text(dump_scene(contact), "utf-8")
    worn = "[[volume]]\ndistance_m = 31.0\nnormal_n = 44.0\nvalue_mm3 = 0.0027\n"
    (place / "wear.toml").write_text(worn, "utf-8")


def commands() -> tuple[Command, ...]:
    """Every command that leaves a folder of results, in the folder that `write_input` filled."""
    free = ["load.normal_n"]
    return (
        Command("process", lambda: isochrome.process("ring.tif", "ring.toml", "process")),
        Command(
            "track",
            lambda: isochrome.process("film.tif", "film.toml", "track", track=True, every=3),
        ),
        Command("simulate", lambda: isochrome.simulate("one.toml", "simulate")),
        Command(
            "sweep", lambda: isochrome.sweep("one.toml", {"load.normal_n": [50.0, 60.0]}, "sweep")
        ),
        Command(
            "fit", lambda: isochrome.fit("ring.tif", "ring.toml", (), per_frame=free, out="fit")
        ),
        Command("follow", lambda: isochrome.track("film.tif", "film.toml", free, out="follow")),
        Command(
            "campaign",
            lambda: isochrome.process_campaign(["ring.tif", "first.tif"], "one.toml", "campaign"),
        ),
        Command(
            "single", lambda: isochrome.process("first.tif", "one.toml", "single"), ("simulate",)
        ),
        Command(
            "compare",
            lambda: isochrome.compare("single", "simulate", "compare"),
            ("single", "simulate"),
        ),
        Command("calibrate", lambda: save_calibration(
            isochrome.calibrate_wear("wear.toml"), "calibrate", source="wear.toml"
        )),
    )  # fmt: skip


def contents_of(dataset) -> dict[str, object]:
    """All that a dataset holds, as bytes or text."""
    with dataset:
        return {
            str(name): str(array.values.tolist()) if array.dtype.kind in "OTU"
            else array.values.tobytes()
            for name, array in dataset.variables.items()
        }  # fmt: skip


def exported(folder: Path, to: str) -> dict[str, bytes]:
    """The files of an export, by their names."""
    out = folder.with_name(f"{folder.name}-export")
    try:
        return {file.name: file.read_bytes() for file in isochrome.export(folder, to, out)}
    finally:
        shutil.rmtree(out, ignore_errors=True)


def reported(folder: Path) -> bytes:
    """The report of a folder, made elsewhere."""
    out = folder.with_name(f"{folder.name}-report")
    try:
        return isochrome.report(folder, out).read_bytes()
    finally:
        shutil.rmtree(out, ignore_errors=True)


def uses(name: str) -> dict[str, Callable[[Path], object]]:
    """What reads a command's folder, and gives the same of the same files."""
    stored = name in ("process", "track", "single", "sweep", "fit", "follow")
    found: dict[str, Callable[[Path], object]] = {}
    if stored:
        found["open_run"] = lambda folder: contents_of(isochrome.open_run(folder))
        found["csv"] = lambda folder: exported(folder, "csv")
    if name in ("process", "track", "sweep"):
        found["tiff"] = lambda folder: exported(folder, "tiff")
        found["netcdf"] = lambda folder: exported(folder, "netcdf")
    if name not in ("sweep", "campaign", "compare"):
        found["report"] = reported
    if name in ("single", "simulate"):
        sets = ("{}", "simulate-kept") if name == "single" else ("single-kept", "{}")
        found["compare"] = lambda folder: (
            isochrome.compare(*(one.format(folder) for one in sets)).columns
        )
    return found


FAULTS = ("byte", "gone", "cut", "longer", "other", "link", "pipe", "folder", "bomb", "linked")
"""Kinds of faults."""


def damage(folder: Path, rng: np.random.Generator, kind: str) -> str:
    """Do something to one file of a folder of results; the file's path in it.

    'other': a file of the same size in its place, as a chunk that was put in the wrong one; 'bomb':
    a file that claims to be of two terabytes; 'linked': its folder is a link to a copy.
    """
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    file = files[rng.integers(len(files))]
    if kind == "other":
        by_size: dict[int, list[Path]] = {}
        for one in files:
            by_size.setdefault(one.stat().st_size, []).append(one)
        alike = [
            (a, b) for group in by_size.values() for a in group for b in group
            if a.read_bytes() != b.read_bytes()
        ]  # fmt: skip
        if not alike:
            kind = "byte"
        else:
            file, source = alike[rng.integers(len(alike))]
            file.write_bytes(source.read_bytes())
    data = file.read_bytes()
    if kind == "byte":
        at = int(rng.integers(len(data)))
        flipped = data[at] ^ 1 << int(rng.integers(8))
        file.write_bytes(data[:at] + bytes([flipped]) + data[at + 1 :])
    elif kind == "cut":
        file.write_bytes(data[: rng.integers(len(data))])
    elif kind == "longer":
        file.write_bytes(data + rng.bytes(int(rng.integers(1, 100))))
    elif kind == "linked" and file.parent != folder:
        copy = folder.with_name(f"{folder.name}-elsewhere")
        shutil.copytree(file.parent, copy)
        shutil.rmtree(file.parent)
        file.parent.symlink_to(copy, target_is_directory=True)
    elif kind != "other":
        file.unlink()
        if kind in ("link", "linked"):
            copy = folder.with_name(f"{folder.name}-elsewhere")
            copy.write_bytes(data)
            file.symlink_to(copy)
        elif kind == "pipe":
            os.mkfifo(file)
        elif kind == "folder":
            file.mkdir()
        elif kind == "bomb":
            with open(file, "wb") as sparse:
                sparse.truncate(BOMB)
    return file.relative_to(folder).as_posix()
