"""Folders of this user: home, data and state, by the XDG rules, also for a user without a home."""

from __future__ import annotations

import os
from pathlib import Path


def home() -> Path:
    """The home folder, / for a user whom the system does not know, as in a container that runs under any number."""
    try:
        return Path.home()
    except RuntimeError:
        return Path("/")


def xdg_folder(variable: str, usual: str) -> Path:
    """The folder that a variable such as XDG_DATA_HOME names, else `usual` in the home folder. A path that is not
    absolute counts as unset, as the XDG Base Directory Specification wants it."""
    given = os.environ.get(variable, "")
    return Path(given) if os.path.isabs(given) else home() / usual
