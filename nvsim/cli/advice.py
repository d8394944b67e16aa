"""Rename options in messages to the names that the running command uses.

A stage does not know which command runs it. For example, `--scanless.steps` of `nvsim train` is
`--train.scanless.steps` of `nvsim run`. Messages use the option names of the stage's own command. This module converts
every message before it is shown.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import re
import typing
from collections.abc import Iterator

from nvsim.cli.command_table import COMMANDS

_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]*(?:\.[a-z0-9][a-z0-9-]*)*")
_COMMAND = re.compile(r"(`nvsim [^`]*`)")  # options in a command belong to that command


@functools.cache
def options_of(verb: str) -> frozenset[str]:
    """All options of a command, such as "--steps"."""
    command = importlib.import_module(f"nvsim.cli.commands.{COMMANDS[verb][0]}")
    return frozenset({"--help", *_options(command.Arguments)})


def _options(cls: type, prefix: str = "") -> Iterator[str]:
    """The options that `nvsim.cli.arguments.parse` creates from a dataclass."""
    hints = typing.get_type_hints(cls, include_extras=True)
    for field in dataclasses.fields(cls):
        hint: typing.Any = hints[field.name]
        notes: list[object] = []
        if typing.get_origin(hint) is typing.Annotated:
            hint, *notes = typing.get_args(hint)
        name = f"{prefix}{field.name.replace('_', '-')}"
        if dataclasses.is_dataclass(hint):
            inline = any(getattr(note, "name", None) == "" for note in notes)
            yield from _options(typing.cast(type, hint), prefix if inline else f"{name}.")
        elif not any("Positional" in str(note) for note in notes):
            head, dot, last = name.rpartition(".")
            yield f"--{head}{dot}no-{last}" if field.default is True else f"--{name}"


def advised(verb: str, text: str, stage: str = "") -> str:
    """`text` with every option renamed for the command `verb`: with or without the prefix of its stage. An option that
    only other commands have becomes a command with that option. `stage`: the stage that the message is from, "" if
    unknown."""
    if "--" not in text or not _OPTION.search(text):
        return text
    parts = _COMMAND.split(text)
    parts[::2] = [_OPTION.sub(lambda found: _named(verb, found.group(), stage), part) for part in parts[::2]]
    return "".join(parts)


def _named(verb: str, option: str, stage: str) -> str:
    mine, name = options_of(verb), option[2:]
    if option in mine:
        return option
    if f"--{stage}.{name}" in mine:
        return f"--{stage}.{name}"
    if "." in name and f"--{name.split('.', 1)[1]}" in mine:
        return f"--{name.split('.', 1)[1]}"
    found = sorted((o for o in mine if o.endswith(f".{name}")), key=lambda o: (o.count("."), o))
    nearest = [o for o in found if o.count(".") == found[0].count(".")]
    if nearest:
        return " or ".join(nearest)
    others = (other for other in COMMANDS if option in options_of(other))
    return next((f"`nvsim {other} {option}`" for other in others), option)
