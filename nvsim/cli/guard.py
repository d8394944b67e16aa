"""Run a command and report its failures: one sentence on stderr, and the traceback in a log file."""

from __future__ import annotations

import errno
import os
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path
from types import FrameType

from nvsim.cli.console import advise, report_failure, with_command_options
from nvsim.cli.options import Command
from nvsim.cli.terminal import print_lines
from nvsim.errors import InputError
from nvsim.events import Failed
from nvsim.files.atomic import as_input_error
from nvsim.plain_text import printable

_FOREIGN = ("r2r python",)
"""Commands that become another program, about which NVSim knows nothing."""


class CommandStopped(BaseException):
    """A user or a program asked the command to stop (SIGTERM, Ctrl-C)."""


def run_guarded(verb: str, command: type[Command], argv: list[str]) -> int:
    """Parses `argv` into the command and runs it; returns the exit code."""
    from nvsim.cli.arguments import parse
    from nvsim.cli.mistakes import OptionError
    from nvsim.cli.session import warn_of_outdated_results

    signal.signal(signal.SIGTERM, _stop)
    signal.signal(signal.SIGINT, _stop)
    as_json = "--json" in argv
    advise(verb, argv)
    try:
        given = parse(command, argv, verb)
        warn_of_outdated_results(verb, given)
        code = given.run()
        sys.stdout.flush()
        return int(code or 0)
    except OptionError as error:
        return _fail(verb, str(error), 2, as_json, rename=False)
    except InputError as error:
        return _fail(verb, str(error), 2, as_json)
    except CommandStopped:
        then = "" if verb in _FOREIGN else "; run the same command again to continue"
        return _fail(verb, f"stopped{then}", 130, as_json)
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
    raise CommandStopped


def _fail(verb: str, sentence: str, code: int, as_json: bool, rename: bool = True) -> int:
    if rename:
        sentence = with_command_options(sentence)
    report_failure(Failed(verb.split()[0], sentence, code), as_json)
    print_lines(f"nvsim {verb}: {sentence}", error=True)
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
