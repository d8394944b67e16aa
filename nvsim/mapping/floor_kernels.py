"""The kernels of `FloorPixels` and `TraversedFloor`. Import this module only where a kernel is called, because numba
loads
slowly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.kernels import njit


@njit(cache=True, nogil=True, error_model="numpy")
def project(
    points: NDArray[np.float64],  # (rows, cells, 3) meters, world
    pose: NDArray[np.float64],  # (4, 4) world to camera
    view: NDArray[np.float64],  # (4,) focal lengths and principal point, pixels
    pixels: NDArray[np.float64],  # (rows, cells, 2) out
    depth: NDArray[np.float64],  # (rows, cells) out, meters along the optical axis
) -> None:
    """Project points (rows, cells, 3) to pixels (rows, cells, 2) as `Camera.project` does. numpy takes many times as
    long for a few hundred points."""
    for i in range(points.shape[0]):
        for j in range(points.shape[1]):
            x, y, z = points[i, j]
            across = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]
            along = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]
            far = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
            depth[i, j] = far
            safe = 1e-9 if abs(far) < 1e-9 else far
            pixels[i, j, 0] = view[0] * across / safe + view[2]
            pixels[i, j, 1] = view[1] * along / safe + view[3]


@njit(cache=True, nogil=True, error_model="numpy")
def locate_points(
    pixels: NDArray[np.float64],  # (rows, cells, 2)
    depth: NDArray[np.float64],  # (rows, cells)
    height: int,
    width: int,
    wraps: bool,  # whether the last column is beside the first, and every point is inside
    inside: NDArray[np.bool_],  # this and the following as in FloorPixels, out
    corners: NDArray[np.int64],
    across: NDArray[np.float64],
    along: NDArray[np.float64],
) -> None:
    """Find the four pixels around each projected point (rows, cells, 2), and the position of the point between them."""
    for i in range(pixels.shape[0]):
        for j in range(pixels.shape[1]):
            u, v = pixels[i, j]
            inside[i, j] = wraps or (depth[i, j] > 0 and -1 < u < width + 1 and -1 < v < height + 1)
            if not inside[i, j]:
                corners[:, i, j], across[i, j], along[i, j] = 0, 0.0, 0.0
                continue
            # Pixel centers are at half-integer coordinates.
            u = (u - 0.5) % width if wraps else min(max(u - 0.5, 0.0), width - 1.0)
            v = min(max(v - 0.5, 0.0), height - 1.0)
            left, v0 = np.floor(u), int(v)
            u0 = int(left) % width  # rounding can make the remainder equal to the width
            u1 = (u0 + 1) % width if wraps else min(u0 + 1, width - 1)
            upper, lower = v0 * width, min(v0 + 1, height - 1) * width
            corners[0, i, j], corners[1, i, j] = upper + u0, upper + u1
            corners[2, i, j], corners[3, i, j] = lower + u0, lower + u1
            across[i, j], along[i, j] = u - left, v - v0


@njit(cache=True, nogil=True)
def mark_pixels(corners: NDArray[np.int64], inside: NDArray[np.bool_], image: NDArray[np.bool_]) -> None:
    """Set the pixels that points (rows, cells) inside the image are read from to True in an image (H, W)."""
    flat = image.reshape(-1)
    for i in range(inside.shape[0]):
        for j in range(inside.shape[1]):
            if inside[i, j]:
                for k in range(4):
                    flat[corners[k, i, j]] = True


@njit(cache=True, nogil=True)
def are_marked(corners: NDArray[np.int64], inside: NDArray[np.bool_], image: NDArray[np.bool_]) -> bool:
    """Whether all pixels that points (rows, cells) inside the image are read from are True in an image (H, W)."""
    flat = image.reshape(-1)
    for i in range(inside.shape[0]):
        for j in range(inside.shape[1]):
            for k in range(4):
                if inside[i, j] and not flat[corners[k, i, j]]:
                    return False
    return True


@njit(cache=True, nogil=True)
def read(
    image: NDArray[np.float32],  # (H, W)
    corners: NDArray[np.int64],  # this and the next as in FloorPixels
    across: NDArray[np.float64],
    along: NDArray[np.float64],
    inside: NDArray[np.bool_],
    outside: float,
    found: NDArray[np.float64],  # (rows, cells) out
) -> None:
    """Interpolate an image (H, W) at points (rows, cells); points that are not inside get `outside`."""
    flat = image.reshape(-1)
    for i in range(inside.shape[0]):
        for j in range(inside.shape[1]):
            if not inside[i, j]:
                found[i, j] = outside
                continue
            u, v = across[i, j], along[i, j]
            top = flat[corners[0, i, j]] * (1 - u) + flat[corners[1, i, j]] * u
            bottom = flat[corners[2, i, j]] * (1 - u) + flat[corners[3, i, j]] * u
            found[i, j] = top * (1 - v) + bottom * v


@njit(cache=True, nogil=True)
def mark_traversed(
    points: NDArray[np.float64],  # (N, 3) meters, world
    places: NDArray[np.float64],  # (P, 3) positions of carried cameras, square by square
    first: NDArray[np.int64],  # (squares + 1,) index of the first place of each square, counted along x, then along y
    low: tuple[float, float],  # the corner of the first square
    side: float,  # side of a square, at least `reach`
    columns: int,  # number of squares along x
    reach: float,  # meters along the ground
    least: float,  # minimum and maximum meters of the nearest camera above the point
    most: float,
    found: NDArray[np.bool_],  # (N,) out
) -> None:
    """Test for each of the points (N, 3) whether the nearest of the cameras (P, 3) within `reach` is over it."""
    rows = (len(first) - 1) // columns
    for i in range(len(points)):
        x, y, z = points[i]
        column, row = int(np.floor((x - low[0]) / side)), int(np.floor((y - low[1]) / side))
        nearest, over = reach * reach, 0.0
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(column - 1, 0), min(column + 2, columns)):
                square = r * columns + c
                for k in range(first[square], first[square + 1]):
                    dx, dy = x - places[k, 0], y - places[k, 1]
                    away = dx * dx + dy * dy
                    if away < nearest:
                        nearest, over = away, places[k, 2] - z
        found[i] = least < over < most
