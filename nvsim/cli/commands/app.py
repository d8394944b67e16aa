"""Open the window on a project."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli import window
from nvsim.cli.arguments import Positional
from nvsim.errors import InputError
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments:
    path: Positional[Path | None] = None
    """The project folder, NAME.nvsim."""
    project: Path | None = None
    """The same, by name."""


def run(arguments: Arguments) -> int:
    path = arguments.project or arguments.path
    if path is not None:
        Project.open(path).close()  # a sentence here rather than a window that opens on nothing
    import importlib.util

    if importlib.util.find_spec("PySide6") is None:
        raise InputError("the window needs PySide6-Essentials; `pip install PySide6-Essentials` adds it.")
    return window.open_window([f"--project={path}"] if path is not None else [])
