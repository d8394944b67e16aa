"""Rows that are finished of a file of features that is not: what a killed extraction leaves to the next one.

A folder beside the file holds `rows`: records of one length, each a checksum, a fingerprint of what the row was made
from, the size of its views, and the row. A record that was being written when the process died is cut off.
"""

from __future__ import annotations

import os
import shutil
import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.files.atomic import as_input_error, make_folder, write_text
from nvsim.files.locking import WriterLock
from nvsim.files.opening import plain_file
from nvsim.files.regular import read_bytes
from nvsim.r2r.features.backbone import Float32

FINGERPRINT = 16
_CHECKSUM = 4
_SIZE = struct.Struct("<II")


class KeptRows:
    """Rows (36, width) float32, in order. See `kept_rows`."""

    def __init__(self, descriptor: int, path: Path, width: int) -> None:
        self._descriptor, self._path, self._shape = descriptor, path, (36, width)
        self._record = _CHECKSUM + FINGERPRINT + _SIZE.size + 4 * 36 * width
        self.count = 0

    def take_over(self, wanted: Iterable[bytes]) -> None:
        """Keeps the rows at the beginning that are whole and whose fingerprints are as `wanted`, drops the others."""
        size = os.fstat(self._descriptor).st_size
        for fingerprint in wanted:
            if self._record * (self.count + 1) > size or self._read(self.count, fingerprint) is None:
                break
            self.count += 1
        os.ftruncate(self._descriptor, self.count * self._record)

    def append(self, fingerprint: bytes, size: tuple[int, int], row: Float32) -> None:
        """Writes a row of views of `size`, width and height in pixels. Raises InputError when the disk refuses."""
        assert row.shape == self._shape and row.dtype == np.float32
        body = fingerprint + _SIZE.pack(*size) + row.tobytes()
        record = zlib.crc32(body).to_bytes(_CHECKSUM, "little") + body
        try:
            written = os.pwrite(self._descriptor, record, self.count * self._record)
            while written < len(record):
                written += os.pwrite(self._descriptor, record[written:], self.count * self._record + written)
        except OSError as error:
            raise as_input_error(self._path, error) from error
        self.count += 1

    def __iter__(self) -> Iterator[tuple[tuple[int, int], Float32]]:
        """One row after the other: the size of its views, and (36, width)."""
        for index in range(self.count):
            body = self._read(index, None)
            if body is None:  # nobody else writes it: `kept_rows` holds the lock
                raise InputError(f"{self._path} was damaged while it was in use; remove it and start again.")
            width, height = _SIZE.unpack_from(body, FINGERPRINT)
            yield (width, height), np.frombuffer(body, np.float32, offset=FINGERPRINT + _SIZE.size).reshape(self._shape)

    def _read(self, index: int, fingerprint: bytes | None) -> bytes | None:
        """What follows the checksum of a record, None where it is not whole or has another fingerprint."""
        record = os.pread(self._descriptor, self._record, index * self._record)
        body = record[_CHECKSUM:]
        if len(record) < self._record or zlib.crc32(body).to_bytes(_CHECKSUM, "little") != record[:_CHECKSUM]:
            return None
        if fingerprint is not None and body[:FINGERPRINT] != fingerprint:
            return None
        return body


@contextmanager
def kept_rows(target: Path, made_by: str, width: int) -> Iterator[KeptRows]:
    """The rows kept for the file `target`, those of an earlier run where `made_by` says the same; they are removed when
    the block ends well.

    made_by  names backbone, layout and order of rows: rows made otherwise are dropped
    width    numbers of each of a row's 36 views

    Raises Held while another process makes the same file, InputError when the disk refuses.
    """
    folder = make_folder(target.parent / f".{target.name}.parts")
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
            yield KeptRows(descriptor, path, width)
        finally:
            os.close(descriptor)
        shutil.rmtree(folder, ignore_errors=True)
    finally:
        lock.release()
