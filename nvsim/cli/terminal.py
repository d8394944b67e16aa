"""Print results as a JSON object or a small table, without control characters that come from files.

`print_lines` prints messages, one line each. `guarded_terminal` guards the standard streams, so that text of other
origins (warnings, a library) is also safe.
"""

from __future__ import annotations

import io
import json
import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TextIO

from nvsim.plain_text import printable


def print_lines(*lines: object, error: bool = False) -> None:
    """Prints each of `lines` as one line; on stderr for an `error` or for a message that is not part of the result."""
    stream = sys.stderr if error else sys.stdout
    for line in lines:
        print(printable(line, "\t"), file=stream)
    stream.flush()


@contextmanager
def guarded_terminal() -> Iterator[None]:
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
    return stream if isinstance(stream, _ScreenedStream) or stream is None else _ScreenedStream(stream)


def unguarded_stream(stream: Any) -> Any:
    """The stream behind a guard. It is for a library that moves the cursor with control characters and receives no
    control characters from outside."""
    return stream.behind if isinstance(stream, _ScreenedStream) else stream


class _ScreenedStream:
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


def as_json(values: object) -> str:
    """One line of JSON in plain ASCII without control characters. NaN and infinity become null, because JSON does not
    have them."""
    try:
        text = json.dumps(values, allow_nan=False)
    except ValueError:
        text = json.dumps(_finite(json.loads(json.dumps(values))), allow_nan=False)
    return text.replace("\x7f", "\\u007f")


def _finite(values: Any) -> Any:
    if isinstance(values, dict):
        return {name: _finite(value) for name, value in values.items()}
    if isinstance(values, list):
        return [_finite(value) for value in values]
    return None if isinstance(values, float) and not math.isfinite(values) else values


def figures(values: Mapping[str, object], in_json: bool, title: str = "") -> None:
    """Prints named values. Nested values appear only in the JSON."""
    if in_json:
        print_lines(as_json(values))
        return
    flat = {k: v for k, v in values.items() if not isinstance(v, list | dict | tuple)}
    table(("metric", "value"), [(k, _text(v)) for k, v in flat.items()], title)


def print_notes(sentences: Iterable[str]) -> None:
    """Prints notes about a file on stderr, each sentence once, so that the results on stdout stay clean."""
    print_lines(*(f"note: {sentence}" for sentence in dict.fromkeys(sentences)), error=True)


def table(head: Sequence[str], rows: Sequence[Sequence[object]], title: str = "") -> None:
    """Prints a table. Cells are plain text, because rich would interpret brackets in strings as markup."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    grid = Table(*head, title=Text(printable(title), "table.title") if title else None, title_justify="left")
    for row in rows:
        grid.add_row(*(Text(printable(_text(v))) for v in row))
    Console(file=unguarded_stream(sys.stdout)).print(grid)


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1000 else f"{value:.0f}"
    return str(value)
