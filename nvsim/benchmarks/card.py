"""What a figure measured on a card has to say of the card, and how long something takes there."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import torch


def name_of(device: str) -> str:
    """The card's name, or "cpu"."""
    return torch.cuda.get_device_name(device) if device != "cpu" else "cpu"


def about() -> dict[str, Any]:
    """Versions, and the card where there is one."""
    import importlib.metadata as metadata
    import platform

    found: dict[str, Any] = {
        "python": platform.python_version(),
        "torch": torch.__version__,
        "cuda": torch.version.cuda,
    }
    for package in ("nvsim", "gsplat", "numba"):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = None
    if torch.cuda.is_available():
        card = torch.cuda.get_device_properties(0)
        found |= {"card": card.name, "memory_gib": round(card.total_memory / (1 << 30), 1)}
        found["capability"] = f"{card.major}.{card.minor}"
    return found


def settle(device: str) -> None:
    """Waits until the card has done what it was asked for."""
    if device != "cpu":
        torch.cuda.synchronize(device)


def milliseconds(work: Callable[[], object], device: str, rounds: int, warm_up: int = 3) -> float:
    """The median over `rounds` of what `work` takes, the card's part included."""
    times = []
    for k in range(warm_up + rounds):
        settle(device)
        started = time.perf_counter()
        work()
        settle(device)
        if k >= warm_up:
            times.append(1e3 * (time.perf_counter() - started))
    return statistics.median(times)
