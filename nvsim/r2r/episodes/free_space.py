"""Free space for a robot on a storey of an exported scan: visible floor near graph edges, without obstacles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import NavGraph
from nvsim.r2r.surroundings.layers import CELL, FLOOR, Layers

RADIUS = 0.25
"""Radius of the robot in meters."""
_MARGIN = 0.07  # extra meters, because the observed surfaces are not exact
_FROM, _TO = 0.1, 1.7  # meters above the floor; surfaces between these heights are obstacles
_LEAST = 2  # smallest number of voxels in a column that make an obstacle
_SPECK = 4  # smallest number of connected cells of a point cloud that make an obstacle
_FROM_EDGES = 0.45  # meters; the floor is not verified farther from the edges
_EASY = 0.6  # meters from the robot's center to obstacles; a larger distance does not make a path cheaper


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """Free space of one storey as a grid.

    room     (rows, columns) meters to the nearest obstacle or unseen floor, minus the robot's radius and margin
    layers   the layers of the storey
    """

    room: NDArray[np.float32]
    layers: Layers

    @staticmethod
    def of(layers: Layers, graph: NavGraph, cloud: NDArray[np.floating] | None = None) -> FreeSpace:
        """Computes the free space of a storey.

        `cloud` (N, 3), meters, world, adds known surfaces, for example from a LiDAR scan.
        """
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
        """Returns (...) whether the robot is in free space at world x, y (..., 2 or more), meters."""
        return np.asarray(self.layers.values_at(self.room, places) >= 0)

    def to_go(self, path: NDArray[np.floating], reach: float) -> NDArray[np.float32]:
        """Returns (rows, columns) the robot's distance in meters to the end of a path (N, 2 or more), meters, world.

        The robot stays within `reach` meters of the path. Distances near obstacles count more. Cells that the robot
        cannot reach are infinite.
        """
        from scipy.ndimage import distance_transform_edt

        from nvsim.occupancy.grid_ways import GridWays

        near = distance_transform_edt(~self._drawn(path)) * CELL <= reach
        open_cells = near & (self.room >= 0)
        row, column = self.layers.cells_of(path[-1])
        if not open_cells[row, column]:
            return np.full(self.room.shape, np.inf, np.float32)
        cost_factors = 1 + np.clip(1 - (self.room + RADIUS) / _EASY, 0, 1)
        return GridWays(open_cells, CELL, (int(row), int(column)), cost_factors=cost_factors).metres.astype(np.float32)

    def _drawn(self, path: NDArray[np.floating]) -> NDArray[np.bool_]:
        return _lines(self.layers, list(zip(path[:-1, :2], path[1:, :2])))


def _scanned(layers: Layers, cloud: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Returns (rows, columns) the cells in which a point cloud has obstacles, without specks."""
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
    """Fills holes of single cells, which occur far from all viewpoints because rays are sparse there."""
    import cv2

    return cv2.morphologyEx(floor.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)).astype(bool)


def _far_from_edges(layers: Layers, graph: NavGraph) -> NDArray[np.bool_]:
    from scipy.ndimage import distance_transform_edt

    at = {one.viewpoint.id: np.array(one.viewpoint.position[:2]) for one in layers.seen}
    ends = [(at[a], at[b]) for a, b in graph.edges if a in at and b in at]
    return np.asarray(distance_transform_edt(~_lines(layers, ends)) * CELL > _FROM_EDGES)


def _lines(layers: Layers, ends: list[tuple[NDArray[np.floating], NDArray[np.floating]]]) -> NDArray[np.bool_]:
    """Returns (rows, columns) the cells on straight lines."""
    mask = np.zeros(layers.shape, bool)
    for a, b in ends:
        count = int(np.linalg.norm(b - a) / (CELL / 2)) + 2
        cells = layers.cells_of(a + np.linspace(0, 1, count)[:, None] * (b - a))
        inside = ((cells >= 0) & (cells < layers.shape)).all(axis=1)
        mask[cells[inside, 0], cells[inside, 1]] = True
    return mask
