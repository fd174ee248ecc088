"""A short run of the fuzzer over all targets; the long one is `python tests/fuzz/run.py`."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mutate import mutated
from run import watched
from targets import TARGETS, Target

FILES = 150

NO_END_S = 1800
"""A run of some ten seconds that takes so long hangs, on a loaded machine too."""


@pytest.mark.parametrize("name", TARGETS)
def test_valid_files_are_read(name, tmp_path):
    target = TARGETS[name]
    seeds = target.seeds()
    assert seeds
    for data in seeds:
        assert target.take(data, tmp_path / f"f{target.suffix}") is None


@pytest.mark.long
@pytest.mark.parametrize("name", TARGETS)
def test_changed_files_are_read_or_refused_in_a_sentence(name, tmp_path):
    target, rng = TARGETS[name], np.random.default_rng(7)
    seeds, path, out = target.seeds(), tmp_path / f"f{target.suffix}", tmp_path / "out"
    out.mkdir()
    for _ in range(FILES):
        watched(target, mutated(seeds[int(rng.integers(len(seeds)))], rng, seeds,
                                name in ("scene", "set")), path, out)  # fmt: skip
    assert [p.read_text()[-2000:] for p in out.glob("*.txt")] == []


def test_a_finding_is_kept_with_its_reason(tmp_path):
    def fails(path):
        raise KeyError("lost")

    target = Target(".bin", fails, lambda: [b"x"])
    assert watched(target, b"abc", tmp_path / "f.bin", tmp_path)
    (kept,) = tmp_path.glob("*.txt")
    assert (
        "KeyError: 'lost'" in kept.read_text() and kept.with_suffix(".bin").read_bytes() == b"abc"
    )


@pytest.mark.long
@pytest.mark.parametrize("way", ["chance", pytest.param("coverage", marks=pytest.mark.study)])
def test_the_command_for_long_runs(way, tmp_path):
    if way == "coverage":
        pytest.importorskip("atheris", reason="atheris is there for Linux on x86-64 alone")
    command = [sys.executable, str(Path(__file__).parent / "run.py"), "--seconds", "4", "--target",
               "pgm", "--way", way, "--out", str(tmp_path)]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=NO_END_S)
    assert done.returncode == 0 and "pgm: " in done.stdout, done.stdout + done.stderr
