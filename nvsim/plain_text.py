"""Make text from outside (a file name, an identifier, a model's answer) safe to show.

Control characters can move the cursor of a terminal, color it, or set its title. A line break in a name can imitate a
second message. Bidirectional control characters change the order in which a text appears (Unicode TR 36, section 2).
This module replaces each of them with its code. Every message of the command line and every label of the window passes
through it.
"""

from __future__ import annotations

import re

UNSEEN = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff\ud800-\udfff\U000e0000-\U000e007f]"
)
"""Matches one control character, line or paragraph separator, bidirectional control, byte order mark, invisible tag, or
half of a surrogate pair."""


def printable(text: object, kept: str = "") -> str:
    """`text` with a visible code for every character that UNSEEN matches, except those in `kept`. An ASCII character
    becomes \\n or \\x1b, a byte of a name that is not UTF-8 becomes \\udce9, and any other becomes ‹U+202E›."""
    words = str(text)
    if words.isprintable():
        return words
    return UNSEEN.sub(lambda found: found.group() if found.group() in kept else _code(found.group()), words)


def _code(letter: str) -> str:
    return ascii(letter)[1:-1] if letter < "\x80" or "\ud800" <= letter <= "\udfff" else f"‹U+{ord(letter):04X}›"


def capitalized(words: str) -> str:
    """`words` with a capital first letter; the others stay as they are."""
    return words[:1].upper() + words[1:]


def count_text(number: int, thing: str) -> str:
    """A number with its noun: "1 edge", "3 edges"."""
    return f"{number:,} {thing}" + ("" if number == 1 else "s")
