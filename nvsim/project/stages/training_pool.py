"""How the submaps that are trained side by side share the cores and the memory of a machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from nvsim.training.config import TrainingConfig

BASE_BYTES = 600 << 20
"""What a process takes before it holds any data: interpreter, libraries, compiled kernels."""
GAUSSIAN_BYTES = 1600
"""Per Gaussian of the cap: parameters, gradient, moments, what drawing and refining need."""
MEMORY_SHARE = 0.7
"""Of the free memory, at most this share is planned for."""


@dataclass(frozen=True)
class Task:
    """A submap to train with `threads` threads; `alone` while no other is trained."""

    submap: int
    threads: int
    alone: bool


def plan(submaps: Sequence[int], cores: int, at_once: int) -> list[Task]:
    """How many threads each submap gets. Depends on the whole list, never on what is left of it after a run that was
    cut off, as the number of threads decides the order of sums. What does not fill all `at_once` processes at the end
    of the list is trained with every core, one after another."""
    together = max(1, min(at_once, cores, len(submaps)))
    full = len(submaps) - len(submaps) % together
    alone = [together == 1 or i >= full for i in range(len(submaps))]
    return [Task(s, cores if a else cores // together, a) for s, a in zip(submaps, alone, strict=True)]


def needed_bytes(frames: int, pixels: int, config: TrainingConfig) -> int:
    """An upper estimate of what training one submap of `frames` images of `pixels` pixels takes."""
    views = frames * pixels * 4 * 5 // 4  # colours and mask, and both at half the size
    return BASE_BYTES + views + 200 * pixels + config.gaussian_cap * GAUSSIAN_BYTES


def fitting(free_bytes: int, bytes_each: int) -> int:
    """How many trainings fit into free memory, at least one."""
    return max(1, int(MEMORY_SHARE * free_bytes) // bytes_each)
