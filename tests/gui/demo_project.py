"""The demo room as a project on disk, with Gaussians on its walls and furniture and a texture on its floor."""

from __future__ import annotations

import math
from pathlib import Path

import demo_room
import numpy as np

from nvsim.capture.store import save_capture
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.occupancy.ros import write_ros_map
from nvsim.project.layout import Layout
from nvsim.project.project import Project
from nvsim.splats.files import save_model
from nvsim.splats.harmonics import DC
from nvsim.splats.types import FloorTexture, Gaussians, SubmapModel


def surfaces() -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Rectangles as (corner, side, side, color): the four walls and the faces of the furniture."""
    w, d, h = demo_room.WIDTH, demo_room.DEPTH, demo_room.HEIGHT
    walls = [
        ((0, 0, 0), (w, 0, 0), (0, 0, h), (0.83, 0.80, 0.74)),
        ((0, d, 0), (w, 0, 0), (0, 0, h), (0.70, 0.74, 0.72)),
        ((0, 0, 0), (0, d, 0), (0, 0, h), (0.80, 0.77, 0.70)),
        ((w, 0, 0), (0, d, 0), (0, 0, h), (0.74, 0.78, 0.80)),
    ]
    for low, high, color in demo_room.FURNITURE:
        x, y, z = np.subtract(high, low)
        walls += [
            (low, (x, 0, 0), (0, 0, z), color),
            ((low[0], high[1], 0), (x, 0, 0), (0, 0, z), color),
            (low, (0, y, 0), (0, 0, z), color),
            ((high[0], low[1], 0), (0, y, 0), (0, 0, z), color),
            ((low[0], low[1], high[2]), (x, 0, 0), (0, y, 0), tuple(min(1.0, 1.2 * c) for c in color)),
        ]
    return [tuple(np.array(v, np.float64) for v in wall) for wall in walls]  # type: ignore[misc]


def gaussians(count: int, seed: int = 3) -> Gaussians:
    rng = np.random.default_rng(seed)
    rectangles = surfaces()
    areas = np.array([np.linalg.norm(np.cross(a, b)) for _, a, b, _ in rectangles])
    numbers = np.maximum(4, (count * areas / areas.sum()).astype(int))
    size = math.sqrt(areas.sum() / numbers.sum()) * 0.75
    means, colors, quats = [], [], []
    half = math.sqrt(0.5)
    for (corner, a, b, color), number in zip(rectangles, numbers, strict=True):
        u, v = rng.random(number), rng.random(number)
        means.append(corner + u[:, None] * a + v[:, None] * b)
        wave = 0.9 + 0.1 * np.sin(9 * u * np.linalg.norm(a)) * np.sin(7 * v)
        colors.append(color * wave[:, None] + rng.normal(0, 0.015, (number, 3)))
        axis = int(np.argmax(np.abs(np.cross(a, b))))
        quats.append(np.tile([(half, 0, half, 0), (half, half, 0, 0), (1, 0, 0, 0)][axis], (number, 1)))
    n = int(numbers.sum())
    scales = np.tile(np.log([size, size, 0.01]), (n, 1)) + rng.normal(0, 0.1, (n, 3))
    return Gaussians(
        np.concatenate(means).astype(np.float32),
        scales.astype(np.float32),
        np.concatenate(quats).astype(np.float32),
        np.full(n, 4.0, np.float32),
        ((np.concatenate(colors) - 0.5) / DC)[:, None].astype(np.float32),
    )


def floor_texture() -> FloorTexture:
    x, y = np.meshgrid(np.arange(0.05, demo_room.WIDTH, 0.1), np.arange(0.05, demo_room.DEPTH, 0.1))
    tiles = (np.floor(x * 2) + np.floor(y * 2)) % 2
    colors = np.array([0.58, 0.50, 0.42]) * (0.82 + 0.18 * tiles[..., None])
    return FloorTexture((colors.astype(np.float32),), (0.0, 0.0), (demo_room.WIDTH, demo_room.DEPTH))


def write_project(folder: Path, count: int = 20_000, models: int = 4, with_graph: bool = True) -> Path:
    """A project at `folder` with `count` Gaussians in each of the first `models` submaps."""
    walk = demo_room.capture()
    parts = demo_room.submaps(walk)
    with Project.create_or_open(folder) as project:
        save_capture(walk, project.layout.imported)
        project.set_submaps(parts)
        if with_graph:
            project.set_graph(demo_room.graph(parts))
        write_ros_map(demo_room.occupancy(), project.layout.ground_truth / "map.yaml")
    for submap in parts[:models]:
        write_model(folder, submap.index, count)
    return folder


def write_model(folder: Path, index: int, count: int) -> None:
    """The model of one submap, as training leaves it."""
    info: dict[str, object] = {"psnr": 28.0 + index, "gaussians": count, "preset": "nvsim"}
    model = SubmapModel(gaussians(count, index), None, floor_texture(), FloorSurface.flat(0.0), True, info)
    save_model(model, Layout(folder).model(index))


if __name__ == "__main__":
    import sys

    write_project(Path(sys.argv[1]), int(sys.argv[2]))
