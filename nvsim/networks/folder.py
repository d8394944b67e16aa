"""The models folder: one folder per user for networks that the user installs.

It contains single ONNX files with fixed names (lpips.onnx), folders of models with a description, and TOML files."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from nvsim.files.opening import is_regular
from nvsim.files.user_folders import home_folder, xdg_folder

VARIABLE = "NVSIM_MODELS"


def models_folder() -> Path:
    """$NVSIM_MODELS, else `nvsim/models` in the platform's folder for user data. It may not exist."""
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named).expanduser()
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", home_folder() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = home_folder() / "Library" / "Application Support"
    else:
        base = xdg_folder("XDG_DATA_HOME", ".local/share")
    return base / "nvsim" / "models"


def find_file(name: str) -> Path | None:
    """The user's file NAME.onnx (such as "lpips"), None if it does not exist."""
    path = models_folder() / f"{name}.onnx"
    return path if is_regular(path) else None
