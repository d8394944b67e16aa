"""Starts the window as a process of its own, or prints the command that does."""

from __future__ import annotations

import importlib.util
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from nvsim.cli.terminal import say
from nvsim.errors import InputError


def has_display() -> bool:
    """Whether a window could be seen."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def installed() -> bool:
    """Whether what the window needs is there."""
    return importlib.util.find_spec("PySide6") is not None


def command(project: Path) -> str:
    """What a user types to open the window."""
    return f"nvsim app --project {shlex.quote(str(project))}"


def offer(project: Path, wanted: bool, quiet: bool) -> int:
    """Opens the window where that is possible and wanted; otherwise prints the command. Exit code 0 either way."""
    if wanted and has_display() and installed():
        return open_window([f"--project={project}"])
    if not quiet:
        say(f"Open the window with: {command(project)}")
    return 0


def open_window(arguments: list[str]) -> int:
    """Runs the window until it is closed; returns its exit code."""
    # -P: a folder called app where the user happens to stand is not ours.
    return subprocess.call([sys.executable, "-P", "-m", "app", *arguments])


def measured_by_window(arguments: Sequence[str], environment: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Starts a window that measures itself, drawn to memory where there is no display, and returns the figures that it
    prints. Raises InputError when it does not start, or cannot measure itself."""
    if environment is None:
        environment = dict(os.environ)
        if not has_display():
            environment["QT_QPA_PLATFORM"] = "offscreen"
    result = subprocess.run(
        [sys.executable, "-P", "-m", "app", *arguments], env=environment, capture_output=True, text=True, check=False
    )
    if result.returncode != 0:
        last = (result.stderr.strip().splitlines() or ["no message"])[-1]
        raise InputError(f"the window cannot be measured here: {last}")
    figures: dict[str, Any] = json.loads(result.stdout.strip().splitlines()[-1])
    return figures
