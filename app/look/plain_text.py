"""Shows text from outside (file names, frames, identifiers, jobs, errors) as plain text.

Qt interprets any text that looks like HTML and opens the files that it names: an image in a tooltip can read /dev/zero.
So every label is a `labels.Label`, every tooltip goes through `tip`, and trusted markup includes text from outside only
through `marked`. Control characters, changes of the writing direction, and line breaks in names become visible. Very
long texts are cut. Sentences name the labels of the window in place of commands. Does not use Qt.
"""

from __future__ import annotations

import html
import re

from app.look.wording import in_window
from nvsim.plain_text import printable

NAME, SENTENCE, ROWS = 200, 2000, 40  # maximum characters of a name and of a longer text, and maximum lines
CAPTION = 100  # maximum characters on a button or in a menu, which is as wide as its text
_TIP_LINE = 120  # maximum characters per line of a plain tooltip; Qt wraps only rich text
_FOLD, _LONGEST_WORD = 40, 48  # longer words get a break point every _FOLD characters; identifiers to copy are shorter

_WORD = re.compile(f"[^\\s/\u200b]{{{_LONGEST_WORD},}}")


def plain(text: object, most: int = NAME) -> str:
    """`text` as one line with visible codes for control characters, cut in the middle to `most` characters."""
    words = str(text)
    if len(words) <= most and words.isprintable():
        return words
    return _cut(printable(_cut(words, most).replace("\u200b", "‹U+200B›")), most)


def lines(text: object, most: int = SENTENCE, rows: int = ROWS) -> str:
    """`text` with its line breaks and visible codes for control characters, cut at the end to `most` characters and
    `rows` lines."""
    words = str(text)
    cut = len(words) > most
    kept = words[:most].replace("\r\n", "\n").replace("\t", "    ").split("\n")
    cut = cut or len(kept) > rows
    shown = "\n".join(map(printable, kept[:rows]))
    return shown[:most] + ("…" if cut or len(shown) > most else "")


def marked(text: object) -> str:
    """`text` escaped for trusted HTML."""
    return html.escape(lines(in_window(str(text)))).replace("\n", "<br>")


def tip(text: object) -> str:
    """`text` as a tooltip. Text that Qt might interpret as HTML, and text with long lines, is escaped and wrapped in
    HTML."""
    shown = lines(in_window(str(text)))
    if "<" not in shown and "&" not in shown and all(len(row) <= _TIP_LINE for row in shown.split("\n")):
        return shown
    return f'<span style="white-space:pre-wrap">{html.escape(folded(shown))}</span>'


def caption(text: object, most: int = CAPTION) -> str:
    """`text` for a button, a tab, or a menu: an ampersand is doubled, because a single one marks a shortcut letter."""
    return plain(text, most).replace("&", "&&")


def title(text: object) -> str:
    """`text` for the title of a window: [*] is escaped, because it marks unsaved changes."""
    return plain(text, CAPTION).replace("[*]", "[*][*]")


def _cut(words: str, most: int) -> str:
    if len(words) <= most:
        return words
    end = (most - 1) // 3
    return f"{words[: most - 1 - end]}…{words[-end:] if end else ''}"


def folded(words: str) -> str:
    """`words` with invisible break points in very long words, except in paths, which users copy and which break at
    slashes."""
    return _WORD.sub(lambda found: "\u200b".join(re.findall(f".{{1,{_FOLD}}}", found.group())), words)
