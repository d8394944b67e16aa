"""Synthetic splats of a building: flat Gaussians on floors, walls, ceilings, and furniture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.rotation import quaternion_from_matrix
from nvsim.splats.turning import transform_gaussians
from nvsim.splats.types import Gaussians

HEIGHT = 2.7
_SPACING = 0.08


def rectangle(corner: object, u: object, v: object, spacing: float = _SPACING) -> Gaussians:
    """Opaque flat Gaussians on the parallelogram from `corner` along the orthogonal edges `u` and `v`, all (3,)."""
    at, u, v = (np.asarray(value, np.float64) for value in (corner, u, v))
    a, b = float(np.linalg.norm(u)), float(np.linalg.norm(v))
    s, t = ((np.arange(max(1, round(n / spacing))) + 0.5) / max(1, round(n / spacing)) for n in (a, b))
    s, t = (grid.ravel() for grid in np.meshgrid(s, t))
    means = at + s[:, None] * u + t[:, None] * v
    axes = np.stack([u / a, v / b, np.cross(u / a, v / b)], axis=1)
    n = len(means)
    scales = np.log([0.6 * spacing, 0.6 * spacing, 0.004])
    color = np.tile(np.array([0.2, 0.1, 0.0], np.float32), (n, 1, 1))
    return Gaussians(
        means.astype(np.float32),
        np.tile(scales, (n, 1)).astype(np.float32),
        np.tile(quaternion_from_matrix(axes), (n, 1)).astype(np.float32),
        np.full(n, 5.0, np.float32),
        color,
    )


def joined(*parts: Gaussians) -> Gaussians:
    """All Gaussians of `parts`."""
    fields = ("means", "log_scales", "quats", "opacity_logits", "sh")
    return Gaussians(*(np.ascontiguousarray(np.concatenate([getattr(p, f) for p in parts])) for f in fields))


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Gaussians:
    """The top and the sides of a box."""
    (x, y, z), (a, b, c) = low, high
    w, d, h = a - x, b - y, c - z
    return joined(
        rectangle((x, y, c), (w, 0, 0), (0, d, 0)),
        rectangle((x, y, z), (w, 0, 0), (0, 0, h)),
        rectangle((x, b, z), (w, 0, 0), (0, 0, h)),
        rectangle((x, y, z), (0, d, 0), (0, 0, h)),
        rectangle((a, y, z), (0, d, 0), (0, 0, h)),
    )


def table(x: float, y: float, z: float = 0.0) -> Gaussians:
    """A table top of 1.2 x 0.8 m, 0.75 m above z, with four legs."""
    legs = [box((x + dx, y + dy, z), (x + dx + 0.06, y + dy + 0.06, z + 0.72)) for dx in (0, 1.14) for dy in (0, 0.74)]
    return joined(rectangle((x, y, z + 0.75), (1.2, 0, 0), (0, 0.8, 0)), *legs)


def two_rooms(z: float = 0.0, table_at: tuple[float, float] = (1.0, 3.0), ceiling: bool = True) -> Gaussians:
    """Two rooms of 4 x 5 m with a doorway of 1 m between them, from (0, 0) to (8.1, 5), and a table in the first."""
    walls = [
        rectangle((0, 0, z), (8.1, 0, 0), (0, 0, HEIGHT)),
        rectangle((0, 5, z), (8.1, 0, 0), (0, 0, HEIGHT)),
        rectangle((0, 0, z), (0, 5, 0), (0, 0, HEIGHT)),
        rectangle((8.1, 0, z), (0, 5, 0), (0, 0, HEIGHT)),
    ]
    for x in (4.0, 4.1):
        walls.append(rectangle((x, 0, z), (0, 2, 0), (0, 0, HEIGHT)))
        walls.append(rectangle((x, 3, z), (0, 2, 0), (0, 0, HEIGHT)))
        walls.append(rectangle((x, 2, z + 2.05), (0, 1, 0), (0, 0, HEIGHT - 2.05)))
    flats = [rectangle((0, 0, z), (8.1, 0, 0), (0, 5, 0))]
    if ceiling:
        flats.append(rectangle((0, 0, z + HEIGHT), (8.1, 0, 0), (0, 5, 0)))
    return joined(*flats, *walls, table(*table_at, z), box((6.5, 0.2, z), (7.9, 2.2, z + 0.45)))


def any_rotation(seed: int = 1) -> NDArray[np.float64]:
    """(3, 3) a random proper rotation."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else q * np.array([1.0, 1.0, -1.0])


def moved(gaussians: Gaussians, rotation: NDArray[np.float64], scale: float) -> Gaussians:
    return transform_gaussians(gaussians, rotation, scale)


def stair_house() -> Gaussians:
    """Two storeys of two rooms, 3 m apart, joined by a straight stair of 16 steps along y in the second room."""
    rise, tread, x, y = 3.0 / 16, 0.26, 4.3, 0.8
    lower = without(two_rooms(), (x, y + 0.9, 2.6), (x + 1.1, y + 16 * tread, 2.8))
    upper = without(two_rooms(3.0), (x, y + 0.9, 2.9), (x + 1.1, y + 16 * tread, 3.1))
    steps = []
    for k in range(16):
        steps.append(rectangle((x, y + k * tread, (k + 1) * rise), (1.1, 0, 0), (0, tread, 0), 0.05))
        steps.append(rectangle((x, y + k * tread, k * rise), (1.1, 0, 0), (0, 0, rise), 0.05))
    return joined(lower, upper, *steps)


def without(g: Gaussians, low: tuple[float, float, float], high: tuple[float, float, float]) -> Gaussians:
    """The Gaussians outside a box."""
    rows = ~((g.means > low) & (g.means < high)).all(axis=1)
    return Gaussians(g.means[rows], g.log_scales[rows], g.quats[rows], g.opacity_logits[rows], g.sh[rows])
