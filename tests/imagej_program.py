"""The real ImageJ, where it is: what it makes of a TIFF."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

IJ_JAR = Path("/usr/share/java/ij.jar")
"""Where Debian's package libij-java puts it."""
_NEEDED = f"{IJ_JAR} and javac (apt-get install libij-java default-jdk-headless)"


def read_by_imagej(*files: Path) -> list[dict[str, Any]]:
    """What ImageJ tells of files; skips the test where it is missing."""
    if not (IJ_JAR.is_file() and shutil.which("javac")):
        pytest.skip(f"NO TEST IN IMAGEJ: it needs {_NEEDED}")
    source = Path(__file__).parent / "ImageJReads.java"
    command = ["java", "-Djava.awt.headless=true", "-cp", str(IJ_JAR), str(source)]
    done = subprocess.run(
        [*command, *map(str, files)], capture_output=True, text=True, check=True, timeout=120
    )
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith(("{", "null"))]
