"""A room of random Gaussians for measurements without a file."""

from __future__ import annotations

import numpy as np

from nvsim.splats.types import Gaussians


def random_room(count: int) -> Gaussians:
    """`count` Gaussians of SH degree 3 on the surfaces of a room of 10 x 8 x 3 m and of its furniture. About 3 % are in
    the air. Their size decreases with their number, so that the surfaces remain covered."""
    r = np.random.default_rng(7)
    boxes = [((0, 0, 0), (10, 8, 3)), ((3.5, 3, 0), (5.5, 4.2, 0.75)), ((0.3, 0.3, 0), (1, 2.3, 2))]
    boxes += [((7.5, 5.5, 0), (9.7, 7.7, 0.5)), ((8.8, 1, 0), (9.9, 3, 0.9)), ((2, 6.8, 0), (4.5, 7.8, 0.8))]
    low, size = np.array([b[0] for b in boxes], float), np.array([np.subtract(b[1], b[0]) for b in boxes])
    area = np.stack([size[:, (a + 1) % 3] * size[:, (a + 2) % 3] for a in range(3)], 1).repeat(2, 1)
    area[1:] *= 2.5
    face = r.choice(area.size, count, p=(area / area.sum()).ravel())
    box, side = np.divmod(face, 6)
    axis, end = np.divmod(side, 2)
    at = r.random((count, 3))
    at[np.arange(count), axis] = end + r.normal(0, 0.002, count)
    air = r.random(count) < 0.03
    means = np.where(air[:, None], r.random((count, 3)) * [10, 8, 3], low[box] + at * size[box])
    spread = np.clip(0.035 * (100_000 / count) ** 0.5, 0.012, 0.08)
    scales = np.exp(r.normal(np.log(spread), 0.4, (count, 3))).clip(0.003, 0.25)
    scales[np.arange(count), axis] *= 0.25
    spin, quats = r.uniform(0, np.pi, count), np.zeros((count, 4))
    quats[:, 0], quats[np.arange(count), 1 + axis] = np.cos(spin), np.sin(spin)
    opacity = np.where(r.random(count) < 0.85, r.uniform(0.3, 0.99, count), r.uniform(0.02, 0.3, count))
    arrays = (means, np.log(scales), quats, np.log(opacity / (1 - opacity)), r.normal(0, 0.2, (count, 16, 3)))
    return Gaussians(*(np.ascontiguousarray(a, np.float32) for a in arrays))
