"""Figures that nobody looks at."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def sketched(*, axes: bool = True) -> Iterator[None]:
    """Within this figures are neither laid out nor drawn, which is most of the work of leaving a
    small folder; pages that are shown need their axes."""
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ConstrainedLayoutEngine, "execute", lambda *_: None)
        patch.setattr(Figure, "draw_without_rendering", lambda *_: None)
        if axes:
            patch.setattr(Axes, "draw", lambda *_: None)
        yield
