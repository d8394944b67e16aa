"""The command that opens the window, and the processes of windows that other commands start."""

from __future__ import annotations

import importlib.util
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nvsim.cli.arguments import Memory, Positional, memory_budget
from nvsim.errors import InputError
from nvsim.project.path_kind import check_openable


@dataclass(frozen=True)
class App:
    """Open the window on a project, on a navigation graph from any source, or on a splat file of any program."""

    path: Positional[Path | None] = None
    """A project folder, NAME.nvsim; a connectivity file, SCAN_connectivity.json, or a folder of them with its
    scans.txt; or a splat file: PLY, compressed PLY, SPZ, SOG (also unpacked: its meta.json), .splat,
    .ksplat, or a .splats list of them."""
    project: Path | None = None
    """The path, as a named option."""
    memory: Memory = None
    """GiB of memory for trained models, remembered for the next start; 0 restores the default, a quarter of the
    machine's memory."""

    def run(self) -> int:
        """Opens the window. Raises InputError if PySide6 is missing, or if the path or the memory limit is invalid."""
        path = self.project or self.path
        if path is not None:
            check_openable(path)
        if not is_window_installed():
            raise InputError("The window needs PySide6-Essentials; install it with `pip install PySide6-Essentials`.")
        words = [f"--project={path}"] if path is not None else []
        if self.memory is not None:
            if self.memory != 0:
                memory_budget(self.memory)  # refuses invalid sizes
            words.append(f"--memory={self.memory}")
        return open_window(words)


def has_display() -> bool:
    """Whether there is a display for a window."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def is_window_installed() -> bool:
    """Whether the packages for the window are installed."""
    return importlib.util.find_spec("PySide6") is not None


def command(project: Path) -> str:
    """The command line that opens the window."""
    return f"nvsim app --project {shlex.quote(str(project))}"


def open_if_wanted(project: Path, wanted: bool) -> int:
    """Opens the window if it is possible and wanted; returns its exit code, else 0."""
    return open_window([f"--project={project}"]) if wanted and has_display() and is_window_installed() else 0


def open_window(arguments: list[str]) -> int:
    """Runs the window until it is closed; returns its exit code."""
    # -P: do not import packages from the current folder.
    return subprocess.call([sys.executable, "-P", "-m", "nvsim_app", *arguments])


def measured_by_window(arguments: Sequence[str], environment: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Starts a window that measures itself, and returns the values that it prints. Without a display it is drawn in
    memory. Raises InputError if the window does not start or cannot measure itself."""
    if environment is None:
        environment = dict(os.environ)
        if not has_display():
            environment["QT_QPA_PLATFORM"] = "offscreen"
    result = subprocess.run(
        [sys.executable, "-P", "-m", "nvsim_app", *arguments],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if result.returncode != 0:
        last = (result.stderr.strip().splitlines() or ["no message"])[-1]
        raise InputError(f"The window cannot be measured here: {last}")
    figures: dict[str, Any] = json.loads(result.stdout.strip().splitlines()[-1])
    return figures
