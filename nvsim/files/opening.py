"""Files that are opened to be written in a folder that may have come from somebody else: never through a link, and
never anything but a plain file.

A project or a graph can be given to a user with links in it. A lock, a log or a database that is such a link would
overwrite the file that it leads to; a pipe or a device there would keep us waiting for ever.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.nofollow import open_regular

PROJECT_DATABASE = "project.db"
"""The file by which the folder of a project is known."""


class NotPlain(InputError):
    """A link, a folder, a pipe or a device stands where a plain file should."""


def plain_file(path: Path, flags: int, mode: int = 0o644) -> int:
    """A descriptor of `path`, opened with `flags` as `os.open` takes them. Raises NotPlain where it is no plain file or
    a folder on the way leads out of its project, OSError as `os.open` does for all else."""
    stay_inside(path.parent)
    try:
        return open_regular(path, flags, mode)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EINVAL, errno.ENXIO, errno.EISDIR, errno.ENODEV) or path.is_symlink():
            raise _not_plain(path) from error
        raise


def own_file(path: Path, flags: int, mode: int = 0o644) -> int:
    """The same for a file of which only the name is ours, a log: what stands there and is no plain file gives way. What
    a link leads to is not touched."""
    try:
        return plain_file(path, flags, mode)
    except NotPlain:
        stay_inside(path.parent)
        path.unlink()  # a folder stays, and is refused with the system's words
        return os.open(path, flags | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, mode)


def refuse_unless_plain(path: Path) -> None:
    """For files that a library opens by name. What does not exist passes. Raises NotPlain."""
    stay_inside(path.parent)
    try:
        found = path.lstat()
    except OSError:
        return
    if not stat.S_ISREG(found.st_mode):
        raise _not_plain(path)


def stay_inside(folder: Path) -> None:
    """Raises NotPlain when a link among the folders on the way to `folder` lies in a project and leads out of it. That
    the project itself is reached by links is no matter."""
    for at in (folder, *folder.parents):
        if not at.is_symlink():
            continue
        for above in at.parents:
            if (above / PROJECT_DATABASE).is_file() and not at.resolve().is_relative_to(above.resolve()):
                raise NotPlain(
                    f"{at} is a link that leads out of the project {above.name}; nothing is written through it. "
                    "Put the folder itself there."
                )


def refuse_links_out(project: Path) -> None:
    """Raises NotPlain when a folder of the project, or one in it, is a link that leads out of the project."""
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
    return NotPlain(f"{path} is {what}, and nothing is written through it; remove it and try again.")
