"""Evidence for single viewpoints of a graph, from the models of the project."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from nvsim.events import Listener
from nvsim.graph.types import NavGraph
from nvsim.mapping.climbing import Trodden
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.new_viewpoint_evidence import NewViewpointEvidence, measure_new_viewpoints
from nvsim.project.floor_heights import floor_of
from nvsim.project.project import Project
from nvsim.project.scene_views import SceneViews
from nvsim.project.thresholds import thresholds_of
from nvsim.project.work import lacks


def measure(
    project: Project,
    graph: NavGraph,
    ids: Iterable[str],
    config: MappingConfig,
    listen: Listener,
    memory_budget: int | None = None,
) -> NewViewpointEvidence:
    """See `measure_new_viewpoints`; what the project's own map is decided by is measured and asked too, and from such
    views. Raises InputError while no submap is trained, or when an id is not in `graph`."""
    own = thresholds_of(project)
    config = replace(config, criteria=(*config.criteria, *own.criteria))
    if own.views == "panorama":
        config = replace(config, views=own.views, panorama_width=own.panorama_width)
    scene, support = project.scene(memory_budget), project.support()
    if scene is None or support is None:
        raise lacks(project.layout.root, "train")
    capture, floor = project.need_capture(), floor_of(project)
    trodden = Trodden(capture.positions, capture.is_scanned)
    views = SceneViews(scene, config)
    return measure_new_viewpoints(
        graph, ids, views, floor.height_at, support.at, config, trodden=trodden, listen=listen
    )


def unmeasured(graph: NavGraph) -> list[str]:
    """Included viewpoints of a user without evidence, or whose evidence is of another place."""
    fresh = {e.viewpoint for e in graph.evidence.values() if not e.joins and not e.stale}
    return [id for id, v in graph.viewpoints.items() if v.included and v.origin == "person" and id not in fresh]
