"""Runs a command of NVSim in a side process. Does not use Qt."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Sequence
from dataclasses import dataclass

from nvsim_app.processes.serving import Requests


@dataclass(frozen=True)
class CommandOutput:
    """The lines that a command prints: its result, and its messages."""

    lines: tuple[str, ...]
    messages: tuple[str, ...]


def run_command(requests: Requests, words: Sequence[str]) -> CommandOutput:
    """Runs `nvsim WORDS`."""
    from nvsim.cli.main import main

    result, messages = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(result), contextlib.redirect_stderr(messages), contextlib.suppress(SystemExit):
        main(words)
    return CommandOutput(tuple(result.getvalue().splitlines()), tuple(messages.getvalue().strip().splitlines()))
