"""A small building made of numpy alone: capture, submaps, graph with evidence, occupancy, jobs, and a renderer that
casts rays against boxes. Values for tests and pictures of the window."""

from __future__ import annotations

import hashlib
import math
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from nvsim.capture.types import Alignment, Capture, Frame
from nvsim.geometry.camera import Camera, camera_pose
from nvsim.geometry.lens import Lens
from nvsim.graph.types import Evidence, NavGraph, Viewpoint, edge
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from nvsim.render.backends import RenderOutput
from nvsim.submaps.split import Submap
from nvsim_app.drawing.painter import Renderer
from nvsim_app.state.loading import Contents

WIDTH, DEPTH, HEIGHT, EYE = 14.0, 9.0, 2.8, 1.5
# Boxes that stand in the room: low corner, high corner, color.
FURNITURE = (
    ((3.0, 3.2, 0.0), (4.8, 4.2, 0.75), (0.55, 0.38, 0.24)),
    ((8.6, 2.0, 0.0), (9.2, 4.8, 1.9), (0.35, 0.42, 0.55)),
    ((11.4, 6.2, 0.0), (13.0, 7.4, 0.5), (0.62, 0.30, 0.28)),
    ((6.0, 6.6, 0.0), (7.4, 7.4, 1.1), (0.36, 0.50, 0.36)),
)


def capture(frames: int = 120) -> Capture:
    turn = np.linspace(0, 2 * math.pi, frames, endpoint=False)
    x, y = WIDTH / 2 + 5.2 * np.cos(turn), DEPTH / 2 + 3.1 * np.sin(turn)
    lens = Lens("PINHOLE", 640, 480, (400.0, 400.0, 320.0, 240.0))
    made = []
    for i in range(frames):
        heading = math.atan2(-5.2 * math.sin(turn[i]), 3.1 * math.cos(turn[i]))
        pose = camera_pose(np.array([x[i], y[i], EYE]), heading, math.radians(-8))
        made.append(Frame(f"images/frame_{i:05d}.jpg", Path(f"/nowhere/frame_{i:05d}.jpg"), lens, pose))
    return Capture(Path("/nowhere"), "nerfstudio", tuple(made), None, Alignment.identity())


def submaps(of: Capture, count: int = 4) -> tuple[Submap, ...]:
    parts = np.array_split(np.arange(len(of.frames)), count)
    result = []
    for i, part in enumerate(parts):
        core = tuple(int(f) for f in part)
        shared = {(core[0] - 1 - k) % len(of.frames) for k in range(4)}
        shared |= {(core[-1] + 1 + k) % len(of.frames) for k in range(4)}
        result.append(Submap(i, core, tuple(sorted(shared | set(core))), of.positions[list(core)]))
    return tuple(result)


def occupied(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    wall = (x < 0.1) | (x > WIDTH - 0.1) | (y < 0.1) | (y > DEPTH - 0.1)
    for low, high, _ in FURNITURE:
        wall |= (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
    return wall


def occupancy(resolution: float = 0.05) -> OccupancyMap:
    origin = (-1.0, -1.0)
    columns, rows = round((WIDTH + 2) / resolution), round((DEPTH + 2) / resolution)
    x = origin[0] + (np.arange(columns) + 0.5) * resolution
    y = origin[1] + (np.arange(rows) + 0.5) * resolution
    gx, gy = np.meshgrid(x, y)
    cells = np.full((rows, columns), UNKNOWN)
    cells[(gx > 0) & (gx < WIDTH) & (gy > 0) & (gy < DEPTH)] = FREE
    cells[occupied(gx, gy) & (gx > -0.05) & (gx < WIDTH + 0.05) & (gy > -0.05) & (gy < DEPTH + 0.05)] = OCCUPIED
    return OccupancyMap(cells, resolution, origin)


def _id(i: int) -> str:
    return hashlib.md5(f"viewpoint {i}".encode()).hexdigest()


def graph(of: tuple[Submap, ...], spacing: float = 1.9) -> NavGraph:
    xs, ys = np.arange(1.2, WIDTH - 0.6, spacing), np.arange(1.2, DEPTH - 0.6, spacing)
    places = [(x, y) for y in ys for x in xs if not _blocked((x, y), (x, y), 0.35)]
    viewpoints, evidence, edges = {}, {}, {}
    for i, (x, y) in enumerate(places):
        at = np.array([x, y, EYE])
        near = min(of, key=lambda s: float(np.min(np.linalg.norm(s.positions - at, axis=1)))).index
        viewpoints[_id(i)] = Viewpoint(
            _id(i), (float(x), float(y), EYE), EYE, near, True, "start" if i == 0 else "step"
        )
    ids = list(viewpoints)
    for i, a in enumerate(places):
        for direction in range(8):
            heading = direction * math.pi / 4
            goal = (a[0] + spacing * math.sin(heading), a[1] + spacing * math.cos(heading))
            alpha = np.zeros((10, 5), np.uint8)
            for row in range(10):
                way = spacing * (row + 0.5) / 10
                here = (a[0] + way * math.sin(heading), a[1] + way * math.cos(heading))
                alpha[row] = 250 if _blocked(here, here, 0.1) else 12
            free = not (alpha > 240).any()
            evidence[(ids[i], direction)] = Evidence(
                ids[i], direction, heading, spacing, alpha, np.full((10, 5), 240, np.uint8), np.ones((10, 5), bool),
                0.2, (spacing - 0.2) / 10, 0.5, viewpoints[ids[i]].submap, goal, "", "open" if free else "alpha",
            )  # fmt: skip
            for j, b in enumerate(places):
                if free and j != i and math.dist(goal, b) < 0.8:
                    made = edge(ids[i], ids[j])
                    edges[made.key] = made
    return NavGraph("demo", viewpoints, edges, evidence)


def _blocked(a: tuple[float, float], b: tuple[float, float], margin: float) -> bool:
    share = np.linspace(0, 1, 9)
    x, y = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
    around = [(dx, dy) for dx in (-margin, 0, margin) for dy in (-margin, 0, margin)]
    return any(bool(occupied(x + dx, y + dy).any()) for dx, dy in around)


@cache
def _parts() -> tuple[Capture, tuple[Submap, ...], NavGraph, OccupancyMap]:
    walk = capture()
    parts = submaps(walk)
    return walk, parts, graph(parts), occupancy()


def contents(path: Path | None = None, scene: bool = True) -> Contents:
    walk, parts, nav, plan = _parts()
    info: dict[int, dict[str, object]] = {
        i: {"psnr": 27.1 + 0.6 * i, "gaussians": 61_000 + 7_431 * i} for i in range(3)
    }
    stages = frozenset({"import", "submaps", "depth", "floors", "train", "map"})
    return Contents(path, walk, parts, nav, plan, "models" if scene else None, info if scene else {}, stages)


@dataclass(frozen=True)
class RoomSource:
    """Rays against the boxes. `burn` seconds of computing are added to every view, `crash` ends the process at the
    view of that number, `fail` raises there."""

    burn: float = 0.0
    crash: int = -1
    fail: int = -1

    def open(self) -> Renderer:
        counter = iter(range(1 << 30))

        def render(camera: Camera, channels: frozenset[str]) -> tuple[int, RenderOutput]:
            number = next(counter)
            if number == self.crash:
                import os
                import signal

                os.kill(os.getpid(), signal.SIGKILL)
            if number == self.fail:
                raise RuntimeError("the test wanted this")
            end = time.perf_counter() + self.burn
            while time.perf_counter() < end:
                np.sort(np.random.default_rng(0).random(20_000))
            return 0 if camera.position[0] < WIDTH / 2 else 2, cast(camera)

        return render


def cast(camera: Camera) -> RenderOutput:
    """The room as it is: rgb, alpha (0 on the floor), depth, normal."""
    eye, rays = camera.position.astype(np.float32), camera.rays()
    best = np.full(rays.shape[:2], np.inf, np.float32)
    rgb = np.zeros((*rays.shape[:2], 3), np.float32)
    normal = np.zeros_like(rgb)
    alpha = np.zeros(rays.shape[:2], np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis, limit, color, inward in (
            (2, 0.0, (0.58, 0.50, 0.42), 1), (0, 0.0, (0.80, 0.77, 0.70), 1), (0, WIDTH, (0.74, 0.78, 0.80), -1),
            (1, 0.0, (0.83, 0.80, 0.74), 1), (1, DEPTH, (0.70, 0.74, 0.72), -1),
        ):  # fmt: skip
            distance = (limit - eye[axis]) / rays[..., axis]
            hit = (distance > 0) & (distance < best) & (rays[..., axis] * inward < 0)
            where = eye + distance[..., None] * rays
            inside = (where[..., 0] > -0.01) & (where[..., 0] < WIDTH + 0.01) & (where[..., 1] > -0.01)
            inside &= (where[..., 1] < DEPTH + 0.01) & (where[..., 2] > -0.01) & (where[..., 2] < HEIGHT)
            hit &= inside
            tint = np.array(color, np.float32)
            if axis == 2:
                tile = (np.floor(where[..., 0] * 2) + np.floor(where[..., 1] * 2)) % 2
                shade = 0.88 + 0.12 * tile
            else:
                shade = 0.92 + 0.08 * np.sin(where[..., 1 - axis] * 4) * np.sin(where[..., 2] * 5)
            rgb[hit] = (tint * shade[..., None])[hit]
            best[hit] = distance[hit]
            normal[hit] = np.eye(3, dtype=np.float32)[axis] * inward
            alpha[hit] = 0.0 if axis == 2 else 0.97
        for low, high, color in FURNITURE:
            t0, t1 = (np.array(low, np.float32) - eye) / rays, (np.array(high, np.float32) - eye) / rays
            near, far = np.minimum(t0, t1), np.maximum(t0, t1)
            enter, leave = near.max(axis=-1), far.min(axis=-1)
            hit = (enter > 0) & (enter < leave) & (enter < best)
            side = near.argmax(axis=-1)
            facing = np.eye(3, dtype=np.float32)[side] * -np.sign(np.take_along_axis(rays, side[..., None], -1))
            rgb[hit] = (np.array(color, np.float32) * (0.75 + 0.25 * facing[..., 2:]))[hit]
            best[hit], normal[hit], alpha[hit] = enter[hit], facing[hit], 0.99
    seen = np.isfinite(best)
    light = np.clip(1.15 - 0.035 * np.where(seen, best, 0), 0.5, 1.1)
    rgb = np.where(seen[..., None], rgb * light[..., None], np.array([0.09, 0.10, 0.12], np.float32))
    along = rays @ camera.rotation[:, 2].astype(np.float32)
    return RenderOutput(
        rgb.astype(np.float32), alpha, np.where(seen, best * along, 0).astype(np.float32), normal * seen[..., None]
    )
