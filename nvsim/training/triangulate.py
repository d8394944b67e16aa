"""Triangulates a sparse cloud from the images, for captures without a cloud."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nvsim.capture.triangulation import Features, triangulate
from nvsim.capture.types import Cloud
from nvsim.training.views import TrainingView

PARTNERS = 3
"""Number of later views with which each view is matched; they look in a similar direction from another place."""
BASELINE = (0.08, 3.0)
"""Least and greatest meters between two matched views."""
LARGEST_TURN = np.radians(35)
NEAREST, FARTHEST = 0.2, 20.0
"""Least and greatest depth along the optical axis, meters."""


def triangulated_cloud(views: Sequence[TrainingView]) -> Cloud:
    """A point cloud of kind "sfm", empty if no features match."""
    features = [Features.of(view.camera, view.image, view.usable) for view in views]
    points, colors = [np.zeros((0, 3), np.float32)], [np.zeros((0, 3), np.uint8)]
    for i, j in _pairs(views):
        found, pixels = triangulate(features[i], features[j])
        near = np.ones(len(found), bool)
        for view in (views[i], views[j]):
            _, depth = view.camera.project(found)
            near &= (depth > NEAREST) & (depth < FARTHEST)
        columns, rows = pixels[near].astype(np.int64).T
        points.append(found[near].astype(np.float32))
        colors.append(views[i].image[rows, columns])
    return Cloud(np.concatenate(points), np.concatenate(colors), "sfm")


def _pairs(views: Sequence[TrainingView]) -> list[tuple[int, int]]:
    positions = np.array([v.camera.position for v in views])
    axes = np.array([v.camera.rotation[:, 2] for v in views])
    pairs = []
    for i in range(len(views)):
        distance = np.linalg.norm(positions[i + 1 :] - positions[i], axis=1)
        turned = np.arccos(np.clip(axes[i + 1 :] @ axes[i], -1, 1))
        fits = (distance > BASELINE[0]) & (distance < BASELINE[1]) & (turned < LARGEST_TURN)
        candidates = np.flatnonzero(fits)
        nearest = candidates[np.argsort(distance[candidates], kind="stable")[:PARTNERS]]
        pairs += [(i, i + 1 + int(j)) for j in nearest]
    return pairs
