"""Geometry, with networks where it leaves the floor open: the cloud knows best what stands on a floor, and a network
what floor looks like where the scan has a hole, or a front where the images give no depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nvsim.geometry.camera import Camera
from nvsim.perception.geometric import GeometricFloor
from nvsim.perception.roles import Float32, FloorMask, Image, SemanticFloor, SurfaceNormals


@dataclass(frozen=True)
class FusedFloor:
    """A FloorSegmenter. Beside a scan the network adds floor that nothing hides, and what the points of things overhang
    by a pixel; what it takes for no floor stays but where it is all but certain, because it misses floor more often
    than a scan misses what stands on it. The depth of images misses more, and draws thin things thick: there a sure
    network is believed where the image's own depth says nothing else, and normals, which a scan need not be told, say
    which near surfaces without depth are fronts."""

    floor: GeometricFloor
    semantic: SemanticFloor
    surface_normals: SurfaceNormals | None = None

    def segment(self, camera: Camera, image: Image, depth: Float32 | None = None) -> FloorMask:
        upward = None
        if depth is not None and self.surface_normals is not None:
            upward = np.ascontiguousarray(self.surface_normals.normals(image, camera)[..., 2])
        return self.floor.segment(camera, image, depth, self.semantic.floor_probability(image, camera), upward)
