"""Read and write lists of booleans by the million, with their original spaces and line ends.

Nearly all of a connectivity file is such lists: two lists of n flags for each of n viewpoints. A list with equal
separators is stored as its values and its style, any other list as its text.
"""

from __future__ import annotations

import json
import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_WORDS = {"T": "true", "F": "false", "1": "1", "0": "0"}
_PARTNER = {"T": "F", "F": "T", "1": "0", "0": "1"}
_YES = {"T", "1"}
_BEGIN = re.compile(r"(\[[ \t\r\n]*)([TF01])([ \t\r\n]*,[ \t\r\n]*)?")
_WORDS_BEGIN = re.compile(r"(\[[ \t\r\n]*)(true|false)([ \t\r\n]*,[ \t\r\n]*)?")
_SPACES = " \t\r\n"
_FINISH = re.compile(r"[ \t\r\n]*\]\Z")
_TAIL = 4096  # maximum characters between the last element and the bracket


class FlagStyle(NamedTuple):
    """The style of a list: opening, value, separator, value, ..., closing."""

    opening: str = "["
    separator: str = ", "
    closing: str = "]"
    yes: str = "true"
    no: str = "false"

    def write(self, values: NDArray[np.bool_]) -> str:
        """Return the text of a list of (n,) values."""
        if not len(values):
            return "[]"
        hits = np.flatnonzero(values)
        if 4 * len(hits) > len(values):
            words = np.array([self.no, self.yes], object)[values.astype(np.intp)]
            return self.opening + self.separator.join(words.tolist()) + self.closing
        # Most values are "no", so runs of them are copied as a whole.
        no, yes = self.no + self.separator, self.yes + self.separator
        runs = np.diff(hits, prepend=-1) - 1
        body = "".join([no * run + yes for run in runs.tolist()])
        body += no * (len(values) - 1 - (int(hits[-1]) if len(hits) else -1))
        return self.opening + body[: len(body) - len(self.separator)] + self.closing


def read_flags(text: str) -> tuple[NDArray[np.bool_], FlagStyle | None]:
    """Parse a JSON list of booleans or of 0 and 1, including brackets. Returns the (n,) bool values and the style,
    which is None if the list has no uniform style. Raises ValueError, with the end of a sentence, for other text."""
    found = _words(text)
    if found is not None:
        return found
    letters = text.replace("true", "T").replace("false", "F")
    begin = _BEGIN.match(letters)
    if begin is not None and letters.isascii() and "T" not in text and "F" not in text:
        finish = _FINISH.search(letters, max(begin.start(2), len(letters) - _TAIL))
        if finish is not None:
            found = _regular(letters, begin, finish)
            if found is not None:
                return found
    return _irregular(text), None


def _words(text: str) -> tuple[NDArray[np.bool_], FlagStyle] | None:
    """Parse a list of true and false in one style. A "true" is one letter shorter than a "false", so the positions of
    the letters t give the elements that are true. The result is checked by writing the list again."""
    begin = _WORDS_BEGIN.match(text)
    if begin is None or not text.isascii() or not text.endswith("]"):
        return None
    first, separator = begin.start(2), begin.group(3) or ", "
    end = len(text[:-1].rstrip(_SPACES))
    hits = np.flatnonzero(np.frombuffer(text.encode("ascii"), np.uint8) == ord("t")) - first
    stride = len("false") + len(separator)
    count, rest = divmod(end - first + len(separator) + len(hits), stride)
    at = (hits + np.arange(len(hits))) // stride
    if rest or (len(at) and not 0 <= at[0] <= at[-1] < count):
        return None
    values = np.zeros(count, np.bool_)
    values[at] = True
    style = FlagStyle(begin.group(1), separator, text[end:])
    return (values, style) if style.write(values) == text else None


def _regular(letters: str, begin: re.Match[str], finish: re.Match[str]) -> tuple[NDArray[np.bool_], FlagStyle] | None:
    first, separator = begin.group(2), begin.group(3) or ""
    body = letters[begin.start(2) : finish.start()] + separator
    stride = 1 + len(separator)
    if len(body) % stride or (len(body) > 1 and not separator):
        return None
    grid = np.frombuffer(body.encode("ascii"), np.uint8).reshape(-1, stride)
    yes = first if first in _YES else _PARTNER[first]
    values = grid[:, 0] == ord(yes)
    if not (values | (grid[:, 0] == ord(_PARTNER[yes]))).all():
        return None
    if not (grid[:, 1:] == np.frombuffer(separator.encode("ascii"), np.uint8)).all():
        return None
    style = FlagStyle(begin.group(1), separator or ", ", finish.group(), _WORDS[yes], _WORDS[_PARTNER[yes]])
    return values, style


def _irregular(text: str) -> NDArray[np.bool_]:
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError("is not a list of booleans") from error
    for value in values:
        if not isinstance(value, bool | int) or value not in (0, 1):
            raise ValueError(f"holds {value!r:.40}; only true, false, 0 and 1 are allowed")
    return np.array([bool(value) for value in values], bool)
