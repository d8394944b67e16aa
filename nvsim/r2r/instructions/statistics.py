"""Statistics of the language of instructions, beside those of R2R's human instructions."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

SAMPLE = 540
"""Number of instructions whose vocabulary is counted, because a vocabulary grows with the number of texts."""
_WORD = re.compile(r"[a-z0-9]+(?:['-][a-z0-9]+)*")
_METRES = re.compile(r"\b(?:met(?:re|er)s?|\d+(?:\.\d+)? ?m)\b")
_VAGUE = re.compile(r"\b(?:object|thing)s?\b")
_LANDMARK = re.compile(
    r"\b(?:door\w*|threshold|entrance|rooms?|corridor|hall\w*|passage\w*|walkway|stair\w*|upstairs|downstairs|floor|"
    r"rug|carpet|tiles?|wall|window|sofa|couch|settee|chair|seat|plant|houseplant|desk|worktable|table|book\w*|shel\w+|"
    r"cabinet|cupboard|box|carton|crate|container|platform|podium|dais|rack|entryway|opening|stage|furniture|unit|"
    r"picture|painting|bed\w*|kitchen|bathroom|sink|"
    r"lamp|counter|fireplace|objects?|things?)\b"
)


@dataclass(frozen=True)
class Statistics:
    """Statistics of instructions.

    instructions      their number
    words             words per instruction, the mean
    vocabulary        different words in the first 540 instructions
    metres            share that states a distance in meters
    vague             share that says "object" or "thing"
    without_landmark  share that names no landmark, such as a door, a room, stairs, or a piece of furniture
    """

    instructions: int
    words: float
    vocabulary: int
    metres: float
    vague: float
    without_landmark: float


def statistics_of(texts: Sequence[str]) -> Statistics:
    """Returns the statistics of instructions; all figures are 0 if there are none."""
    lower = [text.lower() for text in texts]
    words = [_WORD.findall(text) for text in lower]
    count = max(1, len(texts))
    return Statistics(
        instructions=len(texts),
        words=round(sum(map(len, words)) / count, 1),
        vocabulary=len({word for one in words[:SAMPLE] for word in one}),
        metres=round(sum(bool(_METRES.search(text)) for text in lower) / count, 3),
        vague=round(sum(bool(_VAGUE.search(text)) for text in lower) / count, 3),
        without_landmark=round(sum(not _LANDMARK.search(text) for text in lower) / count, 3),
    )


def table_of(found: Statistics, followed: float | None = None) -> list[tuple[str, str, str]]:
    """Returns rows (figure, value, value of 540 random human instructions of R2R) in words.

    `followed` is the share of paths that the follower finds, None if it is unknown.
    """
    count = min(SAMPLE, found.instructions)
    return [
        ("words per instruction", f"{found.words:g}", "26.3"),
        (f"different words in {count} instructions", str(found.vocabulary), f"644 in {SAMPLE}"),
        ("with a distance in meters", percent(found.metres), "0 %"),
        ('with "object" or "thing"', percent(found.vague), "not counted"),
        ("without a landmark", percent(found.without_landmark), "1 %"),
        ("paths that the follower finds", "not tested" if followed is None else percent(followed), "not tested"),
    ]


def percent(share: float) -> str:
    return f"{100 * share:.1f} %".replace(".0 %", " %")
