"""The command that opens the window."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path

from nvsim.cli import window
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
        if importlib.util.find_spec("PySide6") is None:
            raise InputError("The window needs PySide6-Essentials; install it with `pip install PySide6-Essentials`.")
        words = [f"--project={path}"] if path is not None else []
        if self.memory is not None:
            if self.memory != 0:
                memory_budget(self.memory)  # refuses invalid sizes
            words.append(f"--memory={self.memory}")
        return window.open_window(words)
