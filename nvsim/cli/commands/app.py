"""Open the window on a project, on a navigation graph of anyone's, or on a splat file of any program."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli import window
from nvsim.cli.arguments import Memory, Positional, memory_budget
from nvsim.errors import InputError
from nvsim.project.path_kind import check_openable


@dataclass(frozen=True)
class Arguments:
    path: Positional[Path | None] = None
    """The project folder, NAME.nvsim; a connectivity file, SCAN_connectivity.json, or a folder of them with its
    scans.txt; or a splat file: PLY, compressed PLY, SPZ, SOG (also unpacked: its meta.json), .splat."""
    project: Path | None = None
    """The same, by name."""
    memory: Memory = None
    """GiB for trained models, remembered for the next time; 0 goes back to a quarter of the machine's."""


def run(arguments: Arguments) -> int:
    path = arguments.project or arguments.path
    if path is not None:
        check_openable(path)
    import importlib.util

    if importlib.util.find_spec("PySide6") is None:
        raise InputError("the window needs PySide6-Essentials; `pip install PySide6-Essentials` adds it.")
    words = [f"--project={path}"] if path is not None else []
    if arguments.memory is not None:
        if arguments.memory != 0:
            memory_budget(arguments.memory)  # refuses what is no size
        words.append(f"--memory={arguments.memory}")
    return window.open_window(words)
