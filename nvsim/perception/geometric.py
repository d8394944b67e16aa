"""The geometric provider: floor masks without any network. The floor surface is laid into the image, what the cloud
shows before it hides it, floor that nothing confirms is left out, and the edge is moved to the image's own edge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nvsim.capture.types import Cloud
from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.perception.obstacles import standing
from nvsim.perception.refine import RefineConfig, refine
from nvsim.perception.roles import Float32, FloorMask, Image, Mask
from nvsim.perception.splatting import splat_depth


@dataclass(frozen=True)
class GeometricConfig:
    """clearance     metres: what is higher above the floor is not floor
    farthest      metres: floor further away is left out, a pixel of it says nothing
    longest_side  pixels of the image in which occlusion is decided
    shrink        metres taken back from the border of what stands: its points are drawn larger than they are, so that
                  no gap opens between them
    """

    clearance: float = 0.05
    farthest: float = 20.0
    longest_side: int = 320
    shrink: float = 0.03
    margin: float = 0.998
    contact: float = 0.95
    refine: RefineConfig = RefineConfig()


class GeometricFloor:
    """A FloorSegmenter, from a cloud (or None) and the floor surface that holds where the cameras are."""

    def __init__(self, cloud: Cloud | None, surface: FloorSurface, config: GeometricConfig | None = None) -> None:
        self.config = config or GeometricConfig()
        self.surface = surface
        self._standing = standing(cloud, surface, self.config.clearance)

    def segment(self, camera: Camera, image: Image) -> FloorMask:
        """The floor of an undistorted image (H, W, 3) uint8 RGB seen by `camera`."""
        mask = refine(*self.project(camera), image, self.config.refine)
        return FloorMask(mask, mask)

    def project(self, camera: Camera) -> tuple[Mask, Float32]:
        """The floor by geometry alone, (h, w) bool at the working size, and the pixels of the full image per metre."""
        import cv2

        small = Camera(camera.intrinsics.within(self.config.longest_side), camera.camera_to_world)
        rays = small.rays()
        distance = self.surface.meet(small.position, rays)
        met = distance < self.config.farthest
        distance = np.where(met, distance, 0).astype(np.float32)
        meets = small.position[:2] + distance[..., None] * rays[..., :2]
        floor_depth = distance * (rays @ small.rotation[:, 2].astype(np.float32))
        depth = splat_depth(self._standing.points, self._standing.radii, small)
        hidden = ~met | (depth < floor_depth * self.config.margin - 0.003)
        inside = cv2.distanceTransform(hidden.astype(np.uint8), cv2.DIST_L2, 3)
        # Above a foot the floor next to a border lies behind the thing, and the border is a silhouette drawn too large;
        # at a foot the floor lies before it, and the border is where it should be.
        silhouette = depth < floor_depth * self.config.contact
        hidden &= ~(met & silhouette & (inside < self._border(depth, small)))
        floor: Mask = met & ~hidden
        if self._standing.confirmed is not None:
            floor &= self._standing.confirmed.at(meets)
        nearest = np.minimum(depth, np.where(met, floor_depth, np.inf))
        return floor, (camera.intrinsics.fx / nearest).astype(np.float32)

    def _border(self, depth: Float32, camera: Camera) -> Float32:
        """Pixels that `shrink` covers at `depth`."""
        pixels: Float32 = (self.config.shrink * camera.intrinsics.fx / depth).astype(np.float32)
        return pixels
