"""List the options of a command, read from its dataclass: flag, type, default, and help of every field. Rename options
in messages to the names that the running command uses.

A stage does not know which command runs it. For example, `--scanless.steps` of `nvsim train` is
`--train.scanless.steps` of `nvsim run`. Messages use the option names of the stage's own command. `rename_options`
converts every message before it is shown.
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import importlib
import inspect
import re
import sys
import threading
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from nvsim.cli.command_table import COMMANDS

_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]*(?:\.[a-z0-9][a-z0-9-]*)*+(?!\w)")
_VALUE = r" (?:\d+(?:\.\d+)?|given|refined|always|never|auto)\b"
_WITH_VALUE = re.compile(rf"({_OPTION.pattern})({_VALUE})?")
_COMMAND = re.compile(r"(`nvsim [^`]*`)")  # options in a command belong to that command
_PARSING = threading.Lock()  # Python 3.11 can fail to parse in two threads at the same time


class Command(Protocol):
    """A command: a dataclass whose docstring is its purpose and whose fields are its arguments. A command with presets
    also has a static method `defaults(argv)`, which returns the arguments of the chosen preset."""

    def run(self) -> int:
        """Runs the command; returns its exit code."""


@dataclass(frozen=True)
class Option:
    """One field of a command.

    path        dotted, as in the dataclass: "config.loss.ssim"
    flag        "--loss.ssim", or "--loss.no-ssim" if the default is True; "" for a positional argument
    hint        the type without annotations
    default     None if the field is required or has no value
    owner       its class and name, "LossConfig.ssim" or "ExportScan.stub"
    groups      the configurations around it that add a prefix, outermost first: ("loss",)
    """

    path: str
    flag: str
    hint: Any
    default: Any
    required: bool
    help: str
    metavar: str
    owner: str
    groups: tuple[str, ...]


def command_of(verb: str) -> type[Command]:
    """The class of `nvsim VERB`: "export scan" is ExportScan."""
    module = importlib.import_module(f"nvsim.cli.commands.{COMMANDS[verb][0]}")
    command: type[Command] = getattr(module, verb.replace("-", " ").title().replace(" ", ""))
    return command


def path_values(given: Any) -> Iterator[tuple[str, Path]]:
    """Names and values of all arguments of a parsed command that are paths, including defaults."""
    for field in dataclasses.fields(given):
        value = getattr(given, field.name)
        if isinstance(value, Path):
            yield field.name, value
        elif isinstance(value, tuple):
            yield from ((field.name, item) for item in value if isinstance(item, Path))
        elif dataclasses.is_dataclass(value):
            yield from path_values(value)


def options(cls: type, default: object = None) -> list[Option]:
    """All fields of a command, with nested configurations flattened. `default`: an instance that replaces
    the defaults of the class."""
    return list(_options(cls, default, "", "", ()))


def _options(cls: type, values: object, path: str, prefix: str, groups: tuple[str, ...]) -> Iterator[Option]:
    hints = typing.get_type_hints(cls, include_extras=True)
    docs = field_docs(cls)
    for field in dataclasses.fields(cls):
        hint, notes = _without_notes(hints[field.name])
        value, required = _default(field) if values is None else (getattr(values, field.name), False)
        name = field.name.rstrip("_").replace("_", "-")  # a word of Python ends with an underscore: for_
        if dataclasses.is_dataclass(hint):
            inline = any(getattr(note, "name", None) == "" for note in notes)
            inner = (prefix, groups) if inline else (f"{prefix}{name}.", (*groups, field.name))
            yield from _options(typing.cast(type, hint), value, f"{path}{field.name}.", *inner)
            continue
        # `defaults` of a command marks required fields with a value of tyro instead of leaving them out
        required = required or type(value).__module__.startswith("tyro.")
        yield Option(
            f"{path}{field.name}",
            "" if any("Positional" in str(note) for note in notes) else _flag(prefix, name, value),
            hint,
            None if required else value,
            required,
            next((note.help for note in notes if getattr(note, "help", None)), docs.get(field.name, "")),
            next((note.metavar for note in notes if getattr(note, "metavar", None)), ""),
            f"{_definer(cls, field.name)}.{field.name}",
            groups,
        )


def _flag(prefix: str, name: str, value: object) -> str:
    return f"--{prefix}no-{name}" if value is True else f"--{prefix}{name}"


def _without_notes(hint: object) -> tuple[object, list[Any]]:
    notes: list[Any] = []
    while typing.get_origin(hint) is typing.Annotated:
        hint, *more = typing.get_args(hint)
        notes += more
    return hint, notes


def _default(field: dataclasses.Field[Any]) -> tuple[Any, bool]:
    """The default of a field, and whether the field is required."""
    if field.default is not dataclasses.MISSING:
        return field.default, False
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory(), False
    return None, True


def _definer(cls: type, name: str) -> str:
    return next(base for base in cls.__mro__ if name in base.__dict__.get("__annotations__", {})).__name__


@functools.cache
def field_docs(cls: type) -> dict[str, str]:
    """Field -> the string below it in the source, including inherited fields. Empty if there is no source."""
    docs: dict[str, str] = {}
    for base in reversed(cls.__mro__[:-1]):
        body = _class_bodies(base.__module__).get(base.__qualname__, [])
        for first, second in zip(body, body[1:]):
            if (
                isinstance(first, ast.AnnAssign)
                and isinstance(first.target, ast.Name)
                and isinstance(second, ast.Expr)
                and isinstance(second.value, ast.Constant)
                and isinstance(second.value.value, str)
            ):
                docs[first.target.id] = " ".join(second.value.value.split())
    return docs


def _class_bodies(module: str) -> dict[str, list[ast.stmt]]:
    """The statements of the classes at the top of a module, by name. Empty if there is no source."""
    with _PARSING:
        return _parsed_class_bodies(module)


@functools.cache
def _parsed_class_bodies(module: str) -> dict[str, list[ast.stmt]]:
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError):
        return {}
    return {node.name: node.body for node in tree.body if isinstance(node, ast.ClassDef)}


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
        _WITH_VALUE.sub(lambda found: _option_with_value(verb, found[1], stage, found[2] or ""), part)
        for part in parts[::2]
    ]
    return "".join(parts)


def _option_with_value(verb: str, option: str, stage: str, value: str) -> str:
    """The option with the `value` that follows it, or ""."""
    mine, name = options_of(verb), option[2:]
    if option in mine:
        return option + value
    if f"--{stage}.{name}" in mine:
        return f"--{stage}.{name}{value}"
    if "." in name and f"--{name.split('.', 1)[1]}" in mine:
        return f"--{name.split('.', 1)[1]}{value}"
    found = sorted((o for o in mine if o.endswith(f".{name}")), key=lambda o: (o.count("."), o))
    nearest = [o for o in found if o.count(".") == found[0].count(".")]
    if nearest:
        return " or ".join(nearest) + value
    others = (other for other in ("run", *COMMANDS) if option in options_of(other))  # not the built-in building
    return next((f"`nvsim {other} {option}{value}`" for other in others), option + value)
