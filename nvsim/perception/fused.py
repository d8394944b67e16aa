"""The geometric provider combined with networks where geometry is undecided. The cloud is best at objects on the floor.
A network is best at floor in holes of the LiDAR scan, and at vertical surfaces for which the images give no depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nvsim.geometry.camera import Camera
from nvsim.perception.geometric import GeometricFloor
from nvsim.perception.roles import Float32, FloorMask, Image, SemanticFloor, SurfaceNormals


@dataclass(frozen=True)
class FusedFloor:
    """A FloorSegmenter that combines the geometric provider with networks.

    With a LiDAR scan, the semantic network adds unoccluded floor and the pixel by which the points of objects overhang.
    It removes floor only if it is almost certain, because it misses floor more often than a LiDAR scan misses
    obstacles. Depth from images misses more obstacles and makes thin objects too thick. There a confident network
    decides, unless the image's own depth contradicts it. Normals then tell which near surfaces without depth are
    vertical."""

    floor: GeometricFloor
    semantic: SemanticFloor
    surface_normals: SurfaceNormals | None = None

    def segment(self, camera: Camera, image: Image, depth: Float32 | None = None) -> FloorMask:
        """The mask of an image (H, W, 3). `depth` (H, W) is the image's own, meters, 0 if unknown."""
        upward = None
        if depth is not None and self.surface_normals is not None:
            upward = np.ascontiguousarray(self.surface_normals.normals(image, camera)[..., 2])
        return self.floor.segment(camera, image, depth, self.semantic.floor_probability(image, camera), upward)
