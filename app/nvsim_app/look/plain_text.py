"""Shows text from outside (file names, frames, identifiers, jobs, errors) as plain text.

Qt interprets any text that looks like HTML and opens the files that it names: an image in a tooltip can read /dev/zero.
So every label is a `labels.Label`, every tooltip goes through `tooltip_text`, and trusted markup includes text from
outside only through `escape_html`. Control characters, changes of the writing direction, and line breaks in names
become visible. Very long texts are cut. Sentences name the labels of the window in place of commands. Does not use Qt.
"""

from __future__ import annotations

import html
import re

from nvsim.plain_text import capitalized, printable
from nvsim.project.work import WORK

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


def escape_html(text: object) -> str:
    """`text` escaped for trusted HTML."""
    return html.escape(lines(in_window(str(text)))).replace("\n", "<br>")


def tooltip_text(text: object) -> str:
    """`text` as a tooltip. Text that Qt might interpret as HTML, and text with long lines, is escaped and wrapped in
    HTML."""
    shown = lines(in_window(str(text)))
    if "<" not in shown and "&" not in shown and all(len(row) <= _TIP_LINE for row in shown.split("\n")):
        return shown
    return f'<span style="white-space:pre-wrap">{html.escape(with_break_points(shown))}</span>'


def caption(text: object) -> str:
    """`text` for a button, a tab, or a menu: an ampersand is doubled, because a single one marks a shortcut letter."""
    return plain(text, CAPTION).replace("&", "&&")


def title(text: object) -> str:
    """`text` for the title of a window: [*] is escaped, because it marks unsaved changes."""
    return plain(text, CAPTION).replace("[*]", "[*][*]")


def _cut(words: str, most: int) -> str:
    if len(words) <= most:
        return words
    end = (most - 1) // 3
    return f"{words[: most - 1 - end]}…{words[-end:] if end else ''}"


def with_break_points(words: str) -> str:
    """`words` with invisible break points in very long words, except in paths, which users copy and which break at
    slashes."""
    return _WORD.sub(lambda found: "\u200b".join(re.findall(f".{{1,{_FOLD}}}", found.group())), words)


_LABELS = {verb: row.title for verb, row in WORK.items()} | {
    "check": "Import a capture",
    "graph check": "Validation",
    "models add": "Models",
    "run": "Run everything",
}
"""Command -> label of the command or panel that does the same in the window."""
_PHRASES = (
    (re.compile(r"; --model 1(?: to \d+)? imports another piece"), "; the list of pieces imports another one"),
    (re.compile(r"or continue with one piece by --model [^.]*"), "or choose one of the pieces"),
    (
        re.compile(r" METERS or --known-length, or measure a known length in the window"),
        "; after the import, you can also measure a known length",
    ),
    (re.compile(r"with --force"), "by selecting that in the form"),
)
_VALUE = (
    r"\d+(?:\.\d+)?(?:,\d+(?:\.\d+)?)*|[a-z][\w-]*(?=`)"
    r"|(?:aligned|always|auto|cpu|cuda|depth|gaussians|given|hybrid|images|lidar|network|never|opencv|opengl|panorama"
    r"|refined|scan|sent)\b"
)
_PLACEHOLDER = r"[A-Z]{2,}\b(?:,[A-Z]+\b|,\.\.\.)*(?:\.[a-z]+\b)?|[A-Z],[A-Z]\b"
_OPTION = re.compile(
    rf"(?<![\w/.-])--(?:[a-z][a-z0-9-]*\.)*([a-z][a-z0-9-]*)(?:[ =](?:(?P<value>{_VALUE})|{_PLACEHOLDER}))?"
)
_COMMAND = re.compile(r"`nvsim ([^`]*)`")
_BARE = re.compile(rf"(?<![\w/.-])nvsim ({'|'.join(sorted(map(re.escape, _LABELS), key=len, reverse=True))})\b")
_SHORT = frozenset({"ssim", "lpips", "csv", "sh", "mcmc", "dc", "a2c"})
_MOST = 10_000  # characters
_CLEARER = {
    "repeat": "Repeat finished runs",
    "also": "More projects",
    "force": "Write despite errors",
    "for_": "Folders for agents",
    "fps": "Frames per second",
    "goals": "Goals without language",
    "only": "Scans to use",
    "out": "Output",
    "register": "Style of instructions",
    "rxr": "RxR annotations",
    "streamvln": "StreamVLN annotations",
    "stub": "Stub scan of Matterport3D",
    "vlnce": "VLN-CE episodes",
    "want": "Required validity",
    "yes": "Send without asking",
}
"""Options whose name is no label."""


def in_window(text: str) -> str:
    """`text` with every command as the label of a command of the window, and every option as the label of its field.
    The part that is too long to be shown does not change."""
    text, rest = text[:_MOST], text[_MOST:]
    if "--" not in text and "nvsim " not in text:
        return text + rest
    for phrase, words in _PHRASES:
        text = phrase.sub(words, text)
    parts = _COMMAND.split(text)
    parts[::2] = [_BARE.sub(lambda found: f"“{_LABELS[found[1]]}”", _OPTION.sub(_field, part)) for part in parts[::2]]
    parts[1::2] = map(_command, parts[1::2])
    return "".join(parts) + rest


def field_label(name: str) -> str:
    """The label of the field of an option, from its name with underscores."""
    if name in _CLEARER:
        return _CLEARER[name]
    words = " ".join(word.upper() if word in _SHORT else word for word in name.removesuffix("_gb").split("_"))
    return capitalized(words)


def _field(found: re.Match[str]) -> str:
    value = found["value"]
    return f"“{field_label(found[1].replace('-', '_'))}{f': {value}' if value else ''}”"


def _command(line: str) -> str:
    words = line.split()
    label = next((_LABELS[verb] for n in (2, 1) if (verb := " ".join(words[:n])) in _LABELS), None)
    if label is None:
        return f"the command “nvsim {line}” in a terminal"
    options = [_field(found) for found in _OPTION.finditer(f"{line}`") if found[1] not in ("project", "json")]
    return f"“{label}”" + (f" with {' and '.join(options)}" if options else "")
