"""Read OctoMap files (.bt, .ot) and cut them between two heights over the floor to a 2D map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.occupancy.heights import Heights
from nvsim.occupancy.octomap_tree import DEPTH, read_tree
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap

_ANYWAY = 1_500_000  # cells that any file may span: 60 x 60 m in cells of 5 cm; more cells need a larger file
_MOST_PAINTED = 1 << 31  # limit of painted cells; a cell counts once for each voxel of its column in the band


def read_octomap(path: Path, heights: Heights | None = None, floor: float | None = None) -> OccupancyMap:
    """The map of the obstacles between `heights` over the floor.

    A column is occupied if any voxel between the heights is occupied, else free if one is free, else unknown. `floor`
    is the floor height in meters, world z. Without it, the floor is the height at which most occupied voxels end, in
    the lower half of the map.

    Raises InputError if the file is not a complete tree.
    """
    with reading(path, "an OctoMap", "copy it again"):
        return _read(path, heights or Heights(), floor)


def _read(path: Path, heights: Heights, floor: float | None) -> OccupancyMap:
    tree = read_tree(path)
    resolution, leaves = tree.resolution, tree.leaves
    if not len(leaves):
        raise InputError(f"{path} holds an empty tree; there is nothing to compare with.")
    low_corner = leaves[:, :3].min(axis=0)
    size = (leaves[:, :3] + leaves[:, 3:4]).max(axis=0) - low_corner
    if int(size[0]) * int(size[1]) > max(_ANYWAY, 10 * path.stat().st_size):
        raise InputError(
            f"{path} spans {size[0] * resolution:.0f} x {size[1] * resolution:.0f} m in cells of {resolution} m; "
            "cut it to the building."
        )
    centre = 1 << (DEPTH - 1)
    if floor is None:
        floor = (_floor_level(leaves) - centre) * resolution
    first = (floor + heights.from_height) / resolution + centre
    last = (floor + heights.to_height) / resolution + centre
    inside = (leaves[:, 2] < last) & (leaves[:, 2] + leaves[:, 3] > first)
    chosen = leaves[inside]
    if float((chosen[:, 3].astype(np.float64) ** 2).sum()) > _MOST_PAINTED:
        raise InputError(f"{path} has more voxels above one another than a map of a building; copy it again.")
    cells = np.full((int(size[1]), int(size[0])), UNKNOWN, np.uint8)
    _paint(cells, chosen[chosen[:, 4] == FREE], low_corner, FREE)
    _paint(cells, chosen[chosen[:, 4] == OCCUPIED], low_corner, OCCUPIED)
    origin = (low_corner[:2] - centre) * resolution
    return OccupancyMap(cells, resolution, (float(origin[0]), float(origin[1])))


def _floor_level(leaves: NDArray[np.int32]) -> int:
    """The layer (voxels from the tree's corner) at which most occupied voxels end, in the lower half of the map."""
    occupied = leaves[leaves[:, 4] == OCCUPIED]
    if len(occupied) == 0:
        return int(leaves[:, 2].min())
    tops = occupied[:, 2] + occupied[:, 3]
    lowest = int(tops.min())
    middle = (int(tops.max()) + lowest) / 2
    area = np.bincount(tops - lowest, weights=occupied[:, 3].astype(np.float64) ** 2)
    area[np.arange(len(area)) + lowest > middle] = 0
    return lowest + int(np.argmax(area))


def _paint(cells: NDArray[np.uint8], leaves: NDArray[np.int32], corner: NDArray[np.int32], state: np.uint8) -> None:
    for x, y, _, size, _ in leaves:
        cells[y - corner[1] : y - corner[1] + size, x - corner[0] : x - corner[0] + size] = state
