"""Replaces commands and options in messages of the library by the labels of the window. Does not use Qt."""

from __future__ import annotations

import re

from nvsim.project.work import WORK

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
    "afresh": "Train again",
    "also": "More projects",
    "force": "Write despite errors",
    "for_": "Folders for agents",
    "fps": "Frames per second",
    "goals": "Goals without language",
    "least_metres": "Least meters",
    "most_metres": "Most meters",
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
    return words[:1].upper() + words[1:]


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
