"""What a fit or a track found, and how it is written: JSON, table, scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.estimation import ALIKE_CHI, POOR_CHI, BudgetInput
from isochrome.figures import BAND, PaperPanels, panels_figure, plain_name, values_plots
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.frame_fit import FrameFit
from isochrome.fitting.frame.single_state import frame_distance
from isochrome.fitting.frame.unknowns import EARLIER, FRICTION, taken_as_exact
from isochrome.fitting.frame_set import CORRECT
from isochrome.fitting.joint.frame_sequence import over_distance
from isochrome.fitting.joint.joint_fit import JointFit
from isochrome.fitting.tracking.tracker import AGAIN, Tracked
from isochrome.fitting.tractions import Tractions
from isochrome.fitting.wear_laws import WearLaws
from isochrome.messages import (
    frame_messages,
    message,
    read_frame_messages,
    read_warnings,
    warnings_json,
)
from isochrome.output import (
    FittedResult,
    FrameValues,
    agree,
    columns_of,
    counted,
    messages_of_frames,
    named_frames,
    numbers,
    over_items,
    plain,
    refined_texts,
    rows_by_key,
    spoken,
    with_uncertainty,
)
from isochrome.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Found = dict[str, dict[str, float]]
"""Key to what is known of it, see PARTS."""

PARTS = ("value", "standard_uncertainty", "noise_uncertainty", "cramer_rao_bound")
"""What is known of a value: its uncertainty, the frames' noise alone in it, the noise's least."""


def column_name(key: str, part: str) -> str:
    """The name of a column: the key alone is its value."""
    return key if part == PARTS[0] else f"{key} {part}"


@dataclass(frozen=True)
class KeyBudget:
    """The uncertainty budget of one value: of its `key`, in a `frame` or, None, shared by all."""

    frame: int | None
    key: str
    inputs: tuple[BudgetInput, ...]


@dataclass(frozen=True, repr=False, kw_only=True)
class Fit(FittedResult):
    """Fitted unknowns.

    `shared`, key to {value, standard_uncertainty, noise_uncertainty, cramer_rao_bound} of what all
    frames share, where the standard uncertainty is that of the noise and of all inputs that the
    scene states with theirs; `budget` names each input's share, of all values, empty where none is
    stated; `taken_as_exact`, keys of the measured numbers without an uncertainty;
    `frames`, the same for each frame's own; `distance_m` and `frame_chi`, of each frame; `chi`,
    residual over noise over all frames; `scene`, with the fitted values; `other_minima`, of each
    frame on its own: other values that fit nearly as well; `wear_laws`, compared, where several
    frames tell what was worn between them; `warnings` in plain words; `tractions` of each frame,
    where they were asked for; `asked`, the keys that were to be fitted, None where the frames were
    asked for no others; `already`, whether an earlier run had left it all.
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
    budget: tuple[KeyBudget, ...] = ()
    taken_as_exact: tuple[str, ...] = ()
    asked: tuple[str, ...] | None = None
    already: bool = False

    def to_json(self) -> dict[str, Any]:
        """The result as `--json` prints it; a single frame's own unknowns stand at the top too."""
        top: dict[str, Any] = self._with_budget(None, self.shared)
        each = [self._with_budget(i, estimates) for i, estimates in enumerate(self.frames)]
        if len(self.frames) == 1:
            top |= each[0]
        frames = [
            {"frame": i, "distance_m": distance, "chi": chi, "other_minima": others, **estimates}
            for i, (estimates, distance, chi, others) in enumerate(
                zip(each, self.distance_m, self.frame_chi, self.other_minima, strict=True)
            )
        ]
        top |= {"chi": self.chi, **warnings_json(self.warnings), "frames": frames}
        top["taken_as_exact"] = list(self.taken_as_exact)
        top |= {"summary_text": self.summary_text, "causes": self.causes, "refined": self.refined}
        if self.wear_laws is not None:
            top |= {
                "wear_law": self.wear_laws.sentence(),
                "wear_laws": self.wear_laws.to_json(),
                "wear_between_frames": list(self.wear_laws.between),
                "wear_chi": self.wear_laws.chi,
            }
        if self.tractions:
            tractions = [{"frame": i, **one.to_json()} for i, one in enumerate(self.tractions)]
            top["tractions"] = tractions
        return top

    def _with_budget(self, frame: int | None, estimates: Found) -> dict[str, Any]:
        """Values by key, each with its budget where inputs are stated."""
        budgets = {b.key: [i.to_json() for i in b.inputs] for b in self.budget if b.frame == frame}
        return {
            k: v | ({"budget": budgets[k]} if k in budgets else {}) for k, v in estimates.items()
        }

    @property
    def title(self) -> str:
        """The scene, how many frames, and chi."""
        many = counted(len(self.frames), "frame")
        return f"Fit of {self.scene.name}: {many}, chi = {self.chi:.3f}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """What all frames share, and what each has of its own."""
        for key, estimate in self.shared.items():
            yield key, with_uncertainty(estimate["value"], estimate["standard_uncertainty"])
        yield from super().main_values()
        if self.wear_laws is not None:
            yield "wear law", self.wear_laws.sentence()

    @property
    def besides(self) -> list[str]:
        """What else than the pictures the ± are of."""
        scars = ["the measured scars"] * bool(self.scene.scar)
        return ["the stated uncertainties"] * bool(self.budget) + scars

    @property
    def rows(self) -> list[Sequence[Any]]:
        """Of each wanted key what a sentence says of it."""
        return self._parts[0]

    @property
    def causes(self) -> list[str] | None:
        """What the frames asked for besides, with its value; None where nobody asked them."""
        return self._parts[1]

    @property
    def refined(self) -> list[str]:
        """What the frames know better than the scene states it, and agree with."""
        return self._parts[2]

    @property
    def _parts(self) -> tuple[list[Sequence[Any]], list[str] | None, list[str]]:
        """The rows of what was to be fitted, and `causes` and `refined`."""
        inputs = (one for budget in self.budget for one in budget.inputs)
        stated = {i.input: (i.value, i.standard_uncertainty) for i in inputs if i.value is not None}
        rows = rows_by_key(self.columns)
        if self.asked is None:
            return list(rows.values()), None, []
        others = [row for key, row in rows.items() if key not in self.asked]
        near = [r for r in others if r[0] in stated and agree((r[1], r[4]), stated[r[0]])]
        causes = [spoken(*row) for row in others if row not in near]
        wanted: list[Sequence[Any]] = [row for row in rows.values() if row not in others]
        return wanted, causes, refined_texts(near, stated)

    @property
    def over_frames(self) -> FrameValues:
        """What each frame has of its own, NaN where a key is not of a frame."""
        keys = keys_of(self.frames)
        values, spreads = (
            np.array([[f[k][part] if k in f else np.nan for k in keys] for f in self.frames])
            for part in PARTS[:2]
        )
        none = np.zeros(len(self.frames), dtype=bool)
        return FrameValues(
            keys=keys, values=values, standard_uncertainty=spreads, chi=np.array(self.frame_chi),
            distance_m=numbers(self.distance_m), searched=none, whole=none,
        )  # fmt: skip

    @property
    def budget_columns(self) -> dict[str, list[Any]]:
        """Those of budget.csv: one row for each input of each value, the largest share first."""
        rows = [
            ("all" if b.frame is None else str(b.frame), b.key, *i.to_json().values())
            for b in self.budget
            for i in b.inputs
        ]
        names = ("frame", "key", *(f.name for f in fields(BudgetInput)))
        return {name: [row[k] for row in rows] for k, name in enumerate(names)}

    @property
    def columns(self) -> dict[str, list[Any]]:
        """Those of fit.csv: one row for each unknown, 'all' or the frame it belongs to."""
        places: list[Any] = [("all", None, self.chi, self.shared)]
        numbered = map(str, range(len(self.frames)))
        places += zip(numbered, self.distance_m, self.frame_chi, self.frames, strict=True)
        rows = [
            (place, distance, key, *(estimate[part] for part in PARTS), chi)
            for place, distance, chi, estimates in places
            for key, estimate in estimates.items()
        ]
        names = ("frame", "distance_m", "key", *PARTS, "chi")
        return {name: [row[k] for row in rows] for k, name in enumerate(names)}


def keys_of(frames: list[Found]) -> tuple[str, ...]:
    """The keys of frames, in the order in which they come."""
    return tuple(dict.fromkeys(key for estimates in frames for key in estimates))


def make_result(
    joint: JointFit,
    single_fits: list[FrameFit],
    laws: WearLaws | None = None,
    notes: tuple[str, ...] = (),
) -> Fit:
    """A fit as it is reported; `single_fits`, for their other minima; `notes`, what else to say."""
    shared: Found = {}
    per_frame: list[Found] = [{} for _ in joint.scenes]
    for unknown, *parts in zip(
        joint.unknowns, joint.values, joint.standard_uncertainty, joint.noise_uncertainty,
        joint.cramer_rao_bound, strict=True,
    ):  # fmt: skip
        estimate = dict(zip(PARTS, map(float, parts), strict=True))
        for place in [shared] if unknown.shared else [per_frame[i] for i in unknown.frames]:
            place[unknown.key] = estimate
    scene, wear = _scene_of_all(joint, shared, per_frame), joint.scene.wear
    against = []
    if laws is not None and wear is not None and laws.speaks_against(wear.law):
        against = [message("wear_law_not_what", law=wear.law, sentence=laws.sentence())]
    return Fit(
        shared=shared,
        frames=per_frame,
        distance_m=list(joint.sequence.distances_m),
        frame_chi=list(joint.frame_chi),
        chi=joint.chi,
        scene=scene,
        other_minima=[_others(fit) for fit in single_fits],
        wear_laws=laws,
        warnings=(*notes, *_warnings(joint, single_fits), *against),
        budget=tuple(
            KeyBudget(frame, unknown.key, inputs)
            for unknown, inputs in zip(joint.unknowns, joint.budget, strict=False)
            for frame in ((None,) if unknown.shared else unknown.frames)
            if inputs
        ),
        taken_as_exact=taken_as_exact(scene, tuple(u.key for u in joint.unknowns)),
    )


def _scene_of_all(joint: JointFit, shared: Found, per_frame: list[Found]) -> Scene:
    """The fitted scene, with the means of what each frame has of its own."""
    # a run's course is in the scene already, as tables
    averages = {
        key: float(np.mean([f[key]["value"] for f in per_frame if key in f]))
        for key in keys_of(per_frame)
        if not joint.sequence.in_course(key)
    }
    scene = joint.scene.with_values(averages) if averages else joint.scene
    # what is known now of the values that the scene had stated before
    known = {
        key: {part: estimate[part] for part in PARTS[:2]}
        for key, estimate in (shared | (per_frame[0] if len(per_frame) == 1 else {})).items()
        if key in scene.uncertainties and np.isfinite(estimate["standard_uncertainty"])
    }
    return scene.with_values(known) if known else scene


def _others(fit: FrameFit) -> list[dict[str, float]]:
    near = [m for m in fit.others if m.chi <= ALIKE_CHI * fit.chi]
    return [dict(zip(fit.keys, m.values.tolist(), strict=True)) | {"chi": m.chi} for m in near]


def _warnings(joint: JointFit, single_fits: list[FrameFit]) -> list[str]:
    messages_found = []
    poor = [i for i, chi in enumerate(joint.frame_chi) if chi > POOR_CHI]
    if poor:
        where = "" if len(joint.scenes) == 1 else f" ({named_frames(poor)})"
        worst = max(joint.frame_chi)
        messages_found.append(message("chi_model_does_not", worst=worst, where=where))
        if not any(unknown.key.startswith("camera.") for unknown in joint.unknowns):
            messages_found.append(message("contact_place_picture_held"))
    lost = set(joint.lost)
    messages = [(i, message("scene_fringes_not", correct=message(CORRECT))) for i in joint.lost]
    messages += [
        (i, message("no_smooth_illumination_fits"))
        for i, fit in enumerate(single_fits)
        if fit.plain and i not in lost
    ]
    for i, fit in enumerate(single_fits):
        if others := _others(fit):
            count = counted(len(others), "other solution")
            messages.append((i, message("nearly_same_misfit_give", counted=count)))
    messages_found += messages_of_frames(messages)
    if not joint.converged:
        messages_found.append(message("fit_did_not_converge"))
    return messages_found


def fitted_scene(scene: Scene, shared: Found, per_frame: list[Found]) -> Scene:
    """The scene with the means of frames' own values; friction as a table over distance."""
    values: dict[str, Any] = {key: estimate["value"] for key, estimate in shared.items()}
    for key in keys_of(per_frame):
        series = [
            (i, frame[key]["value"])
            for i, frame in enumerate(per_frame)
            if key in frame and np.isfinite(frame[key]["value"])
        ]
        if not series:
            continue
        values[key] = float(np.mean([value for _, value in series]))
        if key == FRICTION and scene.wear and len(series) > 1:
            points = {frame_distance(scene, i) or 0.0: value for i, value in series}
            values[key] = over_distance(points) if len(points) > 1 else values[key]
    if isinstance(values.get(FRICTION), dict):
        values.pop(EARLIER, None)
    return scene.with_values(values)


TRACK_PARTS = {"value": "values"} | {n: n for n in PARTS[1:] if n != "noise_uncertainty"}
"""What is known of a key, as tables name it, and the attribute that holds it."""


@dataclass(frozen=True, repr=False, kw_only=True)
class Track(FittedResult):
    """Tracked values of n frames.

    `keys`; `values`, `standard_uncertainty`, `cramer_rao_bound` (n, keys), NaN where a frame does
    not show the scene's fringes; `chi` (n,), residual over noise; `distance_m` (n,), NaN where
    nothing wears; `searched`, frames that a full search had to find; `scene`, with the values'
    means; `warnings` in plain words; `already`, whether an earlier run had left it all.
    """

    keys: tuple[str, ...]
    values: Array
    standard_uncertainty: Array
    cramer_rao_bound: Array
    chi: Array
    distance_m: Array
    searched: tuple[int, ...]
    scene: Scene
    warnings: tuple[str, ...]
    already: bool = False

    def to_json(self) -> dict[str, Any]:
        """The result as `--json` prints it: a list of values for each key, and of chi."""
        values: dict[str, Any] = {
            key: {part: getattr(self, name)[:, j] for part, name in TRACK_PARTS.items()}
            for j, key in enumerate(self.keys)
        }
        values |= {"chi": self.chi, "distance_m": self.distance_m, "searched": self.searched}
        values |= warnings_json(self.warnings) | {"taken_as_exact": self.taken_as_exact}
        result: dict[str, Any] = plain(values | {"summary_text": self.summary_text})
        return result

    @property
    def columns(self) -> dict[str, Any]:
        """Those of fit.csv: one row for each key of each frame."""
        count, keys = self.values.shape
        return {
            "frame": np.repeat(np.arange(count).astype(str), keys),
            "distance_m": np.repeat(self.distance_m, keys),
            "key": np.tile(np.array(self.keys), count),
            **{part: getattr(self, name).ravel() for part, name in TRACK_PARTS.items()},
            "chi": np.repeat(self.chi, keys),
            "searched": np.repeat(self.over_frames.searched.astype(int), keys),
        }

    @property
    def title(self) -> str:
        """The scene and how many frames were tracked."""
        return f"Track through {counted(len(self.chi), 'frame')} of {self.scene.name}"

    def main_values(self) -> Iterator[tuple[str, str]]:
        """Each key over the frames, and chi."""
        yield from super().main_values()
        yield "chi", over_items(self.chi)

    @property
    def over_frames(self) -> FrameValues:
        """The values, to be drawn and summed up as those of other commands."""
        return FrameValues(
            keys=self.keys, values=self.values, standard_uncertainty=self.standard_uncertainty,
            chi=self.chi, distance_m=self.distance_m,
            searched=np.isin(np.arange(len(self.chi)), self.searched),
            whole=np.zeros(len(self.chi), dtype=bool),
        )  # fmt: skip

    @property
    def taken_as_exact(self) -> tuple[str, ...]:
        """Keys of the measured numbers whose uncertainty is not in the ±, stated or not."""
        return taken_as_exact(self.scene, self.keys, tracked=True)

    def figure(self) -> Figure:
        """Each key with its band, and chi."""
        head = f"{plain_name(self.scene.name)}: tracked values, band ± {BAND:g} standard"
        head += " uncertainties\ncircles: found by a full search"
        return panels_figure(PaperPanels(plots=values_plots(self.over_frames)), head)


def track_row(
    index: int, distance_m: float | None, keys: tuple[str, ...], found: Tracked
) -> dict[str, Any]:
    """A frame's row as plain numbers: its number, distance (m), and what was found in it."""
    row: dict[str, Any] = {"frame": index, "distance_m": distance_m, "chi": float(found.chi)}
    for part, name in TRACK_PARTS.items():
        values = np.asarray(getattr(found, name), float).tolist()
        row |= {column_name(key, part): v for key, v in zip(keys, values, strict=True)}
    # the first frame has nothing to be followed from
    said = [text for text in found.warnings if index or text != message(AGAIN)]
    return row | {"searched": bool(found.searched), "messages": frame_messages(said)}


def untracked_inputs(scene: Scene) -> list[str]:
    """What is said where a scene states uncertainties, which tracked values leave out."""
    if not scene.uncertainties:
        return []
    return [
        message("stated_uncertainties_not_tracked", uncertainties=", ".join(scene.uncertainties))
    ]


def make_track(
    rows: Iterable[Mapping[str, Any]], keys: tuple[str, ...], scene: Scene,
    said: tuple[str, ...] = (),
) -> Track:  # fmt: skip
    """The track of frames' rows, see `track_row`; `said`, what is to be said of all frames. Rows
    are let go one by one: hours of video are some megabytes. Raises PhysicsError where none tells
    any value.
    """
    table = columns_of(rows)
    parts = _track_parts(keys, lambda key, part: table[column_name(key, part)])
    values, spread = parts["values"], parts["standard_uncertainty"]
    known = np.isfinite(values) & np.isfinite(spread)
    if not known.any():
        count, cause = len(values), message(CORRECT)
        raise PhysicsError(
            "nothing_could_read_any", name=scene.name, single_fits_count=count, cause=cause
        )
    cells = enumerate(table["messages"])
    of_frames = [(k, text) for k, cell in cells for text in read_frame_messages(cell)]
    means = {
        key: float(values[known[:, j], j].mean()) for j, key in enumerate(keys) if known[:, j].any()
    }
    return Track(
        keys=keys, **parts, chi=numbers(table["chi"]), distance_m=numbers(table["distance_m"]),
        searched=tuple(np.flatnonzero(table["searched"]).tolist()), scene=scene.with_values(means),
        warnings=(*said, *untracked_inputs(scene), *messages_of_frames(of_frames)),
    )  # fmt: skip


def _track_parts(
    keys: tuple[str, ...], column: Callable[[str, str], Iterable[float | None]]
) -> dict[str, Any]:
    """The arrays (n, keys) of a Track, of a `column` (n,) for each key and part."""
    return {
        name: np.stack([numbers(column(key, part)) for key in keys], axis=1)
        for part, name in TRACK_PARTS.items()
    }


def restored_track(found: Mapping[str, Any], scene: Scene, keys: tuple[str, ...]) -> Track:
    """A Track from its JSON, and the `scene` with the means."""
    parts = _track_parts(keys, lambda key, part: found[key][part])
    return Track(
        keys=keys, **parts, chi=numbers(found["chi"]), distance_m=numbers(found["distance_m"]),
        searched=tuple(found["searched"]), scene=scene, warnings=read_warnings(found), already=True,
    )  # fmt: skip
