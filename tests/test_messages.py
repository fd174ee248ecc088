"""A message is a text for people, and a code with values for programs, wherever it is handed on."""

import json
import pickle

import numpy as np
import pytest

import isochrome
from isochrome.comparison import ComparedFrames, compare_frames
from isochrome.messages import (
    Message,
    message,
    messages_data,
    read_messages,
    read_warnings,
    warnings_json,
)
from isochrome.reporting import warnings_with_remedies

SCENE = "[specimen]\nthickness_mm = 4.0\n\n[camera]\nbit_depth = 8\npixel_mm = 0.05\n"
"""Fringes of no model, and no point of known order: each frame is warned of."""


@pytest.fixture
def bands():
    """Two pictures of bands that no point numbers."""
    order = np.broadcast_to(np.linspace(0.0, 3.0, 96), (64, 96))
    light = np.sin(np.pi * order) ** 2
    return np.stack([20 + 200 * light, 20 + 180 * light]).astype(np.uint8)


def test_a_message_is_its_text_and_keeps_code_and_values_where_it_goes():
    text = message("no_such_file_check", path="frames.tif")
    assert text == "frames.tif: no such file; check its name"
    for handed_on in (text, pickle.loads(pickle.dumps(text)), "set.toml: " + text, text + "!"):
        assert handed_on.code == "no_such_file_check", handed_on
        assert handed_on.values == {"path": "frames.tif"}
    assert pickle.loads(pickle.dumps("set.toml: " + text)) == f"set.toml: {text}"


def test_json_has_code_values_and_text_and_gives_the_message_back():
    texts = [message("no_such_file_check", path=np.float64(2.0)), "of nobody"]
    data = json.loads(json.dumps(messages_data(texts)))
    assert data[0] == {
        "code": "no_such_file_check", "values": {"path": 2.0}, "text": str(texts[0]),
    }  # fmt: skip
    assert data[1] == {"code": "", "values": {}, "text": "of nobody"}
    back = read_messages(data)
    assert back == tuple(texts) and [isinstance(text, Message) for text in back] == [True, False]
    assert read_warnings({"warnings": ["older"]}) == ("older",)
    stored = json.loads(json.dumps(warnings_json(texts)))
    assert read_warnings(stored)[0].code == "no_such_file_check"


def test_a_refusal_has_its_message():
    with pytest.raises(isochrome.InputError) as refused:
        isochrome.load_scene("rign")
    assert refused.value.message.code and str(refused.value) == refused.value.message


def test_a_refusal_that_names_its_frame_has_its_message_still(bands):
    blank = np.full_like(bands, np.nan, dtype=float)
    with pytest.raises(isochrome.InputError) as refused:
        compare_frames(ComparedFrames(signal=blank), ComparedFrames(signal=blank))
    assert str(refused.value).startswith("frame 0 (")
    assert refused.value.message.code == "no_pixel_has_known"


def test_a_frame_without_fringes_says_so_in_a_message(bands):
    noise = np.random.default_rng(1).integers(88, 93, bands[0].shape).astype(np.uint8)
    found = isochrome.process([bands[0], noise], isochrome.parse_scene(SCENE))
    (blank,) = (text for text in found.warnings if "not normalised: " in text)
    assert blank.code


@pytest.mark.long
def test_a_runs_messages_are_the_same_in_memory_in_json_and_when_it_is_complete(tmp_path, bands):
    scene = isochrome.parse_scene(SCENE)
    in_memory = isochrome.process(bands, scene)
    first = isochrome.process(bands, scene, tmp_path / "out")
    again = isochrome.process(bands, scene, tmp_path / "out")
    assert again.already and in_memory.warnings
    wanted = messages_data(in_memory.warnings)
    assert all(one["code"] for one in wanted)
    for result in (first, again):
        assert result.to_json()["messages"] == wanted
        assert result.messages == in_memory.messages and json.loads(result.messages[0])


def test_a_report_explains_messages_by_their_codes():
    known = message("no_such_file_check", path="frames.tif")
    groups = warnings_with_remedies(["set.toml: " + known, "of nobody"])
    assert [group["title"] for group in groups][1] == "Other"
    assert groups[0]["remedy"] and groups[0]["messages"] == ["set.toml: " + known]
