"""The context of the checks of a project's graph: its map, floor, models, thresholds and evidence. The window and the
command line share it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nvsim.graph.findings import Context, Limits
from nvsim.occupancy.types import OccupancyMap
from nvsim.project.occupancy_maps import occupancy_of
from nvsim.project.project import Project

if TYPE_CHECKING:
    from nvsim.mapping.trajectory_detour import TrajectoryDetour


def context_of(project: Project, limits: Limits | None = None, occupancy: OccupancyMap | None = None) -> Context:
    """The context with the project's own map, or with `occupancy` if given."""
    return context_on(occupancy_of(project) if occupancy is None else occupancy, project, limits)


def context_on(occupancy: OccupancyMap | None, project: Project, limits: Limits | None = None) -> Context:
    """The context with this map, or without a map if `occupancy` is None. It has floor heights only if a floor is
    estimated."""
    from nvsim.mapping.edge_doubts import against
    from nvsim.mapping.unmeasured import closed
    from nvsim.project.floor_heights import floor_beneath
    from nvsim.project.thresholds import thresholds_of

    thresholds = thresholds_of(project)
    return Context(
        limits or Limits(),
        occupancy,
        against(thresholds),
        closed(thresholds),
        detour_between=_detour_between(project),
        floor=floor_beneath(project),
        untrained=untrained(project),
    )


def _detour_between(project: Project) -> TrajectoryDetour | None:
    """None if the capture has a LiDAR scan, which shows glass, or no floor is known yet."""
    from nvsim.mapping.trajectory_detour import TrajectoryDetour
    from nvsim.mapping.walk import Walk

    capture, support = project.capture(), project.support()
    if capture is None or support is None or capture.is_scanned:
        return None
    return TrajectoryDetour(Walk(capture.positions, support.at))


def untrained(project: Project) -> frozenset[int]:
    """Submaps without a model; -1 means that no submap has a model. Empty if the trajectory is not divided yet."""
    submaps = [submap.index for submap in project.submaps("train")]
    missing = frozenset(i for i in submaps if not (project.layout.model(i) / "model.json").is_file())
    return missing | {-1} if submaps and len(missing) == len(submaps) else missing
