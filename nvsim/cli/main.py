"""`nvsim VERB ...`: find the command, run it, and turn every failure into one sentence and an exit code.

Exit codes: 0 success, 1 a bug in NVSim, 2 an error of the user, 130 stopped. No large package is imported before the
command is known.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from nvsim.cli.command_table import COMMANDS
from nvsim.cli.terminal import guarded_terminal, print_lines

_GROUPS = {verb.split()[0] for verb in COMMANDS if " " in verb}


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; returns its exit code."""
    with guarded_terminal():
        try:
            return _run(list(sys.argv[1:] if argv is None else argv))
        except BrokenPipeError:
            # The reader of the output ended, as `head` does. There is no one to report to.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0


def _run(arguments: list[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print_lines(*_help().split("\n"))
        return 0
    if arguments[0] in ("-V", "--version"):
        from nvsim import __version__

        print_lines(f"nvsim {__version__}")
        return 0
    verb, rest = arguments[0], arguments[1:]
    if verb in _GROUPS and (verb not in COMMANDS or (rest and f"{verb} {rest[0]}" in COMMANDS)):
        if not rest or rest[0] in ("-h", "--help"):
            print_lines(*_help(verb).split("\n"))
            return 0 if rest else 2
        verb, rest = f"{verb} {rest[0]}", rest[1:]
    if verb not in COMMANDS:
        from nvsim.cli.mistakes import unknown_command

        print_lines(f"nvsim: {unknown_command(verb)}", error=True)
        return 2
    # With few cores, the thread pools of torch and numba block each other by busy waiting, so they wait passively. This
    # must be set before either is loaded.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    from nvsim.cli.guard import run_guarded
    from nvsim.cli.options import command_of

    return run_guarded(verb, command_of(verb), rest)


def _help(group: str = "") -> str:
    rows = [(v, text) for v, (_, text) in COMMANDS.items() if not group or v.split()[0] == group]
    width = max(len(v) for v, _ in rows)
    lines = [f"  {v:<{width}}  {text}" for v, text in rows]
    head = "NVSim: navigation simulators from images of a building with poses.\n\nusage: nvsim COMMAND [options]"
    tail = "`nvsim COMMAND --help` explains the common options of a command, and `--help-all` explains all of them."
    tail += "\nA project is a folder, NAME.nvsim."
    return "\n".join([head, "", *lines, "", tail])


if __name__ == "__main__":
    sys.exit(main())
