"""The semantic and the surface normal role without networks: similarity to the floor color seen from the trajectory,
and normals of the point cloud."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.capture.types import Cloud
from nvsim.geometry.camera import Camera
from nvsim.geometry.nearest_points import axes_of
from nvsim.perception.geometric import GeometricFloor
from nvsim.perception.roles import Float32, Image

_NEIGHBORS = 14


@dataclass(frozen=True)
class FloorSimilarity:
    """A SemanticFloor: how similar a pixel is to the known floor where its ray meets the ground. `floor` has learned
    its color (`GeometricFloor.learn`)."""

    floor: GeometricFloor

    def floor_probability(self, image: Image, camera: Camera) -> Float32:
        """(H, W) float32, 0 to 1, for an image (H, W, 3)."""
        return _resize_like(self.floor.similarity(camera, image), image)


@dataclass(frozen=True)
class CloudNormals:
    """A SurfaceNormals: the normal of the plane through the cloud points around a pixel's surface point. It is straight
    up on the floor and zero where the cloud has no points."""

    floor: GeometricFloor
    cloud: Cloud | None
    _tree: dict[str, cKDTree] = field(default_factory=dict)

    def normals(self, image: Image, camera: Camera) -> Float32:
        """(H, W, 3) float32, unit length, world frame, for an image (H, W, 3); zero if unknown."""
        seen = self.floor.project(camera)
        height, width = seen.floor.shape
        small = camera.scaled(width, height)
        rays = small.rays()
        normals = np.zeros((height, width, 3), np.float32)
        ground = seen.floor if self.floor.has_dense_cloud else seen.floor | seen.unsure
        normals[ground] = (0, 0, 1)
        rows, columns = np.nonzero(np.isfinite(seen.before) & ~ground)
        if self.cloud is not None and len(rows) and len(self.cloud.points) >= _NEIGHBORS:
            toward = rays[rows, columns]
            hits = small.position + seen.before[rows, columns, None] * toward
            normals[rows, columns] = self._planes(self.cloud, hits, toward)
        resized = _resize_like(normals, image)
        length = np.linalg.norm(resized, axis=-1, keepdims=True)
        return np.where(length > 0.5, resized / np.maximum(length, 1e-6), 0).astype(np.float32)

    def _planes(self, cloud: Cloud, places: NDArray[np.floating], toward: Float32) -> Float32:
        """(N, 3) unit normals of the planes through the cloud around `places` (N, 3), toward the camera: against the
        rays `toward` (N, 3)."""
        if "cloud" not in self._tree:
            self._tree["cloud"] = cKDTree(cloud.points)
        _, index = self._tree["cloud"].query(places, k=_NEIGHBORS, workers=1)
        planes = axes_of(cloud.points[index])[..., 0]
        planes *= -np.sign(np.sum(planes * toward, axis=-1, keepdims=True))
        return planes.astype(np.float32)


def _resize_like(values: Float32, image: Image) -> Float32:
    """`values` (h, w) or (h, w, C) at the size of `image`."""
    import cv2

    size = (image.shape[1], image.shape[0])
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_LINEAR), np.float32)
