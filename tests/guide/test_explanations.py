"""What a message means: found by its words, whatever the values in it."""

import message_texts
import pytest

from isochrome.guide import explain_message

SHORTEST = 12
"""Letters of a message that is to be recognised."""

VALUES = ("17", "a name <b> with “marks” and [brackets].tif")


@pytest.mark.parametrize("value", VALUES)
def test_every_message_of_the_code_is_explained_by_its_own_entry(value):
    """Or by one of a longer message, in which it stands as a part."""
    wrong = []
    for text, entry in message_texts.explained().items():
        fixed = sum(map(len, text.split(message_texts.GAP)))
        if entry is None or fixed < SHORTEST:
            continue
        found = explain_message(text.replace(message_texts.GAP, value))
        if found is None or found.title != entry.title:
            wrong.append((text, entry.title, found and found.title))
    assert not wrong, wrong


def test_a_text_of_nobody_is_not_explained():
    assert explain_message("the cat sat on the mat") is None and explain_message("") is None
