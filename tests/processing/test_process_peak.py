"""The largest order where the peak's pixels are missing: the model's with its ±, or "at least".

Contacts, frames and their truth are closed forms of `benchmarks.outside_contact`: no code of the
package.
"""

from __future__ import annotations

import numpy as np
import pytest

import isochrome
from isochrome.benchmarks import load_benchmarks
from isochrome.errors import PhysicsError
from isochrome.output import sentence_of_orders, write_tiff
from isochrome.processing.kinds.largest_order import order_columns

OUTSIDE, CAMERA = load_benchmarks("outside_contact"), load_benchmarks("outside_camera")
HARMS = ("specks", "blob", "glare", "mask", "dead")


def drawn(seed):
    """A contact of a seed, of a random load, friction and place, the peak well inside it."""
    rng = np.random.default_rng([seed, 36])
    noise, fall_off = rng.uniform(1.0, 4.0), rng.uniform(0.0, 0.4)
    contact = OUTSIDE.Contact(
        load_n=np.exp(rng.uniform(*np.log([25.0, 90.0]))),
        friction=rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.25),  # steeper: at the surface
        left_mm=-2.0 + rng.uniform(-0.6, 0.6),
        defects=CAMERA.Defects(noise=noise, fall_off=fall_off),
    )
    return contact, rng


def largest(contact):
    """The largest order in the picture, and its pixel, on a grid of seventh pixels."""
    order = contact.seen(7)
    row, col = np.unravel_index(np.nanargmax(order), order.shape)
    return float(order[row, col]), row // 7, col // 7


def spots(shape, middle, rng, count, radii, spread):
    """Pixels within some discs about a place (rows, cols)."""
    rows, cols = np.indices(shape)
    found = np.zeros(shape, dtype=bool)
    for _ in range(count):
        row, col = rng.normal(middle, spread)
        found |= np.hypot(rows - row, cols - col) < rng.uniform(*radii)
    return found


def harmed(contact, rng, harm, folder):
    """The frame with its peak covered, and its scene, whose load is not quite known."""
    _, *peak = largest(contact)
    size = {"specks": (25, (1.0, 2.5), 5.0), "dead": (60, (0.5, 1.2), 4.0)}
    count, radii, spread = size.get(harm, (1, (5.0, 10.0), 1.0))
    where = spots(contact.shape, peak, rng, count, radii, spread)
    scene = contact.scene() | {"load": {"normal_n": contact.load_n * rng.uniform(0.9, 1.1)}}
    left = {"specks": rng.uniform(0.0, 0.6), "blob": rng.uniform(0.0, 0.6), "glare": np.inf}
    part, seed = left.get(harm), rng.integers(1 << 30)
    image = contact.frame(
        seed, None if part is None else lambda light: np.where(where, light * part, light)
    )
    if harm == "dead":
        image = np.where(where, 0, image)
    if harm == "mask":
        shown = np.where(where, 0, 255).astype(np.uint8)
        write_tiff(folder / "mask.tif", shown[None], pixel_mm=None)
        scene["frames"] = {"mask": str(folder / "mask.tif")}
    return image, scene


def found(image, scene):
    """The row of a frame, and its warnings."""
    result = isochrome.process(image, scene)
    return {name: values[0] for name, values in result.columns.items()}, result


def judged(row, true):
    """Whether the largest order is right within its ±, or a least one and no larger."""
    off = row["n_max"] - true
    spread = row["n_max_uncertainty"]
    return off <= 2.0 * spread if row["n_max_from"] == "at least" else abs(off) <= 2.0 * spread


def test_an_unharmed_frame_shows_its_largest_order_itself():
    contact, _ = drawn(0)
    row, result = found(contact.frame(0), contact.scene())
    assert row["n_max_from"] == "frame" and not result.warnings
    assert judged(row, largest(contact)[0])
    assert abs(row["p_max_mpa"] - contact.pressure_mpa()) <= 3.0 * row["p_max_uncertainty_mpa"]


def test_a_masked_peak_is_the_models_within_its_uncertainty_or_at_least(tmp_path):
    contact, rng = drawn(2)
    row, result = found(*harmed(contact, rng, "glare", tmp_path))
    assert row["n_max_from"] in ("model", "at least")
    assert judged(row, largest(contact)[0])
    assert any("n_max" in text for text in result.warnings)
    assert (
        row["n_max_from"] == "at least"
        or abs(row["p_max_mpa"] - contact.pressure_mpa()) <= 3.0 * row["p_max_uncertainty_mpa"]
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("seeds", "models"),  # specks and a mask; of a glare see above
    [((15, 18), 1), pytest.param(range(50), 30, marks=pytest.mark.study)],
)
def test_masked_peaks(tmp_path, seeds, models):
    wrong, named, refused = [], [], 0
    for seed in seeds:
        contact, rng = drawn(seed)
        try:
            row, _ = found(*harmed(contact, rng, HARMS[seed % 5], tmp_path))
        except PhysicsError:  # nothing is read, and nothing said of the largest order
            refused += 1
            continue
        if not judged(row, largest(contact)[0]):
            wrong.append(row["n_max_from"])
        named.append(row["n_max_from"])
    # a least value is one that was read: of seed 36 it lies 2.1 of its ± above the truth
    assert len(wrong) <= len(seeds) // 50 and "model" not in wrong and refused <= 2
    assert named.count("model") >= models and "frame" not in named


@pytest.mark.long
@pytest.mark.parametrize("tilt", [0.3, pytest.param(0.7, marks=pytest.mark.study)])
def test_a_load_that_varies_through_the_thickness_leaves_the_largest_order_right(tilt):
    """Taken for dust it was 22 % low, and silently so: it is a tilt, or in the tractions."""
    contact = OUTSIDE.Contact(friction=0.15, tilt=tilt)
    row, result = found(contact.frame(1), contact.scene())
    assert judged(row, largest(contact)[0])
    causes = "a load that is uneven through the thickness", "tractions that are not the model's"
    assert any(cause in " ".join(result.warnings) for cause in causes)


@pytest.mark.long
def test_followed_frames_say_where_theirs_is_from(tmp_path):
    contact = drawn(7)[0]
    true, *peak = largest(contact)
    glare = spots(contact.shape, peak, np.random.default_rng(1), 1, (7.0, 8.0), 0.0)
    film = [contact.frame(k) for k in range(6)]
    film[4:] = [contact.frame(k, lambda light: np.where(glare, np.inf, light)) for k in range(4, 6)]
    write_tiff(tmp_path / "film.tif", np.stack(film), pixel_mm=None)
    result = isochrome.process(
        tmp_path / "film.tif", contact.scene(), track=True, every=10, maps="all"
    )
    table = result.columns
    assert table["n_max_from"][:4] == ["frame"] * 4
    for value, source in zip(table["n_max"], table["n_max_from"], strict=True):
        # of noise alone 0.003 fringe; a least order may be as low as the glare is wide
        off = value - true
        assert off < 0.01 if source == "at least" else abs(off) < 0.01
    assert set(table["n_max_from"][4:]) <= {"model", "at least"}
    assert any("n_max" in text for text in result.warnings)


@pytest.mark.parametrize(
    ("hidden", "source"),
    [
        ((slice(0, 0), slice(0, 0)), "frame"),
        ((slice(30, 31), slice(41, 42)), "frame"),  # a pixel alone, beside the peak
        ((slice(24, 36), slice(34, 46)), "at least"),
        ((slice(0, 9), slice(0, 80)), "frame"),  # far from it
    ],
)
def test_without_a_model_the_largest_order_is_at_least_what_its_unread_neighbours_leave(
    hidden, source
):
    rows, cols = np.indices((60, 80))
    order = 3.0 - 1e-3 * ((rows - 30) ** 2 + (cols - 40) ** 2)
    order[hidden] = np.nan
    found = order_columns(order, np.full_like(order, 0.01))
    assert found["n_max_from"] == source
    table = {name: [value] for name, value in found.items()} | {"frame": [0], "kept_share": [0.9]}
    assert ("at least" in sentence_of_orders(table)) == (source == "at least")
