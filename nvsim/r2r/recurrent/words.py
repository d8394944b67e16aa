"""Instructions as rows of numbers: a word, a number or a mark is one, by its place in a vocabulary."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

PAD, BEGIN, END, UNKNOWN = "[pad]", "[begin]", "[end]", "[unknown]"
SPECIAL = (PAD, BEGIN, END, UNKNOWN)
_WORD = re.compile(r"[^\W\d_]+(?:['’][^\W\d_]+)*|\d+(?:\.\d+)?|[.,;:!?]")


def words_of(text: str) -> list[str]:
    """Lower-case words, numbers as they are written, and marks."""
    return _WORD.findall(text.lower())


@dataclass(frozen=True)
class Vocabulary:
    """words   the special ones first; a word's number is its place"""

    words: tuple[str, ...]

    @staticmethod
    def of(texts: Iterable[str], least: int = 2) -> Vocabulary:
        """The words that come `least` times or more, the most frequent first, of equals by the alphabet."""
        counts = Counter(word for text in texts for word in words_of(text))
        known = sorted((word for word, n in counts.items() if n >= least), key=lambda word: (-counts[word], word))
        return Vocabulary((*SPECIAL, *known))

    @cached_property
    def number(self) -> dict[str, int]:
        return {word: i for i, word in enumerate(self.words)}

    def encoded(self, text: str, longest: int) -> list[int]:
        """Begin, up to `longest` words, and end."""
        unknown = self.number[UNKNOWN]
        inside = [self.number.get(word, unknown) for word in words_of(text)[:longest]]
        return [self.number[BEGIN], *inside, self.number[END]]


def padded(rows: Sequence[Sequence[int]]) -> NDArray[np.int64]:
    """(B, longest row), filled up with 0, the number of PAD."""
    found = np.zeros((len(rows), max(map(len, rows))), np.int64)
    for i, row in enumerate(rows):
        found[i, : len(row)] = row
    return found
