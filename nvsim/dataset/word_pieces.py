"""Encode instructions as word pieces of BERT (uncased), with the vocabulary of the agent.

Words are lower case, without accents, and separated at punctuation and at CJK characters. Each word is cut into the
longest pieces of the vocabulary from left to right (WordPiece, Devlin et al. 2019, BERT, and its tokenization.py). The
tests compare the result with the package `tokenizers`. This one rule does not justify a dependency.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.opening import read_text

BEGIN, END, UNKNOWN = "[CLS]", "[SEP]", "[UNK]"
_LARGEST = 1 << 24  # bytes of a vocabulary file
_LONGEST = 100  # characters of a word; longer words are unknown
_CJK = (
    (0x4E00, 0x9FFF),
    (0x3400, 0x4DBF),
    (0x20000, 0x2A6DF),
    (0x2A700, 0x2B73F),
    (0x2B740, 0x2B81F),
    (0x2B820, 0x2CEAF),
    (0xF900, 0xFAFF),
    (0x2F800, 0x2FA1F),
)


@dataclass(frozen=True)
class Vocabulary:
    """The numbers of word pieces. A piece inside a word begins with "##"."""

    numbers: Mapping[str, int]

    @staticmethod
    def read(path: Path) -> Vocabulary:
        """Reads a vocab.txt with one piece per line. Raises InputError if it is unreadable or lacks a special piece."""
        text = read_text(path, "a vocabulary", "name the vocab.txt of the agent's BERT", _LARGEST)
        numbers = {piece.strip(): n for n, piece in enumerate(text.rstrip("\n").split("\n"))}
        for piece in (BEGIN, END, UNKNOWN):
            if piece not in numbers:
                raise InputError(f"{path} has no line {piece}; name the vocab.txt of the agent's BERT.")
        return Vocabulary(numbers)

    def encode(self, text: str) -> list[int]:
        """Returns the numbers of [CLS], of the pieces of a text, and of [SEP]."""
        pieces = [piece for word in words(text) for piece in self._pieces(word)]
        return [self.numbers[piece] for piece in (BEGIN, *pieces, END)]

    def _pieces(self, word: str) -> list[str]:
        if len(word) > _LONGEST:
            return [UNKNOWN]
        found: list[str] = []
        start = 0
        while start < len(word):
            mark = "##" if start else ""
            fitting = (stop for stop in range(len(word), start, -1) if mark + word[start:stop] in self.numbers)
            stop = next(fitting, None)
            if stop is None:
                return [UNKNOWN]
            found.append(mark + word[start:stop])
            start = stop
        return found


def words(text: str) -> list[str]:
    """Splits a text into lower-case words without accents, punctuation marks, and CJK characters."""
    return "".join(_separate_words(text)).split()


def _separate_words(text: str) -> Iterator[str]:
    for char in unicodedata.normalize("NFD", "".join(map(_clean_text, text))).lower():
        if unicodedata.category(char) != "Mn":
            yield f" {char} " if _is_punctuation(char) else char


def _clean_text(char: str) -> str:
    if any(first <= ord(char) <= last for first, last in _CJK):
        return f" {char} "
    if char in "\t\n\r" or unicodedata.category(char) == "Zs":
        return " "
    return "" if char == "\ufffd" or unicodedata.category(char).startswith("C") else char


def _is_punctuation(char: str) -> bool:
    is_mark = char.isascii() and char.isprintable() and not char.isalnum() and char != " "
    return is_mark or unicodedata.category(char).startswith("P")
