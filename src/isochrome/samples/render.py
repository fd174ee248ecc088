"""Everything in `sample_images/`, from one seed."""

from importlib import resources
from pathlib import Path

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.output import staged, write_text

SEED = 2026
"""Seed of the shipped sample images."""


def render_samples(out: str | Path, *, seed: int = SEED) -> Path:
    """Render all sample images with their scenes, sets, truths and README.

    The same seed gives the same bytes.

    Parameters
    ----------
    out : str or Path
        The folder, made if missing.
    seed : int, default 2026
        Seed of the noise and of the faulty pixels.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    InputError
        Where `seed` is negative or `out` cannot be written to; then nothing is left in it.
    """
    from isochrome.samples.calibration_images import render_bending, render_disc
    from isochrome.samples.contact_images import SCENE, render_contact, render_film
    from isochrome.samples.sensor import sample_text
    from isochrome.samples.wear_traces import render_wear

    if seed < 0:
        raise InputError(message("seed_but_must_above", seed=seed))
    library = resources.files("isochrome.scene") / "library"
    scene = (library / f"{SCENE}.toml").read_text("utf-8")
    with staged(out) as folder:
        for name, draw in (
            (SCENE, render_contact),
            ("bending", render_bending),
            ("disc", render_disc),
            ("wear", render_wear),
            ("sliding-film", render_film),
        ):
            (folder / name).mkdir()
            draw(folder / name, seed)
        frames = sample_text("contact-frames.toml")
        write_text(folder / SCENE / "scene.toml", scene.rstrip() + "\n" + frames)
        write_text(folder / "README.md", sample_text("README.md").replace("@SEED@", str(seed)))
    return Path(out)


_NAME = "sample_images"


def samples_path() -> Path:
    """Find the folder of the shipped sample images.

    In an installed wheel they lie inside the package; of an editable install they are the
    repository's.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    InputError
        Where neither is there.
    """
    here = Path(__file__).resolve()
    for folder in (here.parents[1] / _NAME, here.parents[3] / _NAME):
        if (folder / "README.md").is_file():
            return folder
    raise InputError(message("sample_images_not_there", name=here.parents[1] / _NAME))
