"""Writes a building to disk: an ordinary nerfstudio capture, and beside it the ground truth."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.building.config import BuildingConfig
from nvsim.building.novel import listing, novel_cameras
from nvsim.building.readme import TRUTH_EVERY, readme
from nvsim.building.rendering import render
from nvsim.building.scan import scan
from nvsim.building.scene import Scene, make_scene, textures_of
from nvsim.building.truth import floor_mask, normals, transient_mask, true_occupancy
from nvsim.capture.types import Cloud
from nvsim.events import Listener, Progress, silent
from nvsim.files import atomic
from nvsim.occupancy.ros import write_ros_map
from nvsim.occupancy.storeys import NAME as STOREYS
from nvsim.occupancy.storeys import write_storeys

VERSION = 4  # of the generated files: raise it if a configuration gives other files
_NOISE = 1.5 / 255
_RECORD = "building.json"


def generate(folder: Path, config: BuildingConfig, listen: Listener = silent) -> None:
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
        people, clothes = scene.present(frame)
        view = render(scene.camera(frame), scene.solids, textures, people, clothes)
        name = f"{frame:05d}"
        _write(
            capture / "images" / f"{name}.jpg", _exposed(view.color, config.seed, frame), [cv2.IMWRITE_JPEG_QUALITY, 93]
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
    atomic.write_text(truth / "holdout_frames.txt", listing(scene.camera(0).intrinsics, novel))
    _write_capture(capture, scene, cloud)
    if len(true_maps.storeys) == 1:
        write_ros_map(true_maps.storeys[0].occupancy, truth / "map.yaml")
    else:
        write_storeys(true_maps, truth)
    atomic.write_text(truth / "README.txt", readme(scene, cloud, len(novel)))
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


def _exposed(color: NDArray[np.float32], seed: int, frame: int) -> NDArray[np.uint8]:
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
