"""Check the command of a job: it must be one that the window offers, for its own project, with valid options."""

from __future__ import annotations

import contextlib
import dataclasses
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from nvsim.errors import InputError, shown
from nvsim.project.work import WORK


def check_order(root: Path, verb: str, arguments: Sequence[str], confined: bool = False) -> None:
    """Raises InputError if `nvsim VERB ARGUMENTS` is not a job for the project at `root`. With `confined` also if an
    option names another machine, an endpoint, or a path outside the project; a project from another person may contain
    such jobs."""
    from nvsim.cli.arguments import parse
    from nvsim.cli.options import command_of

    if verb not in WORK:
        raise InputError(f"`nvsim {verb}` cannot be a job; run it in a terminal.")
    # The parser has its own options, one of which writes a file.
    own = [word for word in arguments if word.replace("_", "-").startswith("--tyro-")]
    if own:
        raise InputError(f"`nvsim {verb}` has no option {own[0]}; start the job again.")
    command = command_of(verb)
    if confined:
        said = io.StringIO()
        try:
            with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
                parsed = parse(command, list(arguments), verb)
        except SystemExit as stop:
            raise InputError(f"`nvsim {verb}` does not take these options; start the job again.") from stop
    else:
        parsed = parse(command, list(arguments), verb)
    if parsed.project.expanduser().resolve() != root.resolve():
        raise InputError(f"The job is for another project, {parsed.project}; start it there.")
    cluster = getattr(parsed, "cluster", None)
    if confined and cluster is not None and cluster.executor != "local":
        raise InputError(
            f"This job would run on a cluster at {cluster.address}, which another person chose; start the "
            "job again from the Jobs menu."
        )
    asked = getattr(parsed, "asked", None)
    if confined and asked is not None and (asked.endpoint or asked.key_variable):
        raise InputError(
            f"This job would send data to {shown(asked.endpoint or 'an endpoint')}, which another person chose; start "
            "the job again from the Jobs menu."
        )
    for name, path in _paths(parsed) if confined else ():
        if not path.expanduser().resolve().is_relative_to(root.resolve()):
            raise InputError(
                f"The option {name} of this job is {path}, outside of the project, which another person chose; start "
                "the job again from the Jobs menu and choose the path yourself."
            )


def _paths(options: Any) -> Iterator[tuple[str, Path]]:
    """Names and values of all options that are paths, including defaults."""
    for field in dataclasses.fields(options):
        value = getattr(options, field.name)
        if isinstance(value, Path):
            yield field.name, value
        elif isinstance(value, tuple):
            yield from ((field.name, item) for item in value if isinstance(item, Path))
        elif dataclasses.is_dataclass(value):
            yield from _paths(value)
