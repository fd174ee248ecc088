"""What the tests of fits look at."""

import pytest

from isochrome.fitting import search


@pytest.fixture
def scans(monkeypatch):
    """The scans of other loads that a search has made, one item each."""
    made = []

    def rungs(*args):
        made.append(args)
        return scan(*args)

    scan = search.rungs
    monkeypatch.setattr(search, "rungs", rungs)
    return made
