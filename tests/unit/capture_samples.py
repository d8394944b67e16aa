"""A small room as a capture, written in every format that is read: the truth that the reader tests compare with."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT, FOCAL = 64, 48, 40.0


def walk(count: int = 12, pitch_degrees: float = 10.0, height: float = 1.4, seed: int = 0) -> np.ndarray:
    """(count, 4, 4) camera-to-world, OpenCV axes, z up: level cameras on a circle, all pitched down a little."""
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    for i, angle in enumerate(np.linspace(0, 2 * np.pi, count, endpoint=False)):
        heading, pitch = angle + rng.uniform(-0.5, 0.5), np.radians(pitch_degrees)
        forward = np.array([np.cos(heading) * np.cos(pitch), np.sin(heading) * np.cos(pitch), -np.sin(pitch)])
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        poses[i, :3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
        poses[i, :3, 3] = [1.5 * np.cos(angle), 1.5 * np.sin(angle), height]
    return poses


def room(points: int = 6000, seed: int = 1) -> np.ndarray:
    """(points, 3) float32 on the floor z = 0 and four walls of a 6 x 6 x 2.6 m room, 5 mm noise."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(-3, 3, points), rng.uniform(-3, 3, points)
    face = rng.integers(0, 6, points)
    z = np.where(face < 2, 0.0, rng.uniform(0, 2.6, points))
    x = np.where(face == 2, -3.0, np.where(face == 3, 3.0, u))
    y = np.where(face == 4, -3.0, np.where(face == 5, 3.0, v))
    return (np.stack([x, y, z], axis=1) + rng.normal(0, 0.005, (points, 3))).astype(np.float32)


def turn(rotation: np.ndarray, poses: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses and points in a world turned about the origin."""
    turned = poses.copy()
    turned[:, :3] = rotation @ poses[:, :3]
    return turned, (points @ rotation.T).astype(np.float32)


def write_images(folder: Path, count: int, width: int = WIDTH, height: int = HEIGHT) -> list[str]:
    folder.mkdir(parents=True, exist_ok=True)
    names = [f"{i:03d}.png" for i in range(count)]
    for i, name in enumerate(names):
        image = np.full((height, width, 3), 40 + i % 200, np.uint8)
        cv2.rectangle(image, (10, 10), (30, 30), (200, 100, 50), -1)
        assert cv2.imwrite(str(folder / name), image)
    return names


def ply(points: np.ndarray) -> bytes:
    header = "ply\nformat binary_little_endian 1.0\n" + f"element vertex {len(points)}\n"
    header += "property float x\nproperty float y\nproperty float z\nend_header\n"
    return header.encode() + points.astype("<f4").tobytes()


def nerfstudio_tree(poses: np.ndarray, names: list[str], **more: object) -> dict:
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    frames = [{"file_path": f"images/{n}", "transform_matrix": (p @ flip).tolist()} for n, p in zip(names, poses)]
    lens = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2, "w": WIDTH, "h": HEIGHT}
    return {"camera_model": "OPENCV", **lens, "ply_file_path": "cloud.ply", "frames": frames, **more}


def write_nerfstudio(folder: Path, poses: np.ndarray, points: np.ndarray, **more: object) -> Path:
    names = write_images(folder / "images", len(poses))
    (folder / "cloud.ply").write_bytes(ply(points))
    path = folder / "transforms.json"
    path.write_text(json.dumps(nerfstudio_tree(poses, names, **more)))
    return path


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """w x y z, by scipy."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(rotation).as_quat(), 1)


def world_to_camera(pose: np.ndarray) -> np.ndarray:
    """(7,) w x y z tx ty tz of the inverse."""
    inverse = np.linalg.inv(pose)
    return np.concatenate([quaternion(inverse[:3, :3]), inverse[:3, 3]])


def write_colmap(folder: Path, poses: np.ndarray, points: np.ndarray, binary: bool) -> Path:
    """images/ and sparse/0/."""
    names = write_images(folder / "images", len(poses))
    model = folder / "sparse" / "0"
    model.mkdir(parents=True, exist_ok=True)
    rows = [world_to_camera(p) for p in poses]
    if binary:
        camera = struct.pack("<QiiQQ4d", 1, 1, 1, WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2)
        (model / "cameras.bin").write_bytes(camera)
        data = struct.pack("<Q", len(rows))
        for i, (row, name) in enumerate(zip(rows, names)):
            data += struct.pack("<i7di", i + 1, *row, 1) + name.encode() + b"\0" + struct.pack("<Qddq", 1, 1.5, 2.5, -1)
        (model / "images.bin").write_bytes(data)
        data = struct.pack("<Q", len(points))
        for i, p in enumerate(points):
            data += struct.pack("<Q3d3BdQii", i, *p, 10, 20, 30, 0.5, 1, 1, 0)
        (model / "points3D.bin").write_bytes(data)
        return folder
    (model / "cameras.txt").write_text(
        f"# cameras\n1 PINHOLE {WIDTH} {HEIGHT} {FOCAL} {FOCAL} {WIDTH / 2} {HEIGHT / 2}\n"
    )
    text = "# images\n"
    for i, (row, name) in enumerate(zip(rows, names)):
        text += f"{i + 1} {' '.join(map(repr, map(float, row)))} 1 {name}\n" + ("1.5 2.5 -1\n" if i % 2 else "\n")
    (model / "images.txt").write_text(text)
    lines = [f"{i} {' '.join(map(repr, map(float, p)))} 10 20 30 0.5 1 0\n" for i, p in enumerate(points)]
    (model / "points3D.txt").write_text("# points\n" + "".join(lines))
    return folder


def csv(*fields: object) -> str:
    return ", ".join(repr(float(f)) if isinstance(f, float | np.floating) else str(f) for f in fields) + "\n"


def write_kapture(folder: Path, poses: np.ndarray, points: np.ndarray, rig: np.ndarray | None = None) -> Path:
    """One camera; on a rig with the rig-to-camera pose `rig` (4, 4) where given. The cloud is in the world frame."""
    sensors = folder / "sensors"
    names = write_images(sensors / "records_data" / "cam0", len(poses))
    (sensors / "records_data" / "lidar0").mkdir()
    (sensors / "records_data" / "lidar0" / "merged.ply").write_bytes(ply(points))
    head = "# kapture format: 1.1\n"
    pinhole = csv("cam0", "front", "camera", "PINHOLE", WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2)
    (sensors / "sensors.txt").write_text(head + pinhole + "lidar0, scan, lidar\n")
    trajectory = head + "0, lidar0, 1, 0, 0, 0, 0, 0, 0\n"
    for i, pose in enumerate(poses):
        device = "cam0" if rig is None else "rig"
        placed = pose if rig is None else pose @ rig  # camera-to-world times rig-to-camera
        trajectory += csv(1000 + i, device, *world_to_camera(placed))
    (sensors / "trajectories.txt").write_text(trajectory)
    if rig is not None:
        row = np.concatenate([quaternion(rig[:3, :3]), rig[:3, 3]])
        (sensors / "rigs.txt").write_text(head + csv("rig", "cam0", *row))
    records = [csv(1000 + i, "cam0", f"cam0/{name}") for i, name in enumerate(names)]
    (sensors / "records_camera.txt").write_text(head + "".join(records))
    (sensors / "records_lidar.txt").write_text(head + "0, lidar0, lidar0/merged.ply\n")
    return folder
