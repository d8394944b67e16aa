"""The buffers of one view in the kernels, kept between frames, so that rendering allocates only the images."""

from __future__ import annotations

import threading

import numba
import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.kernels import njit
from nvsim.render import kernel_types
from nvsim.render.kernel_types import Float32, Int32, Int64, Mask, Whole, limit, pack
from nvsim.render.projection import project
from nvsim.render.projection_gradient import project_gradient
from nvsim.render.raster import draw
from nvsim.render.raster_gradient import GRADIENT_WIDTH, draw_gradient
from nvsim.render.tiles import find_tile_starts, scatter, sort
from nvsim.splats.types import Gaussians

LOCK = threading.RLock()
"""Held while kernels run: they use all cores, and not every threading layer of numba allows two callers. The kernels
release the interpreter lock, so a window stays responsive."""

Tint = tuple[Float32, Float32]
"""Features (N, F) and a matrix (3, F), whose product is added to SH coefficient 0 during projection. Features (0, F)
add nothing."""
NO_TINT: Tint = np.empty((0, 1), np.float32), np.empty((3, 1), np.float32)
_NO_DEPTH, _NO_NORMAL = np.empty((0, 0), np.float32), np.empty((0, 0, 3), np.float32)


def as_kernel_array(array: NDArray[np.floating]) -> Float32:
    """The array (any shape) in the form that the kernels expect: float32, C-contiguous, aligned, writable; a copy only
    if needed."""
    return np.require(array, np.float32, ["C", "A", "W"])


def tiles_of(mask: Mask) -> Mask:
    """(lines, columns) bool, the tiles in which `mask` (H, W) has a pixel."""
    height, width = mask.shape
    tiles = np.zeros((-(-height // kernel_types.TILE), -(-width // kernel_types.TILE)), np.bool_)
    _mark_tiles(np.asarray(mask), tiles)
    return tiles


@njit(cache=True, nogil=True)
def _mark_tiles(mask: Mask, tiles: Mask) -> None:
    for row in range(mask.shape[0]):
        for column in range(mask.shape[1]):
            if mask[row, column]:
                tiles[row // kernel_types.TILE, column // kernel_types.TILE] = True


def pixels_of(tiles: Mask, height: int, width: int) -> Mask:
    """(H, W) bool, the pixels of `tiles` (lines, columns)."""
    return tiles.repeat(kernel_types.TILE, axis=0).repeat(kernel_types.TILE, axis=1)[:height, :width]


class RenderBuffers:
    """The buffers of one view at a time. Call `project`, `bin`, and `draw`; then, for gradients, `draw_gradient` and
    `project_gradient`, which use the results of the first three.

    Not thread-safe; hold `LOCK` around calls. Images are repeatable with any number of threads
    (`numba.set_num_threads`), gradients with an equal number.
    """

    def __init__(self) -> None:
        self.count = 0
        self.threads = 1
        self._rows = np.empty((0, kernel_types.WIDTH), np.float32)
        self._ids = np.empty(0, np.int32)
        self._entries = 0
        self._pairs = np.empty(0, np.uint64)
        self._order = np.empty(0, np.int32)
        self._spare = np.empty((0, 0), np.uint64)
        self._gradients = np.empty((0, 0, GRADIENT_WIDTH), np.float32)
        self._cursors = np.empty((0, 0), np.int32)
        self._offsets = np.empty(0, np.int64)
        self._last = np.empty(0, np.int64)
        self._visible = np.empty(0, np.int32)
        self._view = np.empty(0, np.float32)
        self._everywhere = self._wanted = np.ones(0, np.bool_)
        self._degree = 0

    @property
    def visible(self) -> int:
        """Number of Gaussians that the last view draws."""
        return int(self._visible.sum())

    @property
    def intersections(self) -> int:
        """Number of pairs of a tile and a Gaussian in the last view."""
        return self._entries

    @property
    def drawn_entries(self) -> tuple[Float32, Int32, Int64, Int64, int]:
        """The data of the last `draw`, for measurements, in this order:

        - the splats (N, 16), and their rows in the order of the tiles (entries or more,)
        - the start of each tile (tiles + 1,), and the past-last entry that it drew (tiles,)
        - the number of tiles in a line
        """
        return self._rows[: self.count], self._order, self._offsets, self._last, self._columns

    @property
    def splats(self) -> tuple[Float32, Int32]:
        """The splats of the last view for other backends: rows (N, 16) with columns as in render.layout, and for each
        block b of B the number of rows (B,) at the start of its run, N * b // B. The next `project` overwrites both."""
        return self._rows[: self.count], self._visible

    def project(
        self,
        gaussians: Gaussians,
        camera: Camera,
        antialiased: bool,
        sh_degree: int | None = None,
        tiles: Mask | None = None,
        tint: Tint = NO_TINT,
    ) -> None:
        """Projects the Gaussians (arrays as from `ready`). `sh_degree` limits the evaluated degree. `tiles` (lines,
        columns) selects the tiles to draw, by default all. `tint` changes the colors."""
        k = camera.intrinsics
        n, self.threads = len(gaussians), numba.get_num_threads()
        self._columns, self._lines = -(-k.width // kernel_types.TILE), -(-k.height // kernel_types.TILE)
        count = self._columns * self._lines
        if len(self._rows) < n:
            self._rows = np.empty((_size_with_reserve(n), kernel_types.WIDTH), np.float32)
            self._ids = np.empty(_size_with_reserve(n), np.int32)
        if self._cursors.shape != (self.threads, count):
            self._cursors = np.empty((self.threads, count), np.int32)
            self._offsets = np.empty(count + 1, np.int64)
            self._last = np.empty(count, np.int64)
            self._visible = np.empty(self.threads, np.int32)
        self.count, self._view = n, pack(camera, antialiased)
        if tiles is None:
            if len(self._everywhere) < count:
                self._everywhere = np.ones(count, np.bool_)
            self._wanted = self._everywhere
        else:
            if tiles.shape != (self._lines, self._columns):
                raise ValueError(f"tiles have shape {tiles.shape}, but the image {self._lines}x{self._columns} tiles")
            self._wanted = np.ascontiguousarray(tiles, np.bool_).reshape(-1)
            limit(self._view, tiles)
        self._degree = min(gaussians.sh_degree, 3 if sh_degree is None else sh_degree)
        project(
            *gaussians.arrays,
            *tint,
            self._degree,
            self._view,
            self._wanted,
            self.threads,
            self._rows[:n],
            self._ids[:n],
            self._visible,
            self._cursors,
        )

    def bin(self) -> None:
        """Computes the order in which each tile draws the splats."""
        total, longest = find_tile_starts(self._cursors, self._offsets)
        self._entries = int(total)
        if len(self._pairs) < total:
            self._pairs = np.empty(_size_with_reserve(total), np.uint64)
            self._order = np.empty(_size_with_reserve(total), np.int32)
        if self._spare.shape[0] != self.threads or self._spare.shape[1] < longest:
            self._spare = np.empty((self.threads, _size_with_reserve(longest)), np.uint64)
        rows = self._rows[: self.count]
        scatter(
            rows,
            self.count,
            self._visible,
            self._wanted,
            self._cursors,
            self._columns,
            self._lines,
            self._pairs,
        )
        sort(self._pairs, self._offsets, self.threads, self._spare, self._order)

    def draw(self, height: int, width: int, geometry: bool) -> tuple[Float32, Float32, Float32, Float32]:
        """rgb (H, W, 3), transmittance (H, W), and with `geometry` the weighted sums of depth (H, W) and of world
        normals (H, W, 3), else empty arrays."""
        rgb, transmittance = np.empty((height, width, 3), np.float32), np.empty((height, width), np.float32)
        depth, normal = _NO_DEPTH, _NO_NORMAL
        if geometry:
            depth, normal = np.empty((height, width), np.float32), np.empty((height, width, 3), np.float32)
        rows = self._rows[: self.count]
        draw(rows, self._order, self._offsets, self.threads, geometry, rgb, transmittance, depth, normal, self._last)
        return rgb, transmittance, depth, normal

    def draw_gradient(self, transmittance: Float32, d_rgb: Float32, d_alpha: Float32, d_depth: Float32) -> None:
        """Computes the gradients of the splats from those of the images: `d_rgb` (H, W, 3), `d_alpha` (H, W), and
        `d_depth` (H, W). `transmittance` (H, W) is that of `draw`."""
        if self._gradients.shape[0] != self.threads or self._gradients.shape[1] < self.count:
            self._gradients = np.empty((self.threads, _size_with_reserve(self.count), GRADIENT_WIDTH), np.float32)
        draw_gradient(
            self._rows[: self.count],
            self._order,
            self._offsets,
            self._last,
            self._visible,
            self.threads,
            transmittance,
            d_rgb,
            d_alpha,
            d_depth,
            self._gradients,
        )

    def project_gradient(
        self,
        gaussians: Gaussians,
        gradients: Gaussians,
        statistics: Float32,
        tint: Tint = NO_TINT,
        d_features: Float32 = NO_TINT[0],
    ) -> Float32:
        """Computes the gradients of the Gaussians from those of the splats, and writes them to `gradients`. With a
        `tint`, the gradient of its features is written to `d_features` (N, F), and that of its matrix (3, F) is
        returned."""
        d_matrix = np.empty((self.threads, *tint[1].shape), np.float32)
        project_gradient(
            *gaussians.arrays,
            *tint,
            self._degree,
            self._view,
            self.threads,
            self._rows[: self.count],
            self._ids[: self.count],
            self._visible,
            self._gradients,
            *gradients.arrays,
            d_features,
            d_matrix,
            statistics,
        )
        return np.asarray(d_matrix.sum(axis=0), np.float32)


def _size_with_reserve(needed: Whole) -> int:
    # A quarter more than requested, so that a scene that grows step by step does not allocate at every step.
    return int(needed) + int(needed) // 4 + 64
