"""Print results as a JSON object or a small table, and notes about files."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from nvsim.cli.terminal import bare, say
from nvsim.plain_text import printable


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
        say(as_json(values))
        return
    flat = {k: v for k, v in values.items() if not isinstance(v, list | dict | tuple)}
    table(("metric", "value"), [(k, _text(v)) for k, v in flat.items()], title)


def notes(sentences: Iterable[str]) -> None:
    """Prints notes about a file on stderr, each sentence once, so that the results on stdout stay clean."""
    say(*(f"note: {sentence}" for sentence in dict.fromkeys(sentences)), error=True)


def table(head: Sequence[str], rows: Sequence[Sequence[object]], title: str = "") -> None:
    """Prints a table. Cells are plain text, because rich would interpret brackets in strings as markup."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    grid = Table(*head, title=Text(printable(title), "table.title") if title else None, title_justify="left")
    for row in rows:
        grid.add_row(*(Text(printable(_text(v))) for v in row))
    Console(file=bare(sys.stdout)).print(grid)


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1000 else f"{value:.0f}"
    return str(value)
