"""Reads what a simulator needs of a project to draw views live and to decide where an agent can move."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.geometry.floor_surface import Floor
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.evidence.climbing import TraversedFloor
from nvsim.perception.stacked_support import StackedSupport
from nvsim.perception.support import FloorSupport
from nvsim.project.floor_heights import floor_of
from nvsim.project.graph import thresholds_of
from nvsim.project.project import Project
from nvsim.project.scene_views import SceneViews
from nvsim.project.work import lacks
from nvsim.splats.scene import SceneModel


@dataclass(frozen=True, eq=False)
class LiveScene:
    """The models, the floor and the graph of a project.

    scan       the scan id of the graph
    config     the thresholds of the map
    scene      the trained models; None without models, and then `views` and `traversed` too
    support    the known floor, None without models
    views      the views of the models for the map builder
    traversed  the trajectory of the capture
    """

    graph: NavGraph
    scan: str
    config: MappingConfig
    floor: Floor
    scene: SceneModel | None
    support: FloorSupport | StackedSupport | None
    views: SceneViews | None
    traversed: TraversedFloor | None


def read_live_scene(root: Path, drawing: bool = True) -> LiveScene:
    """Opens, reads and closes a project.

    Raises InputError if it has no graph, or `drawing` is true and no model is trained.
    """
    with Project.open(root) as project:
        graph, scan, config = project.need_graph(), project.scan_name, thresholds_of(project)
        scene, support = project.scene(), project.support()
        if drawing and (scene is None or support is None):
            raise lacks(project.layout.root, "train")
        floor = floor_of(project)
        if scene is None:
            return LiveScene(graph, scan, config, floor, None, support, None, None)
        capture = project.need_capture()
        traversed = TraversedFloor(capture.positions, not capture.trajectory_counts)
        return LiveScene(graph, scan, config, floor, scene, support, SceneViews(scene, config), traversed)
