"""Read OctoMap files (.bt, .ot) and cut them between two heights over the floor to a 2D map.

Format: octomap's AbstractOcTree::readHeader, OcTree::readBinaryNode and OcTreeBaseImpl::readNodesRecurs. A text
header ends with a line `data`; nodes follow in depth-first order. In a .bt file, an inner node is two bytes: two bits
for each of its eight children. 1 is a free leaf, 2 an occupied leaf, 3 an inner node that follows, and 0 is unknown.
In an .ot file, a node is its log-odds (float32, little-endian), its color in a colored tree, and a byte whose bits
mark its children. Child number: bit 0 is x, bit 1 is y, bit 2 is z. The tree is 16 levels deep around the origin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.opening import read_bytes
from nvsim.files.reading import reading
from nvsim.kernels import njit
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, Heights, OccupancyMap

DEPTH = 16
_BINARY, _FULL = b"# Octomap OcTree binary file", b"# Octomap OcTree file"
_FINEST, _COARSEST = 1e-4, 1e3  # meters
_NODE = {"OcTree": 5, "ColorOcTree": 8, "OcTreeStamped": 5, "1": 5}
"""Kinds of full trees, with the bytes of a node; 1 is another name of the first kind."""


@dataclass(frozen=True, eq=False)
class OccupancyTree:
    """resolution  meters, edge of a voxel
    leaves      (N, 5) int32: x, y, z and size in voxels from the corner of the tree, and FREE or OCCUPIED
    """

    resolution: float
    leaves: NDArray[np.int32]


def read_tree(path: Path) -> OccupancyTree:
    """The leaves of the tree in a .bt or .ot file; its first line decides the format. Raises InputError if the file is
    not a complete tree of a supported kind."""
    content = read_bytes(path)
    is_full = content.startswith(_FULL)
    if not (is_full or content.startswith(_BINARY)):
        raise InputError(
            f"{path} does not begin with {_BINARY.decode()!r} or {_FULL.decode()!r}; "
            "convert it with octomap's convert_octree."
        )
    resolution, kind, data = _header(path, content)
    known = _NODE if is_full else ("OcTree", "1")
    if kind not in known:
        raise InputError(f"{path} holds a tree of kind {kind[:40]!r}; only {', '.join(known)} can be read.")
    if is_full:
        leaves = np.empty((len(data) // _NODE[kind] + 1, 5), np.int32)
    else:
        leaves = np.empty((8 * (len(data) // 2) + 8, 5), np.int32)
    count = _read_nodes(data, _NODE[kind] if is_full else 0, leaves)
    if count < 0:
        raise InputError(
            f"{path} ends in the middle of the tree, is deeper than {DEPTH} levels, or has values that are not finite; "
            "copy it again."
        )
    return OccupancyTree(resolution, leaves[:count].copy())


def _header(path: Path, content: bytes) -> tuple[float, str, NDArray[np.uint8]]:
    at, kind, resolution = 0, "OcTree", math.nan
    while True:
        end = content.find(b"\n", at)
        if end < 0 or end - at > 1000:
            raise InputError(f"{path} has no line 'data' after its header; copy it again.")
        words = content[at:end].decode("latin-1").split()
        at = end + 1
        if words[:1] == ["data"]:
            break
        if words[:1] == ["id"]:
            kind = " ".join(words[1:])
        if words[:1] == ["res"]:
            try:
                resolution = float(words[1])
            except (IndexError, ValueError):
                resolution = math.nan
    if not _FINEST <= resolution <= _COARSEST:
        raise InputError(f"{path} has no positive resolution in its line 'res'; copy it again.")
    return resolution, kind, np.frombuffer(content, np.uint8, offset=at)


@njit(cache=True)
def _read_nodes(
    data: NDArray[np.uint8],  # (bytes,) of the tree
    node: int,  # bytes of a node of a full tree, 0 for a binary tree
    out: NDArray[np.int32],  # (leaves, 5), the largest possible number
) -> int:
    """Fill rows (x, y, z, size, state) in voxels from the tree's corner. As in OctoMap, a leaf of a full tree is
    occupied if its log-odds are not negative. Returns the number of rows, or -1 for a bad file."""
    stack = np.empty((8 * 17, 4), np.int32)
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, 0, 0, 1 << 16
    top, at, count = 1, 0, 0
    if len(data) == 0:
        return 0
    while top > 0:
        top -= 1
        x, y, z, size = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3]
        half = size >> 1
        if at + (node or 2) > len(data):
            return -1
        if node == 0:
            bits = np.int64(data[at]) | (np.int64(data[at + 1]) << 8)
            at += 2
        else:
            bits, is_negative = np.int64(data[at + node - 1]), data[at + 3] >= 128
            if (data[at + 3] & 127) == 127 and data[at + 2] >= 128:
                return -1  # infinite, or not a number
            at += node
            if bits == 0:
                out[count, 0], out[count, 1], out[count, 2], out[count, 3] = x, y, z, size
                out[count, 4] = 0 if is_negative else 1
                count += 1
                continue
        if half == 0:
            return -1
        for i in range(7, -1, -1):  # reversed, so that the stack returns the children in file order
            kind = (bits >> (2 * i)) & 3 if node == 0 else 3 * ((bits >> i) & 1)
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
    center = 1 << (DEPTH - 1)
    if floor is None:
        floor = (_floor_level(leaves) - center) * resolution
    first = (floor + heights.from_height) / resolution + center
    last = (floor + heights.to_height) / resolution + center
    inside = (leaves[:, 2] < last) & (leaves[:, 2] + leaves[:, 3] > first)
    chosen = leaves[inside]
    if float((chosen[:, 3].astype(np.float64) ** 2).sum()) > _MOST_PAINTED:
        raise InputError(f"{path} has more voxels above one another than a map of a building; copy it again.")
    cells = np.full((int(size[1]), int(size[0])), UNKNOWN, np.uint8)
    _paint(cells, chosen[chosen[:, 4] == FREE], low_corner, FREE)
    _paint(cells, chosen[chosen[:, 4] == OCCUPIED], low_corner, OCCUPIED)
    origin = (low_corner[:2] - center) * resolution
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
