"""What a job may be told to do: a command that the window offers, on its own project, with options of that command."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.project.work import WORK


def check_order(root: Path, verb: str, arguments: Sequence[str], confined: bool = False) -> None:
    """Raises InputError where `nvsim VERB ARGUMENTS` is no job for the project at `root`; with `confined` also where an
    option names a file or a folder outside of it or other machines, as in an order that somebody else chose the places
    of."""
    from nvsim.cli.arguments import parse
    from nvsim.cli.command_table import COMMANDS

    if verb not in WORK:
        raise InputError(f"`nvsim {verb}` cannot be a job; run it in a terminal.")
    # The parser has options of its own, one of which writes a file.
    own = [word for word in arguments if word.replace("_", "-").startswith("--tyro-")]
    if own:
        raise InputError(f"`nvsim {verb}` has no option {own[0]}; order the job anew.")
    command = importlib.import_module(f"nvsim.cli.commands.{COMMANDS[verb][0]}")
    if confined:
        said = io.StringIO()
        try:
            with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
                parsed = parse(command, list(arguments), verb)
        except SystemExit as stop:
            raise InputError(f"`nvsim {verb}` does not take these options; order the job anew.") from stop
    else:
        parsed = parse(command, list(arguments), verb)
    if parsed.project.expanduser().resolve() != root.resolve():
        raise InputError(f"The job is for another project, {parsed.project}; order it there.")
    cluster = getattr(parsed, "cluster", None)
    if confined and cluster is not None and cluster.executor != "local":
        raise InputError(
            f"It is to be done by the machines of a cluster at {cluster.address}, which somebody else chose; order the "
            "job anew in the Jobs menu."
        )
    for name, path in _paths(parsed) if confined else ():
        if not path.expanduser().resolve().is_relative_to(root.resolve()):
            raise InputError(
                f"Its {name} is {path}, outside of the project, which somebody else chose; order the job anew in the "
                "Jobs menu and choose the place yourself."
            )


def _paths(options: Any) -> Iterator[tuple[str, Path]]:
    """Names and values of all options that are places, left-out ones as they are by default."""
    for field in dataclasses.fields(options):
        value = getattr(options, field.name)
        if isinstance(value, Path):
            yield field.name, value
        elif isinstance(value, tuple):
            yield from ((field.name, item) for item in value if isinstance(item, Path))
        elif dataclasses.is_dataclass(value):
            yield from _paths(value)
