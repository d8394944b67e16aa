"""Where numba keeps compiled kernels if neither the package nor the user's cache can be written.

In a container, or for a service account, both are read-only, and numba then refuses to define a kernel. A folder of
temporary files takes their place. Numba executes what it finds there, so the folder must belong to this user, be closed
to all others, and must have been so from the beginning.
"""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"
_PACKAGE = Path(__file__).parent


def choose() -> None:
    """Sets numba's cache folder for this process and those that it starts, where numba would find none. A folder that
    the environment names already stays."""
    if os.environ.get(VARIABLE) or sys.platform == "win32":
        return
    if _can_write(_PACKAGE / "render" / "__pycache__") or _can_write(_user_cache()):
        return
    folder = temporary_cache()
    if folder is None:
        return
    os.environ[VARIABLE] = str(folder)
    numba = sys.modules.get("numba")
    if numba is not None:  # it read the environment when it was imported
        numba.config.CACHE_DIR = str(folder)


def temporary_cache() -> Path | None:
    """A folder of temporary files that only this user can enter: the same for all processes of the user, or a fresh one
    if another user has taken that name. None if no temporary file can be made."""
    import tempfile

    for place in (tempfile.gettempdir(), "/dev/shm"):
        folder = Path(place) / f"nvsim-kernels-{os.geteuid()}"
        try:
            folder.mkdir(mode=0o700, exist_ok=True)
            return folder if _is_private(folder) else Path(tempfile.mkdtemp(prefix="nvsim-kernels-", dir=place))
        except OSError:
            continue
    return None


def _is_private(folder: Path) -> bool:
    """Whether the folder itself, not a link to one, is this user's alone, and nobody else can put another in its
    place: the folder above is this user's or root's, and sticky if others may write to it."""
    found, above = os.lstat(folder), os.stat(folder.parent)
    mine = stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o077
    shared = above.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return mine and above.st_uid in (0, os.geteuid()) and (not shared or bool(above.st_mode & stat.S_ISVTX))


def _user_cache() -> Path:
    """Numba's folder in the user's cache, by the rules of the platform."""
    home = os.path.expanduser("~")
    if sys.platform == "darwin":
        return Path(home) / "Library" / "Caches" / "numba"
    return Path(os.environ.get("XDG_CACHE_HOME", os.path.join(home, ".cache"))) / "numba"


def _can_write(folder: Path) -> bool:
    """Whether `folder` can be written, or made and then written."""
    if not folder.is_absolute():  # numba takes ~ as the name of a folder where it knows no home
        return False
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)
