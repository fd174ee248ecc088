"""The atlas has a page of all that may be there, and the nearest pages of a frame are the right."""

import base64
import html
import re
import tomllib

import numpy as np
import pytest

import isochrome
from atlas_pages import FACTS, WORDS
from benchmarks.outside_bench import BenchContact
from benchmarks.outside_camera import Defects
from isochrome.estimation import prepare_frame
from isochrome.fitting import CAUSES, LIGHT, ORDER, fit_with_causes
from isochrome.fitting.causes.score import SHADOW, STATED, STRESS, TRACTIONS
from isochrome.frames import Frame
from isochrome.guide import atlas_picture, guide_page
from isochrome.processing.result import pages_of, pages_text
from isochrome.scene import load_scene

NAMES = {cause.name for cause in CAUSES} | {LIGHT, ORDER, SHADOW, STATED, STRESS, TRACTIONS}


def test_each_cause_has_a_page_and_each_page_a_cause():
    page = guide_page("atlas")
    assert set(re.findall("(?m)^## (.+)$", page)) == NAMES
    assert set(FACTS) == set(tomllib.loads(WORDS.read_text("utf-8"))) == NAMES
    for name in NAMES:
        picture = atlas_picture(name)
        assert picture is not None and picture.startswith(b"\x89PNG") and len(picture) < 30_000
    assert atlas_picture("a cause of nobody") is None


def test_keys_of_a_cause_stand_on_its_page():
    page = guide_page("atlas")
    for cause in CAUSES:
        text = page.split(f"## {cause.name}\n")[1].split("\n## ")[0]
        assert all(f"`{key}`" in text for key in cause.keys), cause.name


@pytest.mark.parametrize(
    ("facts", "camera", "name"),
    [
        ({"layer_mm_per_mpa": 3e-5}, {}, "a soft or rough layer between the bodies"),
        ({"edge_mpa": 0.3}, {}, "stress along a machined surface"),
        ({"focus_mm": 0.4}, {}, "a focus off the middle of the plate"),
        ({}, {"roll_deg": 0.5}, "the camera's roll"),
    ],
)
def test_a_single_fact_is_among_the_nearest(facts, camera, name):
    """By renderers that are not ours; what is nearest explains most of the residual."""
    bench = BenchContact(
        load_n=44.0, shape=(123, 165), pixel_mm=4.0 / 165, left_mm=-2.05, friction=0.2,
        defects=Defects(noise=2.0, **camera), **facts,
    )  # fmt: skip
    scene = load_scene(bench.scene())
    data = prepare_frame(Frame(0, bench.frame(1), None, "bench"), scene, bit_depth=8)
    nearest = fit_with_causes(data, scene).nearest
    assert len(nearest) == 3 and name in dict(nearest)
    assert all(0.0 <= share <= 1.0 for _, share in nearest)
    assert np.max([share for _, share in nearest]) > 0.5


def test_reports_hold_the_pictures_of_the_nearest_pages(tmp_path):
    bench = BenchContact(
        load_n=44.0, shape=(123, 165), pixel_mm=4.0 / 165, left_mm=-2.05, friction=0.2,
        edge_mpa=0.3, defects=Defects(noise=2.0),
    )  # fmt: skip
    image, scene, name = (
        bench.frame(1),
        load_scene(bench.scene()),
        "stress along a machined surface",
    )
    page = base64.b64encode(atlas_picture(name)).decode()
    processed = isochrome.process(image, scene, tmp_path / "processed")
    (cell,) = processed.columns["looks_like"]
    pages = pages_of(cell)
    assert len(pages) == 3 and name in dict(pages)
    assert pages_text([("a (b)", 0.5)]) == "a (b) (50 %)"
    shown = (tmp_path / "processed" / "report.html").read_text("utf-8")
    assert page in shown and all(one in html.unescape(shown) for one, _ in pages)
    again = isochrome.process(image, scene, tmp_path / "processed")
    assert again.already and again.columns["looks_like"] == [cell]
    isochrome.fit(image, scene, ["load.normal_n", "friction.coefficient"], out=tmp_path / "fitted")
    assert page in (tmp_path / "fitted" / "report.html").read_text("utf-8")
    plain = isochrome.process(image, scene, tmp_path / "plain", as_stated=True)
    assert plain.columns["looks_like"] == [""]
    assert "isochrome guide atlas" not in (tmp_path / "plain" / "report.html").read_text("utf-8")
