"""What a fit found, and how it is written: JSON, table, scene."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from isochrome.fit.frame_fit import FrameFit
from isochrome.fit.joint import JointFit
from isochrome.fit.one_state import frame_scene
from isochrome.fit.sequence import over_distance
from isochrome.fit.told import WearLaws
from isochrome.fit.tractions import Tractions
from isochrome.scene import Scene

Found = dict[str, dict[str, float]]

POOR_CHI = 1.3
"""Residual over noise beyond which the model does not describe a frame within its noise."""

_NAMED = 12
"""Frames whose numbers a sentence names."""

_NEARLY = 1.05
"""Other minima are told up to this chi over the fit's own."""


@dataclass(frozen=True)
class Fit:
    """Fitted unknowns.

    `shared`, key to {value, standard_uncertainty, cramer_rao_bound} of what all frames share;
    `frames`, the same for each frame's own; `distance_m` and `frame_chi`, of each frame; `chi`,
    residual over noise over all frames; `scene`, with the fitted values; `other_minima`, of each
    frame on its own: other values that fit nearly as well; `wear_laws`, compared, where several
    frames tell what was worn between them; `warnings` in plain words; `tractions` of each frame,
    where they were asked for; `already`, whether an earlier run had left it all.
    """

    shared: Found
    frames: list[Found]
    distance_m: list[float | None]
    frame_chi: list[float]
    chi: float
    scene: Scene
    other_minima: list[list[dict[str, float]]]
    wear_laws: WearLaws | None
    warnings: tuple[str, ...]
    tractions: tuple[Tractions, ...] = ()
    already: bool = False

    def to_json(self) -> dict[str, Any]:
        """The result as `--json` prints it; a single frame's own unknowns stand at the top too."""
        top: dict[str, Any] = dict(self.shared)
        if len(self.frames) == 1:
            top |= self.frames[0]
        frames = [
            {"frame": i, "distance_m": distance, "chi": chi, "other_minima": others, **own}
            for i, (own, distance, chi, others) in enumerate(
                zip(self.frames, self.distance_m, self.frame_chi, self.other_minima, strict=True)
            )
        ]
        top |= {"chi": self.chi, "warnings": list(self.warnings), "frames": frames}
        if self.wear_laws is not None:
            top |= {
                "wear_law": self.wear_laws.sentence(),
                "wear_laws": self.wear_laws.to_json(),
                "wear_between_frames": list(self.wear_laws.between),
                "wear_chi": self.wear_laws.chi,
            }
        if self.tractions:
            found = [{"frame": i, **one.to_json()} for i, one in enumerate(self.tractions)]
            top["tractions"] = found
        return top

    def table(self) -> dict[str, list[Any]]:
        """The columns of fit.csv: one row for each unknown, 'all' or the frame it belongs to."""
        rows: list[tuple[str, float | None, str, dict[str, float]]] = [
            ("all", None, key, found) for key, found in self.shared.items()
        ]
        for i, own in enumerate(self.frames):
            rows += [(str(i), self.distance_m[i], key, found) for key, found in own.items()]
        return {
            "frame": [row[0] for row in rows],
            "distance_m": [row[1] for row in rows],
            "key": [row[2] for row in rows],
            "value": [row[3]["value"] for row in rows],
            "standard_uncertainty": [row[3]["standard_uncertainty"] for row in rows],
            "cramer_rao_bound": [row[3]["cramer_rao_bound"] for row in rows],
            "chi": [self.chi if row[0] == "all" else self.frame_chi[int(row[0])] for row in rows],
        }


def make_result(
    joint: JointFit,
    alone: list[FrameFit],
    laws: WearLaws | None = None,
    notes: tuple[str, ...] = (),
) -> Fit:
    """A fit as it is reported.

    Parameters: `joint`, over all frames; `alone`, the frames' own fits, for their other minima;
    `laws`, the wear laws compared, None where they cannot be; `notes`, what else is to be said.
    """
    shared: Found = {}
    own: list[Found] = [{} for _ in joint.scenes]
    for unknown, value, spread, bound in zip(
        joint.unknowns, joint.values, joint.standard_uncertainty, joint.cramer_rao_bound,
        strict=True,
    ):  # fmt: skip
        found = {
            "value": float(value),
            "standard_uncertainty": float(spread),
            "cramer_rao_bound": float(bound),
        }
        for place in [shared] if unknown.shared else [own[i] for i in unknown.frames]:
            place[unknown.key] = found
    # a run's course is in the scene already, as tables
    means = {
        key: float(np.mean([f[key]["value"] for f in own if key in f]))
        for key in dict.fromkeys(key for frame in own for key in frame)
        if not joint.sequence.in_course(key)
    }
    return Fit(
        shared,
        own,
        list(joint.sequence.distances_m),
        list(joint.frame_chi),
        joint.chi,
        joint.scene.with_values(means) if means else joint.scene,
        [_others(fit) for fit in alone],
        laws,
        (*notes, *_warnings(joint, alone), *_of_law(joint.scene, laws)),
    )


def _others(fit: FrameFit) -> list[dict[str, float]]:
    near = [m for m in fit.others if m.chi <= _NEARLY * fit.chi]
    return [dict(zip(fit.keys, m.values.tolist(), strict=True)) | {"chi": m.chi} for m in near]


def _warnings(joint: JointFit, alone: list[FrameFit]) -> list[str]:
    found = []
    poor = [i for i, chi in enumerate(joint.frame_chi) if chi > POOR_CHI]
    if poor:
        where = "" if len(joint.scenes) == 1 else f" ({named_frames(poor)})"
        worst = max(joint.frame_chi)
        found.append(
            f"chi = {worst:.2f}{where}: the model does not describe these frames within their "
            "noise; the uncertainties are widened by it, but a bias may remain"
        )
        if not any(unknown.key.startswith("camera.") for unknown in joint.unknowns):
            found.append(
                "the contact's place in the picture was held at the scene's; let it be found with "
                "--per-frame camera.left_mm --per-frame camera.top_mm"
            )
    lost = set(joint.lost)
    said = [(i, "the scene's fringes are not in it") for i in joint.lost]
    said += [
        (
            i,
            "no smooth illumination fits with this model, so that one amplitude stands for all "
            "the frame; give no-load frames",
        )
        for i, fit in enumerate(alone)
        if fit.plain and i not in lost
    ]
    said += [
        (i, f"{len(_others(fit))} other solution(s) fit nearly as well; give the load more closely")
        for i, fit in enumerate(alone)
        if _others(fit)
    ]
    found += said_of_frames(said)
    if not joint.converged:
        found.append("the fit did not converge fully")
    return found


def said_of_frames(said: Iterable[tuple[int, str]], *, single: bool = False) -> list[str]:
    """What is said of frames, each sentence once, with the frames that it is said of.

    Parameters: `said`, frames' numbers and sentences; `single`, whether there is but one frame,
    which needs no number.
    """
    frames: dict[str, list[int]] = {}
    for i, text in said:
        frames.setdefault(text, []).append(i)
    return [text if single else f"{named_frames(own)}: {text}" for text, own in frames.items()]


def named_frames(frames: list[int]) -> str:
    """Frames by their numbers, after a dozen how many more."""
    more = f" and {len(frames) - _NAMED} more" if len(frames) > _NAMED else ""
    return f"frame{'s' * (len(frames) > 1)} {', '.join(map(str, frames[:_NAMED]))}{more}"


def _of_law(scene: Scene, laws: WearLaws | None) -> list[str]:
    """What to say where the frames speak against the scene's own wear law."""
    if laws is None or scene.wear is None or not laws.speaks_against(scene.wear.law):
        return []
    return [
        f"wear.law = '{scene.wear.law}' is not what the frames show: {laws.sentence()}; change the "
        "law in the scene, and fit again"
    ]


def fitted_scene(scene: Scene, shared: Found, own: list[Found]) -> Scene:
    """The scene with values of frames that were fitted each on its own.

    Means of per-frame values; friction as a table over distance.
    Parameters: `scene`; `shared`, key to {value} of all frames; `own`, the same for each frame.
    """
    values: dict[str, Any] = {key: found["value"] for key, found in shared.items()}
    for key in dict.fromkeys(key for frame in own for key in frame):
        series = [
            (i, frame[key]["value"])
            for i, frame in enumerate(own)
            if key in frame and np.isfinite(frame[key]["value"])
        ]
        if not series:
            continue
        values[key] = float(np.mean([value for _, value in series]))
        if key == "friction.coefficient" and scene.wear and len(series) > 1:
            points = {
                (s.wear.distances_m[0] if (s := frame_scene(scene, i)).wear else 0.0): value
                for i, value in series
            }
            values[key] = over_distance(points) if len(points) > 1 else values[key]
    return scene.with_values(values)
