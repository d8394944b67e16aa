"""People in front of the camera, each during a few frames of the trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.building.raycast import Solids, trace

_SHIRTS = ((0.75, 0.22, 0.20), (0.20, 0.35, 0.68), (0.85, 0.70, 0.25), (0.25, 0.52, 0.34), (0.82, 0.82, 0.84))
_TROUSERS = ((0.16, 0.18, 0.26), (0.36, 0.30, 0.24), (0.28, 0.28, 0.30))
_SKINS = ((0.82, 0.64, 0.52), (0.55, 0.38, 0.28), (0.70, 0.52, 0.40))


@dataclass(frozen=True, eq=False)
class Person:
    """A person made of vertical capsules.

    capsules  (P, 5) x, y, lower and upper center height, radius; meters
    colors    (P, 3) RGB, 0 to 1
    first     first frame in which the person is present
    last      last frame in which the person is present
    """

    capsules: NDArray[np.float64]
    colors: NDArray[np.float64]
    first: int
    last: int


def place_people(walk: NDArray[np.float64], solids: Solids, rng: np.random.Generator) -> tuple[Person, ...]:
    """One person per about 70 frames of the trajectory `walk` (M, 5). Each is 1.8 to 4 m in front of the camera, for 5
    to 9 frames."""
    people = []
    count = max(1, len(walk) // 70)
    for k in range(count):
        for _ in range(200):
            first = int((k + rng.uniform(0.1, 0.8)) * len(walk) / count)
            last = min(first + int(rng.integers(5, 10)), len(walk) - 1)
            x, y, heading, floor, _ = walk[(first + last) // 2]
            angle, distance = heading + rng.uniform(-0.35, 0.35), rng.uniform(1.8, 4.0)
            px, py = round(x + distance * np.sin(angle), 3), round(y + distance * np.cos(angle), 3)
            if _stands_free(px, py, walk[first : last + 1], solids):
                people.append(dressed(px, py, floor, first, last, rng))
                break
    return tuple(people)


def _stands_free(px: float, py: float, views: NDArray[np.float64], solids: Solids) -> bool:
    """Whether a place is away from furniture and the trajectory, and visible from the middle one of the `views` (K, 5).
    All views must be on the floor of the place."""
    x, y, _, floor, _ = views[len(views) // 2]
    ceiling = solids.levels[np.isclose(solids.levels[:, 0], floor), 1]
    if not len(ceiling) or np.ptp(views[:, 3]) > 0:
        return False
    here = (solids.lo[:, 2] < ceiling[0]) & (solids.hi[:, 2] > floor)
    gap = np.maximum(np.maximum(solids.lo[here, :2] - (px, py), (px, py) - solids.hi[here, :2]), 0)
    if np.hypot(gap[:, 0], gap[:, 1]).min() < 0.35 or np.hypot(views[:, 0] - px, views[:, 1] - py).min() < 1.0:
        return False
    distance = float(np.hypot(px - x, py - y))
    t, _, glass = trace(x, y, floor + 1.3, (px - x) / distance, (py - y) / distance, 0.0, solids, np.empty((0, 5)))
    return bool(min(t, glass) > distance)


def dressed(x: float, y: float, floor: float, first: int, last: int, rng: np.random.Generator) -> Person:
    """A person who stands at (x, y) meters on a floor at height `floor`, in random clothes."""
    tall = rng.uniform(0.94, 1.06)
    side = rng.uniform(0, np.pi)
    c, s = np.cos(side), np.sin(side)
    shirt, trousers = _SHIRTS[int(rng.integers(5))], _TROUSERS[int(rng.integers(3))]
    skin = _SKINS[int(rng.integers(3))]
    parts = [
        (-0.10, 0.08, 0.80, 0.085, trousers),
        (0.10, 0.08, 0.80, 0.085, trousers),
        (0.00, 0.95, 1.30, 0.175, shirt),
        (-0.23, 0.85, 1.36, 0.055, shirt),
        (0.23, 0.85, 1.36, 0.055, shirt),
        (0.00, 1.50, 1.62, 0.095, skin),
        (0.00, 1.62, 1.66, 0.105, (0.18, 0.14, 0.11)),
    ]
    capsules = np.array([(x + u * c, y + u * s, floor + z0 * tall, floor + z1 * tall, r) for u, z0, z1, r, _ in parts])
    return Person(np.round(capsules, 4), np.array([p[4] for p in parts]), first, last)
