"""Chromium for tests of pages: where it is, and one loud line where there is none."""

import shutil
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or "/usr/bin/chromium"


def skip_without_browser() -> None:
    """Skip the module that asks where Chromium or its driver is missing."""
    missing = [name for name in ("playwright", "axe_playwright_python") if not find_spec(name)]
    missing += [] if shutil.which(CHROMIUM) else [CHROMIUM]
    if missing:
        pytest.skip(f"NO BROWSER TESTS: no {', no '.join(missing)}", allow_module_level=True)


@contextmanager
def open_chromium() -> Iterator[Any]:
    from playwright import sync_api

    with warnings.catch_warnings(), sync_api.sync_playwright() as driver:
        warnings.simplefilter("ignore")
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()
