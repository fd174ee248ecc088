"""A run's folder of any length, from a short run that was really made."""

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from isochrome.output import read_csv, write_csv
from isochrome.reporting import choose_frames
from isochrome.runs import PROVENANCE, STORE, identifier, seal
from isochrome.scene import dump_scene, load_scene

SPEED_MM_PER_S = 250.0
LOAD, WEAR = "load.normal_n", "wear.coefficient_mm2_per_n"
WORST_CHI, LARGEST_N = 9.0, 99.0


def lengthen(source: Path, target: Path, count: int, every: int = 1) -> dict[str, Any]:
    """Write a run of `count` frames; every n-th has maps, those of the chosen ones in files.
    The rows are those of the source's last frame, with a load that swings, distances that grow,
    a file and a warning of each frame's own, one frame of a large chi and one of a large order.
    Maps that no report should ask for have no file: they would be tens of gigabytes, and whoever
    reads them finds nothing known. Returns the columns of frames.csv."""
    shutil.copytree(source, target, ignore=shutil.ignore_patterns("*.tif", STORE, "*.png"))
    found = read_csv(source / "frames.csv")
    table: dict[str, Any] = {name: [values[-1]] * count for name, values in found.items()}
    keys = list(range(0, count, every))
    table |= {
        "frame": list(range(count)),
        "label": [f"{k / 10:.1f} m" for k in range(count)],
        "distance_m": [k / 10 for k in range(count)],
        LOAD: list(44.0 * (1.0 + 0.03 * np.sin(np.arange(count) / 50.0))),
        "warnings": [f"frame {k}: 0.{k:05} of the pixels are saturated" for k in range(count)],
    }
    if every > 1:
        table["picture"] = [k // every if k % every == 0 else None for k in range(count)]
    if WEAR in table:
        table[WEAR][0] = None  # nothing is worn at the distance of nought
    table["chi"][keys[len(keys) // 3]] = WORST_CHI
    table["n_max"][keys[2 * len(keys) // 3]] = LARGEST_N
    write_csv(target / "frames.csv", table)
    _write_store(source / STORE, target / STORE, table, keys)
    scene = load_scene(source / "scene.toml")
    scene = scene.with_values({"frames.sliding_speed_mm_per_s": SPEED_MM_PER_S})
    (target / "scene.toml").write_text(dump_scene(scene), "utf-8")
    record = json.loads((source / PROVENANCE).read_text("utf-8"))
    record["inputs_sha256"] = {f"{k:06}.tif": "0" * 64 for k in range(count)}
    for name in ("outputs", "outputs_crc32c"):  # those of the short run
        del record[name]
    seal(target, record)
    return table


def _write_store(
    source: Path, target: Path, table: Mapping[str, Sequence[Any]], keys: Sequence[int]
) -> None:
    """The store of a longer run: the same arrays along longer axes."""
    own = {identifier(name): values for name, values in table.items()} | {"key_frame": keys}
    sizes = {"frame": len(table["frame"]), "key_frame": len(keys)}
    chi, largest = (np.array([table[name][k] for k in keys]) for name in ("chi", "n_max"))
    having = list(choose_frames(chi, largest))
    old, new = zarr.open_group(source, mode="r"), zarr.create_group(target)
    new.attrs.update(dict(old.attrs))
    for name, array in old.arrays():
        axes = array.metadata.dimension_names
        shape = tuple(sizes.get(axis, n) for axis, n in zip(axes, array.shape, strict=True))
        made = new.create_array(
            name, shape=shape, dtype=array.dtype, dimension_names=axes,
            chunks=shape if array.ndim == 1 else array.chunks, fill_value=array.fill_value,
            attributes=dict(array.attrs),
        )  # fmt: skip
        if array.ndim > 1:
            for k in having:
                made[k] = array[-1]
        elif axes[0] not in sizes:
            made[:] = array[:]
        else:
            none = np.nan if array.dtype.kind == "f" else ""
            values = own.get(name, [array[-1]] * shape[0])
            known = [none if v is None or v != v else v for v in values]
            made[:] = np.array(known, dtype=array.dtype)
