"""What the report of a fit or a track says."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.fitting.result import Fit
from isochrome.fitting.tracking.result import Track
from isochrome.reporting import ReportContent, ReportTable, curves_of, paper_rows
from isochrome.scene import dump_scene

_NO_BUDGET = (
    "The scene states no number with an uncertainty, so there are no shares: the ± is that of the "
    "images' noise alone."
)
_TRACK_BUDGET = (
    "A track gives each value the ± of its frame's noise, and no shares; isochrome fit of a few "
    "of its frames gives them."
)
_TRACK_CAUSES = (
    "What a few of its frames asked of the apparatus is held in all of them, and named in the "
    "warnings."
)


def fit_report(folder: Path, result: Fit | Track, record: Mapping[str, Any]) -> ReportContent:
    """Collect what the report of a fit or a track says.

    Parameters
    ----------
    folder : Path
        Where its figure is.
    result : Fit or Track
        What was found.
    record : mapping
        What provenance.json holds: versions, hashes and options.

    Returns
    -------
    ReportContent
        What the report says.
    """
    options = record.get("options") or {}
    looked = not options.get("as_stated", False)
    of_kind = _of_track(result, looked) if isinstance(result, Track) else _of_fit(result)
    found = result.over_frames
    chi = found.chi[np.isfinite(found.chi)]
    goodness = f"{chi.max():.2f} at most" if chi.size else "not known"
    verdict = str(of_kind.pop("verdict"))
    return ReportContent(
        title=result.title,
        verdict=f"{verdict[:1].upper()}{verdict[1:]}. Residual over noise: {goodness} (about 1 "
        "where the frames are described to their noise).",
        curves=curves_of(found),
        warnings=result.warnings,
        scene=dump_scene(result.scene),
        paper=paper_rows(result.scene, record),
        picture=(folder / "fit.png").read_bytes(),
        **of_kind,
    )


def _of_track(result: Track, looked: bool) -> dict[str, Any]:
    return {
        "command": "fit --track",
        "verdict": result.summary_text,
        "no_budget": _TRACK_BUDGET,
        "causes_text": _TRACK_CAUSES if looked else "",
        "taken_as_exact": result.taken_as_exact,
    }


def _of_fit(result: Fit) -> dict[str, Any]:
    verdict = result.summary_text
    tables = [ReportTable("The fitted values (fit.csv)", result.columns)]
    if result.wear_laws is not None:
        tables.append(ReportTable("The wear laws (wear_laws.csv)", result.wear_laws.table()))
        verdict += f"; wear law: {result.wear_laws.sentence()}"
    budget = ReportTable("Shares of each ± (budget.csv)", result.budget_columns)
    return {
        "command": "fit",
        "verdict": verdict,
        "budget": budget if result.budget else None,
        "no_budget": _NO_BUDGET,
        "tables": tables,
        "causes": result.causes,
        "refined": result.refined,
        "taken_as_exact": result.taken_as_exact,
    }
