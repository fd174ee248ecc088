"""Run notebooks and store their outputs, pictures in few colours: `python tests/store_notebooks.py
[NAME...]`."""

import base64
import io
import sys
import tempfile
from pathlib import Path

import nbclient
import nbformat
from PIL import Image

FOLDER = Path(__file__).parents[1] / "notebooks"
COLOURS = 64
KERNEL = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}


def few_colours(png: str) -> str:
    """A picture (PNG, base64) in few colours."""
    picture = Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB")
    few = picture.quantize(COLOURS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    few.save(buffer, "png", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def store(path: Path) -> None:
    """Run a notebook in a folder of its own, and write it with what its cells gave."""
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as work:
        resources = {"metadata": {"path": work}}
        nbclient.NotebookClient(notebook, timeout=1800, resources=resources).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        for item in cell.get("outputs", []):
            if "image/png" in item.get("data", {}):
                item["data"]["image/png"] = few_colours(item["data"]["image/png"])
    notebook.metadata = nbformat.from_dict(KERNEL)
    nbformat.write(notebook, path)


if __name__ == "__main__":
    for name in sys.argv[1:] or sorted(path.stem for path in FOLDER.glob("*.ipynb")):
        store(FOLDER / f"{name}.ipynb")
