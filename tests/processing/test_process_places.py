"""The axes of a set's maps are of the place that was found, whatever the scene states of it.

The frames come from a few lines of their own: Hertz' line contact (Johnson 1985, Contact mechanics,
section 4.2) here, Frocht's disc in `outside_specimens`; light, pixels and noise of `outside_camera`.
"""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import tifffile

import isochrome
from benchmarks.outside_camera import SAMPLES, Defects, _stored, lit
from benchmarks.outside_specimens import Bench, disc_images
from isochrome.errors import InputError, PhysicsError
from isochrome.output import read_csv
from isochrome.runs import export, open_run
from isochrome.scene import Scene, dump_scene, load_scene

ROWS, COLS, THICK, FRINGE = 120, 160, 4.0, 14.6
LAMP = Defects(noise=2.0)
KINDS = ("stated", "left out", "wrong", "turned", "cropped")
SPECIMENS = ("contact", "disc")
ASIDE = 0.3
"""mm: ten pixels of a contact's, six of a disc's picture."""

ROOM = 14, 9
"""Rows above and columns beside what is cropped."""


def contact_frame(load, pixel, left, top, seed=0, shape=(ROWS, COLS)):
    """Grey levels of a steel cylinder of 24.61 mm on epoxy, plane strain."""
    modulus = 1.0 / ((1 - 0.4**2) / 2100.0 + (1 - 0.3**2) / 210000.0)
    half = np.sqrt(4.0 * load / THICK * 24.61 / (np.pi * modulus))
    peak = 2.0 * load / THICK / (np.pi * half)
    rows, cols = (np.arange(n * SAMPLES) + 0.5 for n in shape)
    z, x = np.meshgrid(top + pixel * rows / SAMPLES, left + pixel * cols / SAMPLES, indexing="ij")
    body, z = z > 0.0, np.maximum(z, 1e-9)
    root, less = np.hypot(half**2 - x**2 + z**2, 2.0 * x * z), half**2 - x**2 + z**2
    m, n = np.sqrt(0.5 * (root + less)), np.sign(x) * np.sqrt(0.5 * np.maximum(root - less, 0.0))
    share = (z**2 + n**2) / (m**2 + n**2)
    sigma_x = -peak / half * (m * (1.0 + share) - 2.0 * z)
    sigma_z = -peak / half * m * (1.0 - share)
    tau = -peak / half * n * (m**2 - z**2) / (m**2 + n**2)
    order = THICK / FRINGE * np.hypot(sigma_x - sigma_z, 2.0 * tau)
    signal = np.where(body, np.sin(np.pi * order) ** 2, 0.0)
    return _stored(lit(signal, LAMP), LAMP, np.random.default_rng(seed))


class Drawn:
    """A frame of a specimen that stands where nobody looked, and the scene that a user writes."""

    def __init__(self, specimen, kind, seed):
        self.rng = rng = np.random.default_rng([SPECIMENS.index(specimen), KINDS.index(kind), seed])
        self.contact, self.kind = specimen == "contact", kind
        self.pixel = rng.uniform(0.018, 0.024) if self.contact else 0.1
        room = ROOM if kind == "cropped" else (0, 0)
        self.shape = (ROWS + room[0], COLS + 2 * room[1])
        scene = self._contact(seed) if self.contact else self._disc(seed)
        place = {"left_mm": self.left, "top_mm": self.top}
        if kind == "left out":
            place = {}
        elif kind == "wrong":
            turn = rng.uniform(0.0, 2.0 * np.pi)
            place = {"left_mm": self.left + ASIDE * np.cos(turn),
                     "top_mm": self.top + ASIDE * np.sin(turn)}  # fmt: skip
        frames = {}
        if kind == "turned":
            quarters, flip = rng.integers(1, 4), rng.choice([None, "horizontal", "vertical"])
            frames = {"rotate_deg": 90 * int(quarters)} | ({"flip": str(flip)} if flip else {})
            if flip:
                self.frame = self.frame[:, ::-1] if flip == "horizontal" else self.frame[::-1]
            self.frame = np.rot90(self.frame, -quarters)  # as it was captured
        elif kind == "cropped":
            roi = {"top_px": ROOM[0], "left_px": ROOM[1], "height_px": ROWS, "width_px": COLS}
            frames = {"roi": roi}
        camera = {"bit_depth": 8, "pixel_mm": self.pixel} | place
        if not self.contact and kind != "wrong" and rng.random() < 0.5:
            del camera["pixel_mm"]  # its rim tells it
        light = {"wavelength_nm": 587.0, "field": "dark"}
        self.scene = load_scene(scene | {"camera": camera, "frames": frames, "polariscope": light})

    def _placed(self, left, top):
        """The picture's corner, and that of what is cropped from it."""
        inner = (self.shape[0] - ROWS, (self.shape[1] - COLS) // 2)
        self.left, self.top = left + inner[1] * self.pixel, top + inner[0] * self.pixel

    def _contact(self, seed):
        load = self.rng.uniform(20.0, 45.0)
        left = -self.pixel * self.shape[1] * self.rng.uniform(0.4, 0.6)
        top = -self.pixel * (self.shape[0] - ROWS + self.rng.uniform(0.0, 4.0))
        self._placed(left, top)
        self.frame = contact_frame(load, self.pixel, left, top, seed, self.shape)
        guess = load * self.rng.uniform(0.9, 1.1)
        steel = {"radius_mm": 24.61, "young_gpa": 210.0, "poisson": 0.3}
        epoxy = {"young_gpa": 2.1, "poisson": 0.4, "plane": "strain", "thickness_mm": THICK}
        return {
            "specimen": epoxy | {"fringe_value_n_per_mm": FRINGE},
            "indenter": steel, "load": {"normal_n": guess},
        }  # fmt: skip

    def _disc(self, seed):
        order, across = self.rng.uniform(0.4, 1.2), 100.0
        down, right = self.rng.uniform(-4.0, 4.0), self.rng.uniform(-12.0, 12.0)
        bench = Bench(
            defects=LAMP, shape=self.shape, size_px=across, angle_deg=0.0, down_px=down,
            right_px=right,
        )  # fmt: skip
        (self.frame,) = disc_images([order], bench, seed)
        size = across * self.pixel
        left = -(0.5 * self.shape[1] + right) * self.pixel
        self._placed(left, 0.5 * size - (0.5 * self.shape[0] + down) * self.pixel)
        load = order * np.pi * size * FRINGE / 8.0 * self.rng.uniform(0.9, 1.1)
        disc = {"shape": "disc", "diameter_mm": size, "thickness_mm": 6.0}
        return {
            "specimen": disc | {"fringe_value_n_per_mm": FRINGE}, "load": {"normal_n": load},
        }  # fmt: skip


def places(found, folder):
    """The axes (x, z) of the map wherever they stand, mm, by where that is."""
    axes = {"dataset": tuple(found.dataset[name].values for name in ("x_mm", "z_mm"))}
    with open_run(folder) as run:
        axes["run.zarr"] = tuple(run[name].values for name in ("x_mm", "z_mm"))
    (path,) = export(folder, "netcdf", folder / "nc")
    with h5py.File(path) as file:
        axes["netCDF"] = tuple(file[name][()] for name in ("x_mm", "z_mm"))
    counts = [np.arange(n) for n in (COLS, ROWS)]
    exported = export(folder, "tiff", folder / "tiff")
    for path in (folder / "fringe_order.tif", *(p for p in exported if p.stem == "fringe_order")):
        with tifffile.TiffFile(path) as tif:
            known, scale = tif.imagej_metadata, tif.pages.first.tags["XResolution"].value
        edges = known["xorigin"], known["yorigin"]  # pixels from the first one's corner
        axes[f"{path.parent.name}/{path.name}"] = tuple(
            (n + 0.5 - edge) * scale[1] / scale[0] for n, edge in zip(counts, edges, strict=True)
        )
    table = read_csv(export(folder, "csv", folder / "csv")[0])
    axes["run.csv"] = tuple(
        table[name][0] + (n + 0.5) * table["pixel_mm"][0]
        for n, name in zip(counts, ("left_mm", "top_mm"), strict=True)
    )
    lines = read_csv(folder / "skeleton.csv")
    axes["skeleton.csv"] = tuple(
        np.polynomial.Polynomial.fit(lines[at], lines[name], 1)(n)
        for n, at, name in zip(counts, ("col_px", "row_px"), ("x_mm", "z_mm"), strict=True)
    )
    drawn = (
        isochrome.plot_order(found.dataset.fringe_order[0], lines=False)
        .get_images()[0]
        .get_extent()
    )
    for name, extent in (("plot_order", drawn),):
        left, right, low, top = extent
        axes[name] = (
            left + (counts[0] + 0.5) * (right - left) / COLS,
            top + (counts[1] + 0.5) * (low - top) / ROWS,
        )
    return axes


def check(specimen, kind, seed, folder):
    """Process a drawn frame, and hold its axes against where it was drawn and against its table.

    Returns the largest distances, px, over all files: of an axis from the truth, of the map's
    maximum from `n_max_x_mm`, `n_max_z_mm`; and the RMS of experiment minus simulation, NaN where
    the simulation is refused for fringes finer than pixels, beside a disc's loads.
    """
    drawn = Drawn(specimen, kind, seed)
    found = isochrome.process(drawn.frame, drawn.scene, folder, rois=True)
    order, table, unit = found.dataset.fringe_order[0], found.columns, drawn.pixel
    assert order.shape == (ROWS, COLS)
    row, col = np.unravel_index(np.nanargmax(order.values), order.shape)
    middle = drawn.left + 0.5 * COLS * unit, drawn.top + 0.5 * ROWS * unit
    true, maximum = [], []
    for x, z in places(found, folder).values():
        true += [x[[79, 80]].mean() - middle[0], z[[59, 60]].mean() - middle[1]]
        maximum += [x[col] - table["n_max_x_mm"][0], z[row] - table["n_max_z_mm"][0]]
    try:
        models = [isochrome.simulate(s) for s in (found.fitted, folder / "fitted_scene.toml")]
    except PhysicsError as error:
        assert "finer than two pixels" in str(error)
        gaps = [np.full((ROWS, COLS), np.nan)]
    else:
        gaps = [order - model.dataset.fringe_order[0] for model in models]
        aside = models[0].dataset.fringe_order[0].assign_coords(x_mm=order.x_mm.values + 0.2 * unit)
        with pytest.raises(InputError, match="other places"):
            order - aside
    assert all(gap.shape == (ROWS, COLS) for gap in gaps)
    return np.abs(true).max() / unit, np.abs(maximum).max() / unit, gaps[0]


def judge(specimen, kind, seed, folder):
    """One draw held against the bars. Returns the figures."""
    true, maximum, gap = check(specimen, kind, seed, folder)
    gap = np.asarray(gap)
    rms = float(np.sqrt(np.mean(gap[np.isfinite(gap)] ** 2))) if np.isfinite(gap).any() else np.nan
    print(specimen, kind, seed, true, maximum, rms)
    return true, maximum, rms


@pytest.mark.parametrize("specimen", SPECIMENS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(10))
def test_trial(specimen, kind, seed, tmp_path):
    judge(specimen, kind, seed, tmp_path / "out")
