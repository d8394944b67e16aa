"""`nvsim VERB ...`: find the command, run it, and turn every failure into one sentence and an exit code.

Exit codes: 0 success, 1 a bug in NVSim, 2 an error of the user, 130 stopped. No large package is imported before the
command is known.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

from nvsim.cli.command_table import COMMANDS
from nvsim.cli.console import advise, in_words, tell_failure
from nvsim.cli.options import Command
from nvsim.cli.terminal import say, screened
from nvsim.errors import InputError
from nvsim.events import Failed
from nvsim.files.atomic import as_input_error
from nvsim.plain_text import printable


class Stopped(BaseException):
    """A user or a program asked the command to stop (SIGTERM, Ctrl-C)."""


def guarded(verb: str, command: type[Command], argv: list[str]) -> int:
    """Parses `argv` into the command and runs it; returns the exit code."""
    from nvsim.cli.arguments import parse

    signal.signal(signal.SIGTERM, _stop)
    signal.signal(signal.SIGINT, _stop)
    as_json = "--json" in argv
    advise(verb)
    try:
        code = parse(command, argv, verb).run()
        sys.stdout.flush()
        return int(code or 0)
    except InputError as error:
        return _fail(verb, str(error), 2, as_json)
    except Stopped:
        return _fail(verb, "stopped; run the same command again to continue", 130, as_json)
    except BrokenPipeError:
        raise  # not a failure of the command
    except MemoryError:
        return _fail(verb, "out of memory; use more submaps or fewer Gaussians (--gaussian-cap)", 2, as_json)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EROFS):
            place = Path(os.fsdecode(error.filename)) if isinstance(error.filename, str | bytes) else Path("the result")
            return _fail(verb, str(as_input_error(place, error)), 2, as_json)
        return _crash(verb, error, as_json)
    except Exception as error:
        return _crash(verb, error, as_json)


def _stop(number: int, frame: FrameType | None) -> None:
    raise Stopped


def _fail(verb: str, sentence: str, code: int, as_json: bool) -> int:
    sentence = in_words(sentence)
    tell_failure(Failed(verb.split()[0], sentence, code), as_json)
    say(f"nvsim {verb}: {sentence}", error=True)
    return code


def _crash(verb: str, error: Exception, as_json: bool) -> int:
    where = ""
    try:
        # The folder is shared with other users, so the file name must not be predictable.
        handle, log = tempfile.mkstemp(f"-{time.strftime('%Y%m%d-%H%M%S')}.log", f"nvsim-{verb.replace(' ', '-')}-")
        with os.fdopen(handle, "w", errors="backslashreplace") as file:
            file.write(printable("".join(traceback.format_exception(error)), "\n\t"))
        where = f"; the traceback is in {log}"
    except OSError:
        traceback.print_exception(error)
    return _fail(verb, f"this is a bug in NVSim, please report it ({type(error).__name__}: {error}){where}", 1, as_json)


_GROUPS = {verb.split()[0] for verb in COMMANDS if " " in verb}


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; returns its exit code."""
    with screened():
        try:
            return _run(list(sys.argv[1:] if argv is None else argv))
        except BrokenPipeError:
            # The reader of the output ended, as `head` does. There is no one to report to.
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
    # With few cores, the thread pools of torch and numba block each other by busy waiting, so they wait passively. This
    # must be set before either is loaded.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    from nvsim.cli.options import command_of

    return guarded(verb, command_of(verb), rest)


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
