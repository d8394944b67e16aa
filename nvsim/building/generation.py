"""Writes a building to disk: an ordinary nerfstudio capture with the point cloud of a simulated LiDAR, and beside it
the ground truth.

The LiDAR is carried along the trajectory: range noise, beams, few or no returns from glass.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.building.baking import Textures
from nvsim.building.config import BuildingConfig
from nvsim.building.raycast import trace
from nvsim.building.rendering import radiance, render
from nvsim.building.scene import CAMERA_HEIGHT, Scene, make_scene, textures_of
from nvsim.building.truth import HIGH, LOW, RESOLUTION, floor_mask, normals, transient_mask, true_occupancy
from nvsim.capture.types import Cloud
from nvsim.events import Listener, Progress, ignore_event
from nvsim.files import atomic
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.kernels import njit, prange
from nvsim.occupancy.paths import clearance
from nvsim.occupancy.ros import write_ros_map
from nvsim.occupancy.storeys import NAME as STOREYS
from nvsim.occupancy.storeys import write_storeys
from nvsim.occupancy.types import FREE, OccupancyMap

TRUTH_EVERY = 10  # frames
_RANGE, _RANGE_NOISE, _GLASS_RETURNS = 12.0, 0.01, 0.04
_EVERY = 1.2  # meters of the trajectory between sweeps
_VOXEL = 0.045
_MOST, _USUAL_AREA = 340_000, 300.0  # greatest number of points of a storey with this many square meters
_AT_ONCE = 32  # sweeps that are merged at once


def readme_text(scene: Scene, cloud: Cloud, novel: int) -> str:
    """The text of README.txt for a scene with `novel` novel views."""
    moved = np.linalg.norm(np.diff(scene.path[:, :2], axis=0), axis=1).sum()
    c = scene.config
    floors = " and ".join(f"{s.floor:g}" for s in scene.storeys)
    rooms = sum(len(s.plan.rooms) for s in scene.storeys)
    area = sum(s.plan.extent.area for s in scene.storeys)
    options = "".join(f", {o}" for o in (c.style, f"{c.storeys} storeys") if o not in ("furnished", "1 storeys"))
    world = f"World: meters, z up, floor at z = {floors}; cameras level, {CAMERA_HEIGHT} m above the floor."
    return f"""Ground truth of a built-in building (seed {c.seed}, {c.size}{options}): for evaluation, never an input.

{rooms} rooms on {area:.0f} m2, {len(scene.walk)} frames on {moved:.0f} m,
{len(cloud.points)} points. {world}

floor/      every frame: pixels that show floor, including rugs and floor behind glass; people are not floor
transient/  every frame: pixels that show a person
depth/      every {TRUTH_EVERY}th frame: 16-bit, millimeters along the optical axis, of the surface behind glass; people
            are included
normals/    for the same frames: world normal toward the camera, RGB = (n + 1) * 127.5; gray on people
novel/      {novel} views from beside the trajectory, turned 35 to 145 degrees off it, without people and noise;
            holdout_frames.txt has their poses, novel_floor/ their true floor
{_maps(scene)}"""


def _maps(scene: Scene) -> str:
    solid = f"occupied are all solids between {LOW}"
    if len(scene.storeys) == 1:
        return f"""map.pgm     ROS map_server, {RESOLUTION} m: {solid} and {HIGH} m (including glass and the step,
map.yaml    without people), free is the floor connected with the trajectory, the rest is unknown
"""
    return f"""storey_N/   map.pgm and map.yaml of each storey, ROS map_server, {RESOLUTION} m: {solid}
            and {HIGH} m above its floor (including glass and the platforms, without people), free is the floor
            connected with the trajectory there, the rest is unknown
storeys.json  the height of each floor, meters, its map, and the outline of the treads of the stairs

The steps of the stairs are floor in the masks, treads and risers alike, because people walk over both. They are free
in both maps. On the stairs the cameras keep their height above the line through the middles of the treads. On the way
down they look down by 20 degrees.
"""


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
    places = occupancy.centers()[free[:, 0], free[:, 1]]
    if scene.plan.flight is not None:
        hole = scene.plan.flight.rect.expanded(0.1)
        places = places[[not hole.contains(x, y) for x, y in places]]
    distance, nearest = cKDTree(walk[:, :2]).query(places)
    allowed = np.flatnonzero((distance >= BESIDE[0]) & (distance <= BESIDE[1]))
    chosen = _farthest_point_order(places[allowed], min(COUNT[scene.config.size], len(allowed)), rng)
    cameras = []
    for i in allowed[chosen]:
        turn = np.radians(rng.uniform(*TURNED)) * rng.choice([-1.0, 1.0])
        pose = camera_pose(np.array([*places[i], level + CAMERA_HEIGHT]), float(walk[nearest[i], 2] + turn))
        cameras.append(Camera(scene.camera(0).intrinsics, np.round(pose, 9) + 0.0))
    return cameras


def _farthest_point_order(places: NDArray[np.float64], count: int, rng: np.random.Generator) -> list[int]:
    """Indices in farthest-point order: each of the places (N, 2) is as far from those before it as possible."""
    if count == 0:
        return []
    chosen = [int(rng.integers(len(places)))]
    distance = np.linalg.norm(places - places[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return chosen


def camera_list_text(k: Intrinsics, cameras: list[Camera]) -> str:
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


VERSION = 4  # of the generated files: raise it if a configuration gives other files
_NOISE = 1.5 / 255
_RECORD = "building.json"


def generate(folder: Path, config: BuildingConfig, listen: Listener = ignore_event) -> None:
    """Writes `folder`/capture and `folder`/ground_truth; returns at once if this building already exists there.

    Raises InputError if a file cannot be written.
    """
    record = _record(config)
    finished = folder / _RECORD
    if finished.is_file() and finished.read_text() == record:
        listen(Progress("building", 1, 1, "already there"))
        return
    try:
        finished.unlink(missing_ok=True)
    except OSError as error:
        raise atomic.as_input_error(finished, error) from error
    listen(Progress("building", 0, 1, "plan"))
    scene = make_scene(config)
    true_maps = true_occupancy(scene)
    novel = [
        camera
        for k, storey in enumerate(true_maps.storeys)
        for camera in novel_cameras(scene, storey.occupancy, _stream(config.seed, 7, *([k] if k else [])), k)
    ]
    total = len(scene.walk) + len(novel) + 2
    textures = textures_of(scene)
    listen(Progress("building", 1, total, "scan"))
    cloud = scan(scene, textures, _stream(config.seed, 5))
    listen(Progress("building", 2, total, "frames"))
    capture, truth = folder / "capture", folder / "ground_truth"
    for frame in range(len(scene.walk)):
        people, clothes = scene.people_in_frame(frame)
        view = render(scene.camera(frame), scene.solids, textures, people, clothes)
        name = f"{frame:05d}"
        _write(
            capture / "images" / f"{name}.jpg",
            _camera_bytes(view.color, config.seed, frame),
            [cv2.IMWRITE_JPEG_QUALITY, 93],
        )
        _write(truth / "floor" / f"{name}.png", 255 * floor_mask(scene, view).astype(np.uint8))
        _write(truth / "transient" / f"{name}.png", 255 * transient_mask(scene, view).astype(np.uint8))
        if frame % TRUTH_EVERY == 0:
            _write(truth / "depth" / f"{name}.png", np.rint(view.depth * 1000).astype(np.uint16))
            rgb = np.rint((normals(scene, view) + 1) * 127.5).astype(np.uint8)
            _write(truth / "normals" / f"{name}.png", rgb[..., ::-1])
        listen(Progress("building", frame + 3, total, "frames"))
    nobody = np.empty((0, 5)), np.empty((0, 3))
    for i, camera in enumerate(novel):
        view = render(camera, scene.solids, textures, *nobody)
        picture = np.rint(np.clip(view.color[..., ::-1], 0, 1) * 255).astype(np.uint8)
        _write(truth / "novel" / f"{i:03d}.png", picture)
        _write(truth / "novel_floor" / f"{i:03d}.png", 255 * floor_mask(scene, view).astype(np.uint8))
        listen(Progress("building", len(scene.walk) + i + 3, total, "novel views"))
    atomic.write_text(truth / "holdout_frames.txt", camera_list_text(scene.camera(0).intrinsics, novel))
    _write_capture(capture, scene, cloud)
    if len(true_maps.storeys) == 1:
        write_ros_map(true_maps.storeys[0].occupancy, truth / "map.yaml")
    else:
        write_storeys(true_maps, truth)
    atomic.write_text(truth / "README.txt", readme_text(scene, cloud, len(novel)))
    _forget_others(folder, len(scene.walk), len(novel), len(true_maps.storeys))
    atomic.write_text(finished, record)


def _record(config: BuildingConfig) -> str:
    """The text that identifies a finished building. Options added later appear only with a value other than the
    default."""
    options = dataclasses.asdict(config)
    for name in ("storeys", "style", "area"):
        if options[name] == getattr(BuildingConfig, name):
            del options[name]
    return json.dumps({"version": VERSION, **options}, indent=1) + "\n"


def _stream(*key: int) -> np.random.Generator:
    """Independent random numbers for each part."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(list(key))))


def _forget_others(folder: Path, frames: int, novel: int, storeys: int) -> None:
    """Removes the frames of a longer trajectory in this folder, and the maps of a building with other storeys."""
    truth = folder / "ground_truth"
    maps = [truth / "map.yaml", truth / "map.pgm"] if storeys > 1 else [truth / STOREYS, *truth.glob("storey_*/map.*")]
    for path in maps:
        path.unlink(missing_ok=True)
    for pattern in ("capture/images/*.jpg", "ground_truth/*/*.png"):
        for path in folder.glob(pattern):
            count = novel if path.parent.name.startswith("novel") else frames
            if path.stem.isdigit() and int(path.stem) >= count:
                path.unlink()


def _camera_bytes(color: NDArray[np.float32], seed: int, frame: int) -> NDArray[np.uint8]:
    """BGR bytes (H, W, 3) with sensor noise, from RGB `color` (H, W, 3), 0 to 1."""
    rng = _stream(seed, 6, frame)
    noisy = color[..., ::-1] + np.float32(_NOISE) * rng.standard_normal(color.shape, dtype=np.float32)
    return np.rint(np.clip(noisy, 0, 1) * 255).astype(np.uint8)


def _write(path: Path, image: NDArray[np.unsignedinteger], options: list[int] | None = None) -> None:
    encoded = cv2.imencode(path.suffix, image, options or [])[1]
    atomic.write_bytes(path, encoded.tobytes())


def _write_capture(capture: Path, scene: Scene, cloud: Cloud) -> None:
    """Writes transforms.json (nerfstudio: OpenGL axes, y up and looking along -z) and the point cloud as binary PLY."""
    k = scene.camera(0).intrinsics
    frames = []
    for frame in range(len(scene.walk)):
        matrix = scene.camera(frame).camera_to_world @ np.diag([1.0, -1.0, -1.0, 1.0]) + 0.0
        frames.append({"file_path": f"images/{frame:05d}.jpg", "transform_matrix": matrix.tolist()})
    transforms = {
        "camera_model": "OPENCV",
        "w": k.width,
        "h": k.height,
        "fl_x": k.fx,
        "fl_y": k.fy,
        "cx": k.cx,
        "cy": k.cy,
        **dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0),
        "unit": "meter",
        "ply_file_path": "points.ply",
        "frames": frames,
    }
    table = np.empty(len(cloud.points), [(a, "<f4") for a in "xyz"] + [(c, "u1") for c in ("red", "green", "blue")])
    assert cloud.colors is not None
    for axis, name in enumerate("xyz"):
        table[name] = cloud.points[:, axis]
    for channel, name in enumerate(("red", "green", "blue")):
        table[name] = cloud.colors[:, channel]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    header += [f"property float {a}" for a in "xyz"] + [f"property uchar {c}" for c in ("red", "green", "blue")]
    atomic.write_bytes(capture / "points.ply", ("\n".join([*header, "end_header"]) + "\n").encode() + table.tobytes())
    atomic.write_text(capture / "transforms.json", json.dumps(transforms, indent=1) + "\n")


def scan(scene: Scene, textures: Textures, rng: np.random.Generator) -> Cloud:
    """One point per voxel, in an order that does not depend on the machine; coordinates in whole millimeters."""
    moved = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(scene.path[:, :2], axis=0), axis=1))])
    stands = scene.path[np.searchsorted(moved, np.arange(0.0, moved[-1], _EVERY))]
    places = stands[:, [0, 1, 3]] + np.array([0.0, 0.0, CAMERA_HEIGHT])
    # Glass is clean in a building of style "glass"; in the other styles it returns a few points.
    returns = 0.0 if scene.config.style == "glass" else _GLASS_RETURNS
    beams, turns = np.radians(np.linspace(-62, 48, 84)), 600
    merged, pending = _VoxelFilter(), []
    for k, place in enumerate(places):
        azimuth = np.radians(np.arange(turns) * 360 / turns + rng.uniform(0, 360 / turns))
        elevation = beams + np.radians(rng.uniform(-0.5, 0.5))
        ce, se = np.cos(elevation)[:, None], np.sin(elevation)[:, None]
        directions = np.stack(np.broadcast_arrays(ce * np.cos(azimuth), ce * np.sin(azimuth), se), axis=-1).reshape(
            -1, 3
        )
        chance = rng.random(len(directions), dtype=np.float32)
        ranges, rgb = _sweep(place, directions, chance, returns, scene.solids, textures)
        kept = ranges < _RANGE
        noisy = ranges[kept] + rng.normal(0, _RANGE_NOISE, int(kept.sum()))
        pending.append((place + noisy[:, None] * directions[kept], rgb[kept]))
        if len(pending) == _AT_ONCE or k + 1 == len(places):
            merged.add(pending)
            pending = []
    most = _MOST * max(len(scene.storeys), round(scene.plan.extent.area / _USUAL_AREA))
    return merged.cloud(most, rng)


class _VoxelFilter:
    """Keeps the first point in each voxel."""

    def __init__(self) -> None:
        self._keys, self._order = np.empty(0, np.int64), np.empty(0, np.int64)
        self._points, self._colors = np.empty((0, 3)), np.empty((0, 3), np.uint8)
        self._count = 0

    def add(self, sweeps: list[tuple[NDArray[np.float64], NDArray[np.uint8]]]) -> None:
        points, colors = (np.concatenate(parts) for parts in zip(*sweeps, strict=True))
        cell = np.floor(points / _VOXEL).astype(np.int64) + 4096
        keys = np.concatenate([self._keys, (cell[:, 0] << 40) + (cell[:, 1] << 20) + cell[:, 2]])
        self._keys, first = np.unique(keys, return_index=True)
        order = np.concatenate([self._order, self._count + np.arange(len(points))])
        self._count += len(points)
        self._order = order[first]
        self._points = np.concatenate([self._points, points])[first]
        self._colors = np.concatenate([self._colors, colors])[first]

    def cloud(self, most: int, rng: np.random.Generator) -> Cloud:
        """All points in voxel order, or, if there are more than `most`, a random sample in the order of observation."""
        chosen = np.arange(len(self._keys))
        if len(chosen) > most:
            chosen = rng.permutation(chosen)[:most]
            chosen = chosen[np.argsort(self._order[chosen])]
        return Cloud(np.round(self._points[chosen], 3).astype(np.float32), self._colors[chosen])


@njit(cache=True, parallel=True, error_model="numpy")
def _sweep(origin, directions, chance, returns, solids, textures):  # type: ignore[no-untyped-def]
    count = directions.shape[0]
    ranges, colors = np.empty(count), np.empty((count, 3), np.uint8)
    nobody, bare = np.empty((0, 5)), np.empty((0, 3))
    for i in prange(count):
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        t, surface, glass = trace(origin[0], origin[1], origin[2], dx, dy, dz, solids, nobody)
        if glass < t and chance[i] < returns:
            ranges[i] = glass
            colors[i, 0], colors[i, 1], colors[i, 2] = 150, 160, 160
            continue
        ranges[i] = t
        x, y, z = origin[0] + t * dx, origin[1] + t * dy, origin[2] + t * dz
        r, g, b = radiance(x, y, z, dx, dy, dz, t, surface, 0.01, solids, textures, nobody, bare)
        colors[i, 0], colors[i, 1], colors[i, 2] = int(255 * r + 0.5), int(255 * g + 0.5), int(255 * b + 0.5)
    return ranges, colors
