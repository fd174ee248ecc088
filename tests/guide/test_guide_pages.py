"""The guide's pages are there, and those made from the code say all that the code has."""

import ast
import io
import re

import file_columns
import message_texts
import pytest
import scene_keys
from write_pages import COMMAND, GUIDE, PAGES

from isochrome.calibration import CalibrationSet, ColourSet
from isochrome.errors import InputError
from isochrome.guide import TOPICS, guide_page
from isochrome.scene import Scene
from isochrome.simulation import LAYERS

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


def test_every_message_has_its_meaning_cause_and_remedy():
    explained, silent = message_texts.explained(), message_texts.no_messages()
    missing = {
        text: place
        for text, place in message_texts.texts().items()
        if explained[text] is None and not any(w in text for w in silent)
    }
    assert not missing, (
        f"no words for the messages {missing}; put some fixed words of each under `words` of an "
        "entry of tests/guide/messages.toml whose meaning, cause and remedy are right for it, or "
        f"write one (a label goes to no_messages), then run `{COMMAND}`"
    )


def test_every_entry_is_whole_and_is_for_a_message_that_the_code_has():
    said, known = list(message_texts.texts()), message_texts.entries()
    words = [w for entry in known for w in entry.words]
    stale = [w for w in words + message_texts.no_messages() if not any(w in t for t in said)]
    assert not stale, f"no message has these words any more; remove them: {stale}"
    assert len(words) == len(set(words)) and all(len(w) >= 7 for w in words)
    titles = [entry.title for entry in known]
    used = {id(entry) for entry in message_texts.explained().values()}
    assert len(titles) == len(set(titles))
    for entry in known:
        assert all(part.endswith(".") for part in (entry.meaning, entry.cause, entry.remedy))
        assert id(entry) in used, entry.title


def test_messages_are_read_from_the_code_and_its_refusals_on_the_page():
    code = '''
def f(x):
    """This docstring is no message at all."""
    if x:
        raise InputError(f"{x}: is bad; mend it")
    y = "a sentence that is a warning, of many words"
    return _damaged("half of it"), "short label"
'''
    found = set(message_texts.texts_of(list(ast.walk(ast.parse(code)))))
    assert found == {"…: is bad; mend it", "a sentence that is a warning, of many words"}
    page = guide_page("messages")
    assert "fringes finer than two pixels" in page and "nothing could be read in any" in page


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
