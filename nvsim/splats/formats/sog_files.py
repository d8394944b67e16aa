"""Read the files of a SOG from a zip archive or a folder. Their headers give the sizes before they are unpacked."""

from __future__ import annotations

import io
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.opening import opened, read_bytes, size_of

META = "meta.json"
Bytes = NDArray[np.uint8]
_LARGEST_META = 1 << 22
_HEAD = 32
_SLACK = 1 << 16
_STEP = 1 << 20
_LARGEST_DIRECTORY = 1 << 21
_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


class Files(ABC):
    """The files of one SOG. All methods raise InputError naming the SOG and the invalid file in it."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def description(self) -> str:
        """The text of meta.json. Raises InputError if it is not text."""
        try:
            return self._load(META, _LARGEST_META).decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise InputError(f"{self._path} has a meta.json that is not text; export it again.") from error

    @abstractmethod
    def size(self, names: Sequence[object]) -> int:
        """Bytes on disk of the files of these names; for an archive, the size of the archive."""

    def image(self, name: str, most: int) -> Bytes:
        """(H, W, 4) uint8, RGBA, of at most so many pixels. Raises InputError if the file is not such a WebP image."""
        import cv2

        where = f"{self._path}: {name}"
        size = webp_size(self._load(name, None, _HEAD))
        if size is None:
            raise InputError(f"{where} is not a WebP image; export it again.")
        width, height = size
        if width * height > most:
            raise InputError(f"{where} has {width} x {height} pixels, more than its Gaussians need; export it again.")
        data = self._load(name, 5 * width * height + _SLACK)
        try:
            decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error as error:
            raise InputError(f"{where} is a WebP image that cannot be decoded; copy it again.") from error
        if decoded is None or decoded.ndim != 3 or decoded.dtype != np.uint8 or decoded.shape[:2] != (height, width):
            raise InputError(f"{where} is not a color image; copy it again.")
        code = cv2.COLOR_BGR2RGBA if decoded.shape[2] == 3 else cv2.COLOR_BGRA2RGBA
        return np.asarray(cv2.cvtColor(decoded, code), np.uint8)

    @abstractmethod
    def _load(self, name: str, most: int | None, only: int | None = None) -> bytes:
        """The content of a file of at most so many bytes, or its `only` first bytes."""


@contextmanager
def from_folder(path: Path) -> Iterator[Files]:
    """The files of the folder whose meta.json is at `path`."""
    yield _Folder(path)


@contextmanager
def from_archive(path: Path) -> Iterator[Files]:
    """The files of the zip archive at `path`. Raises InputError if it is not a valid archive."""
    with opened(path) as file:
        try:
            archive = zipfile.ZipFile(_Cautious(path, file))
        except (zipfile.BadZipFile, NotImplementedError, ValueError) as error:
            raise InputError(f"{path} is a damaged archive ({error}); copy it again.") from error
        with archive:
            yield _Archive(path, archive, size_of(file))


class _Folder(Files):
    def size(self, names: Sequence[object]) -> int:
        total = 0
        for name in {n for n in names if isinstance(n, str)}:
            with opened(self._path_in_folder(name)) as file:
                total += size_of(file)
        return total

    def _load(self, name: str, most: int | None, only: int | None = None) -> bytes:
        path = self._path_in_folder(name)
        if only is None:
            return read_bytes(path, most)
        with opened(path) as file:
            return file.read(only)

    def _path_in_folder(self, name: str) -> Path:
        return self._path.parent / Path(name).name  # never a file of another folder


class _Archive(Files):
    def __init__(self, path: Path, archive: zipfile.ZipFile, size: int) -> None:
        super().__init__(path)
        self._archive, self._size = archive, size

    def size(self, names: Sequence[object]) -> int:
        return self._size

    def _load(self, name: str, most: int | None, only: int | None = None) -> bytes:
        where = f"{self._path}: {name}"
        try:
            info = self._archive.getinfo(name)
        except KeyError as error:
            raise InputError(f"{self._path} has no {name}; copy it again.") from error
        if info.compress_type not in _PACKINGS or info.flag_bits & 1:
            raise InputError(f"{where} has a compression that a SOG does not use; export it again.")
        if most is not None and info.file_size > most:
            raise InputError(f"{where} has {info.file_size} bytes unpacked, too many for its content; export it again.")
        try:
            with self._archive.open(info) as file:
                return file.read(only) if only is not None else b"".join(_parts(file))
        except InputError:
            raise
        except Exception as error:  # zlib and zipfile raise many types if the directory is damaged
            raise InputError(f"{where} is damaged; copy the file again.") from error


def _parts(file: IO[bytes]) -> Iterator[bytes]:
    while part := file.read(_STEP):
        yield part


class _Cautious(io.BufferedReader):
    """A file that refuses a large read. Only a zip directory with more entries than a SOG has would need one."""

    def __init__(self, path: Path, file: io.FileIO) -> None:
        super().__init__(file)
        self._path = path

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > _LARGEST_DIRECTORY:
            raise InputError(f"{self._path} has a zip directory of {size} bytes, too large for a SOG; export it again.")
        return super().read(size)


def webp_size(head: bytes) -> tuple[int, int] | None:
    """Width and height of a WebP image from its first 32 bytes (RFC 9649). None if it is not a WebP image."""
    if len(head) < 30 or head[:4] != b"RIFF" or head[8:12] != b"WEBP":
        return None
    kind = head[12:16]
    if kind == b"VP8L" and head[20] == 0x2F:
        bits = int.from_bytes(head[21:25], "little")
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    if kind == b"VP8X":
        return 1 + int.from_bytes(head[24:27], "little"), 1 + int.from_bytes(head[27:30], "little")
    if kind == b"VP8 " and head[23:26] == b"\x9d\x01\x2a":
        return int.from_bytes(head[26:28], "little") & 0x3FFF, int.from_bytes(head[28:30], "little") & 0x3FFF
    return None
