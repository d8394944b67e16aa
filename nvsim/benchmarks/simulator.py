"""Measures states and images per second of the simulator, on a generated scan and live on a project."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import camera_pose
from nvsim.geometry.directions import face_rays
from nvsim.graph.skybox_files import FOLDER, SkyboxFiles
from nvsim.r2r.simulator import Simulator
from nvsim.r2r.simulator.images import ViewSize

if TYPE_CHECKING:
    from nvsim.r2r.simulator.live import LiveImages
    from nvsim.r2r.simulator.scan import Scan

WIDTH, HEIGHT, VFOV = 640, 480, math.radians(60)


def write_made_scan(
    folder: Path, scan: str = "made", count: int = 100, side: int = 0, seed: int = 1, plain: bool = False
) -> list[str]:
    """Writes a scan into `folder` and returns the ids of its included viewpoints.

    count  viewpoints in connectivity/, on two storeys
    side   pixels per face of skyboxes in scans/, 0 for none; their colors and distances encode the viewing direction
    plain  a scan for data loaders of agents: no tilted poses, no excluded viewpoints, no one-way edges

    Poses have random headings, and unless `plain` a small tilt.
    """
    r = np.random.default_rng(seed)
    size = 1.6 * math.sqrt(count)
    position = np.column_stack([r.uniform(0, size, (count, 2)), r.choice([1.5, 4.5], count) + r.normal(0, 0.05, count)])
    yaw, tilt = r.uniform(0, 2 * np.pi, count), np.zeros(count) if plain else r.normal(0, 0.05, count)
    included = np.ones(count, bool) if plain else r.random(count) > 0.05
    apart = np.linalg.norm(position[:, None] - position[None], axis=-1)
    free = (apart < 2.6) | (apart <= np.sort(apart, axis=1)[:, 1:2])
    free |= free.T
    if not plain:
        free &= r.random(free.shape) > 0.05
    np.fill_diagonal(free, False)
    ids = [f"{value:032x}" for value in r.integers(1, 1 << 60, count)]
    poses = [camera_pose(p, y, t) for p, y, t in zip(position, yaw, tilt, strict=True)]
    entries = [
        {
            "image_id": id,
            "pose": [float(v) for v in pose.ravel()],
            "included": bool(i),
            "visible": row.tolist(),
            "unobstructed": row.tolist(),
            "height": 1.5,
        }
        for id, pose, i, row in zip(ids, poses, included, free, strict=True)
    ]
    graphs = folder / "connectivity"
    graphs.mkdir(parents=True, exist_ok=True)
    (graphs / f"{scan}_connectivity.json").write_text(json.dumps(entries))
    listed = graphs / "scans.txt"
    before = listed.read_text().split() if listed.exists() else []
    listed.write_text("".join(f"{name}\n" for name in dict.fromkeys([*before, scan])))
    if side:
        images = folder / "scans" / scan / FOLDER
        images.mkdir(parents=True, exist_ok=True)
        for id, pose in zip(ids, poses, strict=True):
            _write_skybox(images, id, pose[:3, :3], side)
    return [id for id, i in zip(ids, included, strict=True) if i]


def _write_skybox(folder: Path, id: str, rotation: NDArray[np.float64], side: int) -> None:
    import cv2

    rays = face_rays(side) @ rotation.T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    waves = np.stack([np.sin(9 * rays[..., a] + 4 * rays[..., (a + 1) % 3]) for a in range(3)], axis=-1)
    strip = np.concatenate(list(128 + 80 * rays / 2 + 40 * waves), axis=1).round().astype(np.uint8)
    quality = [cv2.IMWRITE_JPEG_QUALITY, 95, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    SkyboxFiles(folder).strip(id).write_bytes(cv2.imencode(".jpg", strip, quality)[1].tobytes())
    meters = np.concatenate(list(3 + waves[..., 0]), axis=1)
    depth = (4000 * meters).round().astype(np.uint16)
    SkyboxFiles(folder).depth(id).write_bytes(cv2.imencode(".png", depth)[1].tobytes())


def measure_states(folder: Path, scan: str, ids: list[str], batch: int, seconds: float = 1.0) -> dict[str, float]:
    """States per second of random actions without images: "states" with a call of getState, and "read" with access to
    each field of each navigable location too."""
    r = np.random.default_rng(1)
    sim = Simulator()
    sim.setNavGraphPath(folder)
    sim.setRenderingEnabled(False)
    sim.setDiscretizedViewingAngles(True)
    sim.setCameraResolution(WIDTH, HEIGHT)
    sim.setCameraVFOV(VFOV)
    sim.setBatchSize(batch)
    sim.initialize()
    starts = [ids[i] for i in r.integers(0, len(ids), batch)]
    sim.newEpisode([scan] * batch, starts, [0.0] * batch, [0.0] * batch)
    turns = [r.choice([-1.0, 0.0, 1.0], batch).tolist() for _ in range(64)]
    level = [0.0] * batch

    def act(number: int) -> None:
        counts = [min(1, len(s.navigableLocations) - 1) for s in sim.getState()] if number % 4 == 0 else stay
        sim.makeAction(counts, turns[number % 64], level)
        sim.getState()

    def read(number: int) -> None:
        act(number)
        for state in sim.getState():
            for l in [state.location, *state.navigableLocations]:
                fields(l)
            rest(state)

    fields = attrgetter(*["viewpointId", "ix", "x", "y", "z", "rel_heading", "rel_elevation", "rel_distance"])
    rest = attrgetter(*["scanId", "step", "heading", "elevation", "viewIndex"])
    stay = [0] * batch
    return {"states": batch * _rate(act, seconds), "read": batch * _rate(read, seconds)}


def measure_images(
    graphs: Path, dataset: Path, scan: str, ids: list[str], seconds: float = 3.0, depth: bool = False
) -> float:
    """Images of 640 x 480 pixels per second of one environment, at viewpoints whose images are in the cache."""
    sim = Simulator()
    sim.setNavGraphPath(graphs)
    sim.setDatasetPath(dataset)
    sim.setCameraResolution(WIDTH, HEIGHT)
    sim.setCameraVFOV(VFOV)
    sim.setDepthEnabled(depth)
    sim.initialize()
    ids = ids[:10]
    for id in ids:
        sim.newEpisode([scan], [id], [0.0], [0.0])

    def act(number: int) -> None:
        if number % 36 == 0:
            sim.newEpisode([scan], [ids[number // 36 % len(ids)]], [0.0], [0.0])
        else:
            sim.makeAction([0], [0.5], [0.1 if number % 2 else -0.1])

    return _rate(act, seconds)


def measure_live(images: LiveImages, scan: Scan, ids: list[str], stay: int, seconds: float) -> float:
    """Images of 640 x 480 pixels per second that are rendered live. Each position is new, and `stay` images in random
    directions are rendered there."""
    r, view = np.random.default_rng(1), ViewSize(WIDTH, HEIGHT, VFOV, False)
    places = [scan.position[scan.ids.index(id)].astype(np.float64) for id in ids]

    def act(number: int) -> None:
        place = places[number % len(places)] + (0.0, 0.0, 1e-6 * number)  # a new position, which no cached image shows
        for _ in range(stay):
            images.draw_from(place, r.uniform(0, 2 * math.pi), r.uniform(-0.2, 0.2), view)

    return stay * _rate(act, seconds)


def measure(live: Path | None = None, seconds: float = 2.0) -> dict[str, Any]:
    """The figures of `nvsim bench simulator`: on a scan in a temporary folder, and on the project `live` if given.
    Raises InputError if the project has no models or no graph."""
    import tempfile

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ids = write_made_scan(folder, count=100)
        figures: dict[str, Any] = {}
        for batch in (1, 64):
            found = measure_states(folder / "connectivity", "made", ids, batch, seconds)
            figures[f"states_per_s_{batch}"] = round(found["states"])
            figures[f"states_read_per_s_{batch}"] = round(found["read"])
        ids = write_made_scan(folder / "seen", count=10, side=512)
        where = folder / "seen" / "connectivity", folder / "seen" / "scans"
        figures["frames_per_s"] = round(measure_images(*where, "made", ids, seconds), 1)
        figures["frames_with_depth_per_s"] = round(measure_images(*where, "made", ids, seconds, depth=True), 1)
    if live is not None:
        from nvsim.project.scene_views import read_live_scene
        from nvsim.r2r.simulator.live import LiveImages

        images = LiveImages(read_live_scene(live))
        scan = images.scans.scan(images.scans.scan_ids()[0])
        ids = [id for id, i in zip(scan.ids, scan.included.tolist(), strict=True) if i]
        spread = [ids[i] for i in np.linspace(0, len(ids) - 1, min(10, len(ids))).astype(int)]
        for name, stay in (("live_frames_per_s", 36), ("live_moving_frames_per_s", 1)):
            figures[name] = round(measure_live(images, scan, spread, stay, max(seconds, 5.0)), 1)
        figures["live_viewpoints"] = len(ids)
        images.close()
    return figures


def _rate(act: Callable[[int], None], seconds: float) -> float:
    """Calls per second: the best of twenty time slices, because the load of other programs varies."""
    for number in range(4):
        act(number)
    best, number = 0.0, 0
    for _ in range(20):
        begin, done = time.perf_counter(), 0
        while time.perf_counter() - begin < seconds / 20 or not done:
            act(number)
            number, done = number + 1, done + 1
        best = max(best, done / (time.perf_counter() - begin))
    return best
