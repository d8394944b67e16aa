"""Measures the photographed directions of places in a project: its models are compared with their training images."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import NavGraph
from nvsim.mapping.views.photographed import TrainingImage, photographed_directions, share_of_sphere, training_images
from nvsim.project.project import Project
from nvsim.render.backends import Backend
from nvsim.splats.scene import SceneModel


class PhotographedDirections:
    """The photographed directions around places, see `nvsim.mapping.views.photographed`.

    Without images, only the models are evidence. It keeps the training images of the last model only, so places of one
    submap should follow each other."""

    def __init__(self, project: Project, scene: SceneModel, backend: Backend = "auto") -> None:
        """Raises InputError if the capture or the submaps are not readable."""
        capture, self._scene, self._backend = project.capture(), scene, backend
        self._frames = () if capture is None else capture.frames
        self._trained = {submap.index: submap.frames for submap in project.submaps("train")}
        self._images: tuple[int, list[TrainingImage] | None] = -1, None

    def photographed_mask(self, position: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(6, S, S) bool: the directions around `position` (3,), meters, that show a surface which training images
        show. The faces are those of `photographed_directions`. Raises InputError if the model cannot be read."""
        submap = self._scene.nearest(position)
        model = self._scene.model(submap)
        if self._images[0] != submap:
            cameras = [self._frames[i].camera for i in self._trained.get(submap, ())] if self._frames else []
            self._images = submap, training_images(model, cameras, self._backend) if cameras else None
        return photographed_directions(model, position, self._images[1], self._backend)

    def shares(self, graph: NavGraph, ids: Iterable[str]) -> dict[str, float]:
        """The photographed share of viewpoints by id, 0 to 1. Raises InputError like `photographed_mask`."""
        places = {id: np.array(graph.viewpoints[id].position) for id in ids}
        order = sorted(places, key=lambda id: self._scene.nearest(places[id]))
        found = {id: round(share_of_sphere(self.photographed_mask(places[id])), 4) for id in order}
        return {id: found[id] for id in places}


def with_shares(graph: NavGraph, shares: Mapping[str, float]) -> NavGraph:
    """`graph` with the photographed shares of viewpoints."""
    viewpoints = {id: replace(v, photographed=shares[id]) if id in shares else v for id, v in graph.viewpoints.items()}
    return replace(graph, viewpoints=viewpoints)
