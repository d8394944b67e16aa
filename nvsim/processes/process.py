"""A process of NVSim that runs a function and has a pipe to the process that started it.

It is not a fork, because a fork of a process with threads may hang. It does not import the main module of its caller,
which may be a script without `if __name__ == "__main__"`.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any

from nvsim.errors import InputError
from nvsim.processes.messages import send


class PipedProcess:
    """A process that runs `function(connection, *arguments)`, where `connection` is its end of the pipe. It starts at
    once. It ends when the function returns, and with the process that started it, also during a long computation.

    function     a module-level function of a module that can be imported
    arguments    values that can be pickled
    hide_output  whether its error output is hidden, which some libraries fill with messages
    connection   this process's end of the pipe, a `multiprocessing.connection.Connection`

    Raises InputError if no process can be started, and the exception of `pickle` if an argument cannot be pickled.
    """

    def __init__(self, function: Callable[..., object], *arguments: Any, hide_output: bool = False) -> None:
        self._owner, self._ending = os.getpid(), threading.RLock()
        self.connection, theirs = multiprocessing.Pipe()
        # Carries no data: it closes when this process ends, and the child notices.
        life, self._life = multiprocessing.Pipe(duplex=False)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "nvsim.processes.serving", str(theirs.fileno()), str(life.fileno())],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL if hide_output else None,
                pass_fds=(theirs.fileno(), life.fileno()),
                env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            )  # fmt: skip
        except OSError as error:
            self._close()
            raise InputError(f"No process can be started ({error.strerror}); close other programs.") from error
        finally:
            theirs.close()
            life.close()
        try:
            send(self.connection, (function, arguments))
        except OSError:
            pass  # the process has ended; the next read from the pipe reports it
        except BaseException:
            self.end()
            raise

    @property
    def is_owned(self) -> bool:
        """False in a fork of the process that started it. The fork shares the pipe and must not use it."""
        return self._owner == os.getpid()

    @property
    def id(self) -> int:
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """None while it runs; negative if a signal ended it."""
        return self._process.poll()

    def wait(self, seconds: float | None = None) -> bool:
        """Waits for its end, at most for `seconds`. Returns whether it has ended."""
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def terminate(self) -> None:
        """Asks it to end, without waiting. Can be called from any thread."""
        self._process.terminate()

    def kill(self) -> None:
        """Ends it without waiting. Can be called from any thread."""
        self._process.kill()

    def end(self) -> None:
        """Kills it, waits for its end, and closes the pipe. Another thread that reads from the pipe gets an EOFError or
        OSError. Does nothing in a fork of its owner, or if called again, also in another thread."""
        if not self.is_owned:
            return
        with self._ending:
            if not self.connection.closed:
                self._process.kill()
                self._process.wait()
                self._close()

    def _close(self) -> None:
        self.connection.close()
        self._life.close()
