"""Another decision from the same evidence: other thresholds, another robot, without rendering what is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nvsim.events import Listener, silent
from nvsim.graph.types import NavGraph
from nvsim.mapping.builder import BuildResult, build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import HeightAt, SupportAt
from nvsim.mapping.view_source import ViewSource


def reapply(
    graph: NavGraph,
    source: ViewSource,
    trajectory: NDArray[np.floating],
    floor_at: HeightAt,
    support: SupportAt,
    config: MappingConfig,
    *,
    listen: Listener = silent,
    should_stop: Callable[[], bool] = lambda: False,
) -> BuildResult:
    """The graph that `build_map` would make under `config`, from the evidence in `graph`; only viewpoints and corridors
    that it holds nothing about are rendered. What a user added is kept."""
    return build_map(
        source,
        trajectory,
        floor_at,
        support,
        config,
        scan=graph.scan,
        previous=graph,
        listen=listen,
        should_stop=should_stop,
    )
