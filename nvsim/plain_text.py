"""Text from outside (a file's name, an identifier, a model's answer) made safe to show.

Control characters move the cursor of a terminal, color it or set its title; line breaks in a name forge a second
message; marks of the writing direction show a text in another order than it has (Unicode TR 36, section 2). Each of
them is replaced with its code. Every message of the command line and every label of the window passes here.
"""

from __future__ import annotations

import re

UNSEEN = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff\ud800-\udfff\U000e0000-\U000e007f]"
)
"""Control characters, line and paragraph separators, marks of the writing direction, the byte order mark, invisible
tags, and halves of surrogate pairs."""


def printable(text: object, kept: str = "") -> str:
    """`text` with a visible code in place of every character in UNSEEN, except those in `kept`. ASCII ones become
    \\n or \\x1b, bytes of a name that are not UTF-8 \\udce9, and others ‹U+202E›."""
    words = str(text)
    if words.isprintable():
        return words
    return UNSEEN.sub(lambda found: found.group() if found.group() in kept else _code(found.group()), words)


def _code(letter: str) -> str:
    return ascii(letter)[1:-1] if letter < "\x80" or "\ud800" <= letter <= "\udfff" else f"‹U+{ord(letter):04X}›"
