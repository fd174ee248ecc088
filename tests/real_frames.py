"""Captured frames beside the repository, too large for it, and how a test asks for them."""

from pathlib import Path

import pytest

REAL = Path(__file__).resolve().parents[2] / "shared" / "real"
needs_real = pytest.mark.skipif(not REAL.is_dir(), reason=f"NO REAL FRAMES: no {REAL}")
