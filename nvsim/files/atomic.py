"""Writes files atomically: into a private folder beside the target first, then moved to the target path."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import stat
import tempfile
from collections.abc import Callable, Collection, Iterator
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.opening import NotPlainFile, refuse_links_out_of

_REASONS = {
    errno.ENOSPC: "the disk is full; free some space and try again",
    errno.EDQUOT: "the disk quota is used up; free some space and try again",
    errno.EROFS: "the file system is read-only; choose another folder",
    errno.EISDIR: "it is a folder; name a file",
    errno.EIO: "the disk reports an error; check it or choose another",
    errno.ESTALE: "the network file system has lost the file; mount it again",
    **dict.fromkeys(
        (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP),
        "this file system cannot lock files (some network file systems cannot); choose a folder on a local disk",
    ),
    errno.EEXIST: "a part of the path is a file, not a folder; choose another path",
    errno.ENOTDIR: "a part of the path is a file, not a folder; choose another path",
}


def as_input_error(path: Path, error: OSError) -> InputError:
    """The error message for a failed write to `path`."""
    if error.errno in (errno.EACCES, errno.EPERM):
        return InputError(f"Cannot write {path}: {_permission_reason(path)}.")
    reason = _REASONS.get(error.errno or 0, f"{error.strerror or error}; check the path")
    return InputError(f"Cannot write {path}: {reason}.")


def _permission_reason(path: Path) -> str:
    """The reason for a denied permission: the owner of the file, or of the folder that would contain it."""
    at = next((p for p in (path, *path.parents) if os.path.lexists(p)), path)
    if at == path and os.access(path, os.W_OK) and not path.is_dir():
        at = path.parent  # the file is writable, but its folder is not
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


def existing_parent(folder: Path) -> Path:
    """The folder itself, or its nearest parent that exists."""
    place = folder.absolute()
    while not os.path.lexists(place) and place != place.parent:
        place = place.parent
    return place


def refuse_unwritable_folder(folder: Path) -> None:
    """Raises InputError, before any work, if `folder` cannot be created, or if this user may not write into it."""
    place = existing_parent(folder)
    why = errno.ENOTDIR if not place.is_dir() else 0 if os.access(place, os.W_OK | os.X_OK) else errno.EACCES
    if why:
        raise as_input_error(folder, OSError(why, os.strerror(why)))


def refuse_unwritable_file(path: Path) -> None:
    """Raises InputError, before any work, if no file can be written at `path`."""
    if path.is_dir():
        raise as_input_error(path, OSError(errno.EISDIR, os.strerror(errno.EISDIR)))
    refuse_unwritable_folder(path.parent)


def make_folder(path: Path) -> Path:
    """Creates `path` and its parents. Returns `path`. Raises InputError with the reason of a failure."""
    refuse_links_out_of(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise as_input_error(path, error) from error
    return path


def make_own_folder(path: Path) -> Path:
    """Like `make_folder`, for a folder whose files will be replaced. Raises NotPlain if `path` is a link, so that no
    files elsewhere are replaced."""
    if path.is_symlink():
        raise NotPlainFile(f"{path} is a link to a folder, and NVSim replaces no files through links; remove the link.")
    return make_folder(path)


def resumed_folder(path: Path) -> Path:
    """The folder `path` with unfinished work of an earlier run, created if it is missing.

    NVSim deletes the folder and creates it again if it is a link, or contains anything but plain files of this user.
    Targets of links are not touched. Raises InputError if the disk reports an error.
    """
    make_folder(path.parent)
    try:
        if os.path.lexists(path) and not _is_our_own(path):
            remove(path)
        path.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise as_input_error(path, error) from error
    return path


def _is_our_own(folder: Path) -> bool:
    """Whether a folder and its content belong to this user, and all entries are plain files without hard links."""
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid():
        return False
    with os.scandir(folder) as entries:
        files = [entry.stat(follow_symlinks=False) for entry in entries]
    return all(stat.S_ISREG(f.st_mode) and f.st_nlink == 1 and f.st_uid == os.geteuid() for f in files)


def remove(path: Path) -> None:
    """Removes a file, a link, or a folder with its content. A missing path is ignored. Raises OSError."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def remove_others(folder: Path, kept: Collection[str], is_ours: Callable[[Path], bool]) -> None:
    """Removes what an earlier run wrote to `folder`: the entries for which `is_ours` is true, except the names `kept`.
    Raises InputError if the disk refuses."""
    try:
        for entry in folder.iterdir():
            if entry.name not in kept and is_ours(entry):
                remove(entry)
    except OSError as error:
        raise as_input_error(folder, error) from error


@contextlib.contextmanager
def private_folder(path: Path) -> Iterator[Path]:
    """A new folder beside `path` that only this user can open, removed after the block. Libraries write a file with the
    name of `path` in it, so no existing link can be followed. Temporary files of the libraries are removed with the
    folder. Raises InputError if the disk reports an error."""
    make_folder(path.parent)
    try:
        folder = Path(tempfile.mkdtemp(prefix=f".{path.stem[:40]}-", dir=path.parent))
    except OSError as error:
        raise as_input_error(path, error) from error
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def move_into_place(written: Path, path: Path) -> None:
    """Renames the file `written` to `path`; both must be on one file system. A link at `path` is replaced, not
    followed. The bytes are on disk before the name changes. Raises OSError."""
    with open(written, "rb+") as file:
        os.fsync(file.fileno())
    os.replace(written, path)


@contextlib.contextmanager
def replacement_file(path: Path) -> Iterator[Path]:
    """Yields a path with the name of `path` in a private folder. On success, the file written there replaces `path`; on
    failure it is deleted. Raises InputError if the disk reports an error."""
    with private_folder(path) as folder:
        written = folder / path.name
        try:
            yield written
            move_into_place(written, path)
        except OSError as error:
            if error.filename is not None and Path(error.filename).parent not in (folder, path.parent):
                raise  # the error is about a file that the caller reads, not about the written file
            raise as_input_error(path, error) from error


def write_bytes(path: Path, data: bytes) -> None:
    """Replaces the content of `path` atomically. Raises InputError if the disk reports an error."""
    with replacement_file(path) as temporary:
        temporary.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    """Replaces the content of `path` with text in UTF-8. Raises InputError if the disk reports an error, or like
    `encode_text`."""
    write_bytes(path, encode_text(path, text))


def encode_text(path: Path, text: str) -> bytes:
    """`text` in UTF-8, for the file `path`. Raises InputError if it has a code point that UTF-8 cannot encode, which is
    possible in file names."""
    try:
        return text.encode()
    except UnicodeEncodeError as error:
        at = text[max(0, error.start - 20) : error.end + 20]
        raise InputError(
            f"Cannot write {path}: UTF-8 cannot encode {at!a}; rename the file or folder that contains this name."
        ) from error
