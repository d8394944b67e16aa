"""Print to a terminal without control characters that come from files.

`say` prints messages, one line each. `screened` guards the standard streams, so that text of any other origin
(argparse, warnings, a library) is also safe.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TextIO

from nvsim.plain_text import printable


def say(*lines: object, error: bool = False) -> None:
    """Prints each of `lines` as one line; on stderr for an `error` or for a message that is not part of the result."""
    stream = sys.stderr if error else sys.stdout
    for line in lines:
        print(printable(line, "\t"), file=stream)
    stream.flush()


@contextmanager
def screened() -> Iterator[None]:
    """Guards sys.stdout and sys.stderr while a command runs. File names may use characters outside the terminal's
    encoding; these are escaped."""
    former = sys.stdout, sys.stderr
    for stream in former:
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    guard_streams()
    try:
        yield
    finally:
        sys.stdout, sys.stderr = former


def guard_streams() -> None:
    """Replaces sys.stdout and sys.stderr with guarded streams."""
    sys.stdout, sys.stderr = guarded_stream(sys.stdout), guarded_stream(sys.stderr)


def guarded_stream(stream: TextIO) -> Any:
    """A stream that replaces control characters in text written to `stream`, except line breaks and tabs."""
    return stream if isinstance(stream, _Guarded) or stream is None else _Guarded(stream)


def bare(stream: Any) -> Any:
    """The stream behind a guard. It is for a library that moves the cursor with control characters and receives no
    control characters from outside."""
    return stream.behind if isinstance(stream, _Guarded) else stream


@contextmanager
def unguarded_streams(words: Iterable[str]) -> Iterator[None]:
    """Removes the guards of the streams for a parser that colors its help and quotes only `words`. The guards stay if
    `words` contain control characters."""
    former = sys.stdout, sys.stderr
    if all(word.isprintable() for word in words):
        sys.stdout, sys.stderr = bare(sys.stdout), bare(sys.stderr)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = former


class _Guarded:
    def __init__(self, behind: TextIO) -> None:
        self.behind = behind

    def write(self, text: str) -> int:
        self.behind.write(printable(text, "\n\t"))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.behind, name)
