"""Changes made on purpose to the code, one at a time: a promise that no test holds survives them.

    python tests/mutants.py [FILE] [--only WORDS] [--sample N] [--long] [--processes N]

FILE is `tests/mutants.toml`, a list of

    [[mutant]]
    promise = "the worn area is that of the load"   # what is lost; one sentence
    text = "depth += step * k * p"                  # stands exactly once in the package
    change = "depth += step * k"
    tests = ["tests/contact/test_contact_wear.py::test_area"]   # default tests, of which one fails
    long = []              # optional: tests marked `long`, where no default test notices it
    equivalent = ""        # optional: why no test can notice it

The place is named by its text, so that it is found again when code moves. Each change is made in
a copy of the tree, never in the tree itself. First the named tests run unchanged: a test that
fails anyway would notice everything. A change is noticed when a test fails or does not end. The
exit code is 1 where a change survives the tests that are to notice it, or where fewer are noticed
than the project promises: 90 of 100 by the default tests, 95 with the long ones.
"""

import argparse
import ast
import compileall
import contextlib
import os
import py_compile
import queue
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIST = ROOT / "tests" / "mutants.toml"

NO_END_S = 600.0
"""A test of a few seconds that takes so long hangs, on a loaded machine too."""

BY_DEFAULT, WITH_LONG = 0.90, 0.95
"""The shares of all changes, equivalent ones aside, that are to be noticed."""

SEED = 14
"""Of the sample: the same changes each time, so that a failure can be run again."""


@dataclass(frozen=True)
class Mutant:
    """A change of the code, and the tests that are to notice it."""

    promise: str
    text: str
    change: str
    tests: tuple[str, ...] = ()
    long: tuple[str, ...] = ()
    equivalent: str = ""


def read_mutants(path: Path) -> list[Mutant]:
    """The list in a file. Raises TypeError for a key that means nothing."""
    entries = tomllib.loads(path.read_text("utf-8"))["mutant"]
    return [
        Mutant(**{k: tuple(v) if isinstance(v, list) else v for k, v in entry.items()})
        for entry in entries
    ]


def sources(root: Path) -> dict[Path, str]:
    """Every module of the package with its text."""
    return {p: p.read_text("utf-8") for p in sorted((root / "src" / "isochrome").rglob("*.py"))}


def find_place(mutant: Mutant, modules: dict[Path, str]) -> Path:
    """The one module that holds the text. Raises ValueError where there is not just one."""
    places = [path for path, text in modules.items() for _ in range(text.count(mutant.text))]
    if len(places) != 1:
        raise ValueError(f"the text stands {len(places)} times in the package")
    return places[0]


@lru_cache(maxsize=4)
def spans(text: str) -> list[tuple[int, int]]:
    """First and last line of each statement of a module, which many changes share."""
    return [
        (min(n.lineno for n in (node, *getattr(node, "decorator_list", ()))), node.end_lineno or 0)
        for node in ast.parse(text).body
    ]


def same_with(change: Mutant, text: str) -> bool:
    """Whether a module means the same with a change, whatever its layout."""
    first = text[: text.index(change.text)].count("\n") + 1
    last = first + change.text.count("\n")
    touched = [span for span in spans(text) if span[0] <= last and span[1] >= first]
    if not touched:
        return True
    lines = text.splitlines(keepends=True)[touched[0][0] - 1 : touched[-1][1]]
    old = "".join(lines)
    new = old.replace(change.text.strip("\n"), change.change.strip("\n"))
    return ast.dump(ast.parse(old)) == ast.dump(ast.parse(new))


def apply_change(mutant: Mutant, modules: dict[Path, str]) -> tuple[Path, str]:
    """The module and its changed text. Raises ValueError, SyntaxError where it is no change."""
    path = find_place(mutant, modules)
    before, behind = modules[path].split(mutant.text)
    if same_with(mutant, modules[path]):
        raise ValueError("the change changes nothing")
    return path, before + mutant.change + behind


def find_faults(mutants: Iterable[Mutant], modules: dict[Path, str]) -> list[str]:
    """What is wrong with entries of the list: a text that is not there, a change that is none."""
    faults = []
    for mutant in mutants:
        try:
            apply_change(mutant, modules)
        except (ValueError, SyntaxError) as error:
            faults.append(f"{mutant.promise}: {error}")
    return faults


def room(path: Path, root: Path) -> str:
    """The room of the house in which a module stands."""
    return path.relative_to(root / "src" / "isochrome").parts[0].removesuffix(".py")


def copy_tree(root: Path, home: Path) -> Path:
    """A copy of the tree to change, compiled; the folder of shared frames stays beside it."""
    ignore = shutil.ignore_patterns(".git", ".venv", ".*_cache", "__pycache__")
    tree = Path(shutil.copytree(root, home / root.name, ignore=ignore))
    if (root.parent / "shared").exists():
        (home / "shared").symlink_to((root.parent / "shared").resolve())
    # checked by content: a change within the same second and of the same size is seen
    mode = py_compile.PycInvalidationMode.CHECKED_HASH
    compileall.compile_dir(tree / "src", quiet=1, invalidation_mode=mode)
    return tree


_NONE_FOUND = 5
"""What pytest ends with where no test is of the kind."""


def run_tests(tree: Path, tests: Iterable[str], long: bool) -> tuple[str, str]:
    """Run default or long tests in a copy, studies after what is run always.

    Returns passed, failed, no end or error; and the output.
    """
    outcomes = {0: "passed", 1: "failed", None: "no end"}
    result = "error", "no test is of the kind"
    for kind in ("long and not study", "study") if long else ("not long",):
        code, printed = _run_kind(tree, tests, kind)
        if code != _NONE_FOUND:
            result = outcomes.get(code, "error"), printed
            if code != 0:
                break
    return result


def _run_kind(tree: Path, tests: Iterable[str], kind: str) -> tuple[int | None, str]:
    """The exit code of the tests of a kind, None where they do not end, and what they print."""
    own = {"PYTHONPATH": str(tree / "src"), "PYTHONDONTWRITEBYTECODE": "1", "CI": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-p", "no:cacheprovider", "-m", kind, *tests]
    process = subprocess.Popen(
        command, cwd=tree, env=os.environ | {"OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg"} | own,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        start_new_session=True,
    )  # fmt: skip
    try:
        printed, _ = process.communicate(timeout=NO_END_S)
    except subprocess.TimeoutExpired:
        return None, ""
    finally:  # what the tests had started ends with them
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return process.returncode, printed


def judge(mutant: Mutant, tree: Path) -> str:
    """Make a change in a copy, run its tests, and take it back. Returns noticed, survives, …"""
    modules = sources(tree)
    path, changed = apply_change(mutant, modules)
    path.write_text(changed, "utf-8")
    try:
        outcome, printed = run_tests(tree, mutant.tests or mutant.long, not mutant.tests)
    finally:
        path.write_text(modules[path], "utf-8")
    if outcome == "error":  # a change that cannot even be imported proves nothing
        return "error: " + (printed.strip().splitlines() or ["nothing printed"])[-1]
    return {"passed": "survives", "failed": "noticed"}.get(outcome, outcome)


def judge_all(
    mutants: Sequence[Mutant],
    root: Path,
    processes: int,
    tell: Callable[[Mutant, str, float], None],
) -> dict[str, str]:
    """Judge changes, several at a time, each process in its own copy. Returns promise to verdict.

    Raises RuntimeError where a named test fails without any change.
    """
    trees: queue.Queue[Path] = queue.Queue()

    def unchanged(tests: Sequence[str], long: bool) -> None:
        tree = trees.get()
        outcome, printed = run_tests(tree, tests, long)
        trees.put(tree)
        if outcome != "passed":
            raise RuntimeError(f"the tests fail without a change:\n{printed[-4000:]}")

    def one(mutant: Mutant) -> str:
        tree, began = trees.get(), time.monotonic()
        verdict = judge(mutant, tree)
        trees.put(tree)
        tell(mutant, verdict, time.monotonic() - began)
        return verdict

    default = sorted({test for m in mutants for test in m.tests})
    long = sorted({test for m in mutants if not m.tests for test in m.long})
    with tempfile.TemporaryDirectory() as home, ThreadPoolExecutor(processes) as pool:
        for number in range(processes):
            trees.put(copy_tree(root, Path(home) / str(number)))
        shares = [(default[n::processes], False) for n in range(processes)]
        shares += [([test], True) for test in long]
        for run in [pool.submit(unchanged, *share) for share in shares if share[0]]:
            run.result()
        return dict(zip([m.promise for m in mutants], pool.map(one, mutants), strict=True))


def summarise(mutants: Sequence[Mutant], verdicts: dict[str, str], root: Path) -> tuple[str, bool]:
    """A table by room, and whether what the project promises holds for the changes judged."""
    modules = sources(root)
    rows: dict[str, Counter[str]] = {}
    for mutant in mutants:
        row = rows.setdefault(room(find_place(mutant, modules), root), Counter())
        verdict = verdicts.get(mutant.promise, "no test" if not mutant.long else "not run")
        noticed = verdict in ("noticed", "no end")
        row["equivalent" if mutant.equivalent else "tried"] += 1
        if not mutant.equivalent and noticed:
            row["default" if mutant.tests else "long"] += 1
    total = sum(rows.values(), Counter())
    lines = ["room         tried  by default  with long  equivalent"]
    for name, row in [*sorted(rows.items()), ("all", total)]:
        both = row["default"] + row["long"]
        lines.append(
            f"{name:12} {row['tried']:5} {row['default']:11} {both:10} {row['equivalent']:11}"
        )
    tried = max(total["tried"], 1)
    kept = total["default"] / tried >= BY_DEFAULT
    if any(m.long and m.promise in verdicts for m in mutants):
        kept &= (total["default"] + total["long"]) / tried >= WITH_LONG
    return "\n".join(lines), kept


def choose(mutants: list[Mutant], only: str, sample: int | None) -> list[Mutant]:
    """Those whose promise holds some words; of these, a seeded sample that default tests notice."""
    chosen = [m for m in mutants if only in m.promise]
    if sample is None:
        return chosen
    quick = [m for m in chosen if m.tests and not m.equivalent]
    return random.Random(SEED).sample(quick, min(sample, len(quick)))


def main() -> int:
    parser = argparse.ArgumentParser(description="Change the code; see which tests notice.")
    parser.add_argument("file", type=Path, nargs="?", default=LIST)
    parser.add_argument("--only", default="", help="words of the promise")
    parser.add_argument("--sample", type=int, nargs="?", const=10, help="judge only so many")
    parser.add_argument("--long", action="store_true", help="run the tests marked long too")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    chosen = choose(read_mutants(options.file), options.only, options.sample)
    if faults := find_faults(chosen, sources(ROOT)):
        parser.error("\n".join(faults))
    work = [m for m in chosen if not m.equivalent and (m.tests or (m.long and options.long))]

    def tell(mutant: Mutant, verdict: str, seconds: float) -> None:
        print(f"{verdict:9} {seconds:6.1f} s  {mutant.promise}", flush=True)

    verdicts = judge_all(work, ROOT, options.processes, tell)
    table, kept = summarise(chosen, verdicts, ROOT)
    print(table)
    return 0 if kept and all(v in ("noticed", "no end") for v in verdicts.values()) else 1


if __name__ == "__main__":
    raise SystemExit(main())
