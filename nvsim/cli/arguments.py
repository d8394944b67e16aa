"""Derive command-line options from dataclasses: one class defines the options, their defaults, and their help."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro

from nvsim.cli import help
from nvsim.cli.options import Command
from nvsim.cli.terminal import say, unguarded_streams
from nvsim.errors import InputError

T = TypeVar("T")
Positional = Annotated[T, tyro.conf.Positional]
Inline = Annotated[T, tyro.conf.arg(name="")]
"""A configuration whose fields become options without a prefix."""


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
    """Parses `argv` into the command. Prints the help if `argv` asks for it, and exits with code 0. Prints usage and
    exits with code 2 on a wrong option."""
    if asked := help.requested_help(argv):
        say(*help.lines(command, verb, argv, everything=asked == "all"))
        sys.exit(0)
    text = (command.__doc__ or "").split("\n\n")[0]
    options: dict[str, Any] = {}
    if hasattr(command, "defaults"):
        options["default"] = command.defaults(argv)
    try:
        with unguarded_streams(argv):
            return tyro.cli(
                command,
                args=argv,
                prog=f"nvsim {verb}",
                description=text,
                config=(tyro.conf.FlagCreatePairsOff,),
                registry=_registry,
                **options,
            )
    except SystemExit as stop:
        # Keep argparse's convention for any version of tyro: 0 for help, 2 for a wrong option.
        sys.exit(0 if stop.code in (0, None) else 2)


def given(argv: list[str], flag: str, default: str) -> str:
    """The value of `flag` in the unparsed `argv`; `default` if the flag is not there."""
    for i, word in enumerate(argv):
        if word == flag and i + 1 < len(argv):
            return argv[i + 1]
        if word.startswith(flag + "="):
            return word[len(flag) + 1 :]
    return default
