"""The one error a user can cause: a sentence that says what is wrong, where, and what to do."""

import re

_LONGEST = 4000  # characters of a sentence, which may list forty places
_ENDLESS = re.compile(r"\S{301,}")
_ADDRESS = re.compile(r" object at 0x[0-9a-f]+")


class Refusal(Exception):
    """Says in one sentence why something cannot be done. Names and values from files may be in it: what cannot be
    printed is escaped, and the middle of an endless word or sentence is left out."""

    def __init__(self, sentence: str) -> None:
        text = _ENDLESS.sub(lambda word: f"{word[0][:200]}...{word[0][-60:]}", _printable(sentence))
        text = _ADDRESS.sub("", text)
        super().__init__(text if len(text) <= _LONGEST else f"{text[:2500]} ... {text[-1400:]}")


class InputError(Refusal):
    """Something outside the program is wrong (a file, a flag, a full disk).

    The message is one sentence for the user: what, where (file, line, frame), what to do.
    The command line prints it and exits with code 2; the window shows it as a notice.
    """


def shown(value: object, most: int = 300) -> str:
    """A value from a file for a sentence, in one line: its beginning, of at most `most` characters."""
    try:
        text = str(value)
    except ValueError:  # a number of thousands of digits
        return "a number of very many digits"
    text = _printable(text[: most + 1])
    return text if len(text) <= most else f"{text[: most - 3]}..."


def _printable(text: str) -> str:
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
