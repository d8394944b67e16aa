"""COLMAP's text files, line by line (colmap.github.io/format.html)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.colmap import CameraRow, ImageRow
from nvsim.capture.raw import read_text
from nvsim.errors import InputError


def read_cameras(path: Path) -> list[CameraRow]:
    """Raises InputError naming the line that is not a camera."""
    rows = []
    for line, fields in _lines(path):
        try:
            rows.append(
                CameraRow(
                    int(fields[0]),
                    fields[1],
                    int(fields[2]),
                    int(fields[3]),
                    tuple(map(float, fields[4:])),
                    f"{path.name}, line {line}",
                )
            )
        except (ValueError, IndexError, OverflowError) as error:
            raise _bad(path, line, "ID MODEL WIDTH HEIGHT PARAMS...") from error
    return rows


def read_images(path: Path) -> list[ImageRow]:
    """Every second line is a list of observations, perhaps an empty one, and is skipped. Raises InputError."""
    rows = []
    lines = enumerate(read_text(path).split("\n"), 1)
    for line, text in lines:
        fields = text.split(maxsplit=9)
        if not fields or fields[0].startswith("#"):
            continue
        try:
            values = [float(v) for v in fields[1:8]]
            rows.append(
                ImageRow(
                    int(fields[0]),
                    np.array(values[:4]),
                    np.array(values[4:7]),
                    int(fields[8]),
                    fields[9].strip().replace("\\", "/"),
                    f"{path.name}, line {line}",
                )
            )
        except (ValueError, IndexError, OverflowError) as error:
            raise _bad(path, line, "ID QW QX QY QZ TX TY TZ CAMERA_ID NAME") from error
        next(lines, None)
    return rows


def read_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """(N, 3) positions and (N, 3) colours. Raises InputError naming the line."""
    points, colors = [], []
    for line, fields in _lines(path, maxsplit=7):
        try:
            points.append([float(v) for v in fields[1:4]])
            colors.append([min(255, max(0, int(v))) for v in fields[4:7]])
            if len(points[-1]) != 3 or len(colors[-1]) != 3:
                raise ValueError("too few fields")
        except (ValueError, OverflowError) as error:
            raise _bad(path, line, "ID X Y Z R G B ERROR TRACK...") from error
    return np.array(points, np.float64).reshape(-1, 3), np.array(colors, np.uint8).reshape(-1, 3)


def _lines(path: Path, maxsplit: int = -1) -> Iterator[tuple[int, list[str]]]:
    for line, text in enumerate(read_text(path).split("\n"), 1):
        fields = text.split(maxsplit=maxsplit)
        if fields and not fields[0].startswith("#"):
            yield line, fields


def _bad(path: Path, line: int, expected: str) -> InputError:
    return InputError(f"{path}, line {line}: expected {expected}; export the model again.")
