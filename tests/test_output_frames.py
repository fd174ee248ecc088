"""How sentences name frames, and what values over frames come to."""

import numpy as np
import pytest

from isochrome.output import FrameValues, messages_of_frames, named_frames

NAN = np.nan


@pytest.mark.parametrize(
    ("frames", "said"),
    [
        ([3], "frame 3"), ([3, 4], "frames 3-4"), ([0, 1, 2, 4, 7, 8], "frames 0-2, 4, 7-8"),
        (list(range(0, 18, 2)), "frames 0, 2, 4, 6, 8, 10, 12, 14 and 1 more"),
    ],
)  # fmt: skip
def test_frames_are_named_by_their_spans(frames, said):
    assert named_frames(frames) == said


def test_a_sentence_is_said_once_with_all_its_frames():
    said = [(0, "dark"), (1, "bright"), (2, "dark")]
    assert messages_of_frames(said) == ["frames 0, 2 (2 in all): dark", "frame 1: bright"]
    assert messages_of_frames(said[:1], single=True) == ["dark"]


def over_frames(count, *, distance=False):
    value = 44.0 + 0.1 * np.arange(count)
    value[1] = NAN
    spread = np.full((count, 1), 0.02)
    slid = 2.0 * np.arange(count) if distance else np.full(count, NAN)
    marks = np.arange(count) == 2
    return FrameValues(
        keys=("load.normal_n",), values=value[:, None], standard_uncertainty=spread,
        chi=np.ones(count), distance_m=slid, searched=marks, whole=~marks,
    )  # fmt: skip


def test_values_come_to_their_mean_span_and_median_uncertainty():
    found = over_frames(4).summary()
    assert found["key"] == ["load.normal_n"]
    assert found["mean"] == pytest.approx([(44.0 + 44.2 + 44.3) / 3])
    assert (found["least"], found["most"]) == ([44.0], [pytest.approx(44.3)])
    assert found["standard_uncertainty"] == [0.02]


def test_sentences_that_differ_in_their_numbers_have_one_cause():
    found = messages_of_frames(
        [
            (0, "chi = 1.45: the model is poor"), (1, "1 other solution fits; give the load"),
            (2, "chi = 12: the model is poor"), (3, "3 other solutions fit; give the load"),
            (4, "chi = 2.10: the model is poor"), (5, "roll_deg = 0.5 ± 0.02 in sigma_1"),
            (6, "roll_deg = -0.31 ± 0.01 in sigma_1"),
        ]
    )  # fmt: skip
    assert found == [
        "frames 0, 2, 4 (3 in all): chi = 1.45 to 12: the model is poor",
        "frames 1, 3 (2 in all): 1 to 3 other solutions fit; give the load",
        "frames 5-6 (2 in all): roll_deg = -0.31 ± 0.01 to 0.5 ± 0.02 in sigma_1",
    ]


def test_what_a_frame_says_of_two_places_stays_apart():
    said = [(0, "row 4: check it"), (0, "row 7: check it"), (1, "row 4: check it")]
    assert messages_of_frames(said) == [
        "frames 0-1 (2 in all): row 4: check it", "frame 0: row 7: check it"
    ]  # fmt: skip
