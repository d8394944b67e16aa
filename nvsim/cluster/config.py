"""Where the pieces of a command run, as options."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Storage = Literal["auto", "shared", "sent"]


@dataclass(frozen=True)
class ClusterConfig:
    """Where submaps are trained, and other work that comes in pieces is done."""

    executor: Literal["local", "ray"] = "local"
    """Processes of this machine, or the machines of a Ray cluster (the extra `cluster`)."""
    address: str = "auto"
    """Of the cluster's head, HOST:PORT; auto for the cluster that this machine belongs to."""
    storage: Storage = "auto"
    """Whether the machines see the project and its images under the same path: shared; sent takes what a piece needs
    to its machine and brings its result back; auto finds out."""
