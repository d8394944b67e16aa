"""Writes an LMDB of arrays, viewpoint by viewpoint. An interrupted run can resume.

The arrays are kept as rows until all are complete, for two reasons. LMDB does not survive a power loss unless it waits
for the disk after every array, and it crashes on a damaged file. While the LMDB is written, the disk holds the arrays
twice.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.atomic import as_input_error, make_own_folder, move_into_place, private_folder
from nvsim.r2r.features.kept_rows import KeptRows, kept_rows

_LONGEST_KEY = 480  # bytes; LMDB allows 511


class GrowingLmdb:
    """Arrays by key, see `growing_lmdb`. Every call raises InputError if reading or writing fails."""

    def __init__(self, rows: KeptRows, target: Path, largest: int) -> None:
        self._rows, self._target, self._largest = rows, target, largest

    def has(self, key: str, mark: bytes) -> bool:
        """Whether an array with this key and this fingerprint `mark` exists."""
        return self._rows.has(key, mark)

    def put(self, key: str, mark: bytes, array: NDArray[np.float32]) -> None:
        """Stores an array of any shape, float32. Raises InputError if writing fails or the key is not short ASCII."""
        import msgpack

        _name(key)
        value = {b"data": array.tobytes(), b"type": array.dtype.str, b"shape": array.shape}
        self._rows.put(key, mark, msgpack.packb(value))

    def finish(self, wanted: set[str]) -> None:
        """Writes the LMDB with the arrays of the keys `wanted`. Raises InputError if writing fails."""
        import lmdb

        with private_folder(self._target) as folder:
            data = folder / "data.mdb"
            try:
                # Syncs the whole file once at the end, not after every transaction.
                with lmdb.open(str(folder), map_size=self._largest, max_dbs=0, sync=False) as environment:
                    for key in sorted(wanted, key=_name):
                        with environment.begin(write=True) as transaction:
                            transaction.put(_name(key), self._rows.get(key), append=True)
                move_into_place(data, make_own_folder(self._target) / data.name)
            except lmdb.Error as error:
                raise InputError(f"Cannot write {self._target}: {error}; free some space and start again.") from error
            except OSError as error:
                raise as_input_error(self._target, error) from error


def _name(key: str) -> bytes:
    name = key.encode("utf-8", "surrogateescape")
    if not name.isascii() or len(name) > _LONGEST_KEY:
        raise InputError(f"An LMDB cannot store the key {key[:60]!r}; use short ASCII ids for scans and viewpoints.")
    return name


@contextmanager
def growing_lmdb(target: Path, made_by: str, room: int, count: int) -> Iterator[GrowingLmdb]:
    """Opens an LMDB, which `GrowingLmdb.finish` writes to the folder `target`.

    made_by  identifies backbone and layout; arrays of an earlier run with another value are dropped
    room     bytes of all arrays together
    count    number of arrays

    Raises Held if another process is writing this file, InputError if reading or writing fails.
    """
    # Some pages are free or half empty. The file only grows as large as its content.
    largest = round(1.3 * room) + count * (1 << 15) + (1 << 26)
    with kept_rows(target, made_by) as rows:
        yield GrowingLmdb(rows, target, largest)
