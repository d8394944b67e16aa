"""An LMDB of arrays that grows viewpoint by viewpoint beside its place, and is moved there when it is whole. What a
killed run had finished is there for the next one."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.atomic import as_input_error, make_folder, write_text
from nvsim.files.locking import WriterLock
from nvsim.files.regular import read_bytes

_LONGEST_KEY = 480  # bytes; LMDB takes 511
_MARK = "made of "  # before a key: what its array was made of


class GrowingLmdb:
    """Arrays by key. See `growing_lmdb`; every call raises InputError when the disk refuses."""

    def __init__(self, environment: Any, path: Path) -> None:
        self._environment, self._path = environment, path

    def has(self, key: str, mark: bytes) -> bool:
        """Whether there is an array of this key, made of the same."""
        with self._environment.begin() as transaction:
            return bytes(transaction.get(self._key(_MARK + key)) or b"") == mark

    def put(self, key: str, mark: bytes, array: NDArray[np.float32]) -> None:
        import msgpack

        value = {b"data": array.tobytes(), b"type": array.dtype.str, b"shape": array.shape}
        with self._writing() as transaction:
            transaction.put(self._key(key), msgpack.packb(value))
            transaction.put(self._key(_MARK + key), mark)

    def finish(self, wanted: set[str]) -> None:
        """Removes the marks, and arrays of other keys than `wanted`."""
        keep = {self._key(key) for key in wanted}
        with self._writing() as transaction, transaction.cursor() as cursor:
            there = cursor.first()
            while there:
                there = cursor.next() if bytes(cursor.key()) in keep else cursor.delete() and bool(cursor.key())
        self._environment.sync(True)

    @contextmanager
    def _writing(self) -> Iterator[Any]:
        import lmdb

        try:
            with self._environment.begin(write=True) as transaction:
                yield transaction
        except lmdb.Error as error:
            raise InputError(f"Cannot write {self._path}: {error}; free some space and start it again.") from error

    def _key(self, key: str) -> bytes:
        name = key.encode("utf-8", "surrogateescape")
        if not name.isascii() or len(name) > _LONGEST_KEY:
            raise InputError(f"An LMDB cannot hold {key[:60]!r}; rename the scan or viewpoint in short ASCII letters.")
        return name


@contextmanager
def growing_lmdb(target: Path, made_by: str, room: int, count: int) -> Iterator[GrowingLmdb]:
    """An LMDB that becomes `target`, a folder, when the block ends well.

    made_by  names backbone and layout: what was made otherwise is dropped
    room     bytes of all arrays
    count    of arrays

    Raises Held while another process makes the same, InputError when the disk refuses.
    """
    import lmdb

    parts = make_folder(target.parent / f".{target.name}.parts")
    lock = WriterLock(parts / "lock")
    try:
        data, maker = parts / "data.mdb", parts / "made-by"
        if not (maker.is_file() and read_bytes(maker, 1 << 20) == made_by.encode()):
            data.unlink(missing_ok=True)
            write_text(maker, made_by)
        # A number of its pages is free or half empty; the file is no larger than what is in it.
        largest = round(1.3 * room) + count * (1 << 15) + (1 << 26)
        try:
            environment = lmdb.open(str(parts), map_size=largest, max_dbs=0)
        except lmdb.Error as error:
            data.unlink(missing_ok=True)
            raise InputError(f"Cannot write {target}: {error}; start it again.") from error
        try:
            yield GrowingLmdb(environment, target)
        finally:
            environment.close()
        make_folder(target)
        try:
            os.replace(data, target / "data.mdb")
        except OSError as error:
            raise as_input_error(target, error) from error
        shutil.rmtree(parts, ignore_errors=True)
    finally:
        lock.release()
