"""Options that select the machines for pieces of work."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from nvsim.cluster.piece import Storage


@dataclass(frozen=True)
class ClusterConfig:
    """Where NVSim trains submaps and runs other work that it can divide into pieces."""

    executor: Literal["local", "ray"] = "local"
    """local: processes of this machine; ray: the machines of a Ray cluster (needs the extra `cluster`)."""
    address: str = "auto"
    """Address of the cluster's head as HOST:PORT; auto for the cluster of this machine."""
    storage: Storage = "auto"
    """How workers read the project and its images. shared: under the same paths on all machines; sent: NVSim sends the
    input of a piece to its machine and its result back; auto tests for shared storage."""
