"""What a kind of processing is, and which kind a scene's frames are of.

A kind is a class in a module of its own, which is imported when a set is of it: what it needs to
read frames, such as a follower or a table of colours, waits until then.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar

from isochrome.errors import InputError
from isochrome.frames import Frame, FrameReader, load_no_load
from isochrome.processing.result import Capture, ProcessedFrame, row_of_set
from isochrome.progress import RunProgress
from isochrome.runs import Layer
from isochrome.scene import Scene

if TYPE_CHECKING:
    from isochrome.processing.frame_task import FrameSource

NORMALISED = Layer("normalised", "1", "signal, 0 in darkness and 1 in the brightest field")
ORDER = Layer("fringe_order", "1", "fringe order N")
CONFIDENCE = Layer("confidence", "1", "probability that the order is right to 1/20 fringe")
ISOCLINIC = Layer("isoclinic", "degree", "direction of sigma_1, counter-clockwise from x")

ACCEPTS: Mapping[str, Callable[[Scene], bool]] = {
    "followed_film.UnloadedFilm": lambda scene: scene.frames.starts_unloaded,
    "colour_light.ColourLight": lambda scene: scene.polariscope.several_wavelengths,
    "phase_stepped.PhaseStepped": lambda scene: bool(scene.polariscope.step),
    "image_only.ImageOnly": lambda scene: not scene.has_model,
    "known_loads.KnownLoads": lambda scene: bool(scene.frames.known_loads_n),
    "with_model.WithModel": lambda scene: scene.has_model,
}
"""The kinds, as module and class: a scene is of the first that accepts it."""


KEY_EVERY = 200
"""Frames from one key frame to the next where none is named. One costs as much as some 200 that a
contact's model is followed through, or some fifty without a model; and what is done between two is
lost when a run is killed."""


MOST_IN_MEMORY = 8_000_000_000
"""Bytes of maps beyond which a result belongs on the disk."""


def kind_of(scene: Scene) -> FrameKind:
    """The kind of a scene's frames, each state read by itself."""
    module, name = next(k for k, accepts in ACCEPTS.items() if accepts(scene)).split(".")
    kind: FrameKind = getattr(import_module(f"{__package__}.{module}"), name)()
    return kind


def accepts_keys(scene: Scene) -> bool:
    """Whether a scene's film can be followed from key frames that are read without a model."""
    frames = scene.frames
    return (
        not scene.has_model
        and not frames.starts_unloaded
        and frames.orders_known
        and frames.gamma != "unknown"
        and not scene.polariscope.tells_orders
    )


def refuse_colour_table(scene: Scene) -> None:
    """Refuse a table of colours in light of one wavelength. Raises InputError."""
    if scene.frames.colour_table is not None:
        raise InputError("frames_colour_table_light_several", name=scene.name)


def refuse_no_load_steps(scene: Scene) -> None:
    """Refuse no-load steps where a state is one frame. Raises InputError."""
    if scene.frames.no_load_steps is not None:
        raise InputError("frames_no_load_steps_needs_polariscope", name=scene.name)


@dataclass(frozen=True, kw_only=True)
class FrameKind:
    """How the frames of a set are read; `note`, what the first frame says of that.

    `as_stated`, whether all that a scene states is held. Its methods say what is the same for most
    kinds; `read` and `values` are of each.
    """

    note: str = ""
    as_stated: bool = False

    channels: ClassVar[tuple[str, ...]] = ()
    """Those that are read of each frame, where there are several."""

    draws_lines: ClassVar[bool] = True
    """Whether fringe lines are kept of frames without a fit, though nobody asks for them."""

    @property
    def key_step(self) -> int | None:
        """Frames from one key frame to the next, where a model is followed through others."""
        return None

    @property
    def maps_of_all(self) -> bool:
        """Whether the frames between key frames have maps too."""
        return False

    def check(self, scene: Scene) -> None:
        """Refuse a scene whose frames cannot be read, before they are opened. Raises InputError."""
        refuse_colour_table(scene)
        if not scene.has_model and scene.polariscope.field == "plane":
            raise InputError("polariscope_field_plane_without", name=scene.name)
        refuse_no_load_steps(scene)

    def prepare(self, scene: Scene, reader: FrameReader) -> Capture:
        """What all frames share: the files besides them. Raises InputError."""
        return Capture(reader.bit_depth, *load_no_load(scene, full_shape=reader.full_shape))

    def shared(
        self, source: FrameSource, count: int, progress: RunProgress | None, *, on_disk: bool
    ) -> FrameKind:
        """The kind with what the `count` frames of an opened set have in common.

        `on_disk`, whether maps are written. Raises InputError, PhysicsError.
        """
        return self

    def held(self, scene: Scene) -> Scene:
        """The scene with what all frames have in common."""
        return scene

    def states(self, source: FrameSource, start: int, stop: int) -> Iterator[ProcessedFrame]:
        """What is read in the states [start, stop). Raises InputError, PhysicsError."""
        for index, frames in source.captured(start, stop):
            yield source.processed(index, frames)

    def read(self, frames: Sequence[Frame], scene: Scene, capture: Capture) -> ProcessedFrame:
        """One state: its `frames`, its own `scene`. Raises InputError, PhysicsError."""
        raise NotImplementedError

    def values(self, scene: Scene) -> tuple[str, ...]:
        """Columns of what is read in a frame, which depend on the scene alone."""
        raise NotImplementedError

    def columns(self, scene: Scene) -> tuple[str, ...]:
        """The columns of frames.csv, which depend on the scene alone and not on what is read."""
        place = ("distance_m", "chi", "noise", "pixel_mm")
        return ("frame", "name", "label", *place, *self.values(scene), "warnings")

    def row(self, item: ProcessedFrame, scene: Scene) -> dict[str, Any]:
        """A frame's row of frames.csv."""
        return row_of_set(item.row(), self.columns(scene), scene)

    def layers(self, scene: Scene) -> tuple[Layer, ...]:
        """The maps that a set's run leaves."""
        return (NORMALISED, ORDER, CONFIDENCE) if scene.orders_are_read else (NORMALISED,)

    @property
    def identity(self) -> dict[str, Any]:
        """What a result depends on besides the set, as provenance.json keeps it."""
        return {}
