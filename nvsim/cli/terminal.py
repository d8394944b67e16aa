"""Print to a terminal without control characters that come from files.

`say` prints messages, one line each. `screened` guards the standard streams below it, so that text of any other origin
(argparse, warnings, a library) is made harmless as well.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TextIO

from nvsim.plain_text import printable


def say(*lines: object, error: bool = False) -> None:
    """Prints each of `lines` as one line, on stderr for an `error` or a message beside the result."""
    stream = sys.stderr if error else sys.stdout
    for line in lines:
        print(printable(line, "\t"), file=stream)
    stream.flush()


@contextmanager
def screened() -> Iterator[None]:
    """Guards sys.stdout and sys.stderr while a command runs. Names of files need not be in the encoding of the
    terminal, so what it cannot show is escaped."""
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
    """Puts a guard before the streams that sys.stdout and sys.stderr are now."""
    sys.stdout, sys.stderr = guarded_stream(sys.stdout), guarded_stream(sys.stderr)


def guarded_stream(stream: TextIO) -> Any:
    """A stream that replaces control characters in what is written to `stream`, line breaks and tabs aside."""
    return stream if isinstance(stream, _Guarded) or stream is None else _Guarded(stream)


def bare(stream: Any) -> Any:
    """The stream behind a guard, for a library that moves the cursor by control characters and is given none from
    outside."""
    return stream.behind if isinstance(stream, _Guarded) else stream


@contextmanager
def bare_for(words: Iterable[str]) -> Iterator[None]:
    """The streams without their guards, for a parser that colors its help and quotes only `words`; the guards stay if
    there are control characters in them."""
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
