"""The pages of the guide by their topics."""

import difflib
import re
from importlib import resources

from isochrome.errors import InputError

TOPICS = {
    "first-video": "your first own video, step by step",
    "without-model": "orders of a specimen that has no model, from points that you know",
    "phase-steps": "phase-stepped sets, isoclinics and residual stress",
    "colour": "white light: orders by their colours",
    "calibration": "the fringe value, the camera's scale, and the uncertainty budget",
    "fitting": "what the fringes know: unknowns of the scene, causes, wear laws, tractions",
    "arrays": "frames, scenes and results as arrays in Python",
    "long-recordings": "long recordings, campaigns of many, and a cluster",
    "paper-figures": "figures for a paper",
    "conventions": "units, axes, and a glossary",
    "trust": "how far to trust a result: chi, causes, budget; what was tested against what",
    "atlas": "patterns of the residual: what each looks like, its usual causes and its remedy",
    "theory": "the way from load to light, and the pages of its parts",
    "theory-contact": "pressure, friction, wear",
    "theory-stress": "stress below the surface, and in block, disc, ring and beam",
    "theory-optics": "from stress to light: polariscope, bands, camera",
    "theory-fringes": "from light to order: with a model, without one, steps, colours",
    "theory-fitting": "least squares, causes, evidence, tractions",
    "theory-calibration": "beam, disc, scale, and their budgets",
    "scene-keys": "every key of a scene and of a calibration set",
    "files": "every file and column that a command leaves",
    "messages": "every warning and refusal: meaning, cause, remedy",
    "developers": "the rooms of the code, the way of a frame, recipes",
}
"""What each page is about, in the order in which they are best read."""


def guide_page(topic: str | None = None) -> str:
    """A page of the guide, Markdown; without a topic, the list of all; InputError for none such."""
    if topic is None:
        rows = "\n".join(f"| `{name}` | {about} |" for name, about in TOPICS.items())
        return (
            "# The guide\n\n`isochrome guide TOPIC` shows a page.\n\n"
            f"| topic | what it is about |\n|---|---|\n{rows}\n"
        )
    if topic not in TOPICS:
        near = difflib.get_close_matches(topic, TOPICS, n=1, cutoff=0.5)
        hint = f"did you mean '{near[0]}'?" if near else f"pages: {', '.join(TOPICS)}"
        raise InputError("guide_has_no_such", topic=topic, hint=hint)
    return (resources.files("isochrome.guide") / f"{topic}.md").read_text("utf-8")


def atlas_file(name: str) -> str:
    """The picture of a page of the atlas beside it, by the name of what was there."""
    return f"atlas/{re.sub('[^a-z]+', '-', name)}.png"


def atlas_picture(name: str) -> bytes | None:
    """The same as PNG; None where the atlas has no such page."""
    place = resources.files("isochrome.guide") / atlas_file(name)
    return place.read_bytes() if place.is_file() else None
