"""Opens files for writing in folders that may come from other people: only plain files, and never through a link.

A project or graph from another person can contain links. Writing a lock, log or database through a link would overwrite
a file elsewhere. A pipe or device would block the program forever.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.nofollow import open_regular

PROJECT_DATABASE = "project.db"
"""The file that identifies a project folder."""


class NotPlain(InputError):
    """The path is a link, a folder, a pipe or a device and must be a plain file."""


def plain_file(path: Path, flags: int, mode: int = 0o666) -> int:
    """A descriptor of `path`, opened with `flags` of `os.open`. Raises NotPlain if it is not a plain file, or a folder
    in its path leads out of the project. Raises OSError like `os.open` for all other failures."""
    stay_inside(path.parent)
    try:
        return open_regular(path, flags, mode)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EINVAL, errno.ENXIO, errno.EISDIR, errno.ENODEV) or path.is_symlink():
            raise _not_plain(path) from error
        raise


def own_file(path: Path, flags: int, mode: int = 0o666) -> int:
    """Like `plain_file`, for a file whose old content may be lost, such as a log. A link or pipe at `path` is removed
    first. The target of a link is not touched."""
    try:
        return plain_file(path, flags, mode)
    except NotPlain:
        stay_inside(path.parent)
        path.unlink()  # fails for a folder with the message of the system
        return os.open(path, flags | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, mode)


def refuse_unless_plain(path: Path) -> None:
    """Checks a file before a library opens it by name. A missing file passes. Raises NotPlain."""
    stay_inside(path.parent)
    try:
        found = path.lstat()
    except OSError:
        return
    if not stat.S_ISREG(found.st_mode):
        raise _not_plain(path)


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
