"""Everything in `sample_images/`, from one seed."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from isochrome.errors import InputError
from isochrome.output import staged, write_text

SEED = 2026
"""Seed of the shipped sample images."""


def render_samples(out: str | Path, *, seed: int = SEED) -> Path:
    """Render all sample images with their scenes, sets, truths and README.

    Parameters: `out`, the folder, made if missing; `seed` of the noise and of the faulty pixels.
    Returns the folder. The same seed gives the same bytes. Raises InputError where `seed` is
    negative or `out` cannot be written to; then nothing is left in it.
    """
    from isochrome.samples.bending import render_bending
    from isochrome.samples.contact import SCENE, render_contact
    from isochrome.samples.disc import render_disc
    from isochrome.samples.texts import CONTACT_FRAMES, README

    if seed < 0:
        raise InputError(f"seed = {seed}, but must be 0 or above")
    library = resources.files("isochrome.scene") / "library"
    scene = (library / f"{SCENE}.toml").read_text("utf-8")
    with staged(out) as folder:
        for name, draw in (
            (SCENE, render_contact),
            ("bending", render_bending),
            ("disc", render_disc),
        ):
            (folder / name).mkdir()
            draw(folder / name, seed)
        write_text(folder / SCENE / "scene.toml", scene.rstrip() + "\n" + CONTACT_FRAMES)
        write_text(folder / "README.md", README.replace("@SEED@", str(seed)))
    return Path(out)
