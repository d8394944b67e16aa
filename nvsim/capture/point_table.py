"""The points of a file as named columns, and the reader for text tables."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError

Columns = dict[str, NDArray[np.generic]]  # a name -> (N,) values
_BLOCK = 20_000  # lines that are split into words at a time


def ascii_table(path: Path, body: bytes, rows: int, columns: int, first_line: int) -> NDArray[np.float64]:
    """(rows, columns) float64 numbers, one row per line. Raises InputError naming the line if it has too few numbers or
    a word that is not a number, or if the file ends early."""
    parts, found = [], 0
    lines = _filled_lines(body, rows, first_line)
    while block := list(islice(lines, _BLOCK)):
        parts.append(parse_numbers(path, block, columns))
        found += len(block)
    if found < rows:
        raise InputError(f"{path} is truncated: {rows} points announced, {found} present; copy it again.")
    return np.concatenate([np.empty((0, columns)), *parts])


def _filled_lines(body: bytes, most: int, first_line: int) -> Iterator[tuple[int, bytes]]:
    """Number and content of the first `most` lines that are not blank."""
    at, number, found = 0, first_line, 0
    while at < len(body) and found < most:
        end = body.find(b"\n", at)
        end = len(body) if end < 0 else end
        line = body[at:end]
        if line.strip():
            yield number, line
            found += 1
        at, number = end + 1, number + 1


def parse_numbers(
    path: Path, lines: list[tuple[int, bytes]], columns: int, then: str = "correct it"
) -> NDArray[np.float64]:
    """(lines, columns) float64: the first numbers of lines, given with their line numbers. Raises InputError, with the
    advice `then`, naming the line that has too few numbers or a word that is not a number."""
    split = [line.split(maxsplit=columns)[:columns] for _, line in lines]
    try:
        return np.array(split, dtype=np.float64).reshape(len(lines), columns)
    except (ValueError, OverflowError):
        for (number, _), fields in zip(lines, split, strict=True):
            try:
                if len([float(v) for v in fields]) == columns:
                    continue
            except ValueError:
                pass  # reported below, like a line with too few numbers
            raise InputError(f"{path}, line {number}: expected {columns} numbers; {then}.") from None
        raise InputError(f"{path} holds numbers that cannot be read; export it again.") from None
