"""Texts of history steps in the past tense. Does not use Qt."""

from __future__ import annotations

_SAME = frozenset({"set", "split", "put", "cut"})
_IRREGULAR = {"take": "took", "draw": "drew", "make": "made", "undo": "undid", "bring": "brought", "go": "went"}


def past(text: str) -> str:
    """Converts the first verb to the past tense: "Remove 3 viewpoints" becomes "Removed 3 viewpoints"."""
    verb, space, rest = text.partition(" ")
    return f"{_past(verb)}{space}{rest}"


def _past(verb: str) -> str:
    word = verb.lower()
    if word in _SAME or not word.isalpha():
        return verb
    if word in _IRREGULAR:
        made = _IRREGULAR[word]
    elif word.endswith("e"):
        made = f"{word}d"
    elif word.endswith("y") and word[-2] not in "aeiou":
        made = f"{word[:-1]}ied"
    else:
        made = f"{word}ed"
    return made.capitalize() if verb[0].isupper() else made
