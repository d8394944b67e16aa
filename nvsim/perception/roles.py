"""The three roles of hybrid floor segmentation (paper section III-C). A network or geometry may fill each; the fusion
in `hybrid` is the same.

The images are undistorted RGB, (H, W, 3) uint8; masks and maps have the image's size; the camera is the pinhole of the
image at its pose.
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
    """Says how likely a pixel is floor by its looks."""

    def floor_probability(self, image: Image, camera: Camera) -> Float32:
        """(H, W) float32, 0 to 1."""
        ...


class SurfaceNormals(Protocol):
    """Says how the surface at a pixel lies. A network's camera-frame output is turned by its adapter with
    `camera.rotation`; the fusion only knows the world."""

    def normals(self, image: Image, camera: Camera) -> Float32:
        """(H, W, 3) float32, unit length, world frame, towards the camera; zero where nothing is known."""
        ...


class PromptedMask(Protocol):
    """Finds the region of an image that contains given points."""

    def mask(self, picture: Image, points: NDArray[np.floating], camera: Camera) -> Mask:
        """(H, W) bool. `picture` (H, W, 3) uint8 is the normal map as an image (the paper's choice), `points` (K, 2)
        float, pixels x, y with the first pixel's centre at (0.5, 0.5), all inside the region."""
        ...


Failure = Literal["", "no-looks", "no-flat", "no-candidates", "beyond", "short"]
"""Why the mask of a frame is not what the prompted role said; "" where it is."""
FAILURE_WORDS: dict[Failure, str] = {
    "no-looks": "nothing looks like floor, so the mask is empty",
    "no-flat": "nothing lies flat, so the mask is empty",
    "no-candidates": "nothing both looks like floor and lies flat, so the mask is empty",
    "beyond": "the mask grown from prompts left what looks like floor or lies flat, so only the candidates are kept",
    "short": "the mask grown from prompts left most of the candidates out, so they are added to it",
}


@dataclass(frozen=True, eq=False)
class FloorMask:
    """mask        (H, W) bool, the floor: M_final
    candidates  (H, W) bool, pixels that are floor with confidence: M_cand
    normals     (H, W, 3) float32, world, or None where the provider has none
    doubtful    (H, W) bool, what may be floor although the mask does not say so; None where the provider knows
    failure     why the mask is not what the provider meant it to be
    """

    mask: Mask
    candidates: Mask
    normals: Float32 | None = None
    doubtful: Mask | None = None
    failure: Failure = ""


class FloorSegmenter(Protocol):
    """What the stage asks of any provider: the geometric one, or the hybrid of three roles. `depth` (h, w), metres
    along the optical axis, 0 where unknown, is there for who has a use for it."""

    def segment(self, camera: Camera, image: Image, depth: Float32 | None = None) -> FloorMask: ...
