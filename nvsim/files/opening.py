"""Opens files in folders that may come from other people: only plain files, and never through a link.

A project or graph from another person can contain links. Writing a lock, log or database through a link would overwrite
a file elsewhere. Opening a pipe or device could block the program forever, and opening can already have an effect, so
they are refused before.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from nvsim.errors import InputError

PROJECT_DATABASE = "project.db"
"""The file that identifies a project folder."""


class NotPlain(InputError):
    """The path is a link, a folder, a pipe or a device and must be a plain file."""


def plain_file(path: Path, flags: int) -> int:
    """A descriptor of `path`, opened with `flags` of `os.open`. Raises NotPlain if it is not a plain file, or a folder
    in its path leads out of the project. Raises OSError like `os.open` for all other failures."""
    stay_inside(path.parent)
    try:
        return open_regular(path, flags)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EINVAL, errno.ENXIO, errno.EISDIR, errno.ENODEV) or path.is_symlink():
            raise _not_plain(path) from error
        raise


def own_file(path: Path, flags: int) -> int:
    """Like `plain_file`, for a file whose old content may be lost, such as a log. A link or pipe at `path` is removed
    first. The target of a link is not touched."""
    try:
        return plain_file(path, flags)
    except NotPlain:
        stay_inside(path.parent)
        path.unlink()  # fails for a folder with the message of the system
        return os.open(path, flags | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)


def stay_inside(folder: Path) -> None:
    """Raises NotPlain if a folder in the path of `folder` is a link inside a project that leads out of the project.
    Links above the project are allowed."""
    for at in (folder, *folder.parents):
        if not at.is_symlink():
            continue
        for above in at.parents:
            if (above / PROJECT_DATABASE).is_file() and not at.resolve().is_relative_to(above.resolve()):
                raise NotPlain(
                    f"{at} is a link that leads out of the project {above.name}, and NVSim does not write through it. "
                    "Replace the link with the folder itself."
                )


def refuse_links_out(project: Path) -> None:
    """Raises NotPlain if a folder of the project, or a folder in it, is a link that leads out of the project."""
    for folder in (project, *(p for p in _entries(project) if p.is_dir() and not p.is_symlink())):
        for entry in _entries(folder):
            if entry.is_symlink() and entry.is_dir():
                stay_inside(entry)


def _entries(folder: Path) -> list[Path]:
    try:
        with os.scandir(folder) as rows:
            return [Path(row.path) for row in rows if row.is_symlink() or row.is_dir()]
    except OSError:
        return []


def _not_plain(path: Path) -> NotPlain:
    what = "a symbolic link" if path.is_symlink() else "not a plain file"
    return NotPlain(f"{path} is {what}, and NVSim does not write through it; remove it and try again.")


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
