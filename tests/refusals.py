"""What is said of an input that is refused."""

from collections.abc import Callable
from typing import Any

import pytest

from isochrome.errors import InputError


def refusal(call: Callable[..., Any], *given: Any, **named: Any) -> str:
    """The one line in which a call refuses what it is given."""
    with pytest.raises(InputError) as refused:
        call(*given, **named)
    text = str(refused.value)
    assert len(text.splitlines()) == 1, text
    return text
