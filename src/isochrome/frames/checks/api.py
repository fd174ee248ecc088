"""What is wrong with a set of frames, in plain words, before a long run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isochrome.errors import InputError
from isochrome.frames.checks.figure import light_figure
from isochrome.frames.checks.findings import (
    Finding,
    Survey,
    misfits,
    of_depth,
    of_light,
    of_no_load,
    of_unloaded,
    refusals,
    survey,
)
from isochrome.frames.opening import check_scale, open_scene_frames, with_file_scale
from isochrome.frames.readers.signature import signature_of
from isochrome.frames.reading import FrameReader
from isochrome.output import Result, counted
from isochrome.scene import FramesLike, Scene, check_moduli, check_pixel

ENDINGS = {
    ".tif": "TIFF", ".tiff": "TIFF", ".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG",
    ".bmp": "BMP", ".webp": "WebP",
}  # fmt: skip
"""What a picture's name says that it is."""

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Check(Result):
    """What was found in a set of frames.

    Parameters
    ----------
    findings : tuple of Finding
        What to know, errors first.
    count : int
        Number of frames that were read.
    shape : tuple of int or None
        Size of a frame, (rows, cols); None where they could not be opened.
    light : Survey, optional
        Light of the frames; None where they could not be opened.
    draw : callable, optional
        Not used: the figure is made of `light`.
    """

    findings: tuple[Finding, ...]
    count: int
    shape: tuple[int, int] | None
    light: Survey | None = None

    def with_more(self, findings: Iterable[Finding]) -> Check:
        """The same with more findings."""
        return replace(self, findings=_sorted((*self.findings, *findings)))

    @property
    def columns(self) -> dict[str, list[Any]]:
        """A row a finding: how grave, of which frame, and a sentence."""
        names = ("level", "frame", "text")
        return {name: [getattr(finding, name) for finding in self.findings] for name in names}

    @property
    def warnings(self) -> tuple[str, ...]:
        """The errors and warnings among the findings."""
        return tuple(finding.text for finding in self.findings if finding.level != "note")

    @property
    def title(self) -> str:
        """How many frames were read, and whether anything is wrong."""
        verdict = "no error found" if self.ok else "errors found"
        return f"Check of {counted(self.count, 'frame')}: {verdict}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """The findings, errors first."""
        return ((finding.level, finding.text) for finding in self.findings)

    def to_json(self) -> dict[str, Any]:
        """The verdict, the number of frames and the findings."""
        columns = self.columns
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        return {"ok": self.ok, "frames": self.count, "findings": rows}

    def figure(self) -> Figure:
        """The light of each frame, see `light_figure`. Raises InputError where none was read."""
        if self.light is None or not self.count:
            raise InputError("no frame was read: there is nothing to draw")
        return light_figure(self.light)

    @property
    def ok(self) -> bool:
        """Whether no finding is an error."""
        return all(f.level != "error" for f in self.findings)


def look_through(path: FramesLike, scene: Scene) -> Check:
    """Look through captured frames once, without a model: what is wrong with them for this scene.

    Counts, sizes, times, bit depth, exposure, saturation, noise and no-load frames are looked at,
    in one pass with one frame in memory, and whether a frame shows the unloaded specimen. Errors
    come first; frames that cannot be read are a finding, not an exception.
    """
    found = list(_of_scene(scene))
    try:
        reader = open_scene_frames(path, scene, any_scale=True)
    except InputError as error:
        return Check(_sorted([Finding("error", str(error)), *found]), 0, None)
    with reader:
        seen = survey(reader, scene)
    if seen.failure is not None:
        found.append(Finding("error", seen.failure, seen.count))
    found += _of_file(reader, scene)
    count = None if seen.failure else seen.count
    found += [Finding("error", text) for _, text in misfits(reader, scene, count)]
    if seen.failure is None:
        found += _of_count(reader, seen, scene)
    found += of_depth(reader, seen)
    found += of_light(reader, seen)
    found += of_no_load(reader, seen, scene)
    found += of_unloaded(reader, seen, scene)
    return Check(_sorted(found), seen.count, reader.shape, seen)


def _sorted(found: Iterable[Finding]) -> tuple[Finding, ...]:
    order = ("error", "warning", "note")
    return tuple(sorted(found, key=lambda f: order.index(f.level)))


def _of_scene(scene: Scene) -> Iterator[Finding]:
    rest = "process still gives normalised frames, fringe lines, and orders from known points"
    if scene.model is None and scene.specimen.shape is not None:
        text = f"{scene.no_model_reason}: no simulation and no fit; {rest}"
        yield Finding("warning", text)
    elif scene.model is None:
        yield Finding("note", f"{scene.no_model_reason}, so it has no model; {rest}")


def _of_file(reader: FrameReader, scene: Scene) -> Iterator[Finding]:
    yield from refusals(
        lambda: check_scale(reader, scene.camera),
        lambda: check_pixel(with_file_scale(scene, reader), reader.shape),
        lambda: check_moduli(scene),
    )
    if reader.channel is not None:
        text = f"colour frames: the {reader.channel} channel is used; frames.channel changes it"
        yield Finding("note", text)
    names = reader.names or (str(reader.path),)
    if reader.mask is not None:
        text = f"the mask takes {100 * reader.mask.mean():.1f} % of the pixels for the specimen"
        yield Finding("note", text)
    lossy = reader.lossy
    if isinstance(reader.files[0], Path):  # arrays have no first bytes
        kind = signature_of(reader.files[0]).name
        lossy = lossy or kind in ("JPEG", "WebP")
        claimed = ENDINGS.get(Path(names[0]).suffix.lower(), kind)
        if kind != claimed:
            text = (
                f"{names[0]}: is a {kind} by its first bytes and a {claimed} by its name; it is "
                f"read as the {kind} that it is: rename it, for other programs may not open it"
            )
            yield Finding("note", text)
    if lossy:
        text = (
            f"{names[0]}: is compressed with loss, which hides camera noise; a fit with a model "
            "tells it all the same, a reading without one takes it for less: TIFF, PNG and FFV1 "
            "keep it"
        )
        yield Finding("note", text)
    ordinary = lossy or reader.kind == "video" or reader.channel is not None
    if scene.frames.gamma == 1 and ordinary:
        text = (
            "frames.gamma = 1 says that grey levels are proportional to light; ordinary cameras "
            "store light^(1 / 2.2) in such files: set frames.gamma = 2.2 if yours does"
        )
        yield Finding("note", text)


def _of_count(reader: FrameReader, seen: Survey, scene: Scene) -> Iterator[Finding]:
    timed = scene.frames.sliding_speed_mm_per_s is not None
    if timed and seen.untimed:
        text = f"{seen.untimed} of {seen.count} frames carry no time, and sliding_speed_mm_per_s "
        yield Finding("error", text + "needs it; remove that key, or give a timed video")
    claimed = reader.claimed_count
    if claimed is not None and claimed != seen.count:
        text = (
            f"the video's head claims {counted(claimed, 'frame')} and {seen.count} can be decoded"
        )
        yield Finding("warning", text + "; is it whole? (some writers claim wrongly)")
