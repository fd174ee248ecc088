"""Gammas that the frames of one camera give: their uncertainty covers their scatter."""

import numpy as np
import pytest
import tifffile

from isochrome.messages import frame_messages
from isochrome.output import read_csv
from isochrome.processing import process, with_scatter_of_gamma

UNCERTAINTY = "gamma standard_uncertainty"
TEXT = '[specimen]\n[camera]\nbit_depth = 8\n[frames]\ngamma = "unknown"\n'


def table(gammas, uncertainty):
    return {
        "frame": list(range(len(gammas))), "gamma": list(gammas),
        UNCERTAINTY: [uncertainty] * len(gammas), "warnings": ["own"] * len(gammas),
        "messages": [frame_messages(["own"])] * len(gammas),
    }  # fmt: skip


def test_gammas_that_scatter_beyond_their_uncertainty_are_as_uncertain_as_they_scatter():
    """Figures of a real disc: 1.30 to 1.95, each said to be known to 0.01."""
    gammas = [1.30, 1.62, 1.95, 1.48]
    found = with_scatter_of_gamma(table(gammas, 0.01))
    scatter = np.sqrt(np.sum((np.array(gammas) - 1.5875) ** 2) / 3.0)
    assert found[UNCERTAINTY] == pytest.approx([scatter] * 4)
    for text in found["warnings"]:
        assert text.startswith("own | ") and "1.300 (frame 0) to 1.950 (frame 2)" in text
    assert found["gamma"] == gammas
    assert with_scatter_of_gamma(found) is found  # once is enough


def test_gammas_that_agree_one_alone_and_wider_ones_keep_theirs():
    rng = np.random.default_rng(7)
    said = 0
    for _ in range(300):
        given = table(1.4 + 0.02 * rng.standard_normal(6), 0.02)
        said += with_scatter_of_gamma(given) is not given
    assert said <= 10  # of 3 by chance
    for given in (table([1.4], 0.01), table([1.4, None, float("nan")], 0.01)):
        assert with_scatter_of_gamma(given) is given
    given = table([1.3, None, 1.9, 1.6], 0.01)
    given[UNCERTAINTY] = [0.01, None, 0.01, 0.5]
    found = with_scatter_of_gamma(given)
    assert found[UNCERTAINTY][1] is None and found["warnings"][1] == "own"
    assert found[UNCERTAINTY][3] == 0.5 and found[UNCERTAINTY][0] == pytest.approx(0.3)


@pytest.mark.long
def test_a_set_says_it_once_in_its_table_and_its_frames(tmp_path):
    """Two frames that were stored with gammas of 1.2 and 1.9, as no one camera does."""
    rows, cols = np.indices((130, 160), dtype=float)
    order = cols / 23.0 + 3e-4 * (rows - 60.0) ** 2
    light = 0.05 + 0.8 * np.sin(np.pi * order) ** 2
    noise = np.random.default_rng(3).standard_normal((2, *light.shape))
    frames = [255.0 * light ** (1.0 / g) + e for g, e in zip((1.2, 1.9), noise, strict=True)]
    tifffile.imwrite(tmp_path / "film.tif", np.rint(frames).astype(np.uint8))
    (tmp_path / "scene.toml").write_text(TEXT, "utf-8")
    kept = process(tmp_path / "film.tif", tmp_path / "scene.toml", tmp_path / "out")
    again = process(tmp_path / "film.tif", tmp_path / "scene.toml", tmp_path / "out")
    assert again.already and kept.columns["gamma"] == pytest.approx([1.2, 1.9], rel=0.05)
    for found in (kept, again):
        told = [text for text in found.warnings if "gamma scatters" in text]
        assert len(told) == 1 and "(frame 0) to" in told[0]
        for value, spread in zip(found.columns["gamma"], found.columns[UNCERTAINTY], strict=True):
            assert abs(value - 1.55) < 1.5 * spread
    written = read_csv(tmp_path / "out" / "frames.csv")
    assert written[UNCERTAINTY] == pytest.approx(list(kept.columns[UNCERTAINTY]), rel=1e-6)
