"""The notebooks run in a fresh kernel; those stored with their outputs give them again: the same
text, pictures alike."""

import ast
import base64
import io
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import isochrome

FOLDER = Path(__file__).parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
NO_END_S = 1800
"""A cell of seconds that takes so long hangs, on a loaded machine too."""

STORE = "run `python tests/store_notebooks.py NAME`, NAME being"

MOST_BYTES = 2_000_000
"""Of all notebooks together."""

ALIKE = 6.0
"""Mean difference of two pictures of one cell, of 255: other versions of matplotlib and of fonts
move letters by a pixel, which is below 3; another map, or another line, is above 10."""

SAME_SHARE = 0.003
"""Of a printed value, between processors: an iteration that stops within its tolerance stops
elsewhere on another one. With the kernels of an old processor (`OPENBLAS_CORETYPE=Nehalem`,
`NPY_DISABLE_CPU_FEATURES`) the mean distance of fringe lines differs by 0.07 %."""

SAME_SPREAD, WITHIN_SPREAD = 0.05, 0.05
"""Of a printed uncertainty, which differs by 3 % between those kernels where evidence near its
threshold widens it; and of a value beside it, in shares of it."""

NUMBER = r"\d+(?:\.\d+)?(?:e[-+]\d+)?"

DAY = re.compile(r"\b20\d\d-[01]\d-[0-3]\d\b")
"""The day of a run, which a calibration writes into a scene."""

VALUES = re.compile(rf"({NUMBER})(?: ± ({NUMBER}))?")

SLOW = {
    "a-video-from-start-to-report", "calibrate-the-material", "first-own-frames", "phase-steps",
    "reproduce-the-paper", "what-the-fringes-know",
}  # fmt: skip
"""Those of up to half a minute, whose commands have other tests in the long run."""

MODULES = {
    "difflib", "isochrome", "json", "matplotlib", "matplotlib.pyplot", "numpy", "pathlib", "shutil",
    "tempfile", "typing", "xarray",
}  # fmt: skip
"""What the stored notebooks import."""


@pytest.fixture
def own_kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A kernel named python3 that is this interpreter, whatever else the machine has installed."""
    folder = tmp_path / "jupyter" / "kernels" / "python3"
    folder.mkdir(parents=True)
    spec = {
        "argv": [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"],
        "display_name": "this interpreter",
        "language": "python",
    }
    (folder / "kernel.json").write_text(json.dumps(spec), encoding="utf-8")
    monkeypatch.setenv("JUPYTER_PATH", str(tmp_path / "jupyter"))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.delenv("MPLBACKEND", raising=False)
    return "python3"


def code_cells(path: Path) -> list[dict[str, Any]]:
    """The code cells of a notebook."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def test_notebooks_are_stored_with_their_outputs_and_are_small() -> None:
    assert len(NOTEBOOKS) >= 10
    for path in NOTEBOOKS:
        cells = code_cells(path)
        ran = all(cell["execution_count"] for cell in cells)
        assert cells and ran, f"{path.name}: {STORE} {path.stem}"
        pictures = [item for cell in cells for item in pictures_of(cell["outputs"])]
        assert pictures, f"{path.name}: shows no picture"
    assert sum(path.stat().st_size for path in NOTEBOOKS) < MOST_BYTES


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_imports_from_the_front_door_alone(path: Path) -> None:
    for cell in code_cells(path):
        code = "".join(cell["source"]).replace("%matplotlib inline", "")
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.Import):
                assert {alias.name for alias in node.names} <= MODULES, path.name
            if isinstance(node, ast.ImportFrom):
                names = {alias.name for alias in node.names}
                room = node.module == "isochrome" and not names <= set(isochrome.__all__)
                assert node.module in MODULES and not room, path.name


def texts_of(outputs: list[Any]) -> str:
    """What a cell prints and shows as text, but for what stands in a picture's place."""
    found = []
    for item in outputs:
        text = item.get("text")
        if text is None and "image/png" not in item.get("data", {}):
            text = item.get("data", {}).get("text/plain", "")
        found.append("".join(text or ""))
    return "".join(found)


def same_text(one: str, other: str) -> bool:
    """Whether two texts are the same, but for the day, and for what another processor may make of
    their numbers.
    """
    one, other = (DAY.sub("a day", text) for text in (one, other))
    if VALUES.sub("#", one) != VALUES.sub("#", other):
        return False
    pairs = zip(VALUES.findall(one), VALUES.findall(other), strict=True)
    return all(same_value(here, stored) for here, stored in pairs)


def same_value(pair: tuple[str, str], other: tuple[str, str]) -> bool:
    """Whether two printed values agree but for `WITHIN_SPREAD` of the uncertainty (none:
    `SAME_SHARE` of the value) and a unit and a half of the last digit; plain whole numbers exactly.
    """
    (value, spread), (stored, its_spread) = pair, other
    exact = not {".", "e"} & set(stored)
    if bool(spread) != bool(its_spread) or exact != (not {".", "e"} & set(value)):
        return False
    if not spread:
        return value == stored if exact else close(value, stored, SAME_SHARE * float(stored))
    within = WITHIN_SPREAD * float(its_spread)
    return close(value, stored, within) and close(
        spread, its_spread, SAME_SPREAD * float(its_spread)
    )


def close(one: str, other: str, within: float) -> bool:
    """Whether two numbers differ by less than that, or than the last digit's rounding."""
    return abs(float(one) - float(other)) < max(1.5 * last_digit(other), within)


def last_digit(number: str) -> float:
    """What a unit of a number's last digit is worth."""
    digits, _, power = number.partition("e")
    return 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


def pictures_of(outputs: list[Any]) -> list[np.ndarray]:
    """The pictures of a cell, (rows, cols, 3) of 0 to 255."""
    from PIL import Image

    found = []
    for item in outputs:
        data = item.get("data", {}).get("image/png")
        if data is not None:
            image = Image.open(io.BytesIO(base64.b64decode("".join(data))))
            found.append(np.asarray(image.convert("RGB"), dtype=float))
    return found


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """How far two pictures are apart, in the mean of the part that both have."""
    rows, cols = (min(one.shape[axis], other.shape[axis]) for axis in (0, 1))
    if (
        max(one.shape[0], other.shape[0]) > 1.1 * rows
        or max(one.shape[1], other.shape[1]) > 1.1 * cols
    ):
        return 255.0
    return float(np.abs(one[:rows, :cols] - other[:rows, :cols]).mean())


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::DeprecationWarning:nbclient.*")
@pytest.mark.filterwarnings("ignore::DeprecationWarning:jupyter_client.*")
@pytest.mark.filterwarnings("ignore::DeprecationWarning:jupyter_core.*")
@pytest.mark.filterwarnings("ignore::DeprecationWarning:zmq.*")
@pytest.mark.parametrize(
    "path",
    [pytest.param(p, marks=[pytest.mark.study] * (p.stem in SLOW), id=p.stem) for p in NOTEBOOKS],
)
def test_notebook_runs_to_its_end_and_gives_what_is_stored(
    path: Path, tmp_path: Path, own_kernel: str
) -> None:
    import nbclient
    import nbformat

    notebook = nbformat.read(path, as_version=4)
    client = nbclient.NotebookClient(
        notebook, timeout=NO_END_S, kernel_name=own_kernel,
        resources={"metadata": {"path": str(tmp_path)}},
    )  # fmt: skip
    try:
        client.execute()
    except nbclient.exceptions.CellExecutionError as error:
        pytest.fail(f"{path.name}: {error}", pytrace=False)
    ran = [cell for cell in notebook.cells if cell.cell_type == "code"]
    for number, (stored, now) in enumerate(zip(code_cells(path), ran, strict=True)):
        where = f"{path.name}, code cell {number}"
        found, kept = texts_of(now.outputs), texts_of(stored["outputs"])
        assert same_text(found, kept), f"{where}:\n{found}\nand not\n{kept}"
        pairs = zip(pictures_of(now.outputs), pictures_of(stored["outputs"]), strict=True)
        for one, other in pairs:
            assert difference(one, other) < ALIKE, f"{where}: its picture is another"


def test_a_text_that_drifts_is_noticed() -> None:
    assert same_text("load 62.00 ± 0.28 N, 6 frames", "load 61.99 ± 0.28 N, 6 frames")
    for other in (
        "load 61.98 ± 0.28 N",
        "load 62.00 ± 0.28 kN",
        "load 62 ± 0.28 N",
        "load 62.00 ± 0.25 N",
        "load -62.00 ± 0.28 N",
        "load 62.00 N",
    ):
        assert not same_text("load 62.00 ± 0.28 N", other)
    assert same_text("6e-06 ± 4.40e-05", "5e-06 ± 4.35e-05")
    assert same_text("chi 0.15130", "chi 0.15141")
    assert not same_text("chi 0.15130", "chi 0.15200")
    assert not same_text("6 frames", "7 frames")
