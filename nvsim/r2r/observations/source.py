"""The models from which a scan is made, and the keys that identify them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.files.regular import read_bytes
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.project.photographed import PhotographedDirections
from nvsim.project.project import Project
from nvsim.project.work import lacks
from nvsim.splats.scene import SceneModel
from nvsim.submaps.types import Submap


@dataclass(frozen=True, eq=False)
class Source:
    """The models of a scan.

    scene    the trained models, one of them in memory at a time
    submaps  submaps that have a model
    folders  index of a submap -> folder of its model
    photographed  measures which directions the training images show; None without images
    """

    scene: SceneModel
    submaps: tuple[Submap, ...]
    folders: Mapping[int, Path]
    photographed: PhotographedDirections | None = None

    @cached_property
    def keys(self) -> Mapping[int, str]:
        """Index of a submap -> SHA-256 of its model's files, which are read completely."""
        return {i: _key(folder) for i, folder in self.folders.items()}

    @staticmethod
    def of(project: Project, graph: NavGraph) -> Source:
        """Raises InputError if no model is trained, or the submap of a viewpoint has no model."""
        scene = project.scene(memory_budget=0)  # without a budget, only one model stays in memory
        if scene is None:
            raise lacks(project.layout.root, "train")
        submaps = project.submaps("train")
        trained = tuple(s for s in submaps if s.index in scene.indices)
        if len(trained) < len(submaps):
            for v in graph.viewpoints.values():
                nearest = min(submaps, key=lambda s: _distance(s, v))
                if nearest.index not in scene.indices:
                    raise InputError(
                        f"Submap {nearest.index}, which contains viewpoint {v.id}, has no model; run `nvsim train "
                        f"--project {project.layout.root}` first."
                    )
        folders = {i: project.layout.model(i) for i in scene.indices}
        photographed = None if project.capture() is None else PhotographedDirections(project, scene)
        return Source(scene, trained, folders, photographed)


def _distance(submap: Submap, viewpoint: Viewpoint) -> float:
    return float(np.linalg.norm(submap.positions - viewpoint.position, axis=1).min())


def _key(folder: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(p for p in folder.iterdir() if p.is_file()):
        digest.update(path.name.encode())
        digest.update(read_bytes(path))
    return digest.hexdigest()
