"""The pages of the guide, by their topics."""

from __future__ import annotations

import difflib
from importlib import resources

from isochrome.errors import InputError

TOPICS = {
    "developers": "the rooms of the code, the way of a frame, recipes",
}
"""What each page is about, in the order in which they are best read."""


def guide_page(topic: str | None = None) -> str:
    """Read a page of the guide.

    Parameters
    ----------
    topic : str, optional
        Name of the page; without it, the list of all pages.

    Returns
    -------
    str
        Markdown.

    Raises
    ------
    InputError
        Where there is no such page.
    """
    if topic is None:
        rows = "\n".join(f"| `{name}` | {about} |" for name, about in TOPICS.items())
        return (
            "# The guide\n\n`isochrome guide TOPIC` shows a page.\n\n"
            f"| topic | what it is about |\n|---|---|\n{rows}\n"
        )
    if topic not in TOPICS:
        near = difflib.get_close_matches(topic, TOPICS, n=1, cutoff=0.5)
        hint = f"did you mean '{near[0]}'?" if near else f"pages: {', '.join(TOPICS)}"
        raise InputError(f"{topic}: the guide has no such page; {hint}")
    return (resources.files("isochrome.guide") / f"{topic}.md").read_text("utf-8")
