"""Where networks that the user brings lie: one folder per user, files by role (lpips.onnx)."""

from __future__ import annotations

import os
import sys
from pathlib import Path

VARIABLE = "NVSIM_MODELS"


def models_folder() -> Path:
    """$NVSIM_MODELS, else the folder `nvsim/models` where the platform keeps a user's data; it need not exist."""
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named).expanduser()
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Application Support"
    else:
        base = Path(os.environ.get("XDG_DATA_HOME", Path.home() / ".local" / "share"))
    return base / "nvsim" / "models"


def find_model(role: str) -> Path | None:
    """The user's file for a role ("lpips"), None where there is none."""
    path = models_folder() / f"{role}.onnx"
    return path if path.is_file() else None
