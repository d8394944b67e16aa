"""Measure the seconds until `nvsim --help` has answered and until an empty window is usable."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from dataclasses import dataclass

from nvsim.cli import show
from nvsim.cli.window import measured_by_window
from nvsim.errors import InputError


@dataclass(frozen=True)
class Arguments:
    json: bool = False
    """Print one JSON object."""
    runs: int = 5
    """Number of runs per median."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if --runs is out of range."""
    if not 1 <= arguments.runs <= 1000:
        raise InputError(f"--runs {arguments.runs} is out of range; give 1 to 1000.")
    help_s = statistics.median(_seconds([sys.executable, "-P", "-m", "nvsim", "--help"]) for _ in range(arguments.runs))
    app_s = statistics.median(_window() for _ in range(arguments.runs))
    show.figures({"help_s": round(help_s, 3), "app_s": round(app_s, 3)}, arguments.json, "startup")
    return 0


def _seconds(command: list[str]) -> float:
    started = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - started


def _window() -> float:
    """Seconds from the start of the process to the first drawn, responsive window, as the window reports it."""
    return float(measured_by_window(["--bench"])["start_s"])
