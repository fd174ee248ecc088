"""Fuzzing for as long as wanted; what is found is kept as files, with its traceback.

    python tests/fuzz/run.py --seconds 1800 --out findings [--target tiff --target mkv]

Each target runs in processes of its own, at low priority, with 2 GB for what it takes: guided by
coverage where atheris is installed, else by chance. A crash, more than 10 s or 1 GB for a file, or
anything but a refusal in one sentence is a finding. The exit code is 1 where there are any.
"""

import argparse
import hashlib
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
import traceback
from pathlib import Path

import numpy as np

GIGABYTE = 2**30
SLOW_S = 10.0


def limit_memory() -> None:
    """Allow 2 GB on top of what the libraries have already mapped."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    top = pages * os.sysconf("SC_PAGE_SIZE") + 2 * GIGABYTE
    resource.setrlimit(resource.RLIMIT_AS, (top, top))


def watched(target, data: bytes, path: Path, out: Path) -> bool:
    """Run a target on some bytes; keep them, and why, where it is a finding. Returns whether."""
    began, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    last = out / f"last-{os.getpid()}{target.suffix}"
    last.write_bytes(data)  # what a crash of the process leaves
    why = ""
    try:
        target.take(data, path)
    except BaseException:
        why = traceback.format_exc()
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    taken = time.process_time() - began
    if not why and taken > SLOW_S:
        why = f"slow: {taken:.1f} s of processor time"
    if not why and grown > GIGABYTE:
        why = f"memory: {grown / GIGABYTE:.2f} GB"
    last.unlink()
    if why:
        places = [line for line in why.splitlines() if line.startswith("  File")]
        name = hashlib.sha1("".join(places or [why[:6]]).encode()).hexdigest()[:12]
        kept = out / f"{name}{target.suffix}"
        if not kept.exists():
            kept.write_bytes(data)
            kept.with_suffix(".txt").write_text(why)
    return bool(why)


def by_chance(name: str, seconds: float, seed: int, out: Path) -> int:
    """Mutations of valid files for some time. Returns how many were run."""
    from mutate import mutated
    from targets import TARGETS

    target, rng = TARGETS[name], np.random.default_rng(seed)
    seeds = target.seeds()
    limit_memory()
    count, end = 0, time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"f{target.suffix}"
        while time.monotonic() < end:
            data = seeds[int(rng.integers(len(seeds)))]
            watched(target, mutated(data, rng, seeds, name in ("scene", "set")), path, out)
            count += 1
    return count


def by_coverage(name: str, seconds: float, seed: int, out: Path) -> None:
    """The same, guided by the lines that are reached; ends the process."""
    import atheris

    with atheris.instrument_imports(
        include=["isochrome", "tifffile", "roifile", "tomllib", "PIL"], enable_loader_override=False
    ):
        from mutate import mutated
        from targets import TARGETS
    target = TARGETS[name]
    seeds = target.seeds()
    folder = tempfile.mkdtemp()
    corpus = Path(folder) / "corpus"
    corpus.mkdir()
    for i, data in enumerate(seeds):
        (corpus / str(i)).write_bytes(data)
    path = Path(folder) / f"f{target.suffix}"
    counted = [0]

    def one(data: bytes) -> None:
        counted[0] += 1
        watched(target, data, path, out)

    def changed(data: bytes, size: int, number: int) -> bytes:
        rng = np.random.default_rng(number)
        if rng.random() < 0.3:
            return atheris.Mutate(data, size)
        return mutated(data, rng, seeds, name in ("scene", "set"))[:size]

    largest = max(map(len, seeds)) * 2
    argv = [sys.argv[0], str(corpus), f"-max_total_time={int(seconds)}", f"-seed={seed}",
            f"-max_len={largest}", "-rss_limit_mb=0", "-timeout=120", "-print_final_stats=1",
            f"-artifact_prefix={out}/native-{name}-"]  # fmt: skip
    atheris.Setup(argv, one, custom_mutator=changed)
    limit_memory()
    atheris.Fuzz()


def main() -> int:
    """Run the targets one after the other, each in a process, and say what was found."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--seconds", type=float, default=1800)
    arguments.add_argument("--out", type=Path, required=True)
    arguments.add_argument("--target", action="append")
    arguments.add_argument("--seed", type=int, default=int(time.time()))
    arguments.add_argument("--way", choices=("chance", "coverage"))
    arguments.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    given = arguments.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    if given.inside:
        (name,) = given.target
        if given.way == "coverage":
            by_coverage(name, given.seconds, given.seed, given.out)
        else:
            print(f"{name}: {by_chance(name, given.seconds, given.seed, given.out)} files")
        return 0
    from importlib.util import find_spec

    ways = [given.way] if given.way else ["chance", "coverage"]
    if find_spec("atheris") is None:
        ways = ["chance"]
    from targets import TARGETS

    names = given.target or list(TARGETS)
    each = given.seconds / len(names) / len(ways)
    os.nice(15)
    for name in names:
        for way in ways:
            left, seed = each, given.seed
            while left > 1:  # a crash of the process ends it early: go on with other numbers
                began = time.monotonic()
                command = [sys.executable, __file__, "--inside", "--target", name, "--seconds",
                           str(max(int(left), 2)), "--out", str(given.out), "--seed", str(seed),
                           "--way", way]  # fmt: skip
                with tempfile.TemporaryDirectory() as scratch:  # libFuzzer ends without clearing up
                    done = subprocess.run(
                        command, capture_output=True, text=True, check=False,
                        env=os.environ | {"TMPDIR": scratch},
                    )  # fmt: skip
                left -= time.monotonic() - began
                seed += 1
                runs = re.search(r"executed_units: *([0-9]+)", done.stderr)
                said = f"{name}: {runs[1]} files" if runs else done.stdout.strip()[-80:]
                print(way, said, f"exit {done.returncode}" if done.returncode else "", flush=True)
                if done.returncode < 0 or (done.returncode and way == "chance"):
                    (given.out / f"native-{name}-{seed}.txt").write_text(done.stderr[-4000:])
    found = sorted(p.name for p in given.out.iterdir() if not p.name.startswith("."))
    print(f"{len(found)} files in {given.out}: {', '.join(found)}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
