"""Results on the screen: a JSON object, or a small table."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence


def figures(values: Mapping[str, object], as_json: bool, title: str = "") -> None:
    """Prints named figures; nested values are only in the JSON."""
    if as_json:
        print(json.dumps(values), flush=True)
        return
    flat = {k: v for k, v in values.items() if not isinstance(v, list | dict | tuple)}
    table(("figure", "value"), [(k, _text(v)) for k, v in flat.items()], title)


def table(head: Sequence[str], rows: Sequence[Sequence[object]], title: str = "") -> None:
    """Prints a table."""
    from rich.console import Console
    from rich.table import Table

    grid = Table(*head, title=title or None, title_justify="left")
    for row in rows:
        grid.add_row(*(_text(v) for v in row))
    Console().print(grid)


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1000 else f"{value:.0f}"
    return str(value)
