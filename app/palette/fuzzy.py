"""A score for how well a few typed letters match a text. Does not use Qt."""

from __future__ import annotations

_START, _RUN, _PLAIN, _GAP = 12.0, 14.0, 2.0, 0.15


def fit(typed: str, text: str) -> tuple[float, tuple[int, ...]] | None:
    """The score of a match (higher is better) and the positions of its letters in `text`; None if a letter is missing.

    Words may be in any order. The letters of a word keep their order. Word starts and runs score most.
    """
    low = text.casefold()
    if len(low) != len(text):
        low = text.lower() if len(text.lower()) == len(text) else text
    total, places = 0.0, []
    for word in typed.casefold().split():
        found = _best(word, low)
        if found is None:
            return None
        total += found[0]
        places += found[1]
    return total - 0.05 * len(text), tuple(sorted(set(places)))


def _best(word: str, text: str) -> tuple[float, list[int]] | None:
    """The best match of the letters of `word`, in order."""
    # score[j]: the best match whose last letter is at position j.
    score: dict[int, tuple[float, list[int]]] = {}
    for i, letter in enumerate(word):
        reached: dict[int, tuple[float, list[int]]] = {}
        for j in range(len(text)):
            if text[j] != letter:
                continue
            own = _START if j == 0 or not text[j - 1].isalnum() else _PLAIN
            if i == 0:
                reached[j] = own, [j]
                continue
            ways = [
                (value + max(own, _RUN if k == j - 1 else 0.0) - _GAP * (j - k - 1), path)
                for k, (value, path) in score.items()
                if k < j
            ]
            if ways:
                value, path = max(ways, key=lambda way: way[0])
                reached[j] = value, [*path, j]
        score = reached
        if not score:
            return None
    return max(score.values(), key=lambda way: way[0])
