"""The graph of a project: its file, its thresholds, and the context of its checks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nvsim.errors import InputError
from nvsim.graph.connectivity import read_connectivity
from nvsim.graph.findings import Context, Limits
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.occupancy.types import OccupancyMap
from nvsim.project import ledger
from nvsim.project.path_kind import path_kind
from nvsim.project.project import Project

if TYPE_CHECKING:
    from nvsim.mapping.explanation.seen_floor import SeenFloor

_THRESHOLDS = "thresholds"

Camera = tuple[float, ...]


def load_graph(path: Path) -> NavGraph:
    """The navigation graph of a project, or of an R2R connectivity file. Raises InputError if there is no graph, or if
    it cannot be read."""
    path = Path(path).expanduser()
    if path_kind(path) != "project":
        return read_connectivity(path)
    with Project.open(path) as project:
        return project.need_graph()


def recorded_config(config: MappingConfig) -> dict[str, Any]:
    """The part of the stage's summary that stores its configuration."""
    return {_THRESHOLDS: asdict(config)}


def thresholds_of(project: Project) -> MappingConfig:
    """The thresholds with which the graph was built; the defaults if none are recorded."""
    found = ledger.record(project, "map")
    kept = {} if found is None else found.summary.get(_THRESHOLDS)
    if not isinstance(kept, dict):
        return MappingConfig()
    known = {field.name for field in fields(MappingConfig)}
    try:
        # Fields of newer versions are ignored.
        return MappingConfig(**{name: value for name, value in kept.items() if name in known})
    except (TypeError, InputError):
        return MappingConfig()


def context_of(project: Project, limits: Limits | None = None, occupancy: OccupancyMap | None = None) -> Context:
    """The context with the project's own map, or with `occupancy` if given."""
    from nvsim.project.occupancy_maps import occupancy_of

    return context_on(occupancy_of(project) if occupancy is None else occupancy, project, limits)


def context_on(occupancy: OccupancyMap | None, project: Project, limits: Limits | None = None) -> Context:
    """The context with this map, or without a map if `occupancy` is None. It has floor heights only if a floor is
    estimated."""
    from nvsim.mapping.explanation.explain import closed_edge_reason, closed_path_test
    from nvsim.project.floor_heights import floor_beneath

    thresholds = thresholds_of(project)
    return Context(
        limits or Limits(),
        occupancy,
        closed_edge_reason(thresholds),
        closed_path_test(thresholds),
        possible_glass=_possible_glass(project),
        floor=floor_beneath(project),
        photographed=thresholds.photographed,
        untrained=submaps_without_model(project),
    )


def _possible_glass(project: Project) -> Callable[[Camera, Camera], str] | None:
    """None if the trajectory is no evidence (with a LiDAR scan, which shows glass), or no floor is known yet. Without
    the walls of the last map, or if they cannot be read, only detours count."""
    from nvsim.mapping.explanation.trajectory_detour import TrajectoryDetour
    from nvsim.mapping.explanation.wall_openings import PossibleGlass, WallOpenings, read_walls
    from nvsim.mapping.search.trajectory import Walk

    capture, support = project.capture(), project.support()
    if capture is None or support is None or not capture.trajectory_counts:
        return None
    detour = TrajectoryDetour(Walk(capture.positions, support.is_supported))
    try:
        openings = WallOpenings(read_walls(project.layout.walls, capture.positions), capture.positions)
    except InputError:  # no walls, or those of another import
        openings = None
    return PossibleGlass(detour, openings, seen_floor(project)).reason


def seen_floor(project: Project) -> SeenFloor | None:
    """The floor that the images of the project show; None if their depth is not estimated."""
    from nvsim.mapping.explanation.seen_floor import SeenFloor
    from nvsim.project.floor_heights import floor_of
    from nvsim.project.stages.depths import depth_maps

    depth = depth_maps(project)
    if depth is None:
        return None
    return SeenFloor([frame.camera for frame in project.need_capture().frames], depth, floor_of(project).height_at)


def submaps_without_model(project: Project) -> frozenset[int]:
    """Submaps without a model; -1 means that no submap has a model. Empty if the trajectory is not divided yet."""
    submaps = [submap.index for submap in project.submaps_as_cut("train")]
    missing = frozenset(i for i in submaps if not (project.layout.model(i) / "model.json").is_file())
    return missing | {-1} if submaps and len(missing) == len(submaps) else missing
