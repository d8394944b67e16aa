"""Format metrics as a table: aligned text with grouped columns, and CSV. Screens and files show identical text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from nvsim.files.csv_text import csv_text
from nvsim.plain_text import printable

Row = Mapping[str, object]
EMPTY = "-"
SPREAD = "_spread"
"""Suffix of the key with a metric's standard deviation over repetitions."""


@dataclass(frozen=True)
class Column:
    """key in the rows; title; group that adjacent columns share; decimals; whether high or low values are best."""

    key: str
    title: str
    group: str = ""
    decimals: int = 2
    best: Literal["", "high", "low"] = ""


def _picture_columns(suffix: str, group: str) -> tuple[Column, ...]:
    return (
        Column("psnr" + suffix, "PSNR", group, 2, "high"),
        Column("psnr_corrected" + suffix, "corr.", group, 2, "high"),
        Column("ssim" + suffix, "SSIM", group, 3, "high"),
        Column("lpips" + suffix, "LPIPS", group, 3, "low"),
    )


WITH_FLOOR = _picture_columns("", "with floor")
WITHOUT_FLOOR = _picture_columns("_nonfloor", "without floor")
FLOOR_ONLY = _picture_columns("_floor", "floor only")
ALPHA = (
    Column("alpha_floor", "floor", "mean alpha", 3, "low"),
    Column("alpha_nonfloor", "other", "mean alpha", 3, "high"),
)
NOVEL = (
    Column("novel_psnr", "PSNR", "novel views", 2, "high"),
    Column("novel_psnr_down", "down", "novel views", 2, "high"),
    Column("novel_alpha_floor", "alpha", "novel views", 3, "low"),
)


def text_table(columns: Sequence[Column], rows: Sequence[Row], mark_best: bool = False) -> str:
    """Lines of text, with the first column left-aligned and metrics right-aligned. With `mark_best` the best value of a
    column has an asterisk. Missing and None values are a dash."""
    best = {c.key: _best(c, rows) if mark_best else None for c in columns}
    cells = [[_cell(c, row, best[c.key]) for c in columns] for row in rows]
    widths = [max(len(c.title), *(len(r[i]) for r in cells), 0) for i, c in enumerate(columns)]
    spans: list[tuple[int, int]] = []
    for i, c in enumerate(columns):
        if spans and columns[spans[-1][0]].group == c.group:
            spans[-1] = (spans[-1][0], i + 1)
        else:
            spans.append((i, i + 1))
    for first, last in spans:  # the group's name must fit above its columns
        lacking = len(columns[first].group) - (sum(widths[first:last]) + 2 * (last - first - 1))
        widths[first] += max(lacking, 0)

    def line(texts: Sequence[str]) -> str:
        parts = []
        for first, last in spans:
            inside = [t.ljust(w) if first + k == 0 else t.rjust(w) for k, (t, w) in enumerate(
                zip(texts[first:last], widths[first:last], strict=True))]  # fmt: skip
            parts.append("  ".join(inside))
        return " | ".join(parts).rstrip()

    def group_title(first: int, last: int) -> str:
        return columns[first].group.center(sum(widths[first:last]) + 2 * (last - first - 1))

    lines = [" | ".join(group_title(*s) for s in spans).rstrip()] if any(c.group for c in columns) else []
    lines.append(line([c.title for c in columns]))
    lines.append("-+-".join("-" * (sum(widths[a:b]) + 2 * (b - a - 1)) for a, b in spans))
    return "\n".join([*lines, *(line(r) for r in cells)]) + "\n"


def csv_table(names: Sequence[str], rows: Sequence[Row]) -> str:
    """A header of `names`, and one line per row. Missing values are empty."""
    return csv_text([names, *([row.get(n) for n in names] for row in rows)])


def _number(row: Row, key: str) -> float | None:
    value = row.get(key)
    return float(value) if isinstance(value, int | float) else None


def _best(column: Column, rows: Sequence[Row]) -> float | None:
    values = [v for v in (_number(r, column.key) for r in rows) if v is not None]
    if not column.best or len(values) < 2:
        return None
    return round(max(values) if column.best == "high" else min(values), column.decimals)


def _cell(column: Column, row: Row, best: float | None) -> str:
    value = row.get(column.key)
    if value is None:
        return EMPTY + (" " if best is not None else "")
    if isinstance(value, str):
        return printable(value)
    number = float(value) if isinstance(value, int | float) else float("nan")
    text = f"{number:.{column.decimals}f}"
    spread = _number(row, column.key + SPREAD)
    if spread is not None:
        text += f" ±{spread:.{column.decimals}f}"
    if best is None:
        return text
    return text + ("*" if round(number, column.decimals) == best else " ")
