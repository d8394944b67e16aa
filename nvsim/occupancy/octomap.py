"""OctoMap binary trees (.bt), cut between two heights over the floor into a flat map.

Format: octomap's OcTree::readBinaryNode. After a text header every inner node is two bytes, its eight children two
bits each: 1 is a free leaf, 2 an occupied leaf, 3 an inner node that follows in depth-first order, 0 is unknown.
Child number: bit 0 is x, bit 1 is y, bit 2 is z. The tree is 16 levels deep around the origin.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.files.regular import read_bytes
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap

_DEPTH = 16
_ANYWAY = 1_500_000  # cells that any file may span: 60 x 60 m in cells of 5 cm; a larger building is a larger file
_MOST_PAINTED = 1 << 31  # cells, each as often as voxels of one column lie in the band
_FINEST, _COARSEST = 1e-4, 1e3  # metres
_MAGIC = b"# Octomap OcTree binary file"


def read_octomap(path: Path, low: float = 0.1, high: float = 1.5, floor: float | None = None) -> OccupancyMap:
    """The map of what stands between `low` and `high` metres over the floor.

    A column is occupied where any voxel between the heights is, else free where one is free, else unknown. Without
    `floor` (metres, world z) the floor is the most common height of the tops of occupied voxels with free space above
    them, looked for in the lower half of the map.

    Raises InputError when the file is not a whole binary tree.
    """
    with reading(path, "an OctoMap", "copy it again"):
        return _read(path, low, high, floor)


def _read(path: Path, low: float, high: float, floor: float | None) -> OccupancyMap:
    resolution, data = _open(path)
    leaves = np.empty((8 * (len(data) // 2) + 8, 5), np.int32)
    count = _read_leaves(data, leaves)
    if count < 0:
        raise InputError(f"{path} ends in the middle of the tree or is deeper than {_DEPTH} levels; copy it again.")
    leaves = leaves[:count]
    if count == 0:
        raise InputError(f"{path} holds an empty tree; there is nothing to compare with.")
    low_corner = leaves[:, :3].min(axis=0)
    size = (leaves[:, :3] + leaves[:, 3:4]).max(axis=0) - low_corner
    if int(size[0]) * int(size[1]) > max(_ANYWAY, 10 * len(data)):
        raise InputError(
            f"{path} spans {size[0] * resolution:.0f} x {size[1] * resolution:.0f} m in cells of {resolution} m; "
            "cut it to the building."
        )
    centre = 1 << (_DEPTH - 1)
    if floor is None:
        floor = (_floor_level(leaves) - centre) * resolution
    first = (floor + low) / resolution + centre
    last = (floor + high) / resolution + centre
    inside = (leaves[:, 2] < last) & (leaves[:, 2] + leaves[:, 3] > first)
    chosen = leaves[inside]
    if float((chosen[:, 3].astype(np.float64) ** 2).sum()) > _MOST_PAINTED:
        raise InputError(f"{path} lays more voxels over one another than a map of a building does; copy it again.")
    cells = np.full((int(size[1]), int(size[0])), UNKNOWN, np.uint8)
    _paint(cells, chosen[chosen[:, 4] == FREE], low_corner, FREE)
    _paint(cells, chosen[chosen[:, 4] == OCCUPIED], low_corner, OCCUPIED)
    origin = (low_corner[:2] - centre) * resolution
    return OccupancyMap(cells, resolution, (float(origin[0]), float(origin[1])))


def _open(path: Path) -> tuple[float, NDArray[np.uint8]]:
    content = read_bytes(path)
    if not content.startswith(_MAGIC):
        raise InputError(f"{path} does not begin with {_MAGIC.decode()!r}; convert it with octomap's convert_octree.")
    at = 0
    resolution = math.nan
    while True:
        end = content.find(b"\n", at)
        if end < 0 or end - at > 1000:
            raise InputError(f"{path} has no line 'data' after its header; copy it again.")
        words = content[at:end].decode("latin-1").split()
        at = end + 1
        if words[:1] == ["data"]:
            break
        if words[:1] == ["id"] and words[1:] != ["OcTree"]:
            raise InputError(f"{path} holds a tree of kind {' '.join(words[1:])!r}; only OcTree can be read.")
        if words[:1] == ["res"]:
            try:
                resolution = float(words[1])
            except (IndexError, ValueError):
                resolution = math.nan
    if not _FINEST <= resolution <= _COARSEST:
        raise InputError(f"{path} names no positive resolution in its line 'res'; copy it again.")
    return resolution, np.frombuffer(content, np.uint8, offset=at)


@njit(cache=True)
def _read_leaves(
    data: NDArray[np.uint8],  # (bytes,) of the tree
    out: NDArray[np.int32],  # (leaves, 5), as many as there can be
) -> int:
    """Fills rows (x, y, z, size, state) in voxels from the tree's corner; returns their number, -1 for a torn file."""
    stack = np.empty((8 * 17, 4), np.int32)
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, 0, 0, 1 << 16
    top, at, count = 1, 0, 0
    if len(data) == 0:
        return 0
    while top > 0:
        top -= 1
        x, y, z, size = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3]
        if at + 2 > len(data) or size < 2:
            return -1
        bits = np.int64(data[at]) | (np.int64(data[at + 1]) << 8)
        at += 2
        half = size >> 1
        for i in range(7, -1, -1):  # backwards, so that the stack hands the children out in file order
            kind = (bits >> (2 * i)) & 3
            if kind == 0:
                continue
            cx, cy, cz = x + half * (i & 1), y + half * ((i >> 1) & 1), z + half * ((i >> 2) & 1)
            if kind == 3:
                stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3] = cx, cy, cz, half
                top += 1
            else:
                out[count, 0], out[count, 1], out[count, 2], out[count, 3] = cx, cy, cz, half
                out[count, 4] = 0 if kind == 1 else 1
                count += 1
    return count


def _floor_level(leaves: NDArray[np.int32]) -> int:
    """The layer (voxels from the tree's corner) on which most occupied voxels end, in the lower half of the map."""
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
