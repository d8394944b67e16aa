"""Read the Gaussians of a binary PLY file block by block. Memory holds the result and a few megabytes, never the whole
file in addition. The SHA-256 is computed during reading."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from io import FileIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.regular import opened, size_of
from nvsim.splats.types import Gaussians

_ROWS = 8192  # 2 MB at degree 3: stays in the second-level cache while it is read, hashed, and split into columns
_LONGEST_HEADER = 1 << 16
_MOST_COLUMNS = 128
_MEAN, _DC = ("x", "y", "z"), ("f_dc_0", "f_dc_1", "f_dc_2")
_SCALE, _ROTATION = ("scale_0", "scale_1", "scale_2"), ("rot_0", "rot_1", "rot_2", "rot_3")


@dataclass(frozen=True)
class _Layout:
    """Layout of a binary PLY file.

    start    offset of the first row in bytes
    count    number of rows
    columns  property -> its column in a row of float32
    """

    start: int
    count: int
    columns: dict[str, int]

    @property
    def coefficients(self) -> int:
        """SH coefficients per color channel, including the first."""
        return 1 + sum(name.startswith("f_rest_") for name in self.columns) // 3

    def at(self, names: tuple[str, ...]) -> NDArray[np.intp]:
        return np.array([self.columns[name] for name in names], np.intp)


def read_gaussians(path: Path, hashed: bool) -> tuple[Gaussians, str | None]:
    """The Gaussians of a file written by `ply.write_ply`, and the SHA-256 of the file if `hashed`.

    Raises InputError if the file has another layout, is truncated, or has values that are not finite. Raises OSError if
    it cannot be read.
    """
    digest = hashlib.sha256() if hashed else None
    with opened(path) as file:
        layout = _layout(path, file.read(_LONGEST_HEADER))
        if layout.coefficients not in (1, 4, 9, 16) or len(layout.columns) > _MOST_COLUMNS:
            raise InputError(f"{path} does not have the layout that NVSim writes; train this submap again.")
        if layout.start + 4 * layout.count * len(layout.columns) > size_of(file):
            raise InputError(f"{path} is truncated: {layout.count} Gaussians announced; train this submap again.")
        file.seek(0)
        header = file.read(layout.start)
        if digest is not None:
            digest.update(header)
        n, k = layout.count, layout.coefficients
        gaussians = Gaussians(
            np.empty((n, 3), np.float32),
            np.empty((n, 3), np.float32),
            np.empty((n, 4), np.float32),
            np.empty(n, np.float32),
            np.empty((n, k, 3), np.float32),
        )
        # Files store all coefficients of red, then green, then blue. Our arrays store three colors per coefficient.
        rest = [f"f_rest_{colour * (k - 1) + i}" for i in range(k - 1) for colour in range(3)]
        try:
            takes = [
                (gaussians.means, layout.at(_MEAN)),
                (gaussians.log_scales, layout.at(_SCALE)),
                (gaussians.quats, layout.at(_ROTATION)),
                (gaussians.opacity_logits.reshape(n, 1), layout.at(("opacity",))),
                (gaussians.sh.reshape(n, 3 * k), layout.at((*_DC, *rest))),
            ]
        except KeyError as error:
            raise InputError(f"{path} has no property {error.args[0]}; train this submap again.") from error
        block = np.empty((_ROWS, len(layout.columns)), "<f4")
        for first in range(0, n, _ROWS):
            rows = block[: min(_ROWS, n - first)]
            if not _fill(file, rows):
                raise InputError(f"{path} is truncated: {n} Gaussians announced; train this submap again.")
            if digest is not None:
                digest.update(rows)  # type: ignore[arg-type]
            if not np.isfinite(rows).all():
                raise InputError(f"{path} contains values that are not finite; train this submap again.")
            for target, columns in takes:
                # mode="clip": all columns are in range, and only this mode lets take write without a buffer.
                np.take(rows, columns, axis=1, out=target[first : first + len(rows)], mode="clip")
        if digest is not None:
            while more := file.read(1 << 20):
                digest.update(more)
    return gaussians, None if digest is None else digest.hexdigest()


def _fill(file: FileIO, rows: NDArray[np.float32]) -> bool:
    view = memoryview(rows).cast("B")  # type: ignore[arg-type]
    done = 0
    while done < len(view):
        got = file.readinto(view[done:])
        if not got:
            return False
        done += got
    return True


def _layout(path: Path, begin: bytes) -> _Layout:
    end = begin.find(b"end_header\n")
    lines = begin[: max(end, 0)].decode("ascii", "replace").splitlines()
    words = [line.split() for line in lines if not line.startswith(("comment", "obj_info"))]
    count, columns = -1, dict[str, int]()
    for line in words[2:]:
        match line:
            case ["element", "vertex", number] if (
                count < 0 and number.isascii() and number.isdigit() and len(number) < 16
            ):
                count = int(number)
            case ["property", "float" | "float32", name] if count >= 0 and name not in columns:
                columns[name] = len(columns)
            case _:
                count = -1
                break
    if words[:2] != [["ply"], ["format", "binary_little_endian", "1.0"]] or count < 0:
        raise InputError(f"{path} does not have the layout that NVSim writes; train this submap again.")
    return _Layout(end + len(b"end_header\n"), count, columns)
