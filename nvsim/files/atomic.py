"""Files that are either whole or absent: written beside their place, then moved into it."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.opening import stay_inside

_REASONS = {
    errno.ENOSPC: "the disk is full; free some space and try again",
    errno.EDQUOT: "the disk quota is used up; free some space and try again",
    errno.EROFS: "the file system is read-only; choose another folder",
    errno.EIO: "the disk reports an error; check it or choose another",
    errno.ESTALE: "the network file system has lost it; mount it again",
    **dict.fromkeys(
        (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP),
        "this file system cannot lock files, as some network file systems; choose a folder on a local disk",
    ),
    errno.EEXIST: "a part of the path is a file, not a folder; choose another path",
    errno.ENOTDIR: "a part of the path is a file, not a folder; choose another path",
}


def as_input_error(path: Path, error: OSError) -> InputError:
    """The sentence for a failed write to `path`."""
    if error.errno in (errno.EACCES, errno.EPERM):
        return InputError(f"Cannot write {path}: {_denied(path)}.")
    reason = _REASONS.get(error.errno or 0, f"{error.strerror or error}; check the path")
    return InputError(f"Cannot write {path}: {reason}.")


def _denied(path: Path) -> str:
    """Why permission is denied: because of the owner of the file, or of the folder that it would be made in."""
    at = next((p for p in (path, *path.parents) if os.path.lexists(p)), path)
    if at == path and os.access(path, os.W_OK) and not path.is_dir():
        at = path.parent  # the file itself could be written, but none beside it
    try:
        owner = os.lstat(at).st_uid
    except OSError:
        owner = os.geteuid()
    if owner == os.geteuid():
        return "permission is denied; choose a folder that you may write to"
    name = _user(owner)
    return (
        f"permission is denied, as {at} belongs to {name}; ask {name} for it or choose a folder that you may write to"
    )


def _user(number: int) -> str:
    try:
        import pwd

        return pwd.getpwuid(number).pw_name
    except (ImportError, KeyError):
        return f"user {number}"


def make_folder(path: Path) -> Path:
    """Creates `path` and its parents. Raises InputError with the reason."""
    stay_inside(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise as_input_error(path, error) from error
    return path


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yields a temporary path in the same folder, with the same suffix; on success it replaces `path`, on failure
    nothing is left. The bytes are on disk before the name changes. Raises InputError when the disk refuses."""
    make_folder(path.parent)
    temporary: Path | None = None
    try:
        beside = path.with_name(f".{path.stem[:40]}-{secrets.token_hex(6)}{path.suffix}")
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        os.close(os.open(beside, flags, 0o666))  # the umask decides who else may read and write it
        temporary = beside
        yield temporary
        with open(temporary, "rb+") as written:
            os.fsync(written.fileno())
        os.replace(temporary, path)
        temporary = None
    except OSError as error:
        if error.filename is not None and Path(error.filename).parent != path.parent:
            raise  # a file that the caller read, not the one written here
        raise as_input_error(path, error) from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes) -> None:
    """Raises InputError when the disk refuses."""
    with replacing(path) as temporary:
        temporary.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    """UTF-8. Raises InputError when the disk refuses, or the text holds what is no character, as a file name may."""
    write_bytes(path, encoded(path, text))


def encoded(path: Path, text: str) -> bytes:
    """`text` in UTF-8, to be written to `path`. Raises InputError where it holds what is no character."""
    try:
        return text.encode()
    except UnicodeEncodeError as error:
        at = text[max(0, error.start - 20) : error.end + 20]
        raise InputError(
            f"Cannot write {path}: {at!a} is not text in UTF-8; rename the file or folder that it comes from."
        ) from error
