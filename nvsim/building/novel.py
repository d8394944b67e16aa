"""Novel views beside the trajectory of a building, turned away from it. No frame shows whether a model is correct
there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.building.scene import CAMERA_HEIGHT, Scene
from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.occupancy.paths import clearance
from nvsim.occupancy.types import FREE, OccupancyMap

COUNT = {"full": 40, "small": 12, "halls": 60}
BESIDE = (0.3, 0.8)
"""Least and greatest distance from the nearest frame of the trajectory, meters: no wall fits in between."""
TURNED = (35.0, 145.0)
"""Least and greatest angle to that frame's heading, degrees, to either side."""
ROOM = 0.35
"""Meters of free floor around the camera."""


def novel_cameras(scene: Scene, occupancy: OccupancyMap, rng: np.random.Generator, storey: int = 0) -> list[Camera]:
    """Level cameras at the height of the trajectory, spread evenly over the free floor beside it on a storey."""
    level = scene.storeys[storey].floor
    walk = scene.walk[scene.walk[:, 3] == level]
    free = np.argwhere((occupancy.cells == FREE) & (clearance(occupancy) >= ROOM))
    places = occupancy.centres()[free[:, 0], free[:, 1]]
    if scene.plan.flight is not None:
        hole = scene.plan.flight.rect.grown(0.1)
        places = places[[not hole.contains(x, y) for x, y in places]]
    distance, nearest = cKDTree(walk[:, :2]).query(places)
    allowed = np.flatnonzero((distance >= BESIDE[0]) & (distance <= BESIDE[1]))
    chosen = _spread(places[allowed], min(COUNT[scene.config.size], len(allowed)), rng)
    cameras = []
    for i in allowed[chosen]:
        turn = np.radians(rng.uniform(*TURNED)) * rng.choice([-1.0, 1.0])
        pose = look(np.array([*places[i], level + CAMERA_HEIGHT]), float(walk[nearest[i], 2] + turn))
        cameras.append(Camera(scene.camera(0).intrinsics, np.round(pose, 9) + 0.0))
    return cameras


def _spread(places: NDArray[np.float64], count: int, rng: np.random.Generator) -> list[int]:
    """Indices in farthest-point order: each of the places (N, 2) is as far from those before it as possible."""
    if count == 0:
        return []
    chosen = [int(rng.integers(len(places)))]
    distance = np.linalg.norm(places - places[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return chosen


def listing(k: Intrinsics, cameras: list[Camera]) -> str:
    """The text of `holdout_frames.txt`: the name and the row-major camera pose of every view."""
    lines = [
        "# novel views: name, 16 numbers of the row-major 4x4 camera-to-world (OpenCV axes: x right, y down, z forward;"
        " world meters, z up)",
        f"# PINHOLE {k.width} {k.height} fx {k.fx:.6f} fy {k.fy:.6f} cx {k.cx} cy {k.cy}"
        " (pixel centers at +0.5); no people, no sensor noise",
    ]
    for i, camera in enumerate(cameras):
        numbers = " ".join(f"{v:.9g}" for v in camera.camera_to_world.ravel())
        lines.append(f"novel/{i:03d}.png {numbers}")
    return "\n".join(lines) + "\n"
