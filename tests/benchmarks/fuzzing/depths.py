"""Depth: estimated maps and their cloud in a project, LiDAR scans and depth images of captures, and RGB-D captures."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
from capture_samples import HEIGHT, WIDTH, room, walk, write_kapture, write_nerfstudio

from fuzzing.places import workshop
from fuzzing.reader import Files, Reader, Seed, each, files_in
from nvsim.capture.check import check
from nvsim.capture.read import read
from nvsim.capture.sweeps import depth_sweeps, scan_sweeps, scans_with_places
from nvsim.capture.types import Alignment
from nvsim.depth.cloud_file import as_cloud, read_cloud_file, write_cloud
from nvsim.depth.files import read_confidence, read_depth, read_draft, write_depth, write_draft
from nvsim.depth.fusion import FusedCloud
from nvsim.files.stored_arrays import read_arrays

_SIDES = 48, 64


def readers() -> list[Reader]:
    return [
        Reader("depth map", _maps, _read_map),
        Reader("depth draft", _drafts, _read_draft),
        Reader("depth cloud", _clouds, _read_cloud),
        Reader("lidar scans", _lidar, _sweeps),
        Reader("depth images of a capture", _depth_images, _sweeps),
        Reader("rgbd transforms", _rgbd, _checked, share=2),
        Reader("arrays", _arrays, _read_arrays),
    ]


def _depth_png(scale: float = 1.0) -> bytes:
    ramp = np.add.outer(np.arange(_SIDES[0]), np.arange(_SIDES[1]))
    return cv2.imencode(".png", (scale * (1000 + 20 * ramp)).astype(np.uint16))[1].tobytes()


def _maps() -> list[Seed]:
    with workshop() as folder:
        write_depth(folder, 0, np.full(_SIDES, 0.4, np.float32), np.full(_SIDES, 3, np.uint8))
        files = files_in(folder)
    return each(files, "", {name: "picture" for name in files})


def _read_map(path: Path) -> object:
    return read_depth(path, 0).mean(), read_confidence(path, 0).mean()


def _drafts() -> list[Seed]:
    with workshop() as folder:
        write_draft(folder, 0, np.full(_SIDES, 0.4, np.float32), np.full(_SIDES, 100.0, np.float32))
        files = files_in(folder)
    return each(files, "", {name: "zip" for name in files})


def _read_draft(path: Path) -> object:
    return [array.mean() for array in read_draft(path, 0)]


def _clouds() -> list[Seed]:
    ones = np.ones((20, 3), np.float32)
    with workshop() as folder:
        write_cloud(folder / "cloud.ply", FusedCloud(ones, ones.astype(np.uint8), ones, np.ones(20, np.uint16)))
        return each(files_in(folder), "cloud.ply", {"cloud.ply": "headed"})


def _read_cloud(path: Path) -> object:
    return as_cloud(read_cloud_file(path))


def _kapture(records: bool) -> Files:
    """A kapture tree, with depth images if `records`."""
    with workshop() as folder:
        write_kapture(folder, walk(4), room(60))
        files = files_in(folder)
    if records:
        files["sensors/sensors.txt"] += f"d, d, depth, PINHOLE, {WIDTH}, {HEIGHT}, 50, 50, 32, 24\n".encode()
        files["sensors/trajectories.txt"] += b"1000, d, 1, 0, 0, 0, 0, 0, 0\n"
        files["sensors/records_depth.txt"] = b"# kapture format: 1.1\n1000, d, d/0.depth\n"
        files["sensors/records_data/d/0.depth"] = np.full((HEIGHT, WIDTH), 2.0, "<f4").tobytes()
    return files


def _lidar() -> list[Seed]:
    files = _kapture(False)
    targets = {"sensors/records_lidar.txt": "text", "sensors/records_data/lidar0/merged.ply": "headed"}
    return each(files, "", targets)


def _depth_images() -> list[Seed]:
    files = _kapture(True)
    return each(files, "", {"sensors/records_depth.txt": "text", "sensors/records_data/d/0.depth": "binary"})


def _sweeps(path: Path) -> object:
    """Casts rays as `nvsim occupancy build` does."""
    capture = read(path, alignment=Alignment(np.eye(3), 1.0, True))
    sweeps = [*scan_sweeps(capture.scans), *depth_sweeps(capture.depths, 32)]
    return sweeps, scans_with_places(capture.scans)


def _rgbd() -> list[Seed]:
    """Depth images and masks next to the images, with the keys of nerfstudio, Record3D, and PolyCam."""
    with workshop() as folder:
        write_nerfstudio(folder, walk(4), room(60))
        files = files_in(folder)
    mask = cv2.imencode(".png", np.full(_SIDES, 255, np.uint8))[1].tobytes()
    files |= {f"depth/{k:03d}.png": _depth_png() for k in range(4)} | {f"masks/{k:03d}.png": mask for k in range(4)}
    seeds = []
    for key, more in (
        ("depth_file_path", {}),
        ("depth_file_path", {"depth_unit_scale_factor": 0.001}),
        ("depth_path", {"integer_depth_scale": 0.001}),
    ):
        tree = json.loads(files["transforms.json"]) | more
        for k, frame in enumerate(tree["frames"]):
            frame |= {key: f"depth/{k:03d}.png", "mask_path": f"masks/{k:03d}.png"}
        whole = {**files, "transforms.json": json.dumps(tree).encode()}
        pictures = {"depth/001.png": "picture", "masks/001.png": "picture"}
        seeds += each(whole, "", {"transforms.json": "json", **pictures})
    return seeds


def _checked(path: Path) -> object:
    check(path)
    return read(path, scale=1.0)


_WANTED = {"a": ("f", 2), "b": ("iu", 1)}


def _arrays() -> list[Seed]:
    with workshop() as folder:
        np.savez(folder / "a.npz", a=np.ones((3, 4)), b=np.arange(5))
        np.savez_compressed(folder / "b.npz", a=np.ones((3, 4)), b=np.arange(5))
        return [seed for name in ("a.npz", "b.npz") for seed in each(files_in(folder), name, {name: "zip"})]


def _read_arrays(path: Path) -> object:
    return read_arrays(path, "arrays", _WANTED, "write them again")
