"""Times work on a GPU."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import torch


def name_of(device: str) -> str:
    """The name of the GPU, or "cpu"."""
    return torch.cuda.get_device_name(device) if device != "cpu" else "cpu"


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
