"""Choose the folder in which numba caches compiled kernels if its usual folders are read-only.

The package folder and the user's cache folder are read-only in containers and for service accounts. Numba then refuses
to define a kernel, so NVSim chooses a folder for temporary files. Numba executes the files in that folder. It must
therefore belong to this user, exclude all other users, and have done so since it was created.
"""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"
_PACKAGE = Path(__file__).parent


def choose() -> None:
    """Sets numba's cache folder for this process and its child processes, if numba cannot write to its usual folders.
    A folder that the environment variable names takes precedence."""
    if os.environ.get(VARIABLE) or sys.platform == "win32":
        return
    if can_write(_PACKAGE / "render" / "__pycache__") or can_write(user_cache()):
        return
    folder = temporary_cache()
    if folder is None:
        return
    os.environ[VARIABLE] = str(folder)
    numba = sys.modules.get("numba")
    if numba is not None:  # numba reads the environment only when it is imported
        numba.config.CACHE_DIR = str(folder)


def temporary_cache() -> Path | None:
    """A temporary folder that only this user can enter. All processes of the user share it. If another user owns a
    folder of that name, a new folder is created. None if no temporary folder can be created."""
    import tempfile

    for place in (tempfile.gettempdir(), "/dev/shm"):
        folder = Path(place) / f"nvsim-kernels-{os.geteuid()}"
        try:
            folder.mkdir(mode=0o700, exist_ok=True)
            return folder if _is_private(folder) else Path(tempfile.mkdtemp(prefix="nvsim-kernels-", dir=place))
        except OSError:
            continue
    return None


def compiled_since(when: float) -> bool:
    """Whether a process of this user compiled a kernel after `when`, in seconds since the epoch. Does not import
    numba."""
    chosen = os.environ.get(VARIABLE)
    folders = [Path(chosen)] if chosen else [_PACKAGE, user_cache()]
    return any(path.stat().st_mtime > when for folder in folders for path in folder.rglob("*.nbc"))


def _is_private(folder: Path) -> bool:
    """Whether only this user can read or replace the folder. It must be a folder, not a link to one. Its parent must
    belong to this user or root, and must have the sticky bit if other users may write to it."""
    found, above = os.lstat(folder), os.stat(folder.parent)
    mine = stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o077
    shared = above.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return mine and above.st_uid in (0, os.geteuid()) and (not shared or bool(above.st_mode & stat.S_ISVTX))


def user_cache() -> Path:
    """Numba's default folder in the user's cache, which depends on the platform."""
    home = os.path.expanduser("~")
    if sys.platform == "darwin":
        return Path(home) / "Library" / "Caches" / "numba"
    return Path(os.environ.get("XDG_CACHE_HOME", os.path.join(home, ".cache"))) / "numba"


def can_write(folder: Path) -> bool:
    """Whether `folder` is writable, or could be created and written."""
    if not folder.is_absolute():  # if there is no home folder, numba takes ~ literally as a folder name
        return False
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)
