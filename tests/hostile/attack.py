"""A hostile case, and the command line run on it in a process with bounds."""

import ctypes
import gc
import multiprocessing
import os
import re
import resource
import sys
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

MEMORY = 2_000_000_000
"""Bytes that a run may take."""

CPU_S, WALL_S = 40, 900
"""Seconds that a run may compute, four times the longest, and after which one hangs: machines are
slow and loaded."""

SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(
    ["isochrome.cli", "isochrome.processing.api", "isochrome.processing.kinds.image_only",
     "isochrome.fitting.api", "isochrome.simulation.api",
     "isochrome.calibration.four_point_bending", "isochrome.comparison.api",
     "isochrome.runs.store", "isochrome.sweeps.api",
     "matplotlib.figure", "xarray", "zarr", "cv2", "tifffile", "PIL.Image", "roifile", "av",
     "rich.progress", "numpy.ma", "filelock", "threadpoolctl", "tomlkit", "typer._adapters"]
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A hostile input: `make(place)` writes it into a folder and returns the command's arguments.
    `says`, words that the refusal must hold: what is wrong where, and what to do; `code`, the exit
    code; `file_bytes`, the largest file that may be written; `inside`, called in the process before
    the command; `kept`, whether finished work may stay in OUT.partial."""

    make: Callable[[Path], list[str]]
    says: tuple[str, ...]
    code: int = 2
    file_bytes: int | None = None
    inside: Callable[[], None] | None = None
    kept: bool = False
    label: str = ""
    touches: bool = False

    @property
    def name(self) -> str:
        return self.label or self.make.__name__.replace("_", " ")


@dataclass(frozen=True)
class Ended:
    """How a command ended: exit code (None: it hung), what it said, and its peak memory (bytes)."""

    code: int | None
    out: str
    err: str
    peak: int


def hostile(cases: list[Case], *says: str, **how: object) -> Callable[[Callable], Callable]:
    """Put a function down as a case in a list."""

    def add(make: Callable[[Path], list[str]]) -> Callable[[Path], list[str]]:
        cases.append(Case(make, says, **how))  # type: ignore[arg-type]
        return make

    return add


def case(
    cases: list[Case], name: str, make: Callable[[Path], list[str]], *says: str, **how: object
) -> None:
    """Put a case of a few words down in a list."""
    cases.append(Case(make, says, label=name, **how))  # type: ignore[arg-type]


def after(
    do: Callable[[Path], object], then: list[str] | Callable[[Path], list[str]]
) -> Callable[[Path], list[str]]:
    """What makes a case: something is done in its folder, and then there are arguments."""

    def make(place: Path) -> list[str]:
        do(place)
        return then(place) if callable(then) else then

    return make


def snapshot(place: Path) -> dict[str, object]:
    """All names below a folder, hidden ones too, with bytes, or where a link points."""
    found: dict[str, object] = {}
    for folder, names, files in os.walk(place):
        for name in (*names, *files):
            path = Path(folder, name)
            key = os.fsencode(path.relative_to(place)).hex(" ")
            if path.is_symlink():
                found[key] = os.readlink(path)
            elif path.is_file() and os.access(path, os.R_OK):
                state = path.stat()
                small = state.st_size < 10**8
                found[key] = path.read_bytes() if small else (state.st_size, state.st_mtime_ns)
            else:
                found[key] = path.lstat().st_mode
    return found


def run(
    place: Path,
    arguments: list[str],
    *,
    file_bytes: int | None = None,
    inside: Callable[[], None] | None = None,
) -> Ended:
    """Run the command line in a folder, in a process of its own."""
    pipes = [SERVER.Pipe(duplex=False) for _ in range(3)]  # what is said, and the peak
    process = SERVER.Process(
        target=_in_process,
        args=(arguments, place, file_bytes, inside, [theirs for _, theirs in pipes]),
    )
    process.start()
    for _, theirs in pipes:
        theirs.close()
    process.join(WALL_S)
    code = process.exitcode
    if code is None:
        process.kill()
        process.join()
    out, err, peak = (_all_of(mine.fileno()) for mine, _ in pipes)
    return Ended(code, out, err, int(peak or 0))


def _all_of(handle: int) -> str:
    """What was put into a pipe, all of whose writers have ended."""
    found = b""
    while more := os.read(handle, 65536):
        found += more
    return found.decode("utf-8", "backslashreplace")


def _in_process(
    arguments: list[str],
    place: Path,
    file_bytes: int | None,
    inside: Callable[[], None] | None,
    pipes: list[Connection],
) -> None:
    gc.freeze()  # what was imported is not looked through, nor copied
    for number, pipe in enumerate(pipes[:2], start=1):
        os.dup2(pipe.fileno(), number)
    os.chdir(place)
    _give_up_rights()
    taken = int(re.search(r"VmSize:\s*(\d+)", Path("/proc/self/status").read_text())[1]) * 1024
    for kind, most in (
        (resource.RLIMIT_AS, taken + MEMORY),
        (resource.RLIMIT_CPU, CPU_S),
        (resource.RLIMIT_FSIZE, file_bytes),
        (resource.RLIMIT_CORE, 0),
    ):
        if most is not None:
            resource.setrlimit(kind, (most, most))
    sys.argv = ["isochrome", *arguments]
    from isochrome.cli import main

    if inside is not None:
        inside()
    try:
        main()
    finally:
        sys.stdout.flush()
        peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        os.write(pipes[2].fileno(), str(peak).encode())


def _give_up_rights() -> None:
    """Without its capabilities root may read and write what a file's mode allows, and no more."""
    head, none = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
    assert ctypes.CDLL(None, use_errno=True).capset(head, none) == 0, os.strerror(
        ctypes.get_errno()
    )
