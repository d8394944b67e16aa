"""Converts instructions to numbers: each word, number or punctuation mark has a place in a vocabulary."""

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
    """Splits a text into lower-case words, numbers, and punctuation marks."""
    return _WORD.findall(text.lower())


@dataclass(frozen=True)
class Vocabulary:
    """The vocabulary of an agent.

    words   the special tokens first; the number of a word is its index
    """

    words: tuple[str, ...]

    @staticmethod
    def of(texts: Iterable[str], least: int = 2) -> Vocabulary:
        """Returns the words that occur at least `least` times, by descending frequency, then alphabetically."""
        counts = Counter(word for text in texts for word in words_of(text))
        known = sorted((word for word, n in counts.items() if n >= least), key=lambda word: (-counts[word], word))
        return Vocabulary((*SPECIAL, *known))

    @cached_property
    def number(self) -> dict[str, int]:
        return {word: i for i, word in enumerate(self.words)}

    def encoded(self, text: str, longest: int) -> list[int]:
        """Returns the numbers of the begin token, up to `longest` words, and the end token."""
        unknown = self.number[UNKNOWN]
        inside = [self.number.get(word, unknown) for word in words_of(text)[:longest]]
        return [self.number[BEGIN], *inside, self.number[END]]


def padded(rows: Sequence[Sequence[int]]) -> NDArray[np.int64]:
    """Pads rows to (B, longest row) int64 with 0, the number of PAD."""
    found = np.zeros((len(rows), max(map(len, rows))), np.int64)
    for i, row in enumerate(rows):
        found[i, : len(row)] = row
    return found
