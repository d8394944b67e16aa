"""Rename options in messages to the names that the running command uses.

A stage does not know which command runs it. For example, `--scanless.steps` of `nvsim train` is
`--train.scanless.steps` of `nvsim run`. Messages use the option names of the stage's own command. This module converts
every message before it is shown.
"""

from __future__ import annotations

import functools
import re

from nvsim.cli.command_table import COMMANDS
from nvsim.cli.options import command_of, options

_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]*(?:\.[a-z0-9][a-z0-9-]*)*+(?!\w)")
_WITH_NUMBER = re.compile(rf"({_OPTION.pattern})( \d+(?:\.\d+)?\b)?")
_COMMAND = re.compile(r"(`nvsim [^`]*`)")  # options in a command belong to that command


@functools.cache
def options_of(verb: str) -> frozenset[str]:
    """All options of a command, such as "--steps"."""
    found = (option.flag for option in options(command_of(verb)))
    return frozenset({"--help", "--help-all", *found} - {""})


def rename_options(verb: str, text: str, stage: str = "") -> str:
    """`text` with every option renamed for the command `verb`: with or without the prefix of its stage. An option that
    only other commands have becomes a command with that option. `stage`: the stage that the message is from, "" if
    unknown."""
    if "--" not in text or not _OPTION.search(text):
        return text
    parts = _COMMAND.split(text)
    parts[::2] = [
        _WITH_NUMBER.sub(lambda found: _named(verb, found[1], stage, found[2] or ""), part) for part in parts[::2]
    ]
    return "".join(parts)


def _named(verb: str, option: str, stage: str, number: str) -> str:
    """The option with the `number` that follows it, or ""."""
    mine, name = options_of(verb), option[2:]
    if option in mine:
        return option + number
    if f"--{stage}.{name}" in mine:
        return f"--{stage}.{name}{number}"
    if "." in name and f"--{name.split('.', 1)[1]}" in mine:
        return f"--{name.split('.', 1)[1]}{number}"
    found = sorted((o for o in mine if o.endswith(f".{name}")), key=lambda o: (o.count("."), o))
    nearest = [o for o in found if o.count(".") == found[0].count(".")]
    if nearest:
        return " or ".join(nearest) + number
    others = (other for other in COMMANDS if option in options_of(other))
    return next((f"`nvsim {other} {option}{number}`" for other in others), option + number)
