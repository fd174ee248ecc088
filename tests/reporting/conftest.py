"""Pages that several tests look at."""

import pytest
from pages import HOSTILE, Page, made_content

from isochrome.reporting import write_report


@pytest.fixture(scope="session")
def report_file(tmp_path_factory):
    return write_report(tmp_path_factory.mktemp("report") / "report.html", made_content())


@pytest.fixture(scope="session")
def hostile_file(tmp_path_factory):
    """A report all of whose names would be code."""
    return write_report(tmp_path_factory.mktemp("hostile") / "report.html", made_content(HOSTILE))


@pytest.fixture(scope="session")
def page(report_file):
    return Page(report_file)
