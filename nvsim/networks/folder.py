"""Where networks that the user brings lie: one folder per user. What a single ONNX file does (lpips.onnx) lies there
by its name; a model with a description has a folder of its own, or a TOML there."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from nvsim.files.regular import is_regular
from nvsim.files.user_folders import home, xdg_folder

VARIABLE = "NVSIM_MODELS"


def models_folder() -> Path:
    """$NVSIM_MODELS, else the folder `nvsim/models` where the platform keeps a user's data; it need not exist."""
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named).expanduser()
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = home() / "Library" / "Application Support"
    else:
        base = xdg_folder("XDG_DATA_HOME", ".local/share")
    return base / "nvsim" / "models"


def find_file(name: str) -> Path | None:
    """The user's file NAME.onnx ("lpips"), None where there is none."""
    path = models_folder() / f"{name}.onnx"
    return path if is_regular(path) else None
