"""The page as one HTML file, and its policy: it asks this server alone."""

from __future__ import annotations

from isochrome.reporting import assemble_page, content_policy
from isochrome.setup_page.fields import KINDS, field_rows

_ROOM, _NAME = "isochrome.setup_page", "setup"

_SCRIPTS = ("view.js", "tools.js", "overlay.js", "panel.js")

_ALLOWED = "connect-src 'self'; img-src data: blob:"

POLICY = (
    content_policy(_ROOM, _NAME, scripts=_SCRIPTS, policy=_ALLOWED) + "; frame-ancestors 'none'"
)
"""What the server says of the page's content, beside what stands in the page itself."""


def page_html(scene_file: str) -> str:
    """Make the page.

    Parameters
    ----------
    scene_file : str
        Name of the scene's file, for the title.

    Returns
    -------
    str
        HTML; what it shows it asks the server for.
    """
    return assemble_page(
        _ROOM,
        _NAME,
        scripts=_SCRIPTS,
        policy=_ALLOWED,
        values={
            "scene_file": scene_file,
            "kinds": list(KINDS.items()),
            "data": {"fields": field_rows(), "kinds": KINDS},
        },
    )
