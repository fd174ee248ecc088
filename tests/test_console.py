"""What the command line shows: numbers with the digits that they have, a line where it says one."""

import json
import re
import time
from types import SimpleNamespace

import pytest

from isochrome.console import print_fit, print_json, print_warnings, run_bar
from isochrome.progress import Tally

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
    print_fit(SimpleNamespace(columns=table, chi=1.0, wear_laws=None, tractions=[]))
    return capfd.readouterr().out.splitlines()


@pytest.mark.parametrize(
    ("value", "spread", "said"),
    [
        (44.1234567, 0.0123, "44.123 ± 0.012"),
        (-44.1234567, 0.0123, "-44.123 ± 0.012"),
        (2.00123e-9, 3.4e-11, "2.001e-09 ± 3.4e-11"),
        (9.94, 1.0, "9.9 ± 1.0"),
        (11.0, 0.00011, "11.00000 ± 0.00011"),
        (1234.5, 99.6, "1230 ± 100"),
        (12345678.0, 1234.0, "1.23457e+07 ± 1.2e+03"),
        (0.25, 0.5, "0.25 ± 0.50"),
        (44.1234567, float("nan"), "44.1235 ± nan"),
        (0.0, 0.1, "0.00 ± 0.10"),
    ],
)
def test_a_value_has_the_digits_that_its_uncertainty_leaves_it(capfd, value, spread, said):
    """As many decimals as the uncertainty, which is shown with two digits."""
    _, row, *_ = shown(capfd, (value, spread))
    assert re.split(r"  +", row)[2] == said


def test_rows_that_are_not_shown_are_counted(capfd):
    lines = shown(capfd, *(63 * [(1.0, 0.1)]))
    assert lines[-2].split("  ")[0] == "and 3 more in fit.csv"
    assert len(lines) == 1 + 60 + 1 + 1


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
