"""The lines of the bench's figure: which rows belong together, and how each line looks."""

from dataclasses import dataclass

from isochrome.figures import LINE_COLOURS

from .case_stress import EDGES, KINDS, LAGS
from .case_wear import GRID, LOOSE, MESH, TIGHT
from .common import OURS, PAPER
from .rows import Row

HERE = "Isochrome"
BLUE, ORANGE, _, _, SKY, YELLOW = LINE_COLOURS


@dataclass(frozen=True)
class Series:
    """Rows that one line joins, and its look; `hollow`, `dashes` and `size` tell grids apart."""

    name: str
    rows: list[Row]
    colour: str
    marker: str
    hollow: bool = False
    dashes: str = "-"
    size: float = 6.0


def _of(rows: list[Row], case: str, method: str, setting: str = "") -> list[Row]:
    return [
        r
        for r in rows
        if r.case.startswith(case)
        and r.method == method
        and r.setting.startswith(setting)
        and r.error == r.error
    ]


def _seen(lines: list[Series]) -> list[Series]:
    return [line for line in lines if line.rows]


def pressure(rows: list[Row]) -> list[Series]:
    """Both methods on every grid, the larger the larger."""
    cases = list(dict.fromkeys(r.case for r in rows if r.case.startswith("pressure")))
    looks = [(True, ":", 4.0), (False, "-", 6.0), (True, "--", 8.5)]
    lines = []
    for method, short, colour, marker in ((PAPER, "paper", ORANGE, "o"), (OURS, HERE, BLUE, "s")):
        for case, look in zip(cases, looks, strict=False):
            name = f"{short}, {case.removeprefix('pressure, ')}"
            lines.append(Series(name, _of(rows, case, method), colour, marker, *look))
    return _seen(lines)


def wear(rows: list[Row]) -> list[Series]:
    """Explicit steps, the moving mesh, and the fixed grid that other profiles take."""
    steps = _of(rows, "wear", PAPER)
    return _seen(
        [
            Series(
                f"paper: CG to {TIGHT:g}", [r for r in steps if f"CG to {TIGHT:g}" in r.setting],
                ORANGE, "o",
            ),
            Series(
                f"paper: CG to {LOOSE:g}", [r for r in steps if f"CG to {LOOSE:g}" in r.setting],
                YELLOW, "v",
            ),
            Series(f"{HERE}: cylinder", _of(rows, "wear", OURS, MESH), BLUE, "s"),
            Series(f"{HERE}: any profile", _of(rows, "wear", OURS, GRID), SKY, "D"),
        ]
    )  # fmt: skip


def stress(rows: list[Row]) -> list[Series]:
    """Each sum to the closed form, a line from few elements to many, and to the exact sum."""
    single, double = (kind.__name__ for kind in KINDS)
    looks = [
        (PAPER, EDGES, f"paper: {EDGES}", ORANGE, "o"),
        (PAPER, LAGS, f"paper: {LAGS}", YELLOW, "v"),
        (OURS, single, f"{HERE}: {single}", BLUE, "s"),
        (OURS, double, f"{HERE}: {double}", SKY, "D"),
    ]
    lines = []
    for method, how, name, colour, marker in looks:
        found = _of(rows, "stress", method, how)
        to_form = [r for r in found if r.case.endswith("closed form")]
        to_sum = [r for r in found if r.case.endswith("exact sum")]
        lines.append(Series(name, to_form, colour, marker))
        lines.append(Series("", to_sum, colour, marker, hollow=True, dashes="none"))
    return _seen(lines)


PANELS = {
    "Pressure under a cylinder": ("error over $p_0$ (middle half of the contact)", 2, pressure),
    "Wear with friction and coupling": ("largest error of $p_{max}$ and depth (relative)", 2, wear),
    "Stress on the camera's pixels": (
        "error over $p_0$ (filled: closed form, open: exact sum)", 2, stress,
    ),
}  # fmt: skip
"""Title: label of the x axis, columns of the legend, and the lines."""
