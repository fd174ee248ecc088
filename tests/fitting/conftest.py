"""What the tests of fits look at."""

import pytest

from isochrome.fitting.search import cold_start


@pytest.fixture
def scans(monkeypatch):
    """The scans of other loads that a search has made, one item each."""
    made = []

    def rungs(*args):
        made.append(args)
        return scan(*args)

    scan = cold_start.rungs
    monkeypatch.setattr(cold_start, "rungs", rungs)
    return made
