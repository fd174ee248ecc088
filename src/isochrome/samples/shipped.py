"""The shipped samples as arrays, with the files that describe them, and what they were made of."""

import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.frames import open_frames

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
    raise InputError("sample_images_not_there", name=here.parents[1] / _NAME)


Grey = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class ContactSample:
    """Frames of a worn, sliding contact, their no-load frames and their scene. All are rendered.

    Parameters
    ----------
    frames : ndarray of uint8, shape (n, rows, cols)
        The captured frames.
    file : Path
        The stack or film that holds them.
    no_load_dark : ndarray of uint8, shape (rows, cols)
        The unloaded specimen in the dark field.
    no_load_bright : ndarray of uint8, shape (rows, cols)
        The unloaded specimen in the bright field.
    scene : Path
        The scene's file.
    truth : dict
        What the frames were rendered of, by the scene's keys.
    """

    frames: Grey
    file: Path
    no_load_dark: Grey
    no_load_bright: Grey
    scene: Path
    truth: dict[str, Any]

    @property
    def tables(self) -> dict[str, Any]:
        """The scene's tables with the no-load frames as arrays, for `load_scene`."""
        tables = tomllib.loads(self.scene.read_text("utf-8"))
        arrays = {"no_load_dark": self.no_load_dark, "no_load_bright": self.no_load_bright}
        return tables | {"frames": tables["frames"] | arrays}


@dataclass(frozen=True, eq=False)
class CalibrationSample:
    """Images of a specimen at several loads, and their calibration set. All are rendered.

    Parameters
    ----------
    images : ndarray of uint8, shape (n, rows, cols)
        The images.
    loads_n : tuple of float
        Their loads, N.
    set : Path
        The calibration set's file.
    truth : dict
        What the images were rendered of.
    """

    images: Grey
    loads_n: tuple[float, ...]
    set: Path
    truth: dict[str, Any]

    @property
    def tables(self) -> dict[str, Any]:
        """The set's tables with the images as arrays, for `calibrate_bending` and its like."""
        tables = tomllib.loads(self.set.read_text("utf-8"))
        pairs = zip(tables["image"], self.images, strict=True)
        return tables | {"image": [item | {"file": image} for item, image in pairs]}


def line_contact_wear() -> ContactSample:
    """Open the sample of the main job: six frames of a worn contact.

    Returns
    -------
    ContactSample
        Frames, no-load frames, scene and truth.

    Examples
    --------
    >>> import isochrome
    >>> sample = isochrome.samples.line_contact_wear()
    >>> sample.frames.shape, sample.frames.dtype
    ((6, 494, 659), dtype('uint8'))
    >>> isochrome.load_scene(sample.tables).model
    'contact'
    """
    return _contact("line-contact-wear", "captured.tif")


def sliding_film() -> ContactSample:
    """Open the sample of a film: 200 frames of a contact that wears while its load swings.

    Returns
    -------
    ContactSample
        Frames, their file, no-load frames, scene and truth.

    Examples
    --------
    >>> import isochrome
    >>> sample = isochrome.samples.sliding_film()
    >>> sample.frames.shape, sample.file.name
    ((200, 104, 136), 'film.avi')
    """
    return _contact("sliding-film", "film.avi")


def bending() -> CalibrationSample:
    """Open the sample of a calibration in four-point bending: a beam at four loads.

    Returns
    -------
    CalibrationSample
        Images, loads, set and truth.

    Examples
    --------
    >>> import isochrome
    >>> sample = isochrome.samples.bending()
    >>> sample.images.shape, sample.loads_n
    ((4, 440, 480), (60.0, 100.0, 150.0, 200.0))
    """
    return _calibration("bending")


def disc() -> CalibrationSample:
    """Open the sample of a calibration with a disc: three diametral loads.

    Returns
    -------
    CalibrationSample
        Images, loads, set and truth.

    Examples
    --------
    >>> import isochrome
    >>> sample = isochrome.samples.disc()
    >>> sample.images.shape, sample.loads_n
    ((3, 420, 420), (350.0, 560.0, 800.0))
    """
    return _calibration("disc")


def _contact(name: str, file: str) -> ContactSample:
    folder = samples_path() / name
    dark, bright = (_stack(folder / f"no-load-{name}.tif")[0] for name in ("dark", "bright"))
    return ContactSample(
        frames=_stack(folder / file), file=folder / file, no_load_dark=dark, no_load_bright=bright,
        scene=folder / "scene.toml", truth=json.loads((folder / "truth.json").read_text("utf-8")),
    )  # fmt: skip


def _calibration(name: str) -> CalibrationSample:
    folder = samples_path() / name
    items = tomllib.loads((folder / "set.toml").read_text("utf-8"))["image"]
    return CalibrationSample(
        images=np.concatenate([_stack(folder / item["file"]) for item in items]),
        loads_n=tuple(float(item["load_n"]) for item in items), set=folder / "set.toml",
        truth=json.loads((folder / "truth.json").read_text("utf-8")),
    )  # fmt: skip


def _stack(path: Path) -> Grey:
    with open_frames(path) as frames:
        return np.stack([frame.image for frame in frames])
