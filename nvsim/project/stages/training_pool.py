"""Divides the cores and the memory of a machine among submaps that train in parallel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from nvsim.training.config import TrainingConfig

BASE_BYTES = 600 << 20
"""Memory of a process without data: interpreter, libraries, compiled kernels."""
GAUSSIAN_BYTES = 1600
"""Memory per Gaussian of the cap: parameters, gradient, moments, and buffers of rendering and refinement."""
MEMORY_SHARE = 0.7
"""Maximum share of the free memory that is planned for."""


@dataclass(frozen=True)
class TrainingTask:
    """A submap to train with `threads` threads; `alone` if no other submap trains meanwhile."""

    submap: int
    threads: int
    alone: bool


def plan(submaps: Sequence[int], cores: int, at_once: int) -> list[TrainingTask]:
    """Assigns a number of threads to each submap.

    The number depends on the complete list of `submaps`. It does not depend on the submaps that an interrupted run has
    left, because it determines the order of sums. Submaps at the end of the list that do not fill all `at_once`
    processes train one after another with all cores.
    """
    together = max(1, min(at_once, cores, len(submaps)))
    full = len(submaps) - len(submaps) % together
    alone = [together == 1 or i >= full for i in range(len(submaps))]
    return [TrainingTask(s, cores if a else cores // together, a) for s, a in zip(submaps, alone, strict=True)]


def needed_bytes(frames: int, pixels: int, config: TrainingConfig) -> int:
    """An upper estimate in bytes of the memory to train one submap of `frames` images with `pixels` pixels each."""
    views = frames * pixels * 4 * 5 // 4  # colors and mask, and both at half size
    return BASE_BYTES + views + 200 * pixels + config.gaussian_cap * GAUSSIAN_BYTES


def count_that_fit(free_bytes: int, bytes_each: int) -> int:
    """The number of trainings that fit into the free memory, at least one."""
    return max(1, int(MEMORY_SHARE * free_bytes) // bytes_each)
