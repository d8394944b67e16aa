"""Folders of this user (home, data, state) by the XDG specification, also for a user without a home."""

from __future__ import annotations

import os
from pathlib import Path


def home_folder() -> Path:
    """The home folder; / for a user unknown to the system, for example in a container with an arbitrary user id."""
    try:
        return Path.home()
    except RuntimeError:
        return Path("/")


def xdg_folder(variable: str, usual: str) -> Path:
    """The folder in a variable such as XDG_DATA_HOME, or `usual` in the home folder if the variable is unset. A path
    that is not absolute counts as unset, as the XDG Base Directory Specification requires."""
    given = os.environ.get(variable, "")
    return Path(given) if os.path.isabs(given) else home_folder() / usual
