"""Which files a set's results depend on, and their names where other machines read them too."""

from __future__ import annotations

from pathlib import Path

from isochrome.frames.reader import FrameReader, FramesPath
from isochrome.scene import Scene


def input_files(reader: FrameReader, scene: Scene) -> list[Path]:
    """The captured files, and those that the scene names, in order."""
    return [*reader.files, *scene.files(of_frames=True)]


def absolute(frames: FramesPath, scene: Scene) -> tuple[FramesPath, Scene]:
    """Frames and scene found from any folder, as another machine stands in another."""
    found: FramesPath
    if isinstance(frames, str | Path):
        found = str(Path(frames).absolute())
    else:
        found = tuple(str(Path(path).absolute()) for path in frames)
    folder = (scene.folder or Path()).absolute()
    return found, scene.model_copy(update={"folder": folder})
