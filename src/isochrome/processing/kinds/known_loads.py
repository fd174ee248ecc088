"""A disc that holds stress without load: each frame's load, read against those of known load."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from isochrome.calibration import Shot, lay_series, read_load
from isochrome.errors import PhysicsError
from isochrome.estimation import prepare_frame
from isochrome.fitting import LOAD
from isochrome.frames import Frame, FrameReader
from isochrome.messages import message
from isochrome.output import with_uncertainty
from isochrome.processing.kinds.image_only import ImageOnly, read_alone
from isochrome.processing.result import EXPLAINED, SPREAD, Capture, ProcessedFrame
from isochrome.scene import Scene

WITHIN = 0.97
"""Radii within which a disc's fringes are looked at: the rim itself is an edge."""

CONTRADICTED = 3.0
"""Standard uncertainties from which a frame's own stated load and the one that is read disagree."""

FAR = 0.5
"""Ranges of the known loads beyond them from which a load is told to be far outside."""


@dataclass(frozen=True, kw_only=True)
class KnownLoads(ImageOnly):
    """Frames of a disc with residual stress, among which there are some of known load."""

    loads = (LOAD, f"{LOAD} {SPREAD}", EXPLAINED)

    def prepare(self, scene: Scene, reader: FrameReader) -> Capture:
        """The frames of known loads too, laid over each other. InputError on a blank frame,
        PhysicsError where one shows no disc."""
        capture, loads = super().prepare(scene, reader), dict(enumerate(scene.frames.known_loads_n))
        shown = [frame for frame in reader if loads.get(frame.index)]
        bare = Capture(reader.bit_depth)
        shots = [_shot(frame, scene, bare, loads[frame.index]) for frame in shown]
        return replace(capture, series=lay_series(shots, [frame.index for frame in shown]))

    def read(self, frames: Sequence[Frame], scene: Scene, capture: Capture) -> ProcessedFrame:
        """Read a load against the known ones, and the order as the image alone tells it. The load
        is NaN where the known loads do not tell it, and a warning says why."""
        (frame,) = frames
        assert capture.series is not None and scene.rim_diameter_mm is not None
        columns: dict[str, Any] = {LOAD: float("nan"), f"{LOAD} {SPREAD}": float("nan")}
        notes, more, inside = list[str](), dict[str, Any](), None
        try:
            read = read_load(capture.series, _shot(frame, scene, capture, 0.0), frame.index)
        except PhysicsError as error:
            notes.append(str(error))
        else:
            columns = {LOAD: read.load_n, f"{LOAD} {SPREAD}": read.standard_uncertainty}
            columns |= {EXPLAINED: read.explained}
            loads, off = scene.frames.known_loads_n, read.standard_uncertainty
            stated = loads[frame.index] if frame.index < len(loads) else 0.0
            away = abs(read.load_n - stated) / off
            if stated and away > CONTRADICTED:
                notes.append(
                    message(
                        "load_stated_other_known", stated=stated, away=away,
                        with_uncertainty=with_uncertainty(read.load_n, off),
                    )
                )  # fmt: skip
            if read.beyond > FAR:
                notes.append(message("load_lies_far_outside"))
            scale = scene.camera.pixel_mm if scene.camera else None
            more["pixel_mm"] = scale or scene.rim_diameter_mm / (2.0 * read.rim.radius)
            more["chi"] = read.chi
            row, col = np.ogrid[: frame.image.shape[0], : frame.image.shape[1]]
            inside = np.hypot(row - read.rim.row, col - read.rim.col) < WITHIN * read.rim.radius
        # what the image alone tells within the rim
        result = read_alone(frame, scene, capture, inside=inside)[0]
        # where nobody asked for orders it is said once, of the set
        image = result.warnings if scene.frames.orders_known else ()
        columns = {"fringe_lines": len(result.lines)} | result.columns | columns
        return replace(result, columns=columns, warnings=(*notes, *image), **more)


def _shot(frame: Frame, scene: Scene, capture: Capture, load_n: float) -> Shot:
    data = prepare_frame(frame, scene, bit_depth=capture.bit_depth, gamma_found=True)
    bright = scene.polariscope.field == "bright"
    fields = {name: getattr(data, name) for name in ("light", "sigma", "valid", "raw", "raw_sigma")}
    return Shot(**fields, name=data.name, gamma=data.gamma, load_n=load_n, bright=bright)
