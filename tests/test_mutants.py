"""The list of changes made on purpose, and that its runner tells a test that notices from one not.

What the whole list comes to is measured by `python tests/mutants.py --long`, an hour's work.
"""

import ast
from collections import defaultdict

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


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A package of one constant, and for its tests a word on what they say of it: of a sample of
    the list `.ci/run` runs the tests themselves."""
    (tmp_path / "tree" / "src" / "isochrome").mkdir(parents=True)
    module = tmp_path / "tree" / "src" / "isochrome" / "__init__.py"
    module.write_text("THREE = 3\n")

    def run_tests(copy, tests, long):
        three = (copy / "src" / "isochrome" / "__init__.py").read_text() == "THREE = 3\n"
        passes = {"sees it": three, "does not": True, "fails anyway": False}
        return ("passed" if all(passes[name] for name in tests) else "failed"), ""

    monkeypatch.setattr("mutants.run_tests", run_tests)
    return tmp_path / "tree"


def judged(tree, test):
    mutant = Mutant("three is three", "THREE = 3", "THREE = 4", (test,))
    verdicts = judge_all([mutant], tree, 1, lambda *_: None)
    assert (tree / "src" / "isochrome" / "__init__.py").read_text() == "THREE = 3\n"
    return verdicts["three is three"]


def test_a_change_survives_a_test_that_does_not_see_it_and_one_that_fails_anyway_is_none(tree):
    assert (judged(tree, "sees it"), judged(tree, "does not")) == ("noticed", "survives")
    with pytest.raises(RuntimeError, match="fail without a change"):
        judged(tree, "fails anyway")


def kinds_of_tests(text):
    """The names of all tests of a file, each with whether some of it runs by default, and long."""
    kinds = {}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            marks = [ast.unparse(mark) for mark in node.decorator_list]
            whole = not {"pytest.mark.long", "pytest.mark.study"}.isdisjoint(marks)
            some = any("mark.long" in mark or "mark.study" in mark for mark in marks)
            kinds[node.name] = not whole, some
    return kinds


@pytest.mark.long
def test_each_change_of_the_list_can_be_made_and_names_tests_that_exist():
    mutants, modules = read_mutants(LIST), sources(ROOT)
    assert len({m.promise for m in mutants}) == len(mutants) >= 200
    wrong = find_faults(mutants, modules)
    files = defaultdict(dict)
    for path in (ROOT / "tests").rglob("test_*.py"):
        files[path.relative_to(ROOT).as_posix()] = kinds_of_tests(path.read_text("utf-8"))
    for mutant in mutants:
        for test, kind in [(t, 0) for t in mutant.tests] + [(t, 1) for t in mutant.long]:
            path, _, name = test.partition("::")
            name = name.partition("[")[0].rpartition("::")[2]
            if name not in files[path] if name else path not in files:
                wrong.append(f"{mutant.promise}: no test {test}")
            elif name and not files[path][name][kind]:
                wrong.append(f"{mutant.promise}: {test} {('is', 'is not')[kind]} marked long")
    assert not wrong, "\n".join(wrong)


ROOMS = (
    "contact", "stress", "optics", "scene", "simulation", "sweeps", "frames", "fringes", "fitting",
    "calibration", "processing", "campaigns", "comparison", "runs", "output",
)  # fmt: skip


def test_no_room_is_left_out():
    modules = sources(ROOT)
    rooms = [room(find_place(m, modules), ROOT) for m in read_mutants(LIST)]
    assert {r for r in ROOMS if rooms.count(r) < 4} == set()
