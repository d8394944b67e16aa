"""Print the help of a command: `--help` shows the common options, `--help-all` shows all options."""

from __future__ import annotations

import shutil
import textwrap
import types
import typing
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

from nvsim.cli.help_table import COMMON, EXAMPLES, LIMIT, WITHOUT
from nvsim.cli.options import Command, Option, options

_COLUMN = 30  # characters from the left edge to the text of an option
_NAMES = {int: "INT", float: "FLOAT", str: "TEXT", Path: "PATH"}


def requested_help(argv: Sequence[str]) -> Literal["common", "all"] | None:
    """The help that `argv` asks for. Words after `--` belong to another program."""
    own = argv[: argv.index("--")] if "--" in argv else argv
    if "--help-all" in own:
        return "all"
    return "common" if "-h" in own or "--help" in own else None


def lines(command: type[Command], verb: str, argv: list[str], everything: bool) -> list[str]:
    """The help of a command. `argv` selects the preset whose defaults are shown."""
    width = min(shutil.get_terminal_size().columns, 110)
    default = command.defaults(argv) if hasattr(command, "defaults") else None
    found = options(command, default)
    positional, flags = [o for o in found if not o.flag], [o for o in found if o.flag]
    common = COMMON.get(verb, {}) if len(flags) > LIMIT else {}
    groups = _all_groups(flags) if everything or not common else _common_groups(flags, common)

    text = [_usage(verb, found), ""]
    purpose = (command.__doc__ or "").split("\n\n")[0]
    text += [*textwrap.wrap(" ".join(purpose.split()), width), ""]
    if positional:
        text += ["Arguments", *_rows(positional, width), ""]
    for title, group in groups:
        text += [title, *_rows(group, width), ""]
    text += ["Help", *_row("-h, --help", "Show the common options." if common else "Show this help.", width)]
    if common or everything:
        text += _row("--help-all", f"Show all {len(flags)} options.", width)
    examples = EXAMPLES.get(verb, ())
    return [*text, "", "Examples" if len(examples) > 1 else "Example", *(f"  {example}" for example in examples)]


def _usage(verb: str, found: Iterable[Option]) -> str:
    words = [f"usage: nvsim {verb}"]
    words += [invocation(o) if o.required else f"[{invocation(o)}]" for o in found if not o.flag]
    words += [invocation(o) for o in found if o.flag and o.required]
    return " ".join([*words, "[options]"])


def _common_groups(flags: list[Option], table: dict[str, tuple[str, ...]]) -> list[tuple[str, list[Option]]]:
    # A preset can change a default from True to False, and --no-x to --x.
    by_name = {o.flag: o for o in flags} | {_negated(o): o for o in flags}
    return [(title, [by_name[name] for name in names]) for title, names in table.items()]


def _negated(option: Option) -> str:
    head, dot, last = option.flag[2:].rpartition(".")
    return f"--{head}{dot}no-{last}"


def _all_groups(flags: list[Option]) -> list[tuple[str, list[Option]]]:
    groups: dict[tuple[str, ...], list[Option]] = {}
    for option in flags:
        groups.setdefault(option.groups, []).append(option)
    return [(f"Options: {' '.join(key).replace('_', ' ')}" if key else "Options", groups[key]) for key in groups]


def _rows(group: list[Option], width: int) -> list[str]:
    return [line for option in group for line in _row(invocation(option), option_help(option), width)]


def _row(name: str, meaning: str, width: int) -> list[str]:
    body = textwrap.wrap(meaning, max(width - _COLUMN, 30), break_on_hyphens=False, break_long_words=False)
    indented = [" " * _COLUMN + line for line in body]
    if body and len(name) <= _COLUMN - 4:
        return [f"  {name:<{_COLUMN - 2}}{body[0]}", *indented[1:]]
    return [f"  {name}", *indented]


def invocation(option: Option) -> str:
    """The option with its value as a user types it, such as "--steps INT"."""
    value = option.metavar or _metavar(option.hint)
    if not option.flag:
        name = option.path.rpartition(".")[2].upper()
        repeated = typing.get_origin(option.hint) is tuple
        return value if value.startswith("{") else f"{name} ..." if repeated else name
    return f"{option.flag} {value}" if option.hint is not bool else option.flag


def _metavar(hint: Any) -> str:
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        parts = [_metavar(part) for part in inner if part is not type(None)]
        if len(parts) > 1 and all(part.startswith("{") for part in parts):
            return "{" + ",".join(part[1:-1] for part in parts) + "}"
        return "|".join(parts)
    if origin is Literal:
        return "{" + ",".join(str(value) for value in inner if value != "") + "}"
    if origin is tuple:
        return f"{_metavar(inner[0])} ..." if inner[-1] is Ellipsis else " ".join(map(_metavar, inner))
    return _NAMES.get(hint, "VALUE")


def option_help(option: Option) -> str:
    """The meaning of an option, with its default."""
    if option.default is True and option.hint is bool:
        return WITHOUT.get(option.owner, option.help)
    text = option.help
    if option.required and option.flag:
        return f"{text} Required."
    value = option.default
    if option.required or value is None or isinstance(value, bool) or value in ("", ()) or "Default:" in text:
        return text
    shown = " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
    return f"{text} (default: {shown})"
