"""Writes a project of any size for measurements of the window.

The project has rooms in a row, each a submap with a model of random Gaussians. It also has a trajectory, a graph, a map
and a point cloud, but no images.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.benchmarks.random_room import random_room
from nvsim.capture.store import save_capture
from nvsim.capture.types import Alignment, Capture, Cloud, Frame
from nvsim.geometry.camera import camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.lens import Lens
from nvsim.graph.types import Edge, NavGraph, Viewpoint, edge
from nvsim.occupancy.ros import write_ros_map
from nvsim.occupancy.types import FREE, OCCUPIED, OccupancyMap
from nvsim.project.layout import Layout
from nvsim.project.project import Project
from nvsim.splats.files import save_model
from nvsim.splats.types import SubmapModel
from nvsim.submaps.split import Submap

ROOM = (10.0, 8.0)  # meters, as in random_room
EYE = 1.5
FRAMES = 60  # per submap
CLOUD = 200_000


@dataclass(frozen=True)
class ProjectSize:
    """The size of the project.

    submaps      number of rooms
    gaussians    Gaussians per room
    viewpoints   viewpoints of the graph, in a grid of about one meter; it has about four times as many edges
    """

    submaps: int = 3
    gaussians: int = 300_000
    viewpoints: int = 10_000


def write_project(folder: Path, size: ProjectSize) -> Path:
    """Creates the project at `folder` and returns `folder`. Raises InputError if the folder cannot be written or
    contains other files."""
    capture, submaps = _make_capture(size.submaps)
    with Project.create_or_open(folder) as project:
        save_capture(capture, project.layout.imported)
        project.set_submaps(submaps)
        project.set_graph(_graph(size))
        project.layout.ground_truth.mkdir(exist_ok=True)
        write_ros_map(_occupancy(size.submaps), project.layout.ground_truth / "map.yaml")
    room = random_room(size.gaussians)
    for submap in submaps:
        means = room.means + np.array([submap.index * ROOM[0], 0, 0], np.float32)
        info: dict[str, object] = {"gaussians": size.gaussians}
        model = SubmapModel(replace(room, means=means), None, None, FloorSurface.flat(0.0), True, info)
        save_model(model, Layout(folder).model(submap.index))
    return folder


def _make_capture(rooms: int) -> tuple[Capture, tuple[Submap, ...]]:
    lens = Lens("PINHOLE", 640, 480, (400.0, 400.0, 320.0, 240.0))
    turn = np.linspace(0, 2 * math.pi, FRAMES, endpoint=False)
    frames: list[Frame] = []
    submaps: list[Submap] = []
    for room in range(rooms):
        # Around the furniture; cameras look along the direction of motion.
        x, y = (room + 0.5) * ROOM[0] + 3.6 * np.cos(turn), 4.9 + 1.6 * np.sin(turn)
        positions = np.stack([x, y, np.full(FRAMES, EYE)], axis=1)
        first = len(frames)
        for i, at in enumerate(positions):
            name = f"images/{first + i:05d}.jpg"
            heading = math.atan2(-3.6 * math.sin(turn[i]), 1.6 * math.cos(turn[i]))
            frames.append(
                Frame(name, Path("/nowhere") / name, lens, camera_pose(at, heading, -0.1), timestamp=float(first + i))
            )
        core = tuple(range(first, first + FRAMES))
        submaps.append(Submap(room, core, core, positions))
    points = random_room(CLOUD // rooms).means
    cloud = np.concatenate([points + np.array([r * ROOM[0], 0, 0], np.float32) for r in range(rooms)])
    return Capture(Path("/nowhere"), "nerfstudio", tuple(frames), Cloud(cloud), Alignment.identity()), tuple(submaps)


def _graph(size: ProjectSize) -> NavGraph:
    # One meter apart, as in graphs of buildings; many viewpoints are outside the rooms.
    columns = max(1, round(size.viewpoints**0.5))
    rows = max(1, round(size.viewpoints / columns))
    jitter = np.random.default_rng(0).uniform(-0.3, 0.3, (rows, columns, 2))
    at: NDArray[np.float64] = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1) + jitter
    at += np.array([size.submaps * ROOM[0] - columns, ROOM[1] - rows]) / 2
    viewpoints, edges = {}, {}
    names = [[_id(row, column) for column in range(columns)] for row in range(rows)]
    for row in range(rows):
        for column in range(columns):
            x, y = (float(v) for v in at[row, column])
            submap = min(max(int(x / ROOM[0]), 0), size.submaps - 1)
            viewpoints[names[row][column]] = Viewpoint(names[row][column], (x, y, EYE), EYE, submap, True, "step")
            for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
                if row + down < rows and 0 <= column + right < columns:
                    made: Edge = edge(names[row][column], names[row + down][column + right])
                    edges[made.key] = made
    return NavGraph("bench", viewpoints, edges, {})


def _id(row: int, column: int) -> str:
    return f"{(row * 40503 + column + 1) * 2654435761 % 2**32:08x}{row:012x}{column:012x}"


def _occupancy(rooms: int) -> OccupancyMap:
    resolution = 0.05
    columns, rows = round((rooms * ROOM[0] + 2) / resolution), round((ROOM[1] + 2) / resolution)
    x = -1 + (np.arange(columns) + 0.5) * resolution
    y = -1 + (np.arange(rows) + 0.5) * resolution
    gx, gy = np.meshgrid(x, y)
    inside = (gx > 0) & (gx < rooms * ROOM[0]) & (gy > 0) & (gy < ROOM[1])
    in_room = np.mod(gx, ROOM[0])
    desk = (in_room > 3.5) & (in_room < 5.5) & (gy > 3) & (gy < 4.2)
    cells = np.full((rows, columns), OCCUPIED)
    cells[inside & ~desk & (in_room > 0.1) & (in_room < ROOM[0] - 0.1)] = FREE
    return OccupancyMap(cells, resolution, (-1.0, -1.0))
