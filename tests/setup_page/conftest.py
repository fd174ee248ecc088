"""A fresh folder with the sample's frames, and a page on it."""

import shutil
import threading
from contextlib import contextmanager

import pytest

from isochrome.samples import samples_path
from isochrome.setup_page import SetupServer, apply_tool, open_session

GIVEN = {
    "specimen.thickness_mm": 4.0, "specimen.fringe_value_n_per_mm": 14.6,
    "specimen.young_gpa": 2.1, "specimen.poisson": 0.4, "indenter.radius_mm": 24.61,
    "indenter.young_gpa": 210.0, "indenter.poisson": 0.3, "load.normal_n": 40.0,
    "friction.coefficient": 0.25, "friction.static_state_first": True,
    "wear.distances_m": [0, 31, 77, 155, 233], "wear.coefficient_mm2_per_n": 1e-9,
    "polariscope.wavelength_nm": 589.0, "polariscope.field": "dark",
    "camera.pixel_mm": 0.00607, "camera.bit_depth": 8,
}  # fmt: skip
"""What a user of the sample's bench would fill in."""


@pytest.fixture
def fresh(tmp_path):
    """A folder with the sample's frames, and no scene."""
    for name in ("captured.tif", "no-load-dark.tif", "no-load-bright.tif"):
        shutil.copy(samples_path() / "line-contact-wear" / name, tmp_path / name)
    return tmp_path


@pytest.fixture
def session(fresh):
    """A page's session on them, before there is a scene."""
    return open_session(fresh / "captured.tif")


@pytest.fixture
def made(session):
    """The same with the scene from the form."""
    apply_tool(session, {"tool": "new", "kind": "contact", "values": GIVEN})
    return session


@contextmanager
def served(session):
    """A server of a session, ended at the end."""
    server = SetupServer(session)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        yield server
    finally:
        if not server.is_ended:
            server.is_ended = True
        thread.join(20)
        assert not thread.is_alive()
