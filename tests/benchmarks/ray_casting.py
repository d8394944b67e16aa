"""Measure the voxels per second that rays traverse on one core, compared with traversal without memory access.

python -m tests.benchmarks.ray_casting
"""

from __future__ import annotations

import json
import time

import numpy as np
from numba import njit

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.occupancy.heights import Heights
from nvsim.occupancy.ray_grid import RayGrid
from tests.benchmarks.harness import best

RAYS, LENGTH, RESOLUTION = 1_000_000, 5.0, 0.05


@njit(error_model="numpy")
def bare_steps(start: np.ndarray, ends: np.ndarray) -> tuple[int, int]:
    """Counts the voxels that rays from `start` (3,) to `ends` (N, 3) traverse, in units of voxels, without memory
    access. The second result prevents the compiler from removing the loop."""
    steps, seen = 0, 0
    for i in range(len(ends)):
        x, y, z = start[0], start[1], start[2]
        dx, dy, dz = ends[i, 0] - x, ends[i, 1] - y, ends[i, 2] - z
        c, r, level = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        left = (
            abs(int(np.floor(ends[i, 0])) - c)
            + abs(int(np.floor(ends[i, 1])) - r)
            + abs(int(np.floor(ends[i, 2])) - level)
        )
        step_c, step_r, step = (1 if dx > 0 else -1), (1 if dy > 0 else -1), (1 if dz > 0 else -1)
        next_c, next_r = ((c + (step_c > 0)) - x) / dx, ((r + (step_r > 0)) - y) / dy
        next_z = ((level + (step > 0)) - z) / dz
        size_c, size_r, size_z = 1 / abs(dx), 1 / abs(dy), 1 / abs(dz)
        steps += left
        while left > 0:
            left -= 1
            if next_z <= next_c and next_z <= next_r:
                level, next_z = level + step, next_z + size_z
            elif next_c < next_r:
                c, next_c = c + step_c, next_c + size_c
            else:
                r, next_r = r + step_r, next_r + size_r
            seen ^= (r * 4096 + c) * 64 + level
    return steps, seen


def main() -> None:
    rng = np.random.default_rng(0)
    origin = np.array([0.013, 0.021, 0.807])
    results = {}
    for name, flat in (("all around", 1.0), ("along the band", 0.05)):
        directions = rng.normal(size=(RAYS, 3)) * [1, 1, flat]
        points = origin + LENGTH * directions / np.linalg.norm(directions, axis=1, keepdims=True)
        low, high = np.array([-6.0, -6.0]), np.array([6.0, 6.0])
        grid = RayGrid(low, high, RESOLUTION, FloorSurface.flat(0.0), Heights())
        grid.add(points[:1000], origin)
        before = grid.steps
        grid.add(points, origin)
        steps = grid.steps - before
        cast = best(lambda grid=grid, points=points: grid.add(points, origin), 3, time.process_time)  # type: ignore[misc]
        scaled = points / RESOLUTION
        bare_steps(origin / RESOLUTION, scaled[:1000])
        start = origin / RESOLUTION
        bare = best(lambda start=start, scaled=scaled: bare_steps(start, scaled), 3, time.process_time)  # type: ignore[misc]
        all_steps, _ = bare_steps(origin / RESOLUTION, scaled)
        results[name] = {
            "rays": RAYS,
            "seconds": round(cast, 2),
            "million_steps": round(steps / 1e6, 1),
            "million_steps_per_second": round(steps / cast / 1e6, 1),
            "bare_million_steps_per_second": round(all_steps / bare / 1e6, 1),
        }
    print(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
