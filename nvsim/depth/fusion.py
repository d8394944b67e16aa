"""Fuse depth maps to one point cloud: points are averaged in cells.

The cells of a large building do not fit in memory, so they are fused in parts. Each part reads only maps with points in
its cells. Every cell receives its points in the order of the maps, so the division into parts does not change it.

The key of a cell orders cells by band, then y, then x, then z. A band is `1 << _BAND_BITS` cells wide in x, so that
a part of a large building is about as wide as long, and few parts share a map.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.nearest_points import distance_and_normals
from nvsim.kernels import njit

Map = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]
"""Inverse depth (H, W), 1 / meters, 0 where unknown; its inverse variance (H, W), meters squared; and the image
(H, W, 3) RGB, which gives the colors."""

_MOST_CELLS = 1 << 21  # cells of a part: 230 MB with their table, and at most 180 MB more while they are sorted
_FEW_CELLS = 1 << 15  # cells for which a new part has room
_READ_AHEAD = 16  # maps
_STRIP = 1_000_000  # points whose neighbors are searched at the same time, 100 MB
_REACH = 0.5  # meters from a strip in which its neighbors are searched first
_EMPTY = -1
_LAST = int(np.iinfo(np.int64).max)
_BAND_BITS = 9  # 15 meters with cells of 3 cm
_BITS = 21  # of the number of a cell along each axis
_ROW = _BITS + _BAND_BITS  # the bits of a key above these are the band and y
_FAR = 1 << (_BITS - 1)  # cells farther than this from the origin are clamped to the outermost cell
_WITHIN = 3 | 3 << _BITS | 3 << _ROW  # cells whose keys differ only in these bits are beside each other in the table
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)  # 2^64 / golden ratio: spreads neighboring keys over the table (Knuth)


@dataclass(frozen=True, eq=False)
class FusedCloud:
    """points   (N, 3) float32, meters, world
    colors   (N, 3) uint8 RGB
    normals  (N, 3) float32, unit, toward the cameras
    views    (N,) uint16, number of observations of the point
    """

    points: NDArray[np.float32]
    colors: NDArray[np.uint8]
    normals: NDArray[np.float32]
    views: NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class ObservedPoints:
    """A part of the points that cameras saw.

    points   (N, 3) float32, meters, world
    eyes     (N, 3) float32, meters, world: mean position of the cameras that saw the point
    say      (N,) float32, 1 / meters squared: summed inverse variance of the observations
    end      meters: no point of a later part has a smaller x
    """

    points: NDArray[np.float32]
    eyes: NDArray[np.float32]
    say: NDArray[np.float32]
    end: float = np.inf


@dataclass(frozen=True, eq=False)
class FusedCells:
    """The cells of a part, sorted by key.

    seen    the weighted mean points of the N cells
    colors  (N, 3) uint8 RGB
    views   (N,) uint16, number of observations
    """

    seen: ObservedPoints
    colors: NDArray[np.uint8]
    views: NDArray[np.uint16]

    def select(self, kept: NDArray[np.bool_]) -> FusedCells:
        """The cells with True in `kept` (N,)."""
        seen = self.seen
        seen = ObservedPoints(seen.points[kept], seen.eyes[kept], seen.say[kept], seen.end)
        return FusedCells(seen, self.colors[kept], self.views[kept])


def fuse(
    cameras: Sequence[Camera], read: Callable[[int], Map], voxel: float, seen: int, threads: int
) -> Iterator[FusedCells]:
    """Fuse the maps that `read` gives for the index of each camera in cells of `voxel` meters, part by part.

    Only cells with at least `seen` observations and a positive weight are returned. Maps are read on `threads` threads
    and in order; each is read again for every part that has points of it."""
    boxes: list[NDArray[np.int64] | None] = [None] * len(cameras)
    first = 0
    with ThreadPoolExecutor(threads) as pool:
        while True:
            part = Fusion(voxel, first)
            for start in range(0, len(cameras), _READ_AHEAD):
                block = range(start, min(start + _READ_AHEAD, len(cameras)))
                some = [i for i in block if part.may_have_points_in(boxes[i])]
                for i, found in zip(some, pool.map(read, some), strict=True):
                    boxes[i] = part.add(cameras[i], *found)
            yield part.cells(seen)
            return_freed_memory()
            if part.last == _LAST:
                return
            first = part.last + 1


def joined(parts: Iterable[FusedCells]) -> FusedCloud:
    """The point cloud of all parts."""
    columns: tuple[list[NDArray[Any]], ...] = [], [], [], []
    for part in parts:
        seen = part.seen
        found: tuple[NDArray[Any], ...] = seen.points, seen.eyes - seen.points, part.colors, part.views
        for column, values in zip(columns, found, strict=True):
            column.append(values)
    points, towards, colors, views = (concatenate_parts(column) for column in columns)
    return FusedCloud(points, colors, normals_of(points, towards), views)


def concatenate_parts(parts: list[NDArray[Any]]) -> NDArray[Any]:
    """(N, ...) the concatenated `parts` (M, ...), which are removed from their list."""
    together = np.concatenate(parts)
    parts.clear()
    return_freed_memory()
    return together


def return_freed_memory() -> None:
    """Return freed memory to the system. The C library of Linux keeps it, and the next step needs other sizes, so that
    both would be in use."""
    with suppress(AttributeError, OSError, TypeError):  # there is no such function on other systems
        ctypes.CDLL(None).malloc_trim(0)


class Fusion:
    """Accumulates points in the cells whose keys are at least `first` and at most `last`.

    If there are more than `_MOST_CELLS` such cells, `last` is reduced, and the cells above it are removed. The rows of
    the cells are in the order in which the cells were found; an open hash table gives the row of a key."""

    def __init__(self, voxel: float, first: int = 0) -> None:
        self.voxel, self.first, self.last = voxel, first, _LAST
        self._filled = 0
        self._keys, self._sums = np.empty(0, np.int64), np.empty((0, 11))
        self._table = np.empty(0, np.int32)
        self._make_room(min(_FEW_CELLS, _MOST_CELLS))

    def add(
        self, camera: Camera, inverse: NDArray[np.float32], weight: NDArray[np.float32], image: NDArray[np.uint8]
    ) -> NDArray[np.int64]:
        """Add the points of a map `inverse` (H, W) float32 of inverse depth, 1 / meters, 0 where unknown.

        `weight` (H, W) float32 is its inverse variance, meters squared; `image` (H, W, 3) uint8 RGB gives the colors.
        Returns (4,) the least and the greatest number of a cell along x, and along y, of all its points, also of those
        in other parts; the least is greater if there are none."""
        k = camera.intrinsics
        lens = np.array([k.fx, k.fy, k.cx, k.cy])
        pose = np.ascontiguousarray(camera.camera_to_world[:3], np.float64)
        box, at = np.array([2 * _FAR, -1, 2 * _FAR, -1]), 0
        while True:
            limits = np.array([self.first, self.last])
            at, self._filled = _add(
                lens, pose, inverse, weight, image, self.voxel, limits, at, self._filled, self._keys, self._sums,
                self._table, box,
            )  # fmt: skip
            if at == inverse.size:
                return box
            if len(self._keys) < _MOST_CELLS:
                self._make_room(min(2 * len(self._keys), _MOST_CELLS))
            else:
                self._reduce()

    def may_have_points_in(self, box: NDArray[np.int64] | None) -> bool:
        """Whether cells of this part are in a `box` (4,) as from `add`. None is a box of unknown size."""
        if box is None:
            return True
        low, high = self.first >> _ROW, self.last >> _ROW
        bands = np.arange(box[0] >> _BAND_BITS, (box[1] >> _BAND_BITS) + 1) << _BITS
        return bool(((bands | box[3] >= low) & (bands | box[2] <= high)).any())

    def cells(self, seen: int) -> FusedCells:
        """The cells with at least `seen` observations and a positive weight. No further points can be added."""
        sums = self._sums[: self._filled]
        chosen = np.flatnonzero((sums[:, 10] >= max(seen, 1)) & (sums[:, 9] > 0))
        sums = sums[chosen[np.argsort(self._keys[chosen])]]
        self._make_room(0)
        say = sums[:, 9:10]
        points, eyes = (sums[:, :3] / say).astype(np.float32), (sums[:, 6:9] / say).astype(np.float32)
        colors = np.clip(sums[:, 3:6] / say + 0.5, 0, 255).astype(np.uint8)
        band = (self.last + 1) >> (_ROW + _BITS)
        end = np.inf if self.last == _LAST else ((band << _BAND_BITS) - _FAR) * self.voxel
        return FusedCells(
            ObservedPoints(points, eyes, say[:, 0].astype(np.float32), end),
            colors,
            sums[:, 10].clip(0, 65535).astype(np.uint16),
        )

    def _make_room(self, cells: int) -> None:
        """Change the room to that of a number of cells."""
        self._filled = min(self._filled, cells)
        keys, sums = np.empty(cells, np.int64), np.empty((cells, 11))
        keys[: self._filled], sums[: self._filled] = self._keys[: self._filled], self._sums[: self._filled]
        self._keys, self._sums = keys, sums
        rows = max(1 << (2 * cells - 1).bit_length(), 64)  # more than half of them stay empty
        self._table = np.full(rows, _EMPTY, np.int32)
        _index(self._keys[: self._filled], self._keys, self._table)

    def _reduce(self) -> None:
        """Remove the upper half of the cells."""
        keys = self._keys[: self._filled]
        self.last = int(np.partition(keys, (len(keys) - 1) // 2)[(len(keys) - 1) // 2])
        kept = np.flatnonzero(keys <= self.last)
        self._filled = len(kept)
        self._keys[: len(kept)], self._sums[: len(kept)] = keys[kept], self._sums[kept]
        self._table[:] = _EMPTY
        _index(self._keys[: self._filled], self._keys, self._table)


@njit(cache=True, nogil=True)
def _find_row(key: np.int64, keys: NDArray[np.int64], table: NDArray[np.int32]) -> np.int64:
    """The place in `table` (M,) of the row of `key` in `keys`, or an empty place for it. M is a power of two, at least
    64, and some places are empty."""
    mask = len(table) - 1
    mixed = np.uint64(key & ~_WITHIN) * _GOLDEN
    at = np.int64((mixed ^ (mixed >> np.uint64(32))) & np.uint64(mask & ~63))
    at |= key & 3 | (key >> (_BITS - 2)) & 12 | (key >> (_ROW - 4)) & 48
    while table[at] != _EMPTY and keys[table[at]] != key:
        at = np.int64((at + 1) & mask)
    return at


@njit(cache=True, nogil=True)
def _index(some: NDArray[np.int64], keys: NDArray[np.int64], table: NDArray[np.int32]) -> None:
    """Enter the first rows of `keys`, which are `some` (N,), in an empty table."""
    for i in range(len(some)):
        table[_find_row(some[i], keys, table)] = i


@njit(cache=True, nogil=True, error_model="numpy")
def _add(
    lens: NDArray[np.float64],
    pose: NDArray[np.float64],
    inverse: NDArray[np.float32],
    weight: NDArray[np.float32],
    image: NDArray[np.uint8],
    voxel: float,
    limits: NDArray[np.int64],
    start: int,
    filled: int,
    keys: NDArray[np.int64],
    sums: NDArray[np.float64],
    table: NDArray[np.int32],
    box: NDArray[np.int64],
) -> tuple[int, int]:
    """Add the pixels of a map from index `start` on to the first `filled` rows of `keys` (N,) and `sums` (N, 11).

    A row of `sums` has the point, the color, and the camera position times weight; the weight; and the count. `lens` is
    fx, fy, cx, cy; `pose` (3, 4) is camera to world. `limits` (2,) are the least and the greatest key to add. `box`
    (4,), the least and greatest number of a cell along x and y, is updated with all pixels.

    Returns the index of the first pixel for whose cell there is no room, and the number of filled rows."""
    fx, fy, cx, cy = lens
    height, width = inverse.shape
    low, high = limits[0] >> _ROW, limits[1] >> _ROW
    for v in range(start // width, height):
        for u in range(start % width if v == start // width else 0, width):
            w = inverse[v, u]
            if w <= 0:
                continue
            depth = 1.0 / w
            x, y = (u + 0.5 - cx) / fx * depth, (v + 0.5 - cy) / fy * depth
            px = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * depth + pose[0, 3]
            py = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * depth + pose[1, 3]
            pz = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * depth + pose[2, 3]
            column, line = _cell(px, voxel), _cell(py, voxel)
            box[0], box[1] = min(box[0], column), max(box[1], column)
            box[2], box[3] = min(box[2], line), max(box[3], line)
            row = (column >> _BAND_BITS) << _BITS | line
            if row < low or row > high:
                continue
            key = (row << _BAND_BITS | column & ((1 << _BAND_BITS) - 1)) << _BITS | _cell(pz, voxel)
            if key < limits[0] or key > limits[1]:
                continue
            at = _find_row(key, keys, table)
            if table[at] == _EMPTY:
                if filled == len(keys):
                    return v * width + u, filled
                keys[filled] = key
                sums[filled] = 0
                table[at] = filled
                filled += 1
            # The standard deviation of a depth grows with its square, so its weight falls with the fourth power.
            near = min(w, 2.0)
            say = weight[v, u] * near * near * near * near
            total = sums[table[at]]
            total[0] += say * px
            total[1] += say * py
            total[2] += say * pz
            for c in range(3):
                total[3 + c] += say * image[v, u, c]
                total[6 + c] += say * pose[c, 3]
            total[9] += say
            total[10] += 1
    return inverse.size, filled


@njit(cache=True, nogil=True, error_model="numpy")
def _cell(at: float, voxel: float) -> np.int64:
    """The number of the cell at the coordinate `at`, at least 0."""
    return np.int64(min(max(at / voxel + _FAR, 0.0), 2.0 * _FAR - 1))


def normals_of(points: NDArray[np.float32], towards: NDArray[np.floating], neighbors: int = 24) -> NDArray[np.float32]:
    """(N, 3) float32 unit normals of `points` (N, 3): the direction in which their neighbors spread least.

    Each normal is oriented along `towards` (N, 3), the vectors from the points to the cameras. Neighbors are searched
    strip by strip, because the search in a whole large building needs too much memory."""
    if len(points) < 3:
        return np.asarray(towards / np.linalg.norm(towards, axis=1, keepdims=True), np.float32)
    along = points[:, int(np.ptp(points, axis=0).argmax())]
    order = np.argsort(along)
    out, along = np.empty((len(points), 3), np.float32), along[order]
    for start in range(0, len(points), _STRIP):
        todo, reach = np.arange(start, min(start + _STRIP, len(points))), _REACH
        while len(todo):  # few points have so distant neighbors that they need another round
            low, high = along[todo[0]] - reach, along[todo[-1]] + reach
            first, end = np.searchsorted(along, low), np.searchsorted(along, high, side="right")
            distance, normal = distance_and_normals(points[order[first:end]], neighbors, todo - first)
            # Nearer ones than the found neighbors can be among the other points.
            known = distance <= np.minimum(along[todo] - low, high - along[todo])
            known |= end - first == len(points)
            at = order[todo[known]]
            out[at] = normal[known]
            out[at] *= np.where(np.einsum("ij,ij->i", out[at], towards[at]) < 0, -1, 1)[:, None]
            todo = todo[~known]
            reach *= 4
    return out
