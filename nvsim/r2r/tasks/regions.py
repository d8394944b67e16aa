"""Selects the regions of a building that train paths must not enter, cut at places with few edges such as doors."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import NavGraph
from nvsim.r2r.observations.parts import LEAST, split
from nvsim.r2r.tasks.eligible import Eligible


def unseen_viewpoints(graph: NavGraph, paths: Eligible, share: float) -> NDArray[np.bool_]:
    """Returns (N,) bool: which of the included viewpoints are unseen.

    They are regions of up to `share` of all viewpoints. Regions with the most paths are added first, as long as the
    total gets closer to the share. All are False if no region contains a path. The result is deterministic.
    """
    count = len(paths.ids)
    want = share * count
    kept = set(paths.ids)
    included = replace(
        graph,
        viewpoints={id: v for id, v in graph.viewpoints.items() if id in kept},
        edges={key: edge for key, edge in graph.edges.items() if kept.issuperset(key)},
        evidence={},
    )
    row = {id: i for i, id in enumerate(paths.ids)}
    held = []
    for part in split(included, max(LEAST, math.ceil(want))):
        region = np.zeros(count, bool)
        region[[row[id] for id in part.viewpoints]] = True
        held.append((int(paths.inside(region).sum()), region))
    unseen = np.zeros(count, bool)
    for paths_inside, region in sorted(held, key=lambda of: -of[0]):
        with_it = int((unseen | region).sum())
        if paths_inside and abs(with_it - want) < abs(int(unseen.sum()) - want):
            unseen |= region
    return unseen
