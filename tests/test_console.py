"""What the command line shows: numbers with the digits that they have, a line where it says one."""

import json
import re
import time
from types import SimpleNamespace

import numpy as np
import pytest

from isochrome.console import print_fit, print_json, print_warnings, run_bar
from isochrome.estimation import BudgetInput
from isochrome.fitting import PARTS, Fit, KeyBudget
from isochrome.output import FittedResult, refined_texts, sentence_of_orders
from isochrome.progress import Tally
from isochrome.scene import load_scene

LOAD, PIXEL = "load.normal_n", "camera.pixel_mm"
BEFORE, DONE, SLEPT_S = 900, 1000, 0.05


def test_the_rate_of_a_run_that_goes_on_counts_what_it_has_done_itself(monkeypatch, capfd):
    """A hundred frames in some time; the nine hundred that were there cost it none."""
    monkeypatch.setenv("FORCE_COLOR", "1")  # as on a terminal
    monkeypatch.setenv("COLUMNS", "200")
    with run_bar("processing") as show:
        show(Tally(BEFORE, DONE, BEFORE, 0))
        time.sleep(SLEPT_S)
        show(Tally(DONE, DONE, BEFORE, 7))
    said = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", capfd.readouterr().err)
    rates = [float(rate) for rate in re.findall(r"([0-9.e+]+) frames/s", said)]
    assert rates and max(rates) <= (DONE - BEFORE) / SLEPT_S
    assert "1000/1000" in said and "7 flagged" in said


def shown(capfd, *rows):
    """The table that is printed of a fit with some values and uncertainties, a key in each."""
    names = ("frame", "key", "value", "standard_uncertainty", "cramer_rao_bound")
    columns = zip(*((0, f"key{k}", *row, 1.0) for k, row in enumerate(rows)), strict=True)
    table = dict(zip(names, map(list, columns), strict=True))
    made = SimpleNamespace(columns=table, chi=1.0, wear_laws=None, tractions=[], summary_text="")
    print_fit(made)
    return capfd.readouterr().out.splitlines()


@pytest.mark.parametrize(
    ("value", "spread", "said"),
    [
        (44.1234567, 0.0123, "44.123 ± 0.012"), (-44.1234567, 0.0123, "-44.123 ± 0.012"),
        (2.00123e-9, 3.4e-11, "2.001e-09 ± 3.4e-11"), (9.94, 1.0, "9.9 ± 1.0"),
        (11.0, 0.00011, "11.00000 ± 0.00011"), (1234.5, 99.6, "1230 ± 100"),
        (12345678.0, 1234.0, "1.23457e+07 ± 1.2e+03"), (0.25, 0.5, "0.25 ± 0.50"),
        (44.1234567, float("nan"), "44.1235 ± nan"), (0.0, 0.1, "0.00 ± 0.10"),
    ],
)  # fmt: skip
def test_a_value_has_the_digits_that_its_uncertainty_leaves_it(capfd, value, spread, said):
    """As many decimals as the uncertainty, which is shown with two digits."""
    _, row, *_ = shown(capfd, (value, spread))
    assert re.split(r"  +", row)[2] == said


def test_rows_that_are_not_shown_are_counted(capfd):
    lines = shown(capfd, *(63 * [(1.0, 0.1)]))
    assert lines[-3].split("  ")[0] == "and 3 more in fit.csv"
    assert len(lines) == 1 + 60 + 1 + 1 + 1


def sentence_of(rows, frames, causes, basis=""):
    """The sentence of a result of so many frames."""
    made = SimpleNamespace(
        rows=rows, over_frames=SimpleNamespace(chi=[1.0] * frames), causes=causes, refined=[],
        uncertainty_basis=basis,
    )  # fmt: skip
    return FittedResult.summary_text.fget(made)


def basis_of_uncertainty(exact, frames=1, besides=()):
    """What the ± of a result of so many frames are of."""
    over = SimpleNamespace(chi=[1.0] * frames)
    made = SimpleNamespace(taken_as_exact=exact, over_frames=over, besides=besides)
    return FittedResult.uncertainty_basis.fget(made)


def test_a_result_is_a_sentence():
    rows = [
        ("load.normal_n", 62.004, 62.004, 62.004, 0.281),
        ("friction.coefficient", 0.18, 0.18, 0.18, 0.00104),
    ]
    told = sentence_of(rows, 1, ["blur"])
    assert told == "load 62.00 ± 0.28 N, friction 0.1800 ± 0.0010; causes found: blur"
    assert sentence_of(rows[:1], 1, []).endswith("0.28 N; causes found: none")
    assert sentence_of(rows[:1], 1, None) == "load 62.00 ± 0.28 N"


def test_the_sentence_of_several_frames_says_mean_and_span():
    rows = [("load.normal_n", 44.0, 43.0, 45.0, 0.1), ("camera.roll_deg", None, None, None, None)]
    told = sentence_of(rows, 6, [])
    assert told.startswith("mean of 6 frames, ± of each: load 44.00 ± 0.10 N (43.00 to 45.00), ")
    assert "camera.roll_deg not known" in told


def fit_with(rows, asked, budget=(), exact=(PIXEL,)):
    """A Fit of two frames with some rows of key, frame (None for both), value and its ±."""
    shared, frames = {}, [{}, {}]
    for key, frame, value, spread in rows:
        place = shared if frame is None else frames[frame]
        place[key] = dict.fromkeys(PARTS, spread) | {"value": value}
    return Fit(
        shared=shared, frames=frames, distance_m=[None, None], frame_chi=[1.0, 1.0], chi=1.0,
        scene=load_scene("line-contact-wear"), other_minima=[[], []], wear_laws=None, warnings=(),
        asked=asked, budget=tuple(budget), taken_as_exact=exact,
    )  # fmt: skip


def test_the_sentence_of_a_fit_tells_what_was_asked_from_what_frames_asked_for(capfd):
    rows = [(LOAD, None, 62.0, 0.28), ("camera.roll_deg", 0, 0.3, 0.01),
            ("camera.roll_deg", 1, 0.5, 0.01)]  # fmt: skip
    print_fit(fit_with(rows, (LOAD,)))
    assert capfd.readouterr().out.splitlines()[-1] == (
        "mean of 2 frames, ± of each: load 62.00 ± 0.28 N; ± from the pictures alone: "
        "camera.pixel_mm was taken as exact; causes found: "
        "camera.roll_deg 0.400 ± 0.010 (0.300 to 0.500)"
    )
    assert "causes" not in fit_with(rows, None).summary_text


@pytest.mark.parametrize(
    ("stated", "refined", "causes"),
    [
        # two of their combined uncertainties are 4.02e-5 mm
        (0.00611, "camera.pixel_mm 0.0060700 ± 0.0000020 (stated 0.006110 ± 0.000020)", []),
        (0.006029, None, ["camera.pixel_mm 0.0060700 ± 0.0000020"]),
    ],
)
def test_what_was_stated_and_agrees_is_refined_and_else_a_cause(stated, refined, causes):
    entry = BudgetInput(
        input=PIXEL, value=stated, standard_uncertainty=2e-5, sensitivity=1.0, share=0.5
    )
    budget = [KeyBudget(None, key, (entry,)) for key in (LOAD, PIXEL)]
    rows = [(LOAD, None, 62.0, 0.28), (PIXEL, None, 0.00607, 2e-6)]
    found = fit_with(rows, (LOAD,), budget, exact=())
    assert found.causes == causes and found.refined == [refined] * (refined is not None)
    said = found.summary_text
    assert "taken as exact" not in said and ("refined: camera.pixel_mm" in said) == bool(refined)
    assert said.endswith(f"causes found: {', '.join(causes) or 'none'}")
    assert found.to_json()["summary_text"] == said


def test_what_a_frame_knows_no_better_than_it_was_stated_is_not_refined():
    rows = [(PIXEL, 0.00607, None, None, 2.004e-5), ("specimen.poisson", 0.4, None, None, 0.01)]
    stated = {PIXEL: (0.00607, 2e-5), "specimen.poisson": (0.4, 0.02)}
    assert refined_texts(rows, stated) == ["specimen.poisson 0.400 ± 0.010 (stated 0.400 ± 0.020)"]


def test_the_keys_that_were_taken_as_exact_are_some_and_a_number():
    words = "± from the picture alone: a, b, c and 2 more were taken as exact"
    assert basis_of_uncertainty("abcde") == words
    assert ": a, b, c, d were" in basis_of_uncertainty("abcd")
    some = basis_of_uncertainty(["a"], frames=2, besides=["the stated uncertainties"])
    assert some == "± from the pictures and the stated uncertainties: a was taken as exact"
    assert basis_of_uncertainty(()) == ""
    assert sentence_of([(LOAD, None, None, None, None)], 1, [], basis=words).startswith(
        "load not known; causes"
    )


def test_without_a_terminal_progress_is_a_line_a_minute(monkeypatch, capfd):
    """A hundred frames in 150 seconds, of 200: 100 more take as long."""
    now = iter(np.arange(0.0, 1000.0, 1.5))
    monkeypatch.setattr("isochrome.console.monotonic", lambda: next(now))
    with run_bar("processing") as show:
        for done in range(0, 101):
            show(Tally(done, 200, 0, 2))
    lines = capfd.readouterr().err.splitlines()
    assert 2 <= len(lines) <= 5
    assert all(
        re.fullmatch(r"processing: \d+ of 200 frames, .* frames/s, 2 flagged, \d+ min left", line)
        for line in lines
    )


def test_what_is_done_before_the_frames_is_told_of_and_does_not_count_as_theirs(monkeypatch, capfd):
    """A pass of 150 seconds, and then a hundred frames in as many."""
    now = iter(np.arange(0.0, 1000.0, 1.5))
    monkeypatch.setattr("isochrome.console.monotonic", lambda: next(now))
    with run_bar("processing") as show:
        for done in range(0, 101):
            show(Tally(done, 200, 0, 0, stage="following the fringes"))
        for done in range(0, 101):
            show(Tally(done, 200, 0, 2))
    first, *_, last = capfd.readouterr().err.splitlines()
    assert re.fullmatch(r"processing: following the fringes, \d+ of 200 frames", first)
    # two looks at the clock for each of 100 frames
    rate = float(re.search(r"([0-9.]+) frames/s", last)[1])
    assert 0.3 < rate < 0.7


def test_a_warning_is_one_line_whatever_is_in_a_name(capfd):
    print_warnings(["new\nline.tif: is odd", "second"])
    assert capfd.readouterr().err == "warning: new line.tif: is odd\nwarning: second\n"


def test_json_is_one_line_without_nan(capfd):
    print_json({"chi": float("nan"), "long": [1.5] * 10_000, "text": "two\nlines"})
    out = capfd.readouterr().out
    assert out.count("\n") == 1
    assert json.loads(out, parse_constant=pytest.fail) == {
        "chi": None, "long": [1.5] * 10_000, "text": "two\nlines",
    }  # fmt: skip


def test_what_was_read_without_a_model_is_a_sentence():
    """Nothing was said but a table: no sentence had a place for an order."""
    table = {
        "frame": [0, 1, 2], "kept_share": [0.9, 0.8, None], "n_max": [3.2, 4.126, float("nan")],
        "order_uncertainty": [0.004, 0.0062, float("nan")], "fringe_lines": [5, 6, 0],
    }  # fmt: skip
    said = "in 3 frames: order read in 85 % of the pixels, up to 4.13 fringes, ± 0.0051 typically"
    assert sentence_of_orders(table) == said
    one = {name: values[:1] for name, values in table.items()}
    assert sentence_of_orders(one).startswith("order read in 90 % of the pixels, up to 3.20 ")
    none = {name: values[2:] for name, values in table.items()}
    assert sentence_of_orders(none) == "no order could be read"
    lines = {name: table[name] for name in ("frame", "fringe_lines")}
    assert sentence_of_orders(lines).startswith("in 3 frames: 11 fringe lines, and no order: ")
