"""Hybrid floor segmentation (paper section III-C): what looks like floor and lies flat gives candidates, a few of their
points prompt a mask on the normal map."""

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
    upward       a pixel is horizontal when its normal's world z is at least this (0.9: within 26 degrees)
    area         candidate regions smaller than this share of the image are noise
    prompts      K, the number of prompting points (paper: 3)
    beyond       a prompted mask has failed when more than this share of it neither looks like floor nor lies flat
    held         a prompted mask has failed when it holds less than this share of the candidates
    """

    probability: float = 0.5
    upward: float = 0.9
    area: float = 0.002
    prompts: int = 3
    beyond: float = 0.4
    held: float = 0.5


@dataclass(frozen=True, eq=False)
class HybridSteps:
    """The masks that the hybrid segmentation passes through, each (H, W) bool.

    semantic    M_sem, what looks like floor
    horizontal  M_norm, what lies flat
    candidates  M_cand, both, without small regions
    points      (K, 2) float32, pixels x, y: the prompts taken from M_cand
    prompted    M_final, the region of the normal map that holds the points, after the rules for what fails
    normals     (H, W, 3) float32, world
    failure     which rule that was
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

    A FloorSegmenter. Where no candidate is left the mask is empty: there is nothing to prompt with. The paper does not
    say what happens then, nor where the prompted role fails; `Failure` lists what is done here.
    """

    semantic: SemanticFloor
    surface_normals: SurfaceNormals
    prompted: PromptedMask
    config: HybridConfig = HybridConfig()

    def segment(self, camera: Camera, image: Image, depth: Float32 | None = None) -> FloorMask:
        """The floor of an undistorted image (H, W, 3) uint8 RGB seen by `camera`; `depth` is not asked."""
        steps = self.steps(camera, image)
        return FloorMask(steps.prompted, steps.candidates, steps.normals, failure=steps.failure)

    def steps(self, camera: Camera, image: Image) -> HybridSteps:
        """How the floor of an image (H, W, 3) uint8 RGB comes about."""
        normals = self.surface_normals.normals(image, camera)
        looks = self.semantic.floor_probability(image, camera) >= self.config.probability
        flat = normals[..., 2] >= self.config.upward
        candidates = large_regions(looks & flat, self.config.area)
        points = spread_points(candidates, self.config.prompts)
        if not candidates.any():
            missing: Failure = "no-looks" if not looks.any() else "no-candidates" if flat.any() else "no-flat"
            return HybridSteps(looks, flat, candidates, points, candidates, normals, missing)
        prompted = self.prompted.mask(normal_picture(normals), points, camera)
        prompted, failure = self._judged(prompted, candidates, looks | flat)
        return HybridSteps(looks, flat, candidates, points, prompted, normals, failure)

    def _judged(self, prompted: Mask, candidates: Mask, plausible: Mask) -> tuple[Mask, Failure]:
        """The final mask, and which rule made it."""
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
    """At most `count` points (K, 2) x, y inside `mask`, the same for the same mask: first the pixel deepest inside,
    then always the pixel that is far from the points so far and from the border of the mask.

    The paper samples them at random; points on a border prompt the wrong side of it, and a run that cannot be repeated
    cannot be compared.
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
    """(H, W, 3) uint8: (n + 1) / 2 * 255, the colouring that the paper's prompted model sees."""
    picture: Image = np.clip((normals + 1.0) * 127.5, 0, 255).astype(np.uint8)
    return picture
