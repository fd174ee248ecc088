"""The list of changes made on purpose, and that its runner tells a test that notices from one not.

What the whole list comes to is measured by `python tests/mutants.py --long`, an hour's work.
"""

import ast
from pathlib import Path

import pytest

from mutants import (
    LIST,
    ROOT,
    Mutant,
    find_faults,
    find_place,
    judge_all,
    read_mutants,
    room,
    sources,
)


def place(root: Path, test: str) -> None:
    """A package of one constant, and a test of it."""
    (root / "src" / "isochrome").mkdir(parents=True)
    (root / "src" / "isochrome" / "__init__.py").write_text('"""A package."""\nTHREE = 3\n')
    (root / "tests").mkdir()
    (root / "tests" / "test_it.py").write_text(
        f"import isochrome\n\n\ndef test_it():\n    {test}\n"
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("test", "verdict"),
    [
        # what is noticed, `.ci/run` asks of a sample of the list
        pytest.param("assert isochrome.THREE == 3", "noticed", marks=pytest.mark.study),
        ("assert isochrome.THREE < 9", "survives"),
    ],
)
def test_a_change_survives_a_test_that_does_not_see_it(tmp_path, test, verdict):
    root = tmp_path / "tree"
    place(root, test)
    mutant = Mutant("three is three", "THREE = 3", "THREE = 4", ("tests/test_it.py::test_it",))
    verdicts = judge_all([mutant], root, 1, lambda *_: None)
    assert verdicts == {"three is three": verdict}
    assert "THREE = 3" in (root / "src" / "isochrome" / "__init__.py").read_text()


@pytest.mark.long
def test_a_test_that_fails_anyway_judges_nothing(tmp_path):
    root = tmp_path / "tree"
    place(root, "assert isochrome.THREE == 2")
    mutant = Mutant("three is three", "THREE = 3", "THREE = 4", ("tests/test_it.py",))
    with pytest.raises(RuntimeError, match="fail without a change"):
        judge_all([mutant], root, 1, lambda *_: None)


@pytest.mark.long
def test_each_change_of_the_list_can_be_made_and_names_tests_that_exist():
    mutants, modules = read_mutants(LIST), sources(ROOT)
    assert len({m.promise for m in mutants}) == len(mutants) >= 200
    wrong = find_faults(mutants, modules)
    for mutant in mutants:
        for test in (*mutant.tests, *mutant.long):
            path, _, name = test.partition("::")
            name = name.partition("[")[0].rpartition("::")[2]
            if not (ROOT / path).exists() or (name and f"def {name}(" not in functions(path)):
                wrong.append(f"{mutant.promise}: no test {test}")
    assert not wrong, "\n".join(wrong)


def functions(path: str) -> str:
    """The heads of all functions of a test file."""
    tree = ast.parse((ROOT / path).read_text("utf-8"))
    return "\n".join(f"def {n.name}(" for n in ast.walk(tree) if isinstance(n, ast.FunctionDef))


ROOMS = (
    *(
        "contact",
        "stress",
        "optics",
        "scene",
        "simulation",
        "sweeps",
        "frames",
        "fringes",
        "fitting",
    ),
    *("calibration", "processing", "campaigns", "comparison", "runs", "output"),
)


def test_no_room_is_left_out():
    modules = sources(ROOT)
    rooms = [room(find_place(m, modules), ROOT) for m in read_mutants(LIST)]
    assert {r for r in ROOMS if rooms.count(r) < 4} == set()
