"""Stores the finished rows of an unfinished features file, so that an interrupted extraction can resume.

A folder beside the file contains `rows`, a sequence of records. Each record has a checksum, three lengths, the key of a
viewpoint, a fingerprint of the images and the network, and the data. If the process or the machine stopped during a
write, that record and all later ones are dropped. No library opens the file, so a damaged file does no harm.
"""

from __future__ import annotations

import os
import shutil
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.atomic import as_input_error, resumed_folder, write_text
from nvsim.files.locking import WriterLock
from nvsim.files.opening import plain_file, read_bytes

FINGERPRINT = 16
_HEAD = struct.Struct("<IHHQ")  # checksum of the rest of the record; lengths in bytes of key, fingerprint and data
_CHECKSUM = 4
_MOST = 1 << 30  # largest length of a row in bytes


class KeptRows:
    """Rows by key, see `kept_rows`. Raises InputError if writing fails."""

    def __init__(self, descriptor: int, path: Path) -> None:
        self._descriptor, self.path = descriptor, path
        self._rows: dict[str, tuple[int, int, bytes]] = {}  # key -> first byte and length of a record, fingerprint
        self._end = 0
        size = os.fstat(descriptor).st_size
        while (length := self._register_record(self._end, size)) is not None:
            self._end += length
        os.ftruncate(descriptor, self._end)

    def contains(self, key: str, fingerprint: bytes) -> bool:
        """Whether a row with this key and fingerprint exists."""
        row = self._rows.get(key)
        return row is not None and row[2] == fingerprint

    def append(self, key: str, fingerprint: bytes, data: bytes) -> None:
        """Appends a row. It replaces an earlier row with this key. Raises InputError if writing fails."""
        name = key.encode("utf-8", "surrogateescape")
        lengths = _HEAD.pack(0, len(name), len(fingerprint), len(data))[_CHECKSUM:]
        body = b"".join((lengths, name, fingerprint, data))
        record = zlib.crc32(body).to_bytes(_CHECKSUM, "little") + body
        try:
            written = 0
            while written < len(record):
                written += os.pwrite(self._descriptor, record[written:], self._end + written)
        except OSError as error:
            raise as_input_error(self.path, error) from error
        self._rows[key] = (self._end, len(record), fingerprint)
        self._end += len(record)

    def get(self, key: str) -> bytes:
        """Returns the data of a row. Raises KeyError if the key is missing, InputError if the file was damaged."""
        start, length, _ = self._rows[key]
        read = self._read(start, length)
        if read is None:  # no other process writes the file, because `kept_rows` holds the lock
            raise InputError(f"{self.path} was damaged during the extraction; remove it and start again.")
        return read[2]

    def _register_record(self, start: int, size: int) -> int | None:
        """Registers the record at `start` and returns its length, or None if no complete record begins there."""
        head = os.pread(self._descriptor, _HEAD.size, start)
        if len(head) < _HEAD.size:
            return None
        _, *lengths = _HEAD.unpack(head)
        length = _HEAD.size + sum(lengths)
        if lengths[2] > _MOST or start + length > size or (read := self._read(start, length)) is None:
            return None
        key, fingerprint, _ = read
        self._rows[key] = (start, length, fingerprint)
        return length

    def _read(self, start: int, length: int) -> tuple[str, bytes, bytes] | None:
        """Returns key, fingerprint and data of a record, or None if its checksum is wrong."""
        record = os.pread(self._descriptor, length, start)
        if len(record) < length or zlib.crc32(memoryview(record)[_CHECKSUM:]) != _HEAD.unpack_from(record)[0]:
            return None
        _, key, fingerprint, _ = _HEAD.unpack_from(record)
        at = _HEAD.size + key
        name = record[_HEAD.size : at].decode("utf-8", "surrogateescape")
        return name, record[at : at + fingerprint], record[at + fingerprint :]


@contextmanager
def kept_rows(target: Path, made_by: str) -> Iterator[KeptRows]:
    """Opens the kept rows of the file `target`, and removes them if the block ends without an exception.

    made_by  identifies backbone and layout; rows of an earlier run with another value are dropped

    Raises Held if another process is writing this file, InputError if reading or writing fails.
    """
    folder = resumed_folder(target.parent / f".{target.name}.parts")
    lock = WriterLock(folder / "lock")
    try:
        path, maker = folder / "rows", folder / "made-by"
        same = maker.is_file() and path.is_file() and read_bytes(maker, 1 << 20) == made_by.encode()
        if not same:
            path.unlink(missing_ok=True)
            write_text(maker, made_by)
        try:
            descriptor = plain_file(path, os.O_RDWR | os.O_CREAT)
        except OSError as error:
            raise as_input_error(path, error) from error
        try:
            yield KeptRows(descriptor, path)
        finally:
            os.close(descriptor)
        shutil.rmtree(folder, ignore_errors=True)
    finally:
        lock.release()
