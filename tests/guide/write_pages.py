"""Write the pages of the guide that are made from the code: `python tests/guide/write_pages.py`."""

import sys
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parent))

import file_columns
import message_page
import scene_keys

import isochrome

GUIDE = Path(isochrome.__file__).parent / "guide"
PAGES: dict[str, Callable[[], str]] = {
    "scene-keys": scene_keys.page, "files": file_columns.page, "messages": message_page.page,
}  # fmt: skip
COMMAND = "python tests/guide/write_pages.py"


def main() -> None:
    for topic, page in PAGES.items():
        (GUIDE / f"{topic}.md").write_text(page(), "utf-8")


if __name__ == "__main__":
    main()
