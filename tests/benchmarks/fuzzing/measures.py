"""Properties of a process from the operating system: memory, processor time, and whether it sleeps."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import psutil


def forget_peak() -> None:
    with open("/proc/self/clear_refs", "w") as file:
        file.write("5")


def memory(name: str) -> int:
    with open("/proc/self/status") as file:
        for line in file:
            if line.startswith(name):
                return int(line.split()[1]) << 10
    raise RuntimeError(f"no {name} in /proc/self/status")


def sleeps(processes: Iterable[int]) -> bool:
    """Whether every thread of the processes sleeps and does not wait for a disk."""
    try:
        states = [Path(task, "stat").read_text().rpartition(")")[2].split()[0] for p in processes for task in _tasks(p)]
    except OSError:
        return False
    return all(state == "S" for state in states)


def _tasks(process: int) -> list[Path]:
    return list(Path(f"/proc/{process}/task").iterdir())


def with_children(process: int) -> list[int]:
    """The process and all its descendants."""
    try:
        return [process, *(child.pid for child in psutil.Process(process).children(recursive=True))]
    except psutil.Error:
        return [process]


def processor_time(process: int) -> float:
    try:
        with open(f"/proc/{process}/stat") as file:
            fields = file.read().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
