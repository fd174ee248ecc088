"""What a run is a result of, and whether two runs are of the same."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import isochrome
from isochrome.output import InputContent, provenance

LIBRARIES = ("numpy", "scipy", "scikit-image", "opencv-python-headless", "tifffile", "pillow", "av")
"""Those whose version may change a result's bits."""

_LABELS = {
    "options": "the options",
    "isochrome": "Isochrome's version",
    "code_sha256": "Isochrome's own code",
    "libraries": "the version of Python or a library",
    "seed": "the seed",
}
"""What a run is a result of besides its scene and its input, in words."""


@cache
def environment() -> dict[str, Any]:
    """The code that computes: Isochrome's version and a hash of its files, Python, libraries."""
    home = Path(isochrome.__file__).parent
    found = hashlib.sha256()
    for file in sorted(home.rglob("*.py"), key=lambda f: f.relative_to(home).as_posix()):
        found.update(file.relative_to(home).as_posix().encode() + b"\0" + file.read_bytes())
    return {
        "isochrome": isochrome.__version__,
        "code_sha256": found.hexdigest(),
        "libraries": {"python": platform.python_version()} | _versions(),
    }


def run_identity(
    scene_toml: str,
    files: Iterable[InputContent],
    options: Mapping[str, Any],
    seed: int | None = None,
) -> dict[str, Any]:
    """Say what a run is a result of, as provenance.json keeps it: scene, files, code and options.

    Parameters
    ----------
    scene_toml : str
        Text of the resolved scene.
    files : iterable of InputContent
        Files that are read, and arrays in place of files.
    options : mapping of str to Any
        Options of the command that change its result.
    seed : int, optional
        Seed of the random numbers.

    Returns
    -------
    dict of str to Any
        The record, for a Job.

    Raises
    ------
    InputError
        Where a file cannot be read.
    """
    return provenance(scene_toml, files, seed) | environment() | {"options": dict(options)}


def _versions() -> dict[str, str]:
    found = {}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # an optional one
            continue
    return found


def identity_digest(identity: Mapping[str, Any]) -> str:
    """A hash of what a run is a result of, the same where `difference` finds none."""
    files = [[Path(name).name, found] for name, found in (identity["inputs_sha256"] or {}).items()]
    parts = [identity.get(key) for key in ("scene", *_LABELS)]
    return hashlib.sha256(json.dumps([files, parts]).encode()).hexdigest()


def difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> str | None:
    """What differs between two runs' identities, in words; None where they are the same.

    The same files in another folder are the same input. Parameters: `old`, `new`, as in a Job.
    """
    if old.get("scene") != new.get("scene"):
        return f"the scene ({_first_line(old.get('scene'), new.get('scene'))})"
    before, now = (list((run.get("inputs_sha256") or {}).items()) for run in (old, new))
    names = [[Path(name).name for name, _ in files] for files in (before, now)]
    if names[0] != names[1]:
        odd = sorted(set(names[0]) ^ set(names[1]))
        return f"the input files ({', '.join(odd[:3]) or 'their order'})"
    changed = [name for (_, a), (name, b) in zip(before, now, strict=True) if a != b]
    if changed:
        return f"the content of {changed[0]}"
    for key, label in _LABELS.items():
        if old.get(key) != new.get(key):
            return f"{label} ({_pair(old.get(key), new.get(key))})"
    return None


def _first_line(old: Any, new: Any) -> str:
    """The first line that differs of two scenes."""
    before, now = str(old).splitlines(), str(new).splitlines()
    for a, b in zip(before, now, strict=False):
        if a != b:
            return f"'{a}' is now '{b}'"
    longer = before if len(before) > len(now) else now
    rest = longer[min(len(before), len(now)) :]
    what = "no longer there" if longer is before else "new"
    return f"'{' '.join(rest[:2])}' is {what}"


def _pair(old: Any, new: Any) -> str:
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        keys = [key for key in {**old, **new} if old.get(key) != new.get(key)]
        return f"{keys[0]}: {old.get(keys[0])}, now {new.get(keys[0])}"
    if isinstance(old, str) and len(old) == 64:
        return "its files"
    return f"{old}, now {new}"
