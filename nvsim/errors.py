"""Errors that a user can cause. The message of each names the problem, the place, and the fix in one sentence."""

import re

_LONGEST = 4000  # characters of a message, which may list forty places
_ENDLESS = re.compile(r"\S{301,}")
_ADDRESS = re.compile(r" object at 0x[0-9a-f]+")


class UserError(Exception):
    """The base of errors that one sentence explains to the user. The sentence may contain names and values from files:
    characters that cannot be printed are escaped, and very long words and sentences are shortened in the middle."""

    def __init__(self, sentence: str) -> None:
        text = _ENDLESS.sub(lambda word: f"{word[0][:200]}...{word[0][-60:]}", _printable(sentence))
        text = _ADDRESS.sub("", text)
        super().__init__(text if len(text) <= _LONGEST else f"{text[:2500]} ... {text[-1400:]}")


class InputError(UserError):
    """The input or the environment is wrong (a file, an option, a full disk).

    The message is one sentence for the user: the problem, the place (file, line, frame), and the fix.
    The command line prints it and exits with code 2. The window shows it as a notice.
    """


def value_text(value: object, most: int = 300) -> str:
    """A value from a file as text for a message: one line, shortened to at most `most` characters."""
    try:
        text = str(value)
    except ValueError:  # an integer with thousands of digits
        return "a number with very many digits"
    text = _printable(text[: most + 1])
    return text if len(text) <= most else f"{text[: most - 3]}..."


def _printable(text: str) -> str:
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
