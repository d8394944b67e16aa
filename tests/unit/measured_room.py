"""A room with a box in it, measured from several places by a scanner and by a depth camera, exactly."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
from capture_samples import FOCAL, HEIGHT, WIDTH, csv, nerfstudio_tree, ply, walk, world_to_camera, write_images

from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap

SIDE, CEILING = 3.02, 2.61  # meters from the middle to the walls; off the borders of cells
BOX = np.array([[0.52, -0.61, 0.0], [1.22, 0.22, 0.92]])
MOUNT = np.array([[0.0, -1, 0, 0.1], [0, 0, -1, 0.0], [1, 0, 0, -0.2], [0, 0, 0, 1]])  # rig to scanner
HEAD = "# kapture format: 1.1\n"


def cast(origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(N,) distances from `origin` (3,) along `directions` (N, 3) to the first surface."""
    room = np.array([[-SIDE, -SIDE, 0], [SIDE, SIDE, CEILING]])
    with np.errstate(divide="ignore", invalid="ignore"):
        leaves = np.max((room[:, None] - origin) / directions, axis=0).min(axis=1)
        to_box = np.sort((BOX[:, None] - origin) / directions, axis=0)
    enters, exits = to_box[0].max(axis=1), to_box[1].min(axis=1)
    return np.where((enters < exits) & (enters > 0), enters, leaves)


def sphere(count: int = 10_000) -> np.ndarray:
    """(count, 3) unit directions, evenly (Fibonacci's lattice)."""
    i = np.arange(count) + 0.5
    z, turn = 1 - 2 * i / count, i * np.pi * (1 + 5**0.5)
    return np.column_stack([np.sqrt(1 - z * z)[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1), z])


def scan(origin: np.ndarray) -> np.ndarray:
    """(N, 3) meters, world."""
    directions = sphere()
    return origin + cast(origin, directions)[:, None] * directions


def depth_image(pose: np.ndarray) -> np.ndarray:
    """(HEIGHT, WIDTH) meters along the optical axis."""
    u, v = (np.arange(WIDTH) + 0.5 - WIDTH / 2) / FOCAL, (np.arange(HEIGHT) + 0.5 - HEIGHT / 2) / FOCAL
    local = np.stack([*np.meshgrid(u, v), np.ones((HEIGHT, WIDTH))], axis=-1)
    along = cast(pose[:3, 3], (local @ pose[:3, :3].T).reshape(-1, 3))
    return along.reshape(HEIGHT, WIDTH)


def truth(resolution: float = 0.05) -> OccupancyMap:
    """Free, occupied on the cells that a wall or a side of the box runs through, unknown in the box and beyond."""
    count = round(2 * 3.5 / resolution)
    empty = OccupancyMap(np.full((count, count), UNKNOWN, np.uint8), resolution, (-3.5, -3.5))
    low = np.array(empty.origin) + resolution * np.stack(np.meshgrid(np.arange(count), np.arange(count)), axis=-1)
    high = low + resolution
    inside = ((high > -SIDE) & (low < SIDE)).all(axis=-1)
    wall = inside & ~((low > -SIDE) & (high < SIDE)).all(axis=-1)
    meets = ((high > BOX[0, :2]) & (low < BOX[1, :2])).all(axis=-1)
    cells = np.where(inside & ~meets, FREE, UNKNOWN)
    cells[wall | meets] = OCCUPIED
    return OccupancyMap(cells.astype(np.uint8), resolution, empty.origin)


def write_kapture(folder: Path, poses: np.ndarray, merged: bool = False, depth: bool = False) -> Path:
    """Camera and scanner on one rig, a scan for each image, or all points in one cloud in the world; with `depth` a
    depth camera in the camera's place and no scanner."""
    sensors = folder / "sensors"
    names = write_images(sensors / "records_data" / "cam0", len(poses))
    lens = ("PINHOLE", WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2)
    text = HEAD + csv("cam0", "front", "camera", *lens)
    text += csv("depth0", "", "depth", *lens) if depth else "lidar0, scan, lidar\n"
    (sensors / "sensors.txt").write_text(text)
    other, mount = ("depth0", np.eye(4)) if depth else ("lidar0", MOUNT)
    rigs = csv("rig", "cam0", 1, 0, 0, 0, 0, 0, 0)
    if not merged:
        rigs += csv("rig", other, *world_to_camera(np.linalg.inv(mount)))
    (sensors / "rigs.txt").write_text(HEAD + rigs)
    records, trajectory, cameras, clouds = HEAD, HEAD, HEAD, []
    if merged:
        trajectory += "0, lidar0, 1, 0, 0, 0, 0, 0, 0\n"
    for i, (pose, name) in enumerate(zip(poses, names, strict=True)):
        trajectory += csv(1000 + i, "rig", *world_to_camera(pose))
        cameras += f"{1000 + i}, cam0, cam0/{name}\n"
        if depth:
            (sensors / "records_data" / f"{i}.depth").write_bytes(depth_image(pose).astype("<f4").tobytes())
            records += f"{1000 + i}, depth0, {i}.depth\n"
            continue
        to_world = pose @ np.linalg.inv(mount)
        points = scan(to_world[:3, 3])
        if not merged:
            into = np.linalg.inv(to_world)
            (sensors / "records_data" / f"{i}.ply").write_bytes(ply(points @ into[:3, :3].T + into[:3, 3]))
            records += f"{1000 + i}, lidar0, {i}.ply\n"
        clouds.append(points)
    if merged:
        (sensors / "records_data" / "merged.ply").write_bytes(ply(np.concatenate(clouds)))
        records += "0, lidar0, merged.ply\n"
    (sensors / f"records_{'depth' if depth else 'lidar'}.txt").write_text(records)
    (sensors / "trajectories.txt").write_text(trajectory)
    (sensors / "records_camera.txt").write_text(cameras)
    return folder


def write_nerfstudio(folder: Path, poses: np.ndarray, to_source: np.ndarray | None = None, unit: float = 1.0) -> Path:
    """transforms.json with depth images and without a cloud; in a world turned by `to_source` (3, 3), and in units of
    which `unit` make a meter."""
    names = write_images(folder / "images", len(poses))
    (folder / "depth").mkdir()
    placed = poses.copy()
    if to_source is not None:
        placed[:, :3] = to_source @ poses[:, :3]
    placed[:, :3, 3] *= unit
    tree = nerfstudio_tree(placed, names)
    del tree["ply_file_path"]
    for frame, name, pose in zip(tree["frames"], names, poses, strict=True):
        millimeters = np.rint(1000 * unit * depth_image(pose)).astype(np.uint16)
        assert cv2.imwrite(str(folder / "depth" / name), millimeters)
        frame["depth_file_path"] = f"depth/{name}"
    path = folder / "transforms.json"
    path.write_text(json.dumps(tree))
    return path


def poses(count: int = 24) -> np.ndarray:
    """(count, 4, 4): around the box, looking outwards and inwards by turns."""
    found = walk(count, pitch_degrees=15.0, height=1.31)
    found[1::2, :3, :3] = np.diag([-1.0, -1.0, 1.0]) @ found[1::2, :3, :3]
    return found
