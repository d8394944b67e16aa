"""Hybrid floor segmentation (paper section III-C): pixels that look like floor and are horizontal are candidates. A few
candidate points prompt a mask on the normal map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nvsim.geometry.camera import Camera
from nvsim.perception.roles import (
    Failure,
    Float32,
    FloorMask,
    Image,
    Mask,
    PromptedMask,
    SemanticFloor,
    SurfaceNormals,
)


@dataclass(frozen=True)
class HybridConfig:
    """probability  a pixel looks like floor from this semantic probability on
    upward       a pixel is horizontal if the world z of its normal is at least this (0.9: within 26 degrees)
    area         candidate regions smaller than this share of the image are noise
    prompts      K, the number of prompts (paper: 3)
    beyond       a prompted mask fails if more than this share of it neither looks like floor nor is horizontal
    held         a prompted mask fails if it contains less than this share of the candidates
    """

    probability: float = 0.5
    upward: float = 0.9
    area: float = 0.002
    prompts: int = 3
    beyond: float = 0.4
    held: float = 0.5


@dataclass(frozen=True, eq=False)
class HybridSteps:
    """The intermediate masks of the hybrid segmentation, each (H, W) bool.

    semantic    M_sem, pixels that look like floor
    horizontal  M_norm, pixels with a horizontal surface
    candidates  M_cand, the intersection without small regions
    points      (K, 2) float32, pixels x, y: the prompts selected from M_cand
    prompted    M_final, the region of the normal map that contains the points, after the failure rules
    normals     (H, W, 3) float32, world
    failure     the failure rule that applied, "" if none
    """

    semantic: Mask
    horizontal: Mask
    candidates: Mask
    points: Float32
    prompted: Mask
    normals: Float32
    failure: Failure = ""


@dataclass(frozen=True)
class HybridFloor:
    """M_final = prompted(normal map, K points of M_cand), M_cand = M_sem AND M_norm without small regions.

    A FloorSegmenter. Without candidates the mask is empty, because there are no prompts. The paper does not define this
    case, nor a failed prompted role; `Failure` lists how NVSim handles both.
    """

    semantic: SemanticFloor
    surface_normals: SurfaceNormals
    prompted: PromptedMask
    config: HybridConfig = HybridConfig()

    def segment(self, camera: Camera, image: Image, depth: Float32 | None = None) -> FloorMask:
        """The floor of an undistorted image (H, W, 3) uint8 RGB seen by `camera`; `depth` is not used."""
        steps = self.steps(camera, image)
        return FloorMask(steps.prompted, steps.candidates, steps.normals, failure=steps.failure)

    def steps(self, camera: Camera, image: Image) -> HybridSteps:
        """The intermediate results (H, W) for an image (H, W, 3) uint8 RGB."""
        normals = self.surface_normals.normals(image, camera)
        looks = self.semantic.floor_probability(image, camera) >= self.config.probability
        flat = normals[..., 2] >= self.config.upward
        candidates = large_regions(looks & flat, self.config.area)
        points = spread_points(candidates, self.config.prompts)
        if not candidates.any():
            missing: Failure = "no-looks" if not looks.any() else "no-candidates" if flat.any() else "no-flat"
            return HybridSteps(looks, flat, candidates, points, candidates, normals, missing)
        prompted = self.prompted.mask(normal_picture(normals), points, camera)
        prompted, failure = self._apply_failure_rules(prompted, candidates, looks | flat)
        return HybridSteps(looks, flat, candidates, points, prompted, normals, failure)

    def _apply_failure_rules(self, prompted: Mask, candidates: Mask, plausible: Mask) -> tuple[Mask, Failure]:
        """The final mask (H, W), and the failure rule that made it."""
        if (prompted & ~plausible).sum() > self.config.beyond * prompted.sum():
            return candidates, "beyond"
        if (prompted & candidates).sum() < self.config.held * candidates.sum():
            return prompted | candidates, "short"
        return prompted, ""


def large_regions(mask: Mask, area: float) -> Mask:
    """`mask` (H, W) without its 8-connected regions smaller than `area`, a share of the image."""
    import cv2

    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    keep = stats[:, cv2.CC_STAT_AREA] >= max(1.0, area * mask.size)
    keep[0] = False
    large: Mask = keep[labels]
    return large


def spread_points(mask: Mask, count: int) -> Float32:
    """At most `count` points (K, 2) float32 x, y inside `mask` (H, W), in pixels. The first is the pixel farthest from
    the border of the mask. Each next one is far from both the previous points and the border.

    The paper samples the points at random. This selection is repeatable, so runs are comparable. It also avoids points
    on a border, which can prompt the wrong side.
    """
    import cv2

    padded = np.pad(mask.astype(np.uint8), 1)
    depth = cv2.distanceTransform(padded, cv2.DIST_L2, 5)[1:-1, 1:-1]
    rows, columns = np.nonzero(mask)
    inside = depth[rows, columns]
    points: list[tuple[float, float]] = []
    gap = np.full(len(rows), np.inf)
    for _ in range(min(count, len(rows))):
        best = int(np.argmax(inside if not points else np.minimum(inside, 0.25 * gap)))
        points.append((columns[best] + 0.5, rows[best] + 0.5))
        gap = np.minimum(gap, np.hypot(columns - columns[best], rows - rows[best]))
    return np.array(points, np.float32).reshape(-1, 2)


def normal_picture(normals: Float32) -> Image:
    """(H, W, 3) uint8: (n + 1) / 2 * 255 of unit normals (H, W, 3), the color coding of the paper's prompted model."""
    picture: Image = np.clip((normals + 1.0) * 127.5, 0, 255).astype(np.uint8)
    return picture
