"""The three roles of hybrid floor segmentation (paper section III-C), the masks, and their failures. A network or
geometry can fill each role; the fusion in `hybrid` works with both.

Images are undistorted RGB, (H, W, 3) uint8. Masks and maps have the image's size. The camera is the pinhole camera of
the image at its pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera

Image = NDArray[np.uint8]
Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]


class SemanticFloor(Protocol):
    """Estimates how likely a pixel is floor by its appearance."""

    def floor_probability(self, image: Image, camera: Camera) -> Float32:
        """(H, W) float32, 0 to 1."""
        ...


class SurfaceNormals(Protocol):
    """Estimates the surface normal at each pixel. An adapter rotates a network's camera-frame output with
    `camera.rotation`, because the fusion uses world normals."""

    def normals(self, image: Image, camera: Camera) -> Float32:
        """(H, W, 3) float32, unit length, world frame, toward the camera; zero if unknown."""
        ...


class PromptedMask(Protocol):
    """Finds the region of an image that contains given points."""

    def mask(self, picture: Image, points: NDArray[np.floating], camera: Camera) -> Mask:
        """(H, W) bool. `picture` (H, W, 3) uint8 is the normal map as an image (the paper's choice). `points` (K, 2)
        float are pixels x, y inside the region, with the center of the first pixel at (0.5, 0.5)."""
        ...


Failure = Literal["", "no-looks", "no-flat", "no-candidates", "beyond", "short", "unsure"]
"""Why the mask of a frame differs from the prompted role's mask, or may be wrong; "" if it does not."""
FAILURE_WORDS: dict[Failure, str] = {
    "no-looks": "nothing looks like floor, so the mask is empty",
    "no-flat": "no surface is horizontal, so the mask is empty",
    "no-candidates": "no pixel both looks like floor and is horizontal, so the mask is empty",
    "beyond": "the mask grown from prompts covers too much that neither looks like floor nor is horizontal, so only "
    "the candidates are kept",
    "short": "the mask grown from prompts misses most of the candidates, so they are added to it",
    "unsure": "geometry leaves much of the floor open and the network is unsure about it, so the mask may be wrong",
}


@dataclass(frozen=True, eq=False)
class FloorMask:
    """mask        (H, W) bool, the floor: M_final
    candidates  (H, W) bool, pixels that are floor with confidence: M_cand
    normals     (H, W, 3) float32, world, or None if the provider has none
    doubtful    (H, W) bool, possible floor outside the mask; None if the provider has no doubts
    failure     why the mask may be wrong, or is not the one that the provider intended; "" if it is
    """

    mask: Mask
    candidates: Mask
    normals: Float32 | None = None
    doubtful: Mask | None = None
    failure: Failure = ""


class FloorSegmenter(Protocol):
    """A provider of floor masks for the floor stage: the geometric one, or the hybrid of three roles. `depth` (h, w) is
    in meters along the optical axis, 0 if unknown; a provider can ignore it."""

    def segment(self, camera: Camera, image: Image, depth: Float32 | None = None) -> FloorMask: ...
