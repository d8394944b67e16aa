"""The leaves of OctoMap files: binary trees (.bt), and full trees with log-odds (.ot).

Format: octomap's AbstractOcTree::readHeader, OcTree::readBinaryNode and OcTreeBaseImpl::readNodesRecurs. A text header
ends with a line `data`; nodes follow in depth-first order. In a .bt file, an inner node is two bytes: two bits for each
of its eight children. 1 is a free leaf, 2 an occupied leaf, 3 an inner node that follows, and 0 is unknown. In an .ot
file, a node is its log-odds (float32, little-endian), its color in a colored tree, and a byte whose bits mark its
children. Child number: bit 0 is x, bit 1 is y, bit 2 is z. The tree is 16 levels deep around the origin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.regular import read_bytes

DEPTH = 16
_BINARY, _FULL = b"# Octomap OcTree binary file", b"# Octomap OcTree file"
_FINEST, _COARSEST = 1e-4, 1e3  # meters
_NODE = {"OcTree": 5, "ColorOcTree": 8, "OcTreeStamped": 5, "1": 5}
"""Kinds of full trees, with the bytes of a node; 1 is another name of the first kind."""


@dataclass(frozen=True, eq=False)
class Tree:
    """resolution  meters, edge of a voxel
    leaves      (N, 5) int32: x, y, z and size in voxels from the corner of the tree, and FREE or OCCUPIED
    """

    resolution: float
    leaves: NDArray[np.int32]


def read_tree(path: Path) -> Tree:
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
        count = _read_full(data, _NODE[kind], leaves)
    else:
        leaves = np.empty((8 * (len(data) // 2) + 8, 5), np.int32)
        count = _read_binary(data, leaves)
    if count < 0:
        raise InputError(
            f"{path} ends in the middle of the tree, is deeper than {DEPTH} levels, or has values that are not finite; "
            "copy it again."
        )
    return Tree(resolution, leaves[:count].copy())


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
def _read_binary(
    data: NDArray[np.uint8],  # (bytes,) of the tree
    out: NDArray[np.int32],  # (leaves, 5), the largest possible number
) -> int:
    """Fill rows (x, y, z, size, state) in voxels from the tree's corner. Returns their number, or -1 for a bad file."""
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
        for i in range(7, -1, -1):  # reversed, so that the stack returns the children in file order
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


@njit(cache=True)
def _read_full(
    data: NDArray[np.uint8],  # (bytes,) of the tree
    node: int,  # bytes
    out: NDArray[np.int32],  # (leaves, 5), the largest possible number
) -> int:
    """Like `_read_binary`, for a full tree. As in OctoMap, a leaf is occupied if its log-odds are not negative."""
    stack = np.empty((8 * 17, 4), np.int32)
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, 0, 0, 1 << 16
    top, at, count = 1, 0, 0
    if len(data) == 0:
        return 0
    while top > 0:
        top -= 1
        x, y, z, size = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3]
        if at + node > len(data):
            return -1
        bits, is_negative = data[at + node - 1], data[at + 3] >= 128
        if (data[at + 3] & 127) == 127 and data[at + 2] >= 128:
            return -1  # infinite, or not a number
        at += node
        half = size >> 1
        if bits == 0:
            out[count, 0], out[count, 1], out[count, 2], out[count, 3] = x, y, z, size
            out[count, 4] = 0 if is_negative else 1
            count += 1
        elif half == 0:
            return -1
        for i in range(7, -1, -1):
            if (bits >> i) & 1:
                stack[top, 0], stack[top, 1] = x + half * (i & 1), y + half * ((i >> 1) & 1)
                stack[top, 2], stack[top, 3] = z + half * ((i >> 2) & 1), half
                top += 1
    return count
