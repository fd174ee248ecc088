"""What all tests share: hypothesis without deadlines, and code that nobody edits meanwhile."""

import functools
import gc
import os
import shutil
import sys
from contextlib import nullcontext
from pathlib import Path

import pytest
import typer.main
from hypothesis import settings

import isochrome
from sketches import sketched

# Processes of pytest-xdist share the cores: a pool of threads in each makes all of them wait (a
# quarter of the time of all tests). Set in the parent, since a worker reads it as it starts.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# No deadline: a slow machine is no failure. In CI the examples are the same each time, so that a
# change is judged by itself; at a desk they are new ones, which is how property tests find things.
settings.register_profile("desk", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "desk")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Neighbouring tests to one process, for they share what was read and fitted once."""
    from xdist.scheduler import WorkStealingScheduling

    stealing = config.getvalue("dist") == "load"  # what `-n` alone asks for
    return WorkStealingScheduling(config, log) if stealing else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """A study is a long test, whether it says so or not."""
    for item in items:
        if item.get_closest_marker("study"):
            item.add_marker("long")


@pytest.hookimpl(trylast=True)
def pytest_collection_finish():
    """Modules and tests stay to the end: nobody need look through them for garbage, nor often."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000)


SKETCHED = {
    "calibration", "campaigns", "cli", "contact", "drafting", "fitting", "frames", "guide",
    "processing", "runs", "samples", "scene", "setup_page", "simulation", "specimens", "sweeps",
    "test_docstrings.py", "test_folder_report.py", "test_messages.py", "test_other_reports.py",
    "test_report_long_run.py",
}  # fmt: skip
"""Folders and modules whose tests look at no picture that a run leaves."""


@pytest.fixture(scope="module", autouse=True)
def _sketched(request):
    """What nobody looks at is not drawn."""
    room, module = request.path.parent.name, request.path.name
    pages = room in ("reporting", "setup_page")
    with sketched(axes=not pages) if {room, module} & SKETCHED else nullcontext():
        yield


@pytest.fixture(scope="module")
def chromium():
    """A browser for the tests of a module."""
    from browsers import open_chromium, skip_without_browser

    skip_without_browser()
    with open_chromium() as browser:
        yield browser


@pytest.fixture(scope="session")
def code(tmp_path_factory):
    """A copy of the package, which nobody edits in the middle of a run."""
    home = tmp_path_factory.mktemp("code")
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(isochrome.__file__).parent, home / "isochrome", ignore=ignore)
    return home


@pytest.fixture(scope="session", autouse=True)
def _one_command_line():
    """The command line is put together once for all tests that run a command in their process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", functools.cache(typer.main.get_command))
        yield


@pytest.fixture(scope="session", autouse=True)
def _columns_have_words():
    """Whatever table a command writes in any test: its columns are on the guide's page."""
    sys.path.insert(0, str(Path(__file__).parent / "guide"))
    from file_columns import columns, has_words

    from isochrome.output import files

    known, write = columns(), files._write_table

    def checked(file, columns_, *, header=True):
        frame = sys._getframe(1)
        while frame.f_globals["__name__"] == "isochrome.output.files":
            frame = frame.f_back
        room = frame.f_globals["__name__"]
        # benchmarks have tables of their own, an export has the columns that a run has, and the
        # data of a figure's curves go by what stands at its axes
        others = ("benchmarks", "runs.store", "figures.paper")
        if room.startswith("isochrome.") and not room.endswith(others):
            missing = [name for name in columns_ if not has_words(name, known)]
            assert not missing, (
                f"{room} writes the columns {missing} without words; write one line for each "
                "in tests/guide/files.toml, then run `python tests/guide/write_pages.py`"
            )
        write(file, columns_, header=header)

    files._write_table = checked
    yield
    files._write_table = write
