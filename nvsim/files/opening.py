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


def plain_file(path: Path, flags: int, mode: int = 0o666) -> int:
    """A descriptor of `path`, opened with `flags` as `os.open` takes them. Raises NotPlain where it is no plain file or
    a folder on the way leads out of its project, OSError as `os.open` does for all else."""
    stay_inside(path.parent)
    try:
        return open_regular(path, flags, mode)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EINVAL, errno.ENXIO, errno.EISDIR, errno.ENODEV) or path.is_symlink():
            raise _not_plain(path) from error
        raise


def own_file(path: Path, flags: int, mode: int = 0o666) -> int:
    """Like `plain_file`, for a file such as a log, whose old content may be lost: a link or pipe that stands there is
    removed first. What a link leads to is not touched."""
    try:
        return plain_file(path, flags, mode)
    except NotPlain:
        stay_inside(path.parent)
        path.unlink()  # a folder stays, and is refused with the system's words
        return os.open(path, flags | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, mode)


def refuse_unless_plain(path: Path) -> None:
    """Checks a file before a library opens it by name; one that is missing passes. Raises NotPlain."""
    stay_inside(path.parent)
    try:
        found = path.lstat()
    except OSError:
        return
    if not stat.S_ISREG(found.st_mode):
        raise _not_plain(path)


def stay_inside(folder: Path) -> None:
    """Raises NotPlain when a link among the folders on the way to `folder` lies in a project and leads out of it. Links
    on the way to the project itself are allowed."""
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
