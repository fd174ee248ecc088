"""The two ways in which Isochrome says no. Every refusal is one sentence that names the file, key
or frame, the value found, what is allowed and what to do. The command line turns them into the exit
codes 2 and 3."""

from typing import Any

from isochrome.messages import as_message


class IsochromeError(Exception):
    """A refusal with a sentence for the user; never raised itself.

    It is made from a code of `messages.json` and the values in its words, or from a text. `message`
    is the sentence, with its code and values where it has some.
    """

    exit_code = 1

    def __init__(self, text: str = "", /, **values: Any) -> None:
        self.message = as_message(text, values)
        super().__init__(self.message)


def reason_of(error: Exception) -> str:
    """What a library says of an error, its first line; its kind where it says nothing."""
    return (str(error).splitlines() or [""])[0].strip()[:160] or type(error).__name__


class InputError(IsochromeError, ValueError):
    """The input or the scene is wrong (exit code 2).

    Its text is one line that names the file, key or frame, the value, and what to do.

    Parameters
    ----------
    text : str
        The sentence, or the code of one in `messages.json`.
    **values : Any
        The values in the words of a code.

    Examples
    --------
    >>> import isochrome
    >>> try:
    ...     isochrome.load_scene("rign")
    ... except isochrome.InputError as error:
    ...     print(error)
    rign: no such scene file; did you mean 'ring'?
    """

    exit_code = 2


class PhysicsError(IsochromeError, ArithmeticError):
    """The input is well formed, but its physics cannot be computed honestly (exit code 3).

    Its text is one line that says what was refused, and what to change.

    Parameters
    ----------
    text : str
        The sentence, or the code of one in `messages.json`.
    **values : Any
        The values in the words of a code.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("line-contact-wear")
    >>> try:
    ...     isochrome.simulate(scene.with_values({"load.normal_n": 4e4}))
    ... except isochrome.PhysicsError as error:
    ...     print(error.exit_code)
    3
    """

    exit_code = 3
