"""Opens and reads untrusted paths safely: only plain files, and never through a link inside a folder of other people.

A project or graph from another person can contain links. Writing a lock, log or database through a link would overwrite
a file elsewhere. Opening a pipe or device could block the program forever, and opening can already have an effect, so
they are refused before.

Readers also refuse placeholders and web pages, and can limit the size.
"""

from __future__ import annotations

import errno
import json
import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.files.placeholders import HEAD, placeholder_reason
from nvsim.files.reading import as_reading_error, reading

PROJECT_DATABASE = "project.db"
"""The file that identifies a project folder."""


class NotPlainFile(InputError):
    """The path is a link, a folder, a pipe or a device and must be a plain file."""


def plain_file(path: Path, flags: int) -> int:
    """A descriptor of `path`, opened with `flags` of `os.open`. Raises NotPlain if it is not a plain file, or a folder
    in its path leads out of the project. Raises OSError like `os.open` for all other failures."""
    refuse_links_out_of(path.parent)
    try:
        return open_regular(path, flags)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EINVAL, errno.ENXIO, errno.EISDIR, errno.ENODEV) or path.is_symlink():
            raise _not_plain(path) from error
        raise


def open_own_file(path: Path, flags: int) -> int:
    """Like `plain_file`, for a file whose old content may be lost, such as a log. A link or pipe at `path` is removed
    first. The target of a link is not touched."""
    try:
        return plain_file(path, flags)
    except NotPlainFile:
        refuse_links_out_of(path.parent)
        path.unlink()  # fails for a folder with the message of the system
        return os.open(path, flags | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)


def refuse_links_out_of(folder: Path) -> None:
    """Raises NotPlain if a folder in the path of `folder` is a link inside a project that leads out of the project.
    Links above the project are allowed."""
    for at in (folder, *folder.parents):
        if not at.is_symlink():
            continue
        for above in at.parents:
            if (above / PROJECT_DATABASE).is_file() and not at.resolve().is_relative_to(above.resolve()):
                raise NotPlainFile(
                    f"{at} is a link that leads out of the project {above.name}, and NVSim does not write through it. "
                    "Replace the link with the folder itself."
                )


def refuse_links_out(project: Path) -> None:
    """Raises NotPlain if a folder of the project, or a folder in it, is a link that leads out of the project."""
    for folder in (project, *(p for p in _entries(project) if p.is_dir() and not p.is_symlink())):
        for entry in _entries(folder):
            if entry.is_symlink() and entry.is_dir():
                refuse_links_out_of(entry)


def _entries(folder: Path) -> list[Path]:
    try:
        with os.scandir(folder) as rows:
            return [Path(row.path) for row in rows if row.is_symlink() or row.is_dir()]
    except OSError:
        return []


def _not_plain(path: Path) -> NotPlainFile:
    what = "a symbolic link" if path.is_symlink() else "not a plain file"
    return NotPlainFile(f"{path} is {what}, and NVSim does not write through it; remove it and try again.")


def open_regular(path: Path, flags: int = os.O_RDONLY) -> int:
    """A descriptor of the file at `path`. A file to be written must not have hard links. Raises OSError: ELOOP for a
    link, EINVAL for other paths that are not regular files."""
    try:
        _check(os.lstat(path), path, flags)
    except FileNotFoundError:
        if not flags & os.O_CREAT:
            raise
    descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    try:
        _check(os.fstat(descriptor), path, flags)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def read_regular(path: Path, most: int) -> bytes:
    """The complete content of the file at `path`. Raises OSError like `open_regular`, and EFBIG if the file has more
    than `most` bytes."""
    with open(open_regular(path), "rb") as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    return data


def read_end(path: Path, most: int) -> bytes:
    """The last `most` bytes of the file at `path`. Raises OSError like `open_regular`."""
    with open(open_regular(path), "rb") as file:
        file.seek(max(0, os.fstat(file.fileno()).st_size - most))
        return file.read(most)


def is_folder(path: Path) -> bool:
    """Whether `path` is a folder and not a link to one."""
    try:
        return stat.S_ISDIR(os.lstat(path).st_mode)
    except (OSError, ValueError):
        return False


def _check(found: os.stat_result, path: Path, flags: int) -> None:
    if stat.S_ISLNK(found.st_mode):
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "it is not a file", str(path))
    if flags & (os.O_WRONLY | os.O_RDWR) and found.st_nlink > 1:
        raise OSError(errno.EINVAL, "the file has a hard link elsewhere", str(path))


LARGEST_JSON = 1 << 28
_BRACKETS = 200_000
_BYTES_PER_BRACKET = 16
"""Limits for JSON text: a list or object takes about 80 bytes in memory and as few as 3 bytes in the file."""
_DIGITS = 300  # of an integer; a float has at most 309


@contextmanager
def opened(path: Path) -> Iterator[FileIO]:
    """The regular file at `path`, unbuffered, for reading.

    Raises InputError if it is not a regular file, cannot be opened, or is a placeholder such as a Git LFS pointer or a
    web page. Exceptions inside the block pass unchanged.
    """
    flags = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)
    try:
        _refuse_unless_regular(path, os.stat(path))  # before opening, because opening a device can have an effect
        descriptor = os.open(path, flags)
    except OSError as error:
        raise as_reading_error(path, error) from error
    except ValueError as error:  # a NUL in the name
        raise InputError(f"Cannot read {str(path)!r}: file names cannot contain NUL; check the path.") from error
    try:
        found = os.fstat(descriptor)
        _refuse_unless_regular(path, found)  # checked again, because the file can be exchanged before it is opened
        if words := placeholder_reason(os.pread(descriptor, HEAD, 0), found.st_size):
            raise InputError(f"{path} {words}.")
    except OSError as error:
        os.close(descriptor)
        raise as_reading_error(path, error) from error
    except InputError:
        os.close(descriptor)
        raise
    with FileIO(descriptor, "rb") as file:
        yield file


def refuse_placeholder(path: Path) -> None:
    """Checks a file before a library opens it by name. A missing file passes. Raises InputError like `opened`."""
    if is_regular(path):
        with opened(path):
            pass


def _refuse_unless_regular(path: Path, found: os.stat_result) -> None:
    if not stat.S_ISREG(found.st_mode):
        kind = "it is a folder, not a file" if stat.S_ISDIR(found.st_mode) else "it is a pipe, a socket or a device"
        raise InputError(f"Cannot read {path}: {kind}; name a regular file.")


def size_of(file: FileIO) -> int:
    """Bytes of an open file."""
    return os.fstat(file.fileno()).st_size


def is_regular(path: Path) -> bool:
    """Whether `path` is a regular file; False if the path is not a valid file name."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def read_bytes(path: Path, largest: int | None = None) -> bytes:
    """The content of the regular file at `path`. Raises InputError if it is not a regular file, has more than `largest`
    bytes, or cannot be read."""
    with opened(path) as file:
        if largest is not None and size_of(file) > largest:
            raise InputError(f"{path} has {size_of(file)} bytes, more than {largest}; choose another file.")
        try:
            return file.read() if largest is None else _read_up_to(file, largest)
        except OSError as error:
            raise as_reading_error(path, error) from error
        except MemoryError as error:
            raise InputError(f"{path} is too large for the memory of this machine; use a smaller file.") from error


def _read_up_to(file: FileIO, most: int) -> bytes:
    # A file of the system (/proc) reports 0 bytes, and a file that is being written grows.
    parts = []
    while most > 0 and (part := file.read(min(most, 1 << 20))):
        parts.append(part)
        most -= len(part)
    return b"".join(parts)


def read_text(path: Path, what: str, then: str, largest: int | None = None) -> str:
    """UTF-8 text without its byte order mark. Raises InputError like `read_bytes`, or if it is not valid UTF-8."""
    data = read_bytes(path, largest)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not {what}: it is not text in UTF-8 (byte {error.start}); {then}.") from error


def read_json(path: Path, what: str, then: str, largest: int = LARGEST_JSON, *, strict: bool = True) -> Any:
    """The value of a JSON file. Raises InputError like `read_text` and `parse_json`."""
    return parse_json(path, read_text(path, what, then, largest), what, then, strict=strict)


def parse_json(path: Path, text: str, what: str, then: str, *, strict: bool = True) -> Any:
    """The value of JSON text. Integers are converted by `whole`.

    path    the file of the text, for error messages
    what    the kind of file, as in `reading`
    then    the advice to the user, as in `reading`
    strict  refuse NaN and Infinity, which JSON does not define, and duplicate keys

    Raises InputError if the text is not valid JSON, or would use many times its size in memory.
    """
    with reading(path, what, then):
        brackets = text.count("[") + text.count("{")
        if brackets > _BRACKETS + len(text) // _BYTES_PER_BRACKET:
            raise InputError(f"{path} is not {what}: it has {brackets} lists and objects; {then}.")
        try:
            if strict:
                return json.loads(
                    text, parse_int=parse_integer, parse_constant=_refuse_special_file, object_pairs_hook=_unique
                )
            return json.loads(text, parse_int=parse_integer)
        except json.JSONDecodeError as error:
            why = f"line {error.lineno}: {error.msg}"
            raise InputError(f"{path} is not JSON and cannot be read as {what} ({why}); {then}.") from error
        except RecursionError as error:
            raise InputError(f"{path} is not {what}: it is nested too deeply; {then}.") from error


def parse_integer(digits: str) -> int | float:
    """Parses an integer of JSON. Returns infinity if a float cannot hold it, for example for 1 and 999 zeros.

    Readers then refuse the value as not finite and name its place. In contrast, `float(10**400)` and
    `math.isfinite(10**400)` raise OverflowError. Raises ValueError if Python cannot parse the number.
    """
    number = int(digits)  # raises ValueError for thousands of digits
    return number if len(digits) <= _DIGITS else float(digits)


def is_number(value: object) -> bool:
    """Whether a JSON value is a finite number that a float can hold. A bool is not a number."""
    return isinstance(value, (int, float)) and type(value) is not bool and abs(value) <= sys.float_info.max


def _refuse_special_file(name: str) -> None:
    raise ValueError(f"it contains {name}, which JSON does not define")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"it has the key {twice[:40]!r} twice")
    return found
