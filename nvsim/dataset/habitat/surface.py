"""Fuse the color and depth of a scan's strips to a surface: a truncated signed distance on voxels, and its zero level.

The distance is averaged over the strips within REACH (Curless and Levoy 1996). Each cell that the surface crosses gets
one vertex, the mean of the crossings of its edges (naive surface nets, Gibson 1998). Slabs of voxels along x bound the
memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.events import Listener, Progress
from nvsim.files.images import decode_pixels
from nvsim.files.opening import read_bytes
from nvsim.geometry.camera import camera_pose
from nvsim.geometry.directions import face_axes
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.kernels import njit, prange
from nvsim.r2r.observations.layout import ScanPlaces
from nvsim.r2r.observations.skybox import UNITS_A_METER, read_depth
from nvsim.r2r.surroundings.layers import Scalar

STAGE = "surface"
REACH = 6.0
"""Largest distance in meters from a viewpoint to a surface that it measures."""
_TRUNCATION = 3.0  # voxels
_BELOW, _ABOVE = 0.3, 2.6  # meters below the lowest floor and above the highest camera
_MOST = 4_000_000  # voxels of a slab: about 300 MB with the arrays of its cells
_SIDE = 256  # pixels of a face; more are skipped
_STRIPS = 64  # strips in memory, 2 MB each
_FEW = 60  # triangles; smaller separate parts of the surface are dropped
_CORNERS = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)])
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1]


@dataclass(frozen=True, eq=False)
class Surface:
    """vertices   (N, 3) float32, meters, world
    triangles  (M, 3) int64, counterclockwise seen from free space
    colors     (N, 3) uint8 RGB
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int64]
    colors: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class SolidColumns:
    """Columns of voxels over the ground between two heights.

    low     (x, y) meters of the column [0, 0]
    voxel   meters between columns; rows follow y, columns x
    solid   (rows, columns) bool, whether a voxel of the column is behind a surface
    """

    low: tuple[float, float]
    voxel: float
    solid: NDArray[np.bool_]

    def places(self) -> NDArray[np.float64]:
        """Returns (rows, columns, 2) world x, y of the columns, meters."""
        rows, columns = np.indices(self.solid.shape)
        return np.stack([columns, rows], axis=-1) * self.voxel + np.array(self.low)

    def values_at(self, values: NDArray[Scalar], xy: NDArray[np.floating]) -> NDArray[Scalar]:
        """Returns (...) entries of `values` (rows, columns) at world places (..., 2), meters, clipped to the grid."""
        at = np.rint((np.asarray(xy)[..., :2] - np.array(self.low)) / self.voxel).astype(int)
        rows, columns = self.solid.shape
        return values[at[..., 1].clip(0, rows - 1), at[..., 0].clip(0, columns - 1)]


def fuse_surface(
    root: Path, graph: NavGraph, voxel: float, heights: Sequence[tuple[float, float]], listen: Listener
) -> tuple[Surface, list[SolidColumns]]:
    """Returns the surface of the scan in the export folder `root`, with voxels of `voxel` meters, and its columns
    between each pair of `heights`, meters, world.

    Raises InputError if a strip is missing or damaged, or if the strips show no surface.
    """
    places = ScanPlaces(root, graph.scan)
    viewpoints = [v for v in graph.viewpoints.values() if v.included]
    at = np.array([v.position for v in viewpoints])
    low = at.min(axis=0) - REACH
    high = at.max(axis=0) + REACH
    low[2] = min(v.position[2] - v.height for v in viewpoints) - _BELOW
    high[2] = at[:, 2].max() + _ABOVE
    shape = np.ceil((high - low) / voxel).astype(int) + 1

    @lru_cache(maxsize=_STRIPS)
    def strip(i: int) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        return _read_strip(places, viewpoints[i])

    thick = max(2, _MOST // int(shape[1] * shape[2]))
    ends = [*range(1, int(shape[0]) - 1, thick), int(shape[0]) - 1]
    keys, vertices, colors, quads = [], [], [], []
    solid = np.zeros((len(heights), *shape[:2]), bool)
    for done, (first, last) in enumerate(pairwise(ends)):
        origin = low + np.array([(first - 1) * voxel, 0, 0])
        slab = _DistanceSlab.empty((last - first + 2, int(shape[1]), int(shape[2])))
        far = np.maximum(np.maximum(origin[0] - at[:, 0], at[:, 0] - origin[0] - slab.sums.shape[0] * voxel), 0)
        for i in np.flatnonzero(far < REACH):
            meters, image = strip(int(i))
            _integrate(slab.sums, slab.weights, slab.colors, low - at[i], first - 1, voxel, meters, image, _axes())
        for h, (bottom, top) in enumerate(heights):
            levels = slice(*np.ceil((np.array([bottom, top]) - low[2]) / voxel).astype(int).clip(0, shape[2]))
            behind = (slab.weights[:, :, levels] > 0) & (slab.sums[:, :, levels] <= 0)
            solid[h, first - 1 : last + 1] = behind.any(axis=2)
        found = _surface_nets(slab, origin, voxel)
        start = (first - 1) * int(shape[1] * shape[2])
        keys.append(found.keys + start)
        vertices.append(found.vertices)
        colors.append(found.colors)
        quads.append(found.quads + start)
        listen(Progress(STAGE, done + 1, len(ends) - 1, graph.scan))
    every, once = np.unique(np.concatenate(keys), return_index=True)
    corners = np.searchsorted(every, np.concatenate(quads))
    if not len(corners):
        raise InputError(f"The strips of {graph.scan} show no surface; export the scan again.")
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    columns = [SolidColumns((float(low[0]), float(low[1])), voxel, s.T) for s in solid]
    surface = Surface(np.concatenate(vertices)[once], triangles, np.concatenate(colors)[once])
    return _without_specks(surface), columns


def _read_strip(places: ScanPlaces, viewpoint: Viewpoint) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Returns (S, 6 S) meters along the rays, 0 if there is no surface, and (S, 6 S, 3) RGB."""
    import cv2

    depth, path = read_depth(places, viewpoint.id), places.skyboxes.strip(viewpoint.id)
    image = decode_pixels(read_bytes(path), path, cv2.IMREAD_COLOR, what="a skybox strip", then="export the scan again")
    if image.shape[:2] != depth.shape:
        raise InputError(f"{path} does not have the size of its depth strip; export the scan again.")
    side = min(_SIDE, depth.shape[0])
    rows = (np.arange(side) * 2 + 1) * depth.shape[0] // (2 * side)
    columns = (np.arange(6 * side) * 2 + 1) * depth.shape[1] // (12 * side)
    meters = (depth[rows][:, columns] / np.float32(UNITS_A_METER)).astype(np.float32)
    return meters, np.ascontiguousarray(image[rows][:, columns][..., ::-1])


@lru_cache(maxsize=1)
def _axes() -> NDArray[np.float64]:
    """Returns (6, 3, 3) world directions of right, down and ahead of each face, for a pose that faces +y."""
    turn = camera_pose(np.zeros(3), 0.0)[:3, :3]
    return np.ascontiguousarray(np.swapaxes(turn @ face_axes(), 1, 2))


@dataclass(frozen=True, eq=False)
class _DistanceSlab:
    """sums, weights  (X, Y, Z) float32: weighted sum of distances in truncations, and sum of weights
    colors         (X, Y, Z, 4) float32: weighted sum of RGB near the surface, and sum of its weights
    """

    sums: NDArray[np.float32]
    weights: NDArray[np.float32]
    colors: NDArray[np.float32]

    @staticmethod
    def empty(shape: tuple[int, int, int]) -> _DistanceSlab:
        return _DistanceSlab(
            np.zeros(shape, np.float32), np.zeros(shape, np.float32), np.zeros((*shape, 4), np.float32)
        )


@njit(parallel=True, cache=True)
def _integrate(
    sums: NDArray[np.float32],  # (X, Y, Z) changed, as are the next two; see _Slab
    weights: NDArray[np.float32],
    colors: NDArray[np.float32],
    low: NDArray[np.float64],  # (3,) meters from the eye to the first voxel of the grid
    first: int,  # layer of the grid that is layer 0 of the slab
    voxel: float,
    meters: NDArray[np.float32],  # (S, 6 S)
    image: NDArray[np.uint8],  # (S, 6 S, 3)
    axes: NDArray[np.float64],  # (6, 3, 3) of the faces; see _axes
) -> None:
    """Adds one strip to the voxels of a slab."""
    side = meters.shape[0]
    cut = _TRUNCATION * voxel
    for i in prange(sums.shape[0]):
        x = low[0] + (first + i) * voxel
        if abs(x) > REACH:
            continue
        for j in range(sums.shape[1]):
            y = low[1] + j * voxel
            if x * x + y * y > REACH * REACH:
                continue
            for k in range(sums.shape[2]):
                z = low[2] + k * voxel
                far = np.sqrt(x * x + y * y + z * z)
                if far > REACH or far < 0.1:
                    continue
                face, ahead = 0, -1.0
                for f in range(6):
                    a = axes[f, 2, 0] * x + axes[f, 2, 1] * y + axes[f, 2, 2] * z
                    if a > ahead:
                        face, ahead = f, a
                right = (axes[face, 0, 0] * x + axes[face, 0, 1] * y + axes[face, 0, 2] * z) / ahead
                down = (axes[face, 1, 0] * x + axes[face, 1, 1] * y + axes[face, 1, 2] * z) / ahead
                column = min(max(int((1 + right) / 2 * side), 0), side - 1) + face * side
                row = min(max(int((1 + down) / 2 * side), 0), side - 1)
                measured = meters[row, column]
                signed = measured - far
                if measured <= 0 or signed < -cut:
                    continue
                weight = 1 / (0.25 + far * far)
                sums[i, j, k] += weight * min(1.0, signed / cut)
                weights[i, j, k] += weight
                if signed < cut:
                    for c in range(3):
                        colors[i, j, k, c] += weight * image[row, column, c]
                    colors[i, j, k, 3] += weight


@dataclass(frozen=True, eq=False)
class _SurfaceNets:
    """keys (N,) cells with a vertex, vertices (N, 3), colors (N, 3), quads (Q, 4) cells."""

    keys: NDArray[np.int64]
    vertices: NDArray[np.float32]
    colors: NDArray[np.uint8]
    quads: NDArray[np.int64]


def _surface_nets(slab: _DistanceSlab, origin: NDArray[np.float64], voxel: float) -> _SurfaceNets:
    """Returns the zero level in a slab. The key of a cell is its number in the slab, in the order of the voxels."""
    known = slab.weights > 0
    values = np.where(known, slab.sums / np.maximum(slab.weights, 1e-12), np.nan)
    inside = values <= 0
    shape = values.shape
    counts = np.zeros(tuple(n - 1 for n in shape), np.int8)
    whole = np.ones(counts.shape, bool)
    for i, j, k in _CORNERS:
        part = np.s_[i : shape[0] - 1 + i, j : shape[1] - 1 + j, k : shape[2] - 1 + k]
        counts += inside[part]
        whole &= known[part]
    crossed = whole & (counts > 0) & (counts < 8)
    cells = np.argwhere(crossed)
    at = cells[:, None] + _CORNERS
    corners = values[at[..., 0], at[..., 1], at[..., 2]].astype(np.float64)
    total, number = np.zeros((len(cells), 3)), np.zeros(len(cells))
    for a, b in _EDGES:
        changes = (corners[:, a] <= 0) != (corners[:, b] <= 0)
        share = corners[changes, a] / (corners[changes, a] - corners[changes, b])
        total[changes] += _CORNERS[a] + share[:, None] * (_CORNERS[b] - _CORNERS[a])
        number[changes] += 1
    vertices = origin + (cells + total / np.maximum(number, 1)[:, None]) * voxel
    tints = slab.colors[at[..., 0], at[..., 1], at[..., 2]].sum(axis=1)
    colors = np.rint(tints[:, :3] / np.maximum(tints[:, 3:], 1e-12)).astype(np.uint8)
    quads = np.concatenate(list(_quads(inside, known, crossed)))
    keys = (cells[:, 0] * shape[1] + cells[:, 1]) * shape[2] + cells[:, 2]
    return _SurfaceNets(keys, vertices.astype(np.float32), colors, quads)


def _quads(
    inside: NDArray[np.bool_], known: NDArray[np.bool_], crossed: NDArray[np.bool_]
) -> Iterator[NDArray[np.int64]]:
    """Yields (Q, 4) the cells around each voxel edge that crosses the surface, counterclockwise from free space.

    Edges of the first layer along x are skipped, because they belong to the previous slab.
    """
    steps = np.array([inside.shape[1] * inside.shape[2], inside.shape[2], 1])
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        begin, end = [1, 1, 1], [n - 1 for n in inside.shape]
        here = tuple(slice(a, b) for a, b in zip(begin, end))
        there = tuple(slice(a + (i == axis), b + (i == axis)) for i, (a, b) in enumerate(zip(begin, end)))
        changes = (inside[here] != inside[there]) & known[here] & known[there]
        edges = np.argwhere(changes) + 1
        one, other = np.eye(3, dtype=int)[[u, v]]
        corners = [edges - p * one - q * other for p, q in ((1, 1), (0, 1), (0, 0), (1, 0))]
        full = np.logical_and.reduce([crossed[tuple(c.T)] for c in corners])
        found = np.stack([c[full] @ steps for c in corners], axis=1)
        flip = ~inside[tuple(edges[full].T)]
        found[flip] = found[flip][:, ::-1]
        yield found


def _without_specks(surface: Surface) -> Surface:
    """Drops separate parts with few triangles, and vertices without triangles."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    t, n = surface.triangles, len(surface.vertices)
    ends = np.concatenate([t[:, [0, 1]], t[:, [1, 2]]])
    _, part = connected_components(coo_matrix((np.ones(len(ends), bool), ends.T), shape=(n, n)), directed=False)
    sizes = np.bincount(part[t[:, 0]], minlength=part.max() + 1)
    t = t[sizes[part[t[:, 0]]] >= _FEW]
    used, back = np.unique(t, return_inverse=True)
    return Surface(surface.vertices[used], back.reshape(-1, 3), surface.colors[used])
