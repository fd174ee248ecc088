"""Which files a set's results depend on, and their names where other machines read them too."""

from __future__ import annotations

from pathlib import Path

from isochrome.frames.reader import FrameReader, FramesPath
from isochrome.scene import Scene


def input_files(reader: FrameReader, scene: Scene) -> list[Path]:
    """The captured files, and those that the scene names, in order."""
    own = scene.frames
    named = [own.no_load_dark, own.no_load_bright, own.no_load_steps, own.mask, own.colour_table]
    named += [scene.camera.response if scene.camera else None]
    named += [scene.indenter.profile if scene.indenter else None]
    return [*reader.files, *(scene.path(name) for name in named if name is not None)]


def absolute(frames: FramesPath, scene: Scene) -> tuple[FramesPath, Scene]:
    """Frames and scene found from any folder, as another machine stands in another."""
    found: FramesPath
    if isinstance(frames, str | Path):
        found = str(Path(frames).absolute())
    else:
        found = tuple(str(Path(path).absolute()) for path in frames)
    folder = (scene.folder or Path()).absolute()
    return found, scene.model_copy(update={"folder": folder})
