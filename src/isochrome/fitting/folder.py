"""The files that `fit` leaves, their pictures and report; a fit from those of an earlier run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.estimation import POOR_CHI, BudgetInput, FrameData
from isochrome.figures import (
    BAND,
    BOLD_PT,
    DIFFERENCE_MAP,
    FINE_PT,
    FRAME_MAP,
    GREY,
    INK,
    LINE_COLOURS,
    LINE_PT,
    PaperPanels,
    PictureKind,
    Plot,
    add_legend,
    budget_plot,
    centred_limit,
    panels_figure,
    plain_name,
    show_image,
    style_axes,
    values_plots,
)
from isochrome.fitting.arrays import Array
from isochrome.fitting.causes.cause import CAUSES
from isochrome.fitting.frame.renderer import ModelFrame, evaluate_model
from isochrome.fitting.frame_set import Lights, PreparedFrames
from isochrome.fitting.joint.joint_fit import JointFit
from isochrome.fitting.result import (
    PARTS,
    TRACK_PARTS,
    Fit,
    Found,
    KeyBudget,
    Track,
    column_name,
    keys_of,
    restored_track,
)
from isochrome.fitting.tractions import Tractions, node_runs
from isochrome.fitting.wear_laws import restored_laws
from isochrome.messages import read_warnings
from isochrome.output import (
    evenly_spaced,
    imagej_view,
    numbers,
    saved_picture,
    write_csv,
    write_figure,
    write_json,
    write_text,
    write_tiff,
)
from isochrome.reporting import ReportContent, ReportTable, fitted_report, write_report
from isochrome.runs import (
    REPORT,
    STORE,
    Column,
    Job,
    RunFolder,
    add_columns,
    attributes,
    column,
    named_units,
)
from isochrome.scene import FramesLike, Scene, dump_scene, parse_scene
from isochrome.simulation import scene_states

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

_NO_BUDGET = (
    "The scene states no number with an uncertainty, so there are no shares: the ± is that of the "
    "images' noise alone."
)
_TRACK_BUDGET = (
    "A track gives each value the ± of its frame's noise, and no shares; isochrome fit of a few "
    "of its frames gives them."
)
_TRACK_CAUSES = (
    "What one of its frames asked of the apparatus is held in all of them, and named in the "
    "warnings."
)


def fit_report(folder: Path, result: Fit | Track, record: Mapping[str, Any]) -> ReportContent:
    """What the report of a fit or a track says; `record`, what provenance.json holds."""
    parts: dict[str, Any] = {"command": "fit", "verdict": result.summary_text}
    if isinstance(result, Track):
        stated = (record.get("options") or {}).get("as_stated", False)
        parts |= {"command": "fit --track", "no_budget": _TRACK_BUDGET}
        parts["causes_text"] = "" if stated else _TRACK_CAUSES
    else:
        tables = [ReportTable("The fitted values (fit.csv)", result.columns)]
        if result.wear_laws is not None:
            tables.append(ReportTable("The wear laws (wear_laws.csv)", result.wear_laws.table()))
            parts["verdict"] += f"; wear law: {result.wear_laws.sentence()}"
        budget = ReportTable("Shares of each ± (budget.csv)", result.budget_columns)
        parts |= {"budget": budget if result.budget else None, "no_budget": _NO_BUDGET}
        parts |= {"tables": tables, "causes": result.causes, "refined": result.refined}
        keys = {text.partition(" ")[0] for text in result.causes or ()}
        parts["pages"] = [cause.name for cause in CAUSES if keys & {*cause.keys}]
    chi = result.over_frames.chi[np.isfinite(result.over_frames.chi)]
    goodness = f"{chi.max():.2f} at most" if chi.size else "not known"
    text = (
        f"Residual over noise: {goodness} (about 1 where the frames are described to their noise)."
    )
    picture = (folder / PICTURE).read_bytes()
    return fitted_report(result, record, goodness=text, picture=picture, **parts)


PICTURE = "fit.png"


def write_fit(
    run_folder: RunFolder, job: Job, name: str, data: PreparedFrames, result: Fit, joint: JointFit
) -> None:
    """Leave a fit's files in the folder of its run."""
    folder = run_folder.results
    if result.wear_laws is not None:
        write_csv(folder / "wear_laws.csv", result.wear_laws.table())
    write_figure(folder / PICTURE, fit_figure(name, data, joint.scenes))
    if result.budget:
        write_csv(folder / "budget.csv", result.budget_columns)
        write_figure(folder / "budget.png", budget_figure(name, result))
    if result.tractions:
        _write_tractions(folder, result.tractions)
        figure = tractions_figure(name, data, joint.scenes, result.tractions)
        write_figure(folder / "tractions.png", figure)
    over_distance = over_distance_figure(name, result)
    if over_distance is not None:
        write_figure(folder / "fit_over_distance.png", over_distance)
    good = [chi <= POOR_CHI for chi in result.frame_chi]
    columns: dict[str, Any] = {
        "chi": column(result.frame_chi, "frame", "chi"),
        "status": column(["ok" if ok else "flagged" for ok in good], "frame", "status"),
    }
    for key in keys_of(result.frames):
        for part in PARTS:
            values = [
                estimates[key][part] if key in estimates else None for estimates in result.frames
            ]
            columns[column_name(key, part)] = column(values, "frame", key)
    for key, estimate in result.shared.items():
        for part in PARTS:
            single = Column((), np.array(estimate[part], float), named_units(key))
            columns[column_name(key, part)] = single
    _keep_values(folder, job, result, columns)


def _write_tractions(folder: Path, tractions: tuple[Tractions, ...]) -> None:
    """Leave tractions.csv, and the principal stresses and the order as TIFFs."""
    nodes = [len(one.x_mm) for one in tractions]
    columns: dict[str, Any] = {"frame": np.repeat(np.arange(len(tractions)), nodes)}
    for field in fields(Tractions)[:5]:  # what is known of each node
        columns[field.name] = np.concatenate([getattr(one, field.name) for one in tractions])
    write_csv(folder / "tractions.csv", columns)
    labels, pixels = [f"frame {i}" for i in range(len(nodes))], tractions[0].pixels
    maps = zip(*(one.maps(one.components()) for one in tractions), strict=True)
    for name, stack in zip(("sigma_1_mpa", "sigma_2_mpa", "fringe_order"), maps, strict=True):
        known = np.concatenate([image[np.isfinite(image)] for image in stack])
        ends = float(known.min(initial=0.0)), float(known.max(initial=0.0))
        view = imagej_view(name, ends, labels=labels, **pixels.scale)
        write_tiff(folder / f"{name}.tif", np.stack(stack), pixel_mm=pixels.pixel_mm, metadata=view)


def write_track(run_folder: RunFolder, job: Job, result: Track, status: list[str]) -> None:
    """Leave a track's files in the folder of its run; `status` of each frame."""
    write_figure(run_folder.results / PICTURE, result.figure())
    columns = {
        "chi": column(result.chi.tolist(), "frame", "chi"),
        "searched": column(result.over_frames.searched.astype(int).tolist(), "frame", "searched"),
        "status": column(status, "frame", "status"),
    }
    for j, key in enumerate(result.keys):
        for part, name in TRACK_PARTS.items():
            values = getattr(result, name)[:, j].tolist()
            columns[column_name(key, part)] = column(values, "frame", key)
    _keep_values(run_folder.results, job, result, columns)


def _keep_values(folder: Path, job: Job, result: Fit | Track, columns: dict[str, Column]) -> None:
    """Leave what every fit leaves: fit.csv, fit.json, scene, values over frame, report."""
    write_csv(folder / "fit.csv", result.columns)
    write_text(folder / "scene.toml", dump_scene(result.scene))
    write_json(folder / "fit.json", result.to_json())
    distances = list(result.distance_m)
    axes = {
        "frame": column(list(range(len(distances))), "frame", "frame"),
        "distance_m": column(distances, "frame", "distance_m"),
    }
    add_columns(folder / STORE, columns, axes, attributes(job.identity))
    write_report(folder / REPORT, fit_report(folder, result, job.identity))


def kept_values(out: Path, scene: Scene) -> tuple[dict[str, Any], Scene]:
    """A fit's JSON and its fitted scene, from the folder that an earlier run left complete."""
    text = (out / "scene.toml").read_text("utf-8")
    fitted = parse_scene(text, name=scene.name, folder=scene.folder)
    return json.loads((out / "fit.json").read_text("utf-8")), fitted


def restore_fit(out: Path, scene: Scene, keys: tuple[str, ...] | None = None) -> Fit:
    """A fit without tractions, from the folder that an earlier run left complete."""
    found, fitted = kept_values(out, scene)
    rows, budget = found["frames"], list[KeyBudget]()
    own = rows[0] if len(rows) == 1 else {}
    return Fit(
        shared=_estimates({k: value for k, value in found.items() if k not in own}, None, budget),
        frames=[_estimates(row, i, budget) for i, row in enumerate(rows)],
        distance_m=[row["distance_m"] for row in rows],
        frame_chi=numbers(row["chi"] for row in rows).tolist(),
        chi=float(numbers([found["chi"]])[0]), scene=fitted,
        other_minima=[row["other_minima"] for row in rows],
        wear_laws=restored_laws(found) if "wear_laws" in found else None,
        warnings=read_warnings(found), budget=tuple(budget),
        taken_as_exact=tuple(found["taken_as_exact"]), asked=keys, already=True,
        draw=partial(saved_picture, out.absolute() / PICTURE),
    )  # fmt: skip


def _estimates(values: dict[str, Any], frame: int | None, budget: list[KeyBudget]) -> Found:
    """Those of a place in a fit's JSON, whose budgets join the others. JSON knows no infinity: an
    uncertainty that is not there is one."""
    result: Found = {}
    for key, value in values.items():
        if not (isinstance(value, dict) and set(PARTS) <= set(value)):
            continue
        unknown = dict.fromkeys(PARTS, np.inf) | {"value": np.nan}
        result[key] = unknown | {p: value[p] for p in PARTS if value[p] is not None}
        if inputs := tuple(BudgetInput(**row) for row in value.get("budget", ())):
            budget.append(KeyBudget(frame, key, inputs))
    return result


def restore_values(out: Path, scene: Scene, options: Mapping[str, Any]) -> Fit | Track:
    """A fit, without its tractions, or a track, from the folder that a run left complete."""
    if "track" in options:
        return restored_track(*kept_values(out, scene), tuple(options["track"]))
    keys = (*options.get("free", ()), *options.get("per_frame", ()))
    return restore_fit(out, scene, None if options.get("as_stated") else keys)


_SHOWN = 6
"""Frames that are drawn."""


def figure_of_frames(
    path: FramesLike, scene: Scene, plain: frozenset[int], lights: Lights, scenes: tuple[Scene, ...]
) -> Figure:
    """`fit_figure` of frames that are read once more: they may be many, or gone (InputError)."""
    with closing(PreparedFrames(path, scene)) as frames:
        frames.plain, frames.lights = set(plain), lights
        return fit_figure(scene.name, frames, scenes)


def fit_figure(name: str, frames: PreparedFrames, scenes: tuple[Scene, ...]) -> Figure:
    """Captured light, fitted light, and their difference over the noise, for up to six frames."""
    shown = evenly_spaced(range(len(scenes)), _SHOWN)
    wanted = [frames[k].as_fitted(scenes[k]) for k in shown]
    models = [evaluate_model(data, scenes[k]) for k, data in zip(shown, wanted, strict=True)]

    def draw(axes: Axes, k: int, column: int) -> AxesImage:
        data, model = wanted[k], models[k]
        if column == 2:
            return _show_residual(axes, data, model)
        shown = (data.light, data.valid), (_light(model), model.picture.material)
        most = float(np.percentile(data.light[data.valid], 99.8))
        look: dict[str, Any] = {"cmap": FRAME_MAP, "vmin": 0, "vmax": most}
        return show_image(
            axes, np.where(shown[column][1], shown[column][0], np.nan), **look, **model.pixels.scale
        )

    bars = {"captured": "", "fitted model": "", "residual": _RESIDUAL_LABEL}
    labels = [f"frame {k}, χ = {m.chi:.2f}" for k, m in zip(shown, models, strict=True)]
    return _pictures(draw, bars, labels, f"{plain_name(name)}: fit to the intensity")


_RESIDUAL_LABEL = "(captured - fitted) / noise"


def _light(model: ModelFrame) -> Array:
    return np.asarray(model.background + model.illumination * model.signal(1))


def _show_residual(axes: Axes, data: FrameData, model: ModelFrame) -> AxesImage:
    """A frame's light less its model's, over the noise, where that is known."""
    residual = np.where(model.mask, (data.light - _light(model)) / data.sigma, np.nan)
    look: dict[str, Any] = {"cmap": DIFFERENCE_MAP, "vmin": -5, "vmax": 5}
    return show_image(axes, residual, **look, **model.pixels.scale)


def tractions_figure(
    name: str, frames: Iterable[FrameData], scenes: tuple[Scene, ...], found: tuple[Tractions, ...]
) -> Figure:
    """Residual, principal stresses, and tractions with 95 % bands beside the models of `scenes`."""
    shown = evenly_spaced(range(len(found)), _SHOWN)
    wanted = {i: data for i, data in enumerate(frames) if i in shown}
    stress = {i: found[i].components() for i in shown}
    maps = {i: found[i].maps(stress[i]) for i in shown}

    def draw(axes: Axes, k: int, column: int) -> AxesImage:
        i = shown[k]
        if column == 0:
            scene = found[i].scene
            data = wanted[i].as_fitted(scene)
            model = evaluate_model(data, scene, difference=stress[i].difference)
            return _show_residual(axes, data, model)
        limit = centred_limit(*(maps[i][column - 1] for i in shown), percentile=99.8)
        look: dict[str, Any] = {"cmap": DIFFERENCE_MAP, "vmin": -limit, "vmax": limit}
        return show_image(axes, maps[i][column - 1], **look, **found[i].pixels.scale)

    bars = {"residual": _RESIDUAL_LABEL} | {
        sigma: f"{sigma} (MPa), tension positive" for sigma in ("σ₁", "σ₂")
    }
    plots = [
        Plot(
            title=f"frame {i}: tractions on the specimen",
            draw=partial(_draw_tractions, one=found[i], scene=scenes[i]),
        )
        for i in shown
    ]
    labels = [f"frame {i}, χ = {found[i].chi:.2f}" for i in shown]
    head = f"{plain_name(name)}: pressure and shear without a contact model"
    return _pictures(draw, bars, labels, head, plots)


def _pictures(
    draw: Callable[..., AxesImage], bars: Mapping[str, str], labels: list[str],
    head: str, plots: Sequence[Plot] = (),
) -> Figure:  # fmt: skip
    """A figure of frames' pictures, of each kind with its colour bar."""
    kinds = [
        PictureKind(name=kind, draw=partial(draw, column=column), bar=bar)
        for column, (kind, bar) in enumerate(bars.items())
    ]
    return panels_figure(PaperPanels(kinds=kinds, labels=labels, plots=plots), head)


def _draw_tractions(axes: Axes, one: Tractions, scene: Scene) -> None:
    """Pressure and shear with their bands, and those of a scene's contact model."""
    surface, pixels = scene_states(scene)[-1].surface, one.pixels
    assert surface is not None
    for label, values, spread, model, colour in (
        ("pressure p", one.pressure_mpa, one.pressure_standard_uncertainty_mpa,
         surface.pressure_mpa, LINE_COLOURS[0]),
        ("shear q", one.shear_mpa, one.shear_standard_uncertainty_mpa,
         surface.shear_mpa, LINE_COLOURS[1]),
    ):  # fmt: skip
        look: dict[str, Any] = {"color": colour, "lw": LINE_PT, "ls": "--"}
        axes.plot(surface.grid.x_mm, model, label=f"{label}, model", **look)
        for i, j in node_runs(np.ones(len(one.x_mm), bool), one.x_mm):
            x, p, u = one.x_mm[i:j], values[i:j], 1.96 * spread[i:j]  # 95 %
            axes.fill_between(x, p - u, p + u, color=colour, alpha=0.25, lw=0)
            axes.plot(x, p, color=colour, lw=BOLD_PT, label=label if i == 0 else None)
    axes.axhline(0.0, color=INK, lw=FINE_PT)
    axes.set_xlim(pixels.left_mm, pixels.left_mm + pixels.cols * pixels.pixel_mm)
    style_axes(axes, x_label="x (mm)", z_label="traction (MPa)")
    add_legend(axes)


def over_distance_figure(name: str, result: Fit) -> Figure | None:
    """Each per-frame key, and the wear, over the distance; None where nothing is per frame."""
    values = result.over_frames
    if len(result.frames) < 2 or not (values.keys or result.wear_laws):
        return None
    plots = values_plots(values)
    if result.wear_laws is not None:
        title = "worn between frames, and by each law"
        plots.append(Plot(title=title, draw=partial(_wear, result=result)))
    head = f"{plain_name(name)}: values of each frame, band ± {BAND:g} standard uncertainties"
    return panels_figure(PaperPanels(plots=plots), f"{head}\nsquares: static")


def _wear(axis: Axes, result: Fit) -> None:
    """What was worn between the frames, with its band, and what each law gives there."""
    assert result.wear_laws is not None
    between = result.wear_laws.between
    edges = np.array([item["from_m"] for item in between] + [between[-1]["to_m"]])
    value, spread = (
        np.array([item[part] for item in between]) for part in ("value", "standard_uncertainty")
    )
    low, high = (np.repeat(value + sign * BAND * spread, 2) for sign in (-1.0, 1.0))
    axis.fill_between(np.repeat(edges, 2)[1:-1], low, high, color=GREY, alpha=0.35, lw=0)
    axis.stairs(value, edges, color=INK, lw=BOLD_PT, baseline=None, label="between frames")
    for law, colour, style in zip(
        result.wear_laws.laws, LINE_COLOURS[1:], ("--", "-.", ":", (0, (6, 1))), strict=False
    ):
        label = f"{law.law}: ln Z {law.log_evidence:+.3g}" if law.log_evidence else law.law
        axis.stairs(
            law.between, edges, color=colour, ls=style, lw=BOLD_PT, baseline=None, label=label
        )
    style_axes(axis, x_label="sliding distance (m)", z_label="mean wear coefficient (mm²/N)")
    add_legend(axis)


def budget_figure(name: str, result: Fit) -> Figure:
    """Each value's uncertainty budget as bars; of several frames' own, the mean square."""
    plots = []
    for key in dict.fromkeys(budget.key for budget in result.budget):
        squares: dict[str, list[float]] = {}
        for budget in result.budget:
            for item in budget.inputs if budget.key == key else ():
                squares.setdefault(item.input, []).append(item.contribution**2)
        sizes = {name: float(np.sqrt(np.mean(variances))) for name, variances in squares.items()}
        parts = dict(sorted(sizes.items(), key=lambda item: -item[1]))
        plots.append(budget_plot(key, parts, unit=named_units(key).get("units", "1")))
    return panels_figure(PaperPanels(plots=plots), f"{plain_name(name)}: uncertainty budget")
