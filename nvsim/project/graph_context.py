"""What the findings of a project's graph are held against: its map, its floor, the thresholds and the evidence."""

from __future__ import annotations

import numpy as np

from nvsim.graph.findings import Context, Limits
from nvsim.occupancy.types import OccupancyMap
from nvsim.project.project import Project


def context_of(project: Project, limits: Limits | None = None, occupancy: OccupancyMap | None = None) -> Context:
    """`occupancy` stands in for the project's own map where one is given. Floor heights are asked of the project only
    where a floor was estimated."""
    from nvsim.mapping.against import against
    from nvsim.project.floor_heights import floor_of
    from nvsim.project.thresholds import thresholds_of

    floor = None
    if any(project.surface(submap.index) is not None for submap in project.submaps()):
        surface = floor_of(project)

        def floor(x: float, y: float, z: float) -> float:
            return float(surface.height_at(np.array([x, y])))

    known = project.occupancy() if occupancy is None else occupancy
    return Context(limits or Limits(), known, against(thresholds_of(project)), floor)
