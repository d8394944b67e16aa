"""Seconds until `nvsim --help` has answered and until an empty window can be used."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass

from nvsim.cli import show
from nvsim.cli.window import has_display
from nvsim.errors import InputError


@dataclass(frozen=True)
class Arguments:
    json: bool = False
    """Print one JSON object."""
    runs: int = 5
    """How many runs the median is of."""


def run(arguments: Arguments) -> int:
    help_s = statistics.median(_seconds([sys.executable, "-m", "nvsim", "--help"]) for _ in range(arguments.runs))
    app_s = statistics.median(_window() for _ in range(arguments.runs))
    show.figures({"help_s": round(help_s, 3), "app_s": round(app_s, 3)}, arguments.json, "startup")
    return 0


def _seconds(command: list[str]) -> float:
    started = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - started


def _window() -> float:
    """From the process's start to the first painted, responding window, as the window itself reports it."""
    environment = dict(os.environ)
    if not has_display():
        environment["QT_QPA_PLATFORM"] = "offscreen"
    result = subprocess.run(
        [sys.executable, "-P", "-m", "app", "--bench"], env=environment, capture_output=True, text=True, check=False
    )
    if result.returncode != 0:
        last = (result.stderr.strip().splitlines() or ["no message"])[-1]
        raise InputError(f"the window does not start here: {last}")
    return float(json.loads(result.stdout.strip().splitlines()[-1])["start_s"])
