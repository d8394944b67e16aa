"""Where a robot has room on a storey of an exported scan: floor that is seen, near the edges of its graph, with nothing
about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import NavGraph
from nvsim.r2r.surroundings.layers import CELL, FLOOR, Layers

RADIUS = 0.25
"""Metres of the robot."""
_MARGIN = 0.07  # metres besides, as what is seen is not exact
_FROM, _TO = 0.1, 1.7  # metres above the floor between which things are in its way
_LEAST = 2  # voxels of a cell that are something
_SPECK = 4  # cells of a cloud that are something together
_FROM_EDGES = 0.45  # metres; farther off nobody looked whether there is floor
_EASY = 0.6  # metres of room from which on more of it makes a way no better


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """room   (rows, columns) metres that the robot's middle is from what it may not touch, less its radius and margin
    layers of the storey
    """

    room: NDArray[np.float32]
    layers: Layers

    @staticmethod
    def of(layers: Layers, graph: NavGraph, cloud: NDArray[np.floating] | None = None) -> FreeSpace:
        """`cloud` (N, 3), metres, world, are surfaces that are known besides, such as those of a laser scan."""
        from scipy.ndimage import distance_transform_edt

        floor = layers.between(-FLOOR - CELL / 2, FLOOR + CELL / 2) > 0
        blocked = layers.counted(layers.firm(_FROM, _TO)) >= _LEAST
        if cloud is not None:
            blocked |= _scanned(layers, cloud)
        free = _closed(floor) & ~blocked
        metres = (distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1] - 0.5) * CELL
        metres[_far_from_edges(layers, graph)] = 0.0
        return FreeSpace((metres - (RADIUS + _MARGIN)).astype(np.float32), layers)

    def is_free(self, places: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(...) whether the robot stands at world x, y (..., 2 or more)."""
        return np.asarray(self.layers.values_at(self.room, places) >= 0)

    def to_go(self, path: NDArray[np.floating], reach: float) -> NDArray[np.float32]:
        """(rows, columns) metres to the end of a path (N, 2 or more) for the robot, where it stays within `reach`
        metres of the path; longer where it is tight, infinite where it cannot be."""
        from scipy.ndimage import distance_transform_edt

        from nvsim.occupancy.grid_ways import GridWays

        near = distance_transform_edt(~self._drawn(path)) * CELL <= reach
        open_cells = near & (self.room >= 0)
        row, column = self.layers.cells_of(path[-1])
        if not open_cells[row, column]:
            return np.full(self.room.shape, np.inf, np.float32)
        dearer = 1 + np.clip(1 - (self.room + RADIUS) / _EASY, 0, 1)
        return GridWays(open_cells, CELL, (int(row), int(column)), dearer=dearer).metres.astype(np.float32)

    def _drawn(self, path: NDArray[np.floating]) -> NDArray[np.bool_]:
        return _lines(self.layers, list(zip(path[:-1, :2], path[1:, :2])))


def _scanned(layers: Layers, cloud: NDArray[np.floating]) -> NDArray[np.bool_]:
    """(rows, columns) where a cloud has points in the robot's way, but for specks."""
    import cv2

    above = cloud[:, 2] - layers.floor
    cells = layers.cells_of(cloud[(above > _FROM) & (above < _TO), :2])
    cells = cells[((cells >= 0) & (cells < layers.shape)).all(axis=1)]
    mask = np.zeros(layers.shape, np.uint8)
    mask[cells[:, 0], cells[:, 1]] = 1
    _, labels, sizes, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    large = sizes[:, cv2.CC_STAT_AREA] >= _SPECK
    large[0] = False
    return np.asarray(large[labels])


def _closed(floor: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Without the holes of single cells that few rays leave far from all viewpoints."""
    import cv2

    return cv2.morphologyEx(floor.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)).astype(bool)


def _far_from_edges(layers: Layers, graph: NavGraph) -> NDArray[np.bool_]:
    from scipy.ndimage import distance_transform_edt

    at = {one.viewpoint.id: np.array(one.viewpoint.position[:2]) for one in layers.seen}
    ends = [(at[a], at[b]) for a, b in graph.edges if a in at and b in at]
    return np.asarray(distance_transform_edt(~_lines(layers, ends)) * CELL > _FROM_EDGES)


def _lines(layers: Layers, ends: list[tuple[NDArray[np.floating], NDArray[np.floating]]]) -> NDArray[np.bool_]:
    """(rows, columns) the cells on straight lines."""
    mask = np.zeros(layers.shape, bool)
    for a, b in ends:
        count = int(np.linalg.norm(b - a) / (CELL / 2)) + 2
        cells = layers.cells_of(a + np.linspace(0, 1, count)[:, None] * (b - a))
        inside = ((cells >= 0) & (cells < layers.shape)).all(axis=1)
        mask[cells[inside, 0], cells[inside, 1]] = True
    return mask
