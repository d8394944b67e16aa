"""Finds the projected point or segment under the cursor. Does not use widgets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera

NEAR = 0.05  # distance of the near plane, meters


def nearest_point(
    pixels: NDArray[np.floating], depths: NDArray[np.floating], cursor: tuple[float, float], tolerance: float
) -> int | None:
    """Index of the point within `tolerance` pixels of the cursor, None if there is none.

    `pixels` is (N, 2), `depths` is (N,) in meters. Of several points, the one nearest to the camera is chosen, because
    it covers the others."""
    if len(pixels) == 0:
        return None
    distance = np.hypot(pixels[:, 0] - cursor[0], pixels[:, 1] - cursor[1])
    hit = np.flatnonzero((distance <= tolerance) & (depths > NEAR))
    if len(hit) == 0:
        return None
    return int(hit[np.argmin(depths[hit] + 0.05 * distance[hit])])


def projected_segments(
    camera: Camera, a: NDArray[np.floating], b: NDArray[np.floating], near: float = NEAR
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """The visible parts of the world segments from `a` to `b`, both (N, 3) in meters, clipped at depth `near`.

    Returns the ends in pixels (M, 4) as x1 y1 x2 y2, the index of each segment in the input (M,), and the depth of its
    nearer end in meters (M,)."""
    if len(a) == 0:
        return np.zeros((0, 4)), np.zeros(0, np.int64), np.zeros(0)
    to_camera = camera.world_to_camera
    p = np.asarray(a, np.float64) @ to_camera[:3, :3].T + to_camera[:3, 3]
    q = np.asarray(b, np.float64) @ to_camera[:3, :3].T + to_camera[:3, 3]
    index = np.flatnonzero((p[:, 2] > near) | (q[:, 2] > near))
    p, q = p[index], q[index]
    step = q[:, 2] - p[:, 2]
    share = np.clip((near - p[:, 2]) / np.where(np.abs(step) < 1e-12, 1e-12, step), 0, 1)[:, None]
    cut = p + share * (q - p)
    p, q = np.where(p[:, 2:] <= near, cut, p), np.where(q[:, 2:] <= near, cut, q)
    k = camera.intrinsics
    lines = np.empty((len(index), 4))
    for column, end in ((0, p), (2, q)):
        depth = np.maximum(end[:, 2], near * 0.5)
        lines[:, column] = k.fx * end[:, 0] / depth + k.cx
        lines[:, column + 1] = k.fy * end[:, 1] / depth + k.cy
    left, right = np.minimum(lines[:, 0], lines[:, 2]), np.maximum(lines[:, 0], lines[:, 2])
    top, bottom = np.minimum(lines[:, 1], lines[:, 3]), np.maximum(lines[:, 1], lines[:, 3])
    seen = (right >= 0) & (left <= k.width) & (bottom >= 0) & (top <= k.height)
    return lines[seen], index[seen], np.minimum(p[:, 2], q[:, 2])[seen]


def nearest_segment(
    lines: NDArray[np.floating], depths: NDArray[np.floating], cursor: tuple[float, float], tolerance: float
) -> int | None:
    """Index of the line within `tolerance` pixels of the cursor, None if there is none.

    `lines` is (N, 4) as x1 y1 x2 y2 in pixels, `depths` is (N,) in meters. Of several lines, the one nearest to the
    cursor is chosen; of equally near lines, the one nearest to the camera."""
    if len(lines) == 0:
        return None
    start, way = lines[:, :2], lines[:, 2:] - lines[:, :2]
    to_cursor = np.array(cursor) - start
    share = np.clip((to_cursor * way).sum(axis=1) / np.maximum((way * way).sum(axis=1), 1e-12), 0, 1)
    distance = np.linalg.norm(to_cursor - share[:, None] * way, axis=1)
    hit = np.flatnonzero(distance <= tolerance)
    if len(hit) == 0:
        return None
    return int(hit[np.argmin(distance[hit] + 1e-3 * depths[hit])])


def within_polygon(points: NDArray[np.floating], polygon: NDArray[np.floating]) -> NDArray[np.bool_]:
    """(N,) bool, which of `points` (N, 2) are inside `polygon` (K, 2), by the even-odd rule."""
    # In the order of y, each edge needs only the points at its height; a lasso has hundreds of short edges.
    order = np.argsort(points[:, 1])
    x, y = np.ascontiguousarray(points[order].T)
    crossed = np.zeros(len(points), bool)
    for (x1, y1), (x2, y2) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if y1 != y2:
            beside = slice(*np.searchsorted(y, sorted((y1, y2))))
            crossed[beside] ^= x[beside] < (x2 - x1) * (y[beside] - y1) / (y2 - y1) + x1
    inside = np.empty_like(crossed)
    inside[order] = crossed
    return inside
