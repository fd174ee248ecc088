"""The guide's pages are there, and those made from the code say all that the code has."""

import ast
import io
import re
import string
from pathlib import Path

import file_columns
import message_page
import pytest
import scene_keys
from write_pages import COMMAND, GUIDE, PAGES

from isochrome import messages
from isochrome.calibration import CalibrationSet, ColourSet
from isochrome.errors import InputError
from isochrome.guide import TOPICS, guide_page
from isochrome.messages import entries
from isochrome.scene import Scene
from isochrome.simulation import LAYERS
from package_code import modules, nodes

BY_HAND = [topic for topic in TOPICS if topic not in PAGES]


@pytest.mark.parametrize("topic", PAGES)
def test_a_page_is_what_the_code_says(topic):
    told = f"the page is older than the code: run `{COMMAND}` and commit what it wrote"
    assert guide_page(topic) == PAGES[topic](), told


def test_every_page_is_a_topic_with_its_title_and_others_are_refused():
    assert {path.stem for path in GUIDE.glob("*.md")} == set(TOPICS)
    for topic in TOPICS:
        assert guide_page(topic).startswith("# "), topic
        assert topic in guide_page()
    with pytest.raises(InputError, match="did you mean 'phase-steps'"):
        guide_page("phase-step")


@pytest.mark.parametrize("model", [Scene, CalibrationSet, ColourSet])
def test_every_key_has_words(model):
    """And a line in the page, under its own table."""
    page = guide_page("scene-keys")
    for at, table, _ in scene_keys.tables(model):
        texts = scene_keys.words_of(table)
        missing = [
            name
            for name, field in table.model_fields.items()
            if name not in scene_keys.NO_KEYS and not texts.get(name)
        ]
        assert not missing, (
            f"{at}: no words for {missing}; write each under Parameters in the docstring of "
            f"{table.__name__}, then run `{COMMAND}`"
        )
        assert at == "[top]" or f"### `{at}`" in page


def test_keys_are_shown_with_their_range_unit_and_default():
    page = guide_page("scene-keys")
    assert "| `poisson` | number > -1, ≤ 0.5 | – | absent | Poisson's ratio. |" in page
    assert "| `coefficient_mm2_per_n` | number ≥ 0 or a table over distance | mm²/N |" in page
    assert "| `gamma` | number ≥ 0.1, ≤ 10 | – | `1.0` |" in page
    assert "| mm/s |" in page and "| MPa/mm |" in page


def test_every_file_has_words_and_no_words_are_of_none():
    missing = sorted(file_columns.left_by_the_code() - set(file_columns.files()))
    assert not missing, (
        f"no words for the files {missing}; write [command, when, what it is] of each in "
        f"tests/guide/files.toml, then run `{COMMAND}`"
    )
    made = {"imagej", "records"} | {
        f"{name}.{end}" for name in ("calibration", "scale") for end in ("json", "png")
    }
    made |= {"background.tif", "illumination.tif", "residual_order.tif", "residual_isoclinic.tif"}
    made |= {"sigma_1_mpa.tif", "sigma_2_mpa.tif", "demo.json"}  # their names are put together
    made |= {f"{name}.tif" for name in LAYERS}
    assert set(file_columns.files()) - file_columns.left_by_the_code() <= made


def test_a_new_column_would_be_noticed():
    """Of every table that any test lets the package write: see conftest.py."""
    known = file_columns.columns()
    assert file_columns.has_words("load.normal_n standard_uncertainty", known)
    assert file_columns.has_words("load.normal_n mean", known)
    assert not file_columns.has_words("shininess", known)
    assert not file_columns.has_words("load.normal_n shininess", known)


def test_every_message_has_its_words_and_every_word_its_message():
    """Each code that the code names is in the table, with its values; none is of nobody."""
    named = message_page.named_codes()
    assert set(named) == set(message_page.TEXTS)
    for code, places in named.items():
        text = message_page.TEXTS[code]
        wanted = {field for _, field, _, _ in string.Formatter().parse(text) if field}
        wanted |= set(re.findall(r":[^{}]*\{(\w+)\}", text))  # a number of digits
        for place, values in places:
            assert values == wanted, f"{place}: {code} has the values {wanted}, not {values}"


def test_every_entry_is_complete_and_no_code_stands_twice():
    assert len({entry.title for entry in entries()}) == len(entries())
    codes = [code for entry in entries() for code in entry.texts]
    table = Path(messages.__file__).with_name("messages.json").read_text("utf-8")
    assert len(re.findall('(?m)^   "', table)) == len(codes)  # the last of two would be the one
    assert len(codes) == len(set(codes)) and all(re.fullmatch("[a-z0-9_]+", c) for c in codes)
    for entry in entries():
        assert all(part.endswith(".") for part in (entry.meaning, entry.cause, entry.remedy))
        assert entry.texts, entry.title


def test_refusals_are_raised_with_messages_alone():
    """A sentence of many words that is raised without a code would be in no table."""
    bare = [
        f"{path.name}:{node.lineno}"
        for path in modules()
        for node in nodes(path)
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)
        if getattr(node.exc.func, "id", "") != "PydanticCustomError"  # becomes a key's message
        for given in node.exc.args
        if getattr(given, "value", None) not in message_page.TEXTS
        if len(re.findall("[A-Za-z]{2,}", fixed_words(given))) >= 4
    ]
    assert not bare, f"sentences without a code; put their words into messages.json: {bare}"


def fixed_words(node: ast.expr) -> str:
    """The text of a literal, or of the literal parts of an f-string."""
    parts = node.values if isinstance(node, ast.JoinedStr) else [node]
    return " ".join(str(part.value) for part in parts if isinstance(part, ast.Constant))


@pytest.mark.parametrize("topic", BY_HAND)
def test_topics_that_a_page_names_are_there(topic):
    named = set(re.findall(r"`isochrome guide ([a-z-]+)`", guide_page(topic)))
    assert named <= {*TOPICS, "topic"}


@pytest.mark.parametrize("topic", BY_HAND)
def test_a_terminal_shows_a_page(topic):
    from rich.console import Console
    from rich.markdown import Markdown

    console = Console(width=100, record=True, file=io.StringIO())
    console.print(Markdown(guide_page(topic)))
    shown = console.export_text()
    assert len(shown) > 300 and "```" not in shown
