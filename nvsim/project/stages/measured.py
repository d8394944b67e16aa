"""Measures evidence for single viewpoints of a graph with the project's models."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from nvsim.events import Listener
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.evidence.new_viewpoints import NewViewpointEvidence, measure_new_viewpoints
from nvsim.mapping.evidence.traversed_floor import TraversedFloor
from nvsim.project.floor_heights import floor_of
from nvsim.project.graph import thresholds_of
from nvsim.project.project import Project
from nvsim.project.scene_views import SceneViews
from nvsim.project.work import missing_result_error


def measure(
    project: Project,
    graph: NavGraph,
    ids: Iterable[str],
    config: MappingConfig,
    listen: Listener,
    memory_budget: int | None = None,
) -> NewViewpointEvidence:
    """Measures new viewpoints, see `measure_new_viewpoints`, with the criteria and views of `config` and of the
    project's own map. Raises InputError if no submap is trained, or an id is not in `graph`."""
    from nvsim.project.photographed import PhotographedDirections

    own = thresholds_of(project)
    config = replace(config, criteria=(*config.criteria, *own.criteria))
    if own.views == "panorama":
        config = replace(config, views=own.views, panorama_width=own.panorama_width)
    scene, support = project.scene(memory_budget), project.support()
    if scene is None or support is None:
        raise missing_result_error(project.layout.root, "train")
    capture, floor = project.need_capture(), floor_of(project)
    traversed = TraversedFloor(capture.positions, not capture.trajectory_counts)
    views = SceneViews(scene, config)
    found = measure_new_viewpoints(
        graph, ids, views, floor.height_at, support.is_supported, config, traversed=traversed, listen=listen
    )
    return replace(found, photographed=PhotographedDirections(project, scene).shares(graph, found.submaps))


def unmeasured_viewpoints(graph: NavGraph) -> list[str]:
    """Ids of included viewpoints from users without evidence for their present place."""
    fresh = {e.viewpoint for e in graph.evidence.values() if not e.joins and not e.stale}
    return [id for id, v in graph.viewpoints.items() if v.included and v.origin == "person" and id not in fresh]
