"""An LMDB of arrays, written viewpoint by viewpoint. What a killed run had finished is there for the next one.

The arrays are kept as rows until all are there, because LMDB neither survives a power loss without waiting for the disk
at every array, nor opens a damaged file without a crash. So the disk holds them twice while the LMDB is written.
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

_LONGEST_KEY = 480  # bytes; LMDB takes 511


class GrowingLmdb:
    """Arrays by key. See `growing_lmdb`; every call raises InputError when the disk refuses."""

    def __init__(self, rows: KeptRows, target: Path, largest: int) -> None:
        self._rows, self._target, self._largest = rows, target, largest

    def has(self, key: str, mark: bytes) -> bool:
        """Whether there is an array of this key, made of the same."""
        return self._rows.has(key, mark)

    def put(self, key: str, mark: bytes, array: NDArray[np.float32]) -> None:
        import msgpack

        _name(key)
        value = {b"data": array.tobytes(), b"type": array.dtype.str, b"shape": array.shape}
        self._rows.put(key, mark, msgpack.packb(value))

    def finish(self, wanted: set[str]) -> None:
        """Writes the LMDB with the arrays of the keys `wanted`."""
        import lmdb

        with private_folder(self._target) as folder:
            data = folder / "data.mdb"
            try:
                # The whole file is synced at the end, not every transaction.
                with lmdb.open(str(folder), map_size=self._largest, max_dbs=0, sync=False) as environment:
                    for key in sorted(wanted, key=_name):
                        with environment.begin(write=True) as transaction:
                            transaction.put(_name(key), self._rows.get(key), append=True)
                move_into_place(data, make_own_folder(self._target) / data.name)
            except lmdb.Error as error:
                raise InputError(
                    f"Cannot write {self._target}: {error}; free some space and start it again."
                ) from error
            except OSError as error:
                raise as_input_error(self._target, error) from error


def _name(key: str) -> bytes:
    name = key.encode("utf-8", "surrogateescape")
    if not name.isascii() or len(name) > _LONGEST_KEY:
        raise InputError(f"An LMDB cannot hold {key[:60]!r}; rename the scan or viewpoint in short ASCII letters.")
    return name


@contextmanager
def growing_lmdb(target: Path, made_by: str, room: int, count: int) -> Iterator[GrowingLmdb]:
    """An LMDB that is written to `target`, a folder, by `GrowingLmdb.finish`.

    made_by  names backbone and layout: what was made otherwise is dropped
    room     bytes of all arrays
    count    of arrays

    Raises Held while another process makes the same, InputError when the disk refuses.
    """
    # A number of its pages is free or half empty; the file is no larger than what is in it.
    largest = round(1.3 * room) + count * (1 << 15) + (1 << 26)
    with kept_rows(target, made_by) as rows:
        yield GrowingLmdb(rows, target, largest)
