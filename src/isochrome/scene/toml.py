"""Scenes in and out of TOML, with errors that name the file, the key, the value and the fix."""

from __future__ import annotations

import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

from isochrome.errors import InputError
from isochrome.scene.mistakes import check_reach, nearest, validate
from isochrome.scene.scene import Scene

__all__ = ["dump_scene", "load_scene", "parse_scene", "parse_toml", "read_text", "validate"]

MAX_BYTES = 1_000_000
"""A settings file of over a megabyte is not one."""


def load_scene(scene: str | Path | Scene) -> Scene:
    """Read a scene: a TOML file's path, or the name of one inside the package.

    Parameters: `scene`, a path, a name such as 'line-contact-wear', or a Scene (returned as it is).
    Returns the validated Scene. Raises InputError that names the file, key, value and fix.
    """
    if isinstance(scene, Scene):
        return scene
    path = Path(scene)
    if str(scene) in scene_names():
        text = (resources.files("isochrome.scene") / "library" / f"{scene}.toml").read_text("utf-8")
        return parse_scene(text, name=str(scene))
    if path.is_dir():
        raise InputError(f"{scene}: is a folder, not a scene file; name the .toml file in it")
    if not path.is_file():
        near = nearest(str(scene), scene_names())
        hint = f"did you mean '{near}'?" if near else "scenes by name: " + ", ".join(scene_names())
        raise InputError(f"{scene}: no such scene file; {hint}")
    found = parse_scene(read_text(path), name=path.stem, folder=path.parent, label=str(path))
    check_reach(found.model_dump(exclude_unset=True), str(path))
    return found


def parse_scene(
    text: str, *, name: str = "scene", folder: Path | None = None, label: str | None = None
) -> Scene:
    """Make a scene from TOML text; `label` names it in errors, `folder` anchors its paths."""
    data = parse_toml(text, label or name)
    scene = validate(Scene, data, label or name, reserved=("folder", "name"))
    return scene.model_copy(update={"name": name, "folder": folder})


def dump_scene(scene: Scene) -> str:
    """Write a scene as TOML text; reading it back gives an equal scene."""
    import tomli_w

    return tomli_w.dumps(scene.model_dump(mode="json", exclude_none=True, exclude_unset=True))


def scene_names() -> list[str]:
    """Names of the scenes that ship inside the package."""
    folder = resources.files("isochrome.scene") / "library"
    return sorted(
        p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml")
    )


def read_text(path: Path) -> str:
    """Text of a settings file, without the mark that some editors begin UTF-8 with.

    Raises InputError where it is missing, too large or not UTF-8.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: larger than {MAX_BYTES} bytes; is it a settings file?")
        return path.read_text("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text; save it as UTF-8") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its name") from error


def parse_toml(text: str, label: str) -> dict[str, Any]:
    """TOML text as a dictionary; InputError with the line where it is not TOML."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also of numbers of thousands of digits
        raise InputError(f"{label}: not valid TOML: {error}; correct that line") from error
