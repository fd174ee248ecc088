"""What the tests of long runs share."""

import pytest

from runs.counting import Count


@pytest.fixture
def notes(tmp_path):
    """A folder for the notes of who computed what."""
    folder = tmp_path / "notes"
    folder.mkdir()
    return folder


@pytest.fixture
def count(notes):
    """Work that fails nowhere."""
    return Count(notes)
