"""A computation of the window in a child process that answers with bytes. Does not use Qt."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from nvsim.errors import InputError

NICE = 5  # the window has priority


class Child:
    """One run of `module`, which starts immediately. The module must call `answer` as its main function."""

    def __init__(self, module: str, argument: Path, cannot: str, then: str = "close other programs") -> None:
        """`cannot` is the beginning of the error sentence, `then` is the fix if no process can be started. Raises
        InputError if no process can be started."""
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        command, pipe = [sys.executable, "-P", "-m", module, str(argument)], subprocess.PIPE
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, env=environment
            )
        except OSError as error:
            raise InputError(f"{cannot}: {error}; {then}.") from error
        self._cannot, self._killed = cannot, False

    def output(self) -> bytes | None:
        """Waits for the output. None after `kill`. Raises InputError with the reason if the process fails."""
        found, words = self._process.communicate()
        if self._killed:
            return None
        if self._process.returncode != 0:
            lines = words.decode(errors="replace").strip().splitlines()
            why = lines[-1] if lines else f"its process ended with code {self._process.returncode}"
            raise InputError(why if self._process.returncode == 2 else f"{self._cannot}: {why}.")
        return found

    def kill(self) -> None:
        """Ends the process. Can be called from any thread, also after the end."""
        self._killed = True
        self._process.kill()


def answer(work: Callable[[Path], bytes]) -> int:
    """The main function of a child process: writes the result of `work` for the command-line argument to standard
    output. Returns the exit code; 2 after an InputError, whose message is printed."""
    if hasattr(os, "nice"):
        os.nice(NICE)
    try:
        found = work(Path(sys.argv[1]))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    sys.stdout.buffer.write(found)
    return 0
