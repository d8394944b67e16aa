"""COLMAP's text files, line by line (colmap.github.io/format.html)."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.colmap_rows import CameraRow, ImageRow
from nvsim.capture.raw import lines_of, read_text, whole_number
from nvsim.errors import InputError


def read_cameras(path: Path) -> list[CameraRow]:
    """Raises InputError naming the line that is not a camera."""
    rows = []
    for line, fields in _lines(path):
        try:
            rows.append(
                CameraRow(
                    whole_number(fields[0]),
                    fields[1],
                    whole_number(fields[2]),
                    whole_number(fields[3]),
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
    lines = lines_of(read_text(path))
    for line, text in lines:
        fields = text.split(maxsplit=9)
        if not fields or fields[0].startswith("#"):
            continue
        try:
            values = [float(v) for v in fields[1:8]]
            rows.append(
                ImageRow(
                    whole_number(fields[0]),
                    np.array(values[:4]),
                    np.array(values[4:7]),
                    whole_number(fields[8]),
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
    points, colors = array("d"), array("B")
    for line, fields in _lines(path, maxsplit=7):
        try:
            if len(fields) < 7:
                raise ValueError("too few fields")
            points.extend([float(v) for v in fields[1:4]])
            colors.extend([min(255, max(0, whole_number(v))) for v in fields[4:7]])
        except (ValueError, OverflowError) as error:
            raise _bad(path, line, "ID X Y Z R G B ERROR TRACK...") from error
    return np.array(points, np.float64).reshape(-1, 3), np.array(colors, np.uint8).reshape(-1, 3)


def _lines(path: Path, maxsplit: int = -1) -> Iterator[tuple[int, list[str]]]:
    for line, text in lines_of(read_text(path)):
        fields = text.split(maxsplit=maxsplit)
        if fields and not fields[0].startswith("#"):
            yield line, fields


def _bad(path: Path, line: int, expected: str) -> InputError:
    return InputError(f"{path}, line {line}: expected {expected}; export the model again.")
