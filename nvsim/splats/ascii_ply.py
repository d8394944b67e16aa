"""Read Gaussians from a PLY file in text format. It reads a few lines at a time and needs a few extra megabytes."""

from __future__ import annotations

import io
from collections.abc import Iterator
from io import FileIO
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.splats.types import Gaussians

_VALUES = 1 << 16
_LONGEST_VALUE = 64
"""Largest number of characters of a number, including the space after it."""
_SHORTEST_VALUE = 2


class Prepared(Protocol):
    """Allocates so many Gaussians; returns them and, by property name, the array that stores the property."""

    def __call__(
        self, path: Path, n: int, properties: tuple[str, ...], /
    ) -> tuple[Gaussians, dict[str, NDArray[np.float32]]]: ...


def read_ascii(path: Path, file: FileIO, begin: bytes, prepared: Prepared) -> Gaussians:
    """Reads Gaussians from a file. `begin` contains its complete and valid header. Raises InputError naming the invalid
    line, or if the file ends early."""
    end = begin.find(b"\n", begin.find(b"end_header")) + 1
    header = begin[:end].decode("ascii", "replace").splitlines()
    skipped, count, names = _vertices(header)
    file.seek(0, io.SEEK_END)
    if (skipped + count * len(names)) * _SHORTEST_VALUE > file.tell() - end + _SHORTEST_VALUE:
        raise InputError(f"{path} is truncated: {count} Gaussians announced, but the file ends early; copy it again.")
    gaussians, targets = prepared(path, count, names)
    file.seek(end)
    lines = _lines(path, io.BufferedReader(file), len(header) + 1, len(names) * _LONGEST_VALUE)
    for _ in range(skipped):
        next(lines, None)
    at, columns = 0, [(names.index(name), target) for name, target in targets.items()]
    step = max(1, _VALUES // len(names))
    while at < count:
        block, numbers = [], []
        for number, line in lines:
            block.append(line.split(maxsplit=len(names))[: len(names)])
            numbers.append(number)
            if len(block) == min(step, count - at):
                break
        if len(block) < min(step, count - at):
            raise InputError(
                f"{path} is truncated: {count} Gaussians announced, {at + len(block)} present; copy it again."
            )
        values = _numbers(path, block, numbers, len(names))
        with np.errstate(over="ignore"):  # Gaussians with infinite values are removed later
            for column, target in columns:
                target[at : at + len(block)] = values[:, column]
        at += len(block)
    return gaussians


def _vertices(header: list[str]) -> tuple[int, int, tuple[str, ...]]:
    """The number of lines before the vertices, the number of vertices, and the names of their properties."""
    skipped, count, names, inside = 0, -1, list[str](), False
    for line in header:
        match line.split():
            case ["element", name, number]:
                if inside:
                    break
                inside = name == "vertex"
                skipped, count = (skipped, int(number)) if inside else (skipped + int(number), count)
            case ["property", _, name] if inside:
                names.append(name)
    return skipped, count, tuple(names)


def _lines(path: Path, file: io.BufferedReader, number: int, longest: int) -> Iterator[tuple[int, bytes]]:
    """Lines that are not empty, each with its number. Raises InputError if a line is too long."""
    while line := file.readline(longest + 1):
        if len(line) > longest:
            raise InputError(f"{path}, line {number}: it has more than {longest} characters; export it again.")
        if line.strip():
            yield number, line
        number += 1


def _numbers(path: Path, rows: list[list[bytes]], numbers: list[int], columns: int) -> NDArray[np.float64]:
    try:
        return np.array(rows, np.float64).reshape(len(rows), columns)
    except (ValueError, OverflowError):
        for number, row in zip(numbers, rows, strict=True):
            if len(row) != columns or not all(map(_is_number, row)):
                raise InputError(f"{path}, line {number}: expected {columns} numbers; export it again.") from None
        raise InputError(f"{path} contains numbers that cannot be read; export it again.") from None


def _is_number(text: bytes) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
