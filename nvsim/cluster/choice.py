"""The executor that a user asked for."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from nvsim.cluster.config import ClusterConfig
from nvsim.cluster.local import LocalPool
from nvsim.cluster.piece import Executor


@contextlib.contextmanager
def opened(config: ClusterConfig) -> Iterator[Executor]:
    """It, until the block ends. Raises InputError where Ray is asked for and is not installed, or no cluster answers.
    Ray is imported where it is asked for and nowhere else."""
    if config.executor == "local":
        yield LocalPool()
        return
    from nvsim.cluster.connecting import connected
    from nvsim.cluster.ray_pool import RayPool

    with connected(config.address) as ray:
        yield RayPool(ray)
