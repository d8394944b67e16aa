"""Starting the window as a process of its own, or saying how."""

from __future__ import annotations

import importlib.util
import os
import shlex
import subprocess
import sys
from pathlib import Path


def has_display() -> bool:
    """Whether a window could be seen."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def command(project: Path) -> str:
    """What a person types to open the window."""
    return f"nvsim app --project {shlex.quote(str(project))}"


def offer(project: Path, wanted: bool, quiet: bool) -> int:
    """Opens the window where that is possible and wanted; otherwise prints the command. Exit code 0 either way."""
    if wanted and has_display() and importlib.util.find_spec("PySide6") is not None:
        return open_window([f"--project={project}"])
    if not quiet:
        print(f"Open the window with: {command(project)}")
    return 0


def open_window(arguments: list[str]) -> int:
    """Runs the window until it is closed; returns its exit code."""
    # -P: a folder called app where the person happens to stand is not ours.
    return subprocess.call([sys.executable, "-P", "-m", "app", *arguments])
