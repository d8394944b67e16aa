"""Writes CSV that a spreadsheet shows and does not execute. All tables in text form are written here.

A spreadsheet reads a cell that begins with =, +, - or @ as a formula, which may send other cells to an address or
start a program (https://owasp.org/www-community/attacks/CSV_Injection). Ids and names can come from untrusted files, so
an apostrophe is put before such text. Numbers are unchanged.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence

_FORMULA = re.compile("[=+\\-@\t\r\n\uff1d\uff0b\uff0d\uff20]")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?|[+-]?(inf|nan)", re.IGNORECASE | re.ASCII)


def csv_text(rows: Iterable[Sequence[object]], by: str = ",") -> str:
    """`rows` as lines of text with the separator `by`, quoted if needed; None is an empty cell."""
    out = _LineCollector()
    # Python quotes a line break in a cell only if the line terminator contains it.
    csv.writer(out, delimiter=by, lineterminator="\r\n").writerows([_cell(value) for value in row] for row in rows)
    return "".join(f"{line[:-2]}\n" for line in out.lines)


class _LineCollector:
    def __init__(self) -> None:
        self.lines: list[str] = []

    def write(self, line: str) -> None:
        self.lines.append(line)


def _cell(value: object) -> object:
    if value is None:
        return ""
    if isinstance(value, int | float):
        return value
    text = str(value)
    return f"'{text}" if _FORMULA.match(text.lstrip(" ")) and not _NUMBER.fullmatch(text) else text
