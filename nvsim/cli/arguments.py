"""Options from dataclasses: the same class gives the flags, their defaults and their help."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeVar

import tyro

T = TypeVar("T")


def parse(kind: type[T], argv: list[str], verb: str, description: str) -> T:
    """An instance of the dataclass `kind`. Prints usage and exits with code 2 on a wrong option."""
    text = description.split("\n\n")[0]
    try:
        return tyro.cli(
            kind,
            args=argv,
            prog=f"nvsim {verb}",
            description=text,
            config=(tyro.conf.FlagCreatePairsOff, tyro.conf.OmitArgPrefixes if verb in _FLAT else _keep),
        )
    except SystemExit as stop:
        # argparse's convention is kept whatever tyro's version answers: 0 for help, 2 for a wrong option.
        sys.exit(0 if stop.code in (0, None) else 2)


_keep = tyro.conf.AvoidSubcommands
_FLAT = {"submaps", "train", "map"}


@dataclass(frozen=True)
class ProjectArguments:
    """What every command on a project takes."""

    project: Path
    """The project folder, NAME.nvsim."""
    json: bool = False
    """Print typed events, or the result, as JSON."""


Positional = Annotated[T, tyro.conf.Positional]
