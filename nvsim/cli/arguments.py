"""Derive command-line options from dataclasses: one class defines the options, their defaults, and their help. `--help`
shows the common options, `--help-all` shows all options."""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import sys
import textwrap
import types
import typing
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import tyro

from nvsim.cli.help_table import COMMON, EXAMPLES, LIMIT, WITHOUT
from nvsim.cli.mistakes import OptionError, mistake_in
from nvsim.cli.options import Command, Option, options
from nvsim.cli.terminal import print_lines
from nvsim.errors import InputError

T = TypeVar("T")
Positional = Annotated[T, tyro.conf.Positional]
Inline = Annotated[T, tyro.conf.arg(name="")]
"""A configuration whose fields become options without a prefix."""
_COLUMN = 30  # characters from the left edge to the text of an option
_NAMES = {int: "INT", float: "FLOAT", str: "TEXT", Path: "PATH"}
_EARLIER_NAMES = {"least-metres": "least-meters", "most-metres": "most-meters", "neighbours": "neighbors"}
"""Options of earlier versions, in scripts and stored jobs -> their current names. Both are without the dashes."""


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

    text = [f"usage: {_usage(verb, found)}", ""]
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
    words = [f"nvsim {verb}"]
    words += [invocation(o) if o.required else f"[{invocation(o)}]" for o in found if not o.flag]
    words += [invocation(o) for o in found if o.flag and o.required]
    return " ".join([*words, "[options]"])


def _common_groups(flags: list[Option], table: dict[str, tuple[str, ...]]) -> list[tuple[str, list[Option]]]:
    # A preset can change a default from True to False, and --no-x to --x.
    by_name = {o.flag: o for o in flags} | {_negated_flag(o): o for o in flags}
    return [(title, [by_name[name] for name in names]) for title, names in table.items()]


def _negated_flag(option: Option) -> str:
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


@dataclass(frozen=True)
class ProjectArguments:
    """Arguments of every command that works on a project."""

    project: Path
    """The project folder, NAME.nvsim."""
    json: bool = False
    """Print events or the result as JSON."""


Memory = Annotated[float | None, tyro.conf.arg(metavar="GIB")]
"""A limit in GiB on the memory of trained models."""


def memory_budget(gibibytes: float | None) -> int | None:
    """The budget in bytes, None for None. Raises InputError if it is not positive."""
    if gibibytes is None:
        return None
    if not 0 < gibibytes < 1 << 20:
        raise InputError(f"Models cannot have {gibibytes} GiB of memory; give --memory a positive number.")
    return round(gibibytes * (1 << 30))


_registry = tyro.constructors.ConstructorRegistry()


@_registry.primitive_rule
def _number(info: tyro.constructors.PrimitiveTypeInfo) -> tyro.constructors.PrimitiveConstructorSpec[Any] | None:
    """Reads integers and floats without Python's underscores, as in 1_0 for 10, which are usually typing errors."""
    kind: type[int] | type[float]
    if info.type is int:
        kind = int
    elif info.type is float:
        kind = float
    else:
        return None

    def read(words: list[str]) -> int | float:
        if "_" in words[0]:
            raise ValueError(f"{words[0]} is not a number")
        return kind(words[0])

    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar=kind.__name__.upper(),
        instance_from_str=read,
        is_instance=lambda value: isinstance(value, int | float) if kind is float else type(value) is int,
        str_from_instance=lambda value: [str(value)],
    )


def parse(command: type[Command], argv: list[str], verb: str) -> Any:
    """Parses `argv` into the command. Prints the help if `argv` asks for it, and exits with code 0. Raises OptionError
    if an option or a value is wrong or missing."""
    argv = _with_current_flags(argv)
    if asked := requested_help(argv):
        print_lines(*lines(command, verb, argv, everything=asked == "all"))
        sys.exit(0)
    text = (command.__doc__ or "").split("\n\n")[0]
    given_defaults: dict[str, Any] = {}
    if hasattr(command, "defaults"):
        given_defaults["default"] = command.defaults(argv)
    report = io.StringIO()
    try:
        with contextlib.redirect_stderr(report):
            return tyro.cli(
                command,
                args=argv,
                prog=f"nvsim {verb}",
                description=text,
                config=(tyro.conf.FlagCreatePairsOff,),
                registry=_registry,
                **given_defaults,
            )
    except SystemExit as stop:
        if stop.code in (0, None):
            sys.exit(0)
        found = options(command, given_defaults.get("default"))
        sentence = mistake_in(verb, found, argv, _usage(verb, found))
        raise OptionError(sentence or " ".join(re.sub(r"[─-╿]", " ", report.getvalue()).split())) from None


def _with_current_flags(argv: list[str]) -> list[str]:
    own = argv.index("--") if "--" in argv else len(argv)
    pairs = [word.partition("=") for word in argv[:own]]
    return [*(_current_flag(flag) + sign + value for flag, sign, value in pairs), *argv[own:]]


def _current_flag(flag: str) -> str:
    name = _EARLIER_NAMES.get(flag.removeprefix("--"))
    return f"--{name}" if name and flag.startswith("--") else flag


def value_of_flag(argv: list[str], flag: str, default: str) -> str:
    """The value of `flag` in the unparsed `argv`; `default` if the flag is not there."""
    for i, word in enumerate(argv):
        if word == flag and i + 1 < len(argv):
            return argv[i + 1]
        if word.startswith(flag + "="):
            return word[len(flag) + 1 :]
    return default
