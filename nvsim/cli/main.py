"""`nvsim VERB ...`: finds the command, runs it, and turns every failure into one sentence and an exit code.

0 done, 2 the user's mistake, 1 ours, 130 stopped. Nothing heavy is imported before the command is known.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence

from nvsim.cli.command_table import COMMANDS
from nvsim.cli.terminal import say, screened

_GROUPS = {verb.split()[0] for verb in COMMANDS if " " in verb}


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; returns its exit code."""
    with screened():
        try:
            return _run(list(sys.argv[1:] if argv is None else argv))
        except BrokenPipeError:
            # The reader of our output went away, as `head` does; nobody is left to tell.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0


def _run(arguments: list[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        say(*_help().split("\n"))
        return 0
    if arguments[0] in ("-V", "--version"):
        from nvsim import __version__

        say(f"nvsim {__version__}")
        return 0
    verb, rest = arguments[0], arguments[1:]
    if verb in _GROUPS and (verb not in COMMANDS or (rest and f"{verb} {rest[0]}" in COMMANDS)):
        if not rest or rest[0] in ("-h", "--help"):
            say(*_help(verb).split("\n"))
            return 0 if rest else 2
        verb, rest = f"{verb} {rest[0]}", rest[1:]
    if verb not in COMMANDS:
        say(f"nvsim: there is no command `{verb}`; `nvsim --help` lists them.", error=True)
        return 2
    # The thread pools of torch and numba spin against each other on few cores; passive waiting leaves them to work.
    # It has to be said before either is loaded.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    from nvsim.cli.guard import guarded

    command = importlib.import_module(f"nvsim.cli.commands.{COMMANDS[verb][0]}")
    return guarded(verb, command, rest)


def _help(group: str = "") -> str:
    rows = [(v, text) for v, (_, text) in COMMANDS.items() if not group or v.split()[0] == group]
    width = max(len(v) for v, _ in rows)
    lines = [f"  {v:<{width}}  {text}" for v, text in rows]
    head = "NVSim: from images of a building with poses to a navigation simulator.\n\nusage: nvsim COMMAND [options]"
    tail = "`nvsim COMMAND --help` explains its options. A project is a folder, NAME.nvsim."
    return "\n".join([head, "", *lines, "", tail])


if __name__ == "__main__":
    sys.exit(main())
