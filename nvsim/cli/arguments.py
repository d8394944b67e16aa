"""Options from dataclasses: the same class gives the flags, their defaults and their help."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, TypeVar

import tyro

from nvsim.cli.terminal import bare_for
from nvsim.errors import InputError

T = TypeVar("T")
Positional = Annotated[T, tyro.conf.Positional]
Inline = Annotated[T, tyro.conf.arg(name="")]
"""A configuration whose fields are flags without a prefix."""


@dataclass(frozen=True)
class ProjectArguments:
    """What every command on a project takes."""

    project: Path
    """The project folder, NAME.nvsim."""
    json: bool = False
    """Print typed events, or the result, as JSON."""


Memory = Annotated[float | None, tyro.conf.arg(metavar="GIB")]
"""A limit in GiB on the trained models in memory."""


def memory_budget(gibibytes: float | None) -> int | None:
    """Bytes. Raises InputError when it is not positive."""
    if gibibytes is None:
        return None
    if not 0 < gibibytes < 1 << 20:
        raise InputError(f"Models cannot have {gibibytes} GiB of memory; give --memory a positive number.")
    return round(gibibytes * (1 << 30))


def parse(command: ModuleType, argv: list[str], verb: str) -> Any:
    """The command's Arguments. A command with presets offers `defaults(argv)`, the Arguments that the other flags then
    change. Prints usage and exits with code 2 on a wrong option."""
    text = (command.__doc__ or "").split("\n\n")[0]
    options: dict[str, Any] = {}
    if hasattr(command, "defaults"):
        options["default"] = command.defaults(argv)
    try:
        with bare_for(argv):
            return tyro.cli(
                command.Arguments,
                args=argv,
                prog=f"nvsim {verb}",
                description=text,
                config=(tyro.conf.FlagCreatePairsOff,),
                **options,
            )
    except SystemExit as stop:
        # argparse's convention is kept whatever tyro's version answers: 0 for help, 2 for a wrong option.
        sys.exit(0 if stop.code in (0, None) else 2)


def given(argv: list[str], flag: str, default: str) -> str:
    """The value of `flag` in `argv`, before anything is parsed; `default` where it is not there."""
    for i, word in enumerate(argv):
        if word == flag and i + 1 < len(argv):
            return argv[i + 1]
        if word.startswith(flag + "="):
            return word[len(flag) + 1 :]
    return default
