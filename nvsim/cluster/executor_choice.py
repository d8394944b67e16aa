"""Opens the executor that the options select."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from nvsim.cluster.config import ClusterConfig
from nvsim.cluster.local import LocalPool
from nvsim.cluster.piece import Executor


@contextlib.contextmanager
def open_executor(config: ClusterConfig) -> Iterator[Executor]:
    """The executor of the options, until the block ends. Ray is imported only if it is selected.

    Raises InputError if Ray is selected and not installed, or if no cluster answers.
    """
    if config.executor == "local":
        yield LocalPool()
        return
    from nvsim.cluster.ray_connection import connect_to_cluster
    from nvsim.cluster.ray_pool import RayPool

    with connect_to_cluster(config.address) as ray:
        yield RayPool(ray)
