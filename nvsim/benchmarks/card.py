"""Times work on a GPU, and describes the GPU and the software of a measurement."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import torch


def name_of(device: str) -> str:
    """The name of the GPU, or "cpu"."""
    return torch.cuda.get_device_name(device) if device != "cpu" else "cpu"


def describe_device() -> dict[str, Any]:
    """Versions of the software, and the properties of the GPU if there is one."""
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


_WARM_UP = 3  # calls that are not counted


def settle(device: str) -> None:
    """Waits until the device has finished all submitted work."""
    if device != "cpu":
        torch.cuda.synchronize(device)


def milliseconds(work: Callable[[], object], device: str, rounds: int) -> float:
    """Median time of `work` over `rounds` calls in milliseconds, including its work on the GPU."""
    times = []
    for k in range(_WARM_UP + rounds):
        settle(device)
        started = time.perf_counter()
        work()
        settle(device)
        if k >= _WARM_UP:
            times.append(1e3 * (time.perf_counter() - started))
    return statistics.median(times)
