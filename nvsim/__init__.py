"""NVSim builds vision-and-language navigation simulators from images with camera poses.

`__all__` is the public interface, described in resources/docs/api.md. A name is imported when it is first used, so that
`import nvsim` is fast.
"""

from typing import TYPE_CHECKING

from nvsim import kernel_folder, kernel_threads

if TYPE_CHECKING:
    from nvsim.depth.config import DepthConfig
    from nvsim.errors import InputError
    from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
    from nvsim.graph.compare import compare as compare_graphs
    from nvsim.graph.connectivity import write_connectivity
    from nvsim.graph.edits import (
        EditError,
        add_edge,
        merge_viewpoints,
        move_viewpoint,
        place_viewpoint,
        remove_edge,
        remove_viewpoints,
        split_edge,
    )
    from nvsim.graph.findings import check_graph
    from nvsim.graph.history import History
    from nvsim.graph.operations import apply as edit_graph
    from nvsim.graph.types import Edge, NavGraph, Viewpoint
    from nvsim.mapping.config import MappingConfig
    from nvsim.project.config import CaptureConfig, FloorsConfig, RunConfig
    from nvsim.project.graph import load_graph
    from nvsim.project.graph import thresholds_of as mapping_config
    from nvsim.project.pipeline import run as build_project
    from nvsim.project.project import Project
    from nvsim.project.stages.depths import run as estimate_depth
    from nvsim.project.stages.floors import run as find_floors
    from nvsim.project.stages.imported import run as import_capture
    from nvsim.project.stages.mapped import run as build_graph
    from nvsim.project.stages.submaps import run as split_submaps
    from nvsim.project.stages.trained import run as train_models
    from nvsim.r2r.metrics.distances import Distances
    from nvsim.r2r.metrics.scores import Scores
    from nvsim.r2r.metrics.scores import score as score_trajectories
    from nvsim.r2r.metrics.submission import check_submission as check_trajectories
    from nvsim.r2r.metrics.submission import read_submission as read_trajectories
    from nvsim.r2r.metrics.submission import write_submission as write_trajectories
    from nvsim.r2r.observations.export import export_scan
    from nvsim.r2r.observations.layout import ScanSettings
    from nvsim.r2r.simulator import Simulator
    from nvsim.r2r.tasks.task import Task, read_tasks
    from nvsim.render.panorama import render_equirectangular as render_panorama
    from nvsim.render.scene import render_scene
    from nvsim.submaps.split import SubmapConfig
    from nvsim.training.config import TrainingConfig
    from nvsim.training.config import preset as training_preset

    create_project = Project.create_or_open
    open_project = Project.open

__version__ = "0.2.0"

__all__ = [
    "Camera",
    "CaptureConfig",
    "DepthConfig",
    "Distances",
    "Edge",
    "EditError",
    "FloorsConfig",
    "History",
    "InputError",
    "Intrinsics",
    "MappingConfig",
    "NavGraph",
    "Project",
    "RunConfig",
    "ScanSettings",
    "Scores",
    "Simulator",
    "SubmapConfig",
    "Task",
    "TrainingConfig",
    "Viewpoint",
    "add_edge",
    "build_graph",
    "build_project",
    "camera_pose",
    "check_graph",
    "check_trajectories",
    "compare_graphs",
    "create_project",
    "edit_graph",
    "estimate_depth",
    "export_scan",
    "find_floors",
    "import_capture",
    "load_graph",
    "mapping_config",
    "merge_viewpoints",
    "move_viewpoint",
    "open_project",
    "place_viewpoint",
    "read_tasks",
    "read_trajectories",
    "remove_edge",
    "remove_viewpoints",
    "render_panorama",
    "render_scene",
    "score_trajectories",
    "split_edge",
    "split_submaps",
    "train_models",
    "training_preset",
    "write_connectivity",
    "write_trajectories",
]

_PLACES = {
    "Camera": "nvsim.geometry.camera:Camera",
    "CaptureConfig": "nvsim.project.config:CaptureConfig",
    "DepthConfig": "nvsim.depth.config:DepthConfig",
    "Distances": "nvsim.r2r.metrics.distances:Distances",
    "Edge": "nvsim.graph.types:Edge",
    "EditError": "nvsim.graph.edits:EditError",
    "FloorsConfig": "nvsim.project.config:FloorsConfig",
    "History": "nvsim.graph.history:History",
    "InputError": "nvsim.errors:InputError",
    "Intrinsics": "nvsim.geometry.camera:Intrinsics",
    "MappingConfig": "nvsim.mapping.config:MappingConfig",
    "NavGraph": "nvsim.graph.types:NavGraph",
    "Project": "nvsim.project.project:Project",
    "RunConfig": "nvsim.project.config:RunConfig",
    "ScanSettings": "nvsim.r2r.observations.layout:ScanSettings",
    "Scores": "nvsim.r2r.metrics.scores:Scores",
    "Simulator": "nvsim.r2r.simulator:Simulator",
    "SubmapConfig": "nvsim.submaps.split:SubmapConfig",
    "Task": "nvsim.r2r.tasks.task:Task",
    "TrainingConfig": "nvsim.training.config:TrainingConfig",
    "Viewpoint": "nvsim.graph.types:Viewpoint",
    "add_edge": "nvsim.graph.edits:add_edge",
    "build_graph": "nvsim.project.stages.mapped:run",
    "build_project": "nvsim.project.pipeline:run",
    "camera_pose": "nvsim.geometry.camera:camera_pose",
    "check_graph": "nvsim.graph.findings:check_graph",
    "check_trajectories": "nvsim.r2r.metrics.submission:check_submission",
    "compare_graphs": "nvsim.graph.compare:compare",
    "create_project": "nvsim.project.project:Project.create_or_open",
    "edit_graph": "nvsim.graph.operations:apply",
    "estimate_depth": "nvsim.project.stages.depths:run",
    "export_scan": "nvsim.r2r.observations.export:export_scan",
    "find_floors": "nvsim.project.stages.floors:run",
    "import_capture": "nvsim.project.stages.imported:run",
    "load_graph": "nvsim.project.graph:load_graph",
    "mapping_config": "nvsim.project.graph:thresholds_of",
    "merge_viewpoints": "nvsim.graph.edits:merge_viewpoints",
    "move_viewpoint": "nvsim.graph.edits:move_viewpoint",
    "open_project": "nvsim.project.project:Project.open",
    "place_viewpoint": "nvsim.graph.edits:place_viewpoint",
    "read_tasks": "nvsim.r2r.tasks.task:read_tasks",
    "read_trajectories": "nvsim.r2r.metrics.submission:read_submission",
    "remove_edge": "nvsim.graph.edits:remove_edge",
    "remove_viewpoints": "nvsim.graph.edits:remove_viewpoints",
    "render_panorama": "nvsim.render.panorama:render_equirectangular",
    "render_scene": "nvsim.render.scene:render_scene",
    "score_trajectories": "nvsim.r2r.metrics.scores:score",
    "split_edge": "nvsim.graph.edits:split_edge",
    "split_submaps": "nvsim.project.stages.submaps:run",
    "train_models": "nvsim.project.stages.trained:run",
    "training_preset": "nvsim.training.config:preset",
    "write_connectivity": "nvsim.graph.connectivity:write_connectivity",
    "write_trajectories": "nvsim.r2r.metrics.submission:write_submission",
}
"""Name -> module and attribute. The imports for type checkers above are the same."""

# Set both before numba is imported. Every import of the library begins here.
kernel_threads.choose()
kernel_folder.choose()

if not TYPE_CHECKING:  # a type checker reports unknown names

    def __getattr__(name: str) -> object:
        """Imports a public name when it is first used."""
        if name not in _PLACES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module
        from operator import attrgetter

        module, attribute = _PLACES[name].split(":")
        value = attrgetter(attribute)(import_module(module))
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
