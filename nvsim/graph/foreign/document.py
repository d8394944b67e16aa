"""A connectivity file as text: its entries member by member, with the text between them, so that unedited parts are
written as they were read.

Nearly all of a connectivity file is two lists of n flags for each of n viewpoints. These lists are read and written by
the million, with their original spaces and line ends: a list with equal separators is stored as its values and its
style, any other list as its text."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Viewpoint

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
    found = _parse_flags(text)
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


def _parse_flags(text: str) -> tuple[NDArray[np.bool_], FlagStyle] | None:
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


FLAGS = ("visible", "unobstructed")


@dataclass(frozen=True)
class Member:
    """One member of an entry, as text.

    lead   "{" or "," with the white space after it
    name   the key in quotes, the colon, and the white space around it
    key    the key
    value  its text; for a list of flags in one style, that style: the flags are in the document's matrix
    """

    lead: str
    name: str
    key: str
    value: str | FlagStyle


@dataclass(frozen=True)
class Entry:
    """One viewpoint of the file. `closing` is the text after the last value; `faults` are its problems as (kind, end of
    a sentence)."""

    viewpoint: Viewpoint
    members: tuple[Member, ...]
    closing: str
    faults: tuple[tuple[str, str], ...] = ()

    def text(self, key: str) -> str | FlagStyle | None:
        """Return the value of a member; None if there is none."""
        return next((m.value for m in self.members if m.key == key), None)

    def with_value(self, key: str, value: str | FlagStyle) -> Entry:
        """Return the entry with another value of a member. A missing member is added at the end."""
        if any(m.key == key for m in self.members):
            members = tuple(replace(m, value=value) if m.key == key else m for m in self.members)
            return replace(self, members=members)
        last = self.members[-1]
        lead = last.lead if "," in last.lead else "," + last.lead[1:]
        name = f'"{key}"' + last.name[last.name.rindex('"') + 1 :]
        return replace(self, members=(*self.members, Member(lead, name, key, value)))


@dataclass(frozen=True, eq=False)
class Document:
    """A connectivity file of n entries.

    opening, closing   text before the first entry and after the last
    between            (n - 1) texts between two entries
    flags              "visible" and "unobstructed" -> (n, n) bool, row i of entry i
    """

    entries: tuple[Entry, ...] = ()
    opening: str = "["
    closing: str = "]"
    between: tuple[str, ...] = ()
    flags: Mapping[str, NDArray[np.bool_]] = field(
        default_factory=lambda: {key: np.zeros((0, 0), np.bool_) for key in FLAGS}
    )

    @cached_property
    def has_visibility(self) -> bool:
        """Whether the visibility lists contain more than edges."""
        return bool((self.flags["visible"] & ~self.flags["unobstructed"]).any())

    def pieces(self) -> Iterator[str]:
        """Yield the text of the file in pieces."""
        yield self.opening
        for i, entry in enumerate(self.entries):
            if i:
                yield self.between[i - 1]
            for member in entry.members:
                value = member.value
                if isinstance(value, FlagStyle):
                    value = value.write(self.flags[member.key][i])
                yield f"{member.lead}{member.name}{value}"
            yield entry.closing
        yield self.closing
