"""What comes from outside (a file's name, a frame, an identifier, a job, an error) is shown as plain text.

Qt takes a text for HTML as soon as it looks like it, and then opens the files that the text names: an image in a tool
tip reads /dev/zero. So every label is a `labels.Label`, every tool tip goes through `tip`, and our own markup holds
what comes from outside only through `marked`. What would mislead or break the layout is made visible or cut: control
characters, changes of the direction of writing, line breaks in a name, a name of a megabyte. Knows no Qt.
"""

from __future__ import annotations

import html
import re

from nvsim.plain_text import printable

NAME, SENTENCE, ROWS = 200, 2000, 40  # characters of a name, of a text of several lines, and its lines
CAPTION = 100  # characters on a button or in a menu: it is as wide as its words
_TIP_LINE = 120  # characters of a plain tool tip in one line; Qt folds rich text alone
_FOLD, _LONGEST_WORD = 40, 48  # characters without a place to fold; none of those that people copy is longer

_WORD = re.compile(f"[^\\s/\u200b]{{{_LONGEST_WORD},}}")


def plain(text: object, most: int = NAME) -> str:
    """One line that shows every character of `text`, cut in the middle to `most` characters."""
    words = str(text)
    if len(words) <= most and words.isprintable():
        return words
    return _cut(printable(_cut(words, most).replace("\u200b", "‹U+200B›")), most)


def lines(text: object, most: int = SENTENCE, rows: int = ROWS) -> str:
    """The same with its line breaks, cut at the end to `most` characters and `rows` lines."""
    words = str(text)
    cut = len(words) > most
    kept = words[:most].replace("\r\n", "\n").replace("\t", "    ").split("\n")
    cut = cut or len(kept) > rows
    shown = "\n".join(map(printable, kept[:rows]))
    return shown[:most] + ("…" if cut or len(shown) > most else "")


def marked(text: object) -> str:
    """As a part of our own HTML."""
    return html.escape(lines(text)).replace("\n", "<br>")


def tip(text: object) -> str:
    """As a tool tip, which has no format: what might be taken for HTML, and a long line, becomes HTML that says just
    that."""
    shown = lines(text)
    if "<" not in shown and "&" not in shown and all(len(row) <= _TIP_LINE for row in shown.split("\n")):
        return shown
    return f'<span style="white-space:pre-wrap">{html.escape(folded(shown))}</span>'


def caption(text: object, most: int = CAPTION) -> str:
    """On a button, a tab or in a menu, where & marks a letter and a tab begins the shortcut."""
    return plain(text, most).replace("&", "&&")


def title(text: object) -> str:
    """In the title of a window, where [*] is the mark of unsaved changes."""
    return plain(text, CAPTION).replace("[*]", "[*][*]")


def _cut(words: str, most: int) -> str:
    if len(words) <= most:
        return words
    end = (most - 1) // 3
    return f"{words[: most - 1 - end]}…{words[-end:] if end else ''}"


def folded(words: str) -> str:
    """With places to fold in words that have none; a path has them already, and must be copied as it is."""
    return _WORD.sub(lambda found: "\u200b".join(re.findall(f".{{1,{_FOLD}}}", found.group())), words)
