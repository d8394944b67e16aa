"""Read kapture 1.1: sensors, rigs, trajectories, and records as comma-separated text (NAVER's kapture_format).

Trajectories are world-to-device and rigs are rig-to-sensor, so a camera on a rig has the pose rig_to_sensor times
world_to_rig. A record without a pose at exactly its timestamp is skipped with a finding; poses are not interpolated.

The unit is the meter, because the devices are robots and phones. The exception is a tree that was converted from a
reconstruction: it has points3d.txt, but no rig and no lidar, depth, or GNSS sensor.
"""

from __future__ import annotations

import os
from array import array
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import Findings
from nvsim.capture.moved_files import FolderFiles, report_moved
from nvsim.capture.pointcloud import merge, read_cloud, stored_points, usable_cloud
from nvsim.capture.raw import (
    RawCapture,
    RawFrame,
    file_size,
    inverse,
    lines_of,
    pose_from_quaternion,
    read_lens,
    read_text,
)
from nvsim.capture.trajectories import with_rigs
from nvsim.capture.types import Cloud, DepthFile, ScanFile
from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.geometry.lens import Lens

_METRIC_SENSORS = {"lidar", "depth", "gnss"}
_ALIKE = float(np.cos(np.radians(30)))
Pose = NDArray[np.float64]
_NESTED, _CARRIERS = 8, 64  # limits: levels of nested rigs, and carriers of one sensor


def find(path: Path) -> Path | None:
    """The kapture tree of a folder: the folder itself, a child named kapture or mapping, or the parent of a `sensors`
    folder. For a file sensors.txt, the tree that contains it. None if there is no tree."""
    if not path.is_dir() and path.name != "sensors.txt":
        return None
    folder = path if path.is_dir() else path.parent
    for root in (folder, folder / "kapture", folder / "mapping", folder.parent):
        if root == folder.parent and folder.name != "sensors":
            continue
        if file_size(root / "sensors" / "sensors.txt") is not None:
            return root
    return None


def explain_missing(folder: Path) -> str:
    """A sentence about a folder with a `sensors` folder that is not a kapture tree; "" without a `sensors` folder."""
    if not (folder / "sensors").is_dir():
        return ""
    return f"{folder / 'sensors' / 'sensors.txt'} is missing; a kapture capture needs it."


def read(root: Path, findings: Findings) -> RawCapture:
    """The capture of a kapture tree. Raises InputError if sensors.txt, records_camera.txt, or trajectories.txt is
    missing or cannot be read."""
    with reading(root / "sensors", "the sensors of a kapture capture"):
        raw = _read(root, findings)
    unposed = [f for f in raw.frames if f.camera_to_world is None]
    for frame in unposed:
        findings.warning("the frame has no pose at its timestamp", frame.where, "the frame is skipped")
    if raw.frames and len(unposed) == len(raw.frames):
        findings.error("no frame has a pose", "trajectories.txt", "no frame can be placed")
    return raw


def _read(root: Path, findings: Findings) -> RawCapture:
    sensors = root / "sensors"
    for name in ("sensors.txt", "records_camera.txt", "trajectories.txt"):
        if file_size(sensors / name) is None:
            raise InputError(f"{sensors / name} is missing; a kapture capture needs it.")
    tree = SensorTree()
    _read_sensors(sensors / "sensors.txt", tree, findings)
    if file_size(sensors / "rigs.txt") is not None:
        _read_rigs(sensors / "rigs.txt", tree, findings)
    _read_trajectories(sensors / "trajectories.txt", tree, findings)
    frames = _read_records(sensors, tree, findings)
    points = root / "reconstruction" / "points3d.txt"
    reconstructed = file_size(points) is not None
    has_depth = file_size(sensors / "records_depth.txt") is not None
    depths = _read_depths(sensors, tree, frames, findings) if has_depth else []
    cloud, scans = None, list[ScanFile]()
    if file_size(sensors / "records_lidar.txt") is not None:
        cloud, scans = _read_lidar(sensors, tree, findings)
    elif reconstructed:
        cloud = _read_points(points, findings)
    metric = not reconstructed or bool(tree.mounts) or bool(_METRIC_SENSORS & set(tree.kinds.values()))
    return RawCapture(root, "kapture", tuple(frames), cloud, metric, tuple(scans), tuple(depths))


def _rows(path: Path, least: int, findings: Findings, maxsplit: int = -1) -> Iterator[tuple[str, list[str]]]:
    """Place and fields of each row. A row with fewer than `least` fields becomes an error finding."""
    for number, line in lines_of(read_text(path)):
        if number == 1 and line.startswith("#") and "format" in line and not line.rstrip().endswith(("1.1", "1.0")):
            findings.warning("the format version is not 1.1", f"{path.name}, line 1", "fields may be read wrongly")
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        where = f"{path.name}, line {number}"
        fields = [f.strip() for f in line.split(",", maxsplit)]
        if len(fields) < least:
            findings.error(f"the row has {len(fields)} fields, not {least}", where, "the row cannot be used")
            continue
        yield where, fields


def _numbers(fields: list[str], where: str, findings: Findings) -> list[float] | None:
    try:
        return [float(f) for f in fields]
    except ValueError:
        findings.error("a field is not a number", where, "the row cannot be used")
        return None


def _timestamp(text: str, where: str, findings: Findings) -> int | None:
    if text.isascii() and text.isdigit() and len(text) <= 19:
        return int(text)
    findings.error(f"{text[:30]!r} is not a timestamp", where, "the row cannot be used")
    return None


def _pose(fields: list[str], where: str, findings: Findings) -> Pose | None:
    """The pose (4, 4) from seven fields. None without a finding if a field is empty, which kapture allows."""
    if any(f == "" for f in fields):
        return None
    values = _numbers(fields, where, findings)
    if values is None:
        return None
    return pose_from_quaternion(np.array(values[:4]), np.array(values[4:]), where, findings)


def _read_sensors(path: Path, tree: SensorTree, findings: Findings) -> None:
    for where, fields in _rows(path, 3, findings):
        sensor, kind = fields[0], fields[2].lower()
        if sensor in tree.kinds:
            findings.error(f"sensor {sensor!r} is listed twice", where, "it is ambiguous")
            continue
        tree.kinds[sensor] = kind
        if kind == "depth":
            tree.depth_lenses[sensor] = _depth_lens(fields, where, findings)
        if kind != "camera":
            continue
        tree.lenses[sensor] = None
        if len(fields) < 6:
            findings.error(f"camera {sensor!r} has no model and size", where, "no frame can use this camera")
            continue
        params = _numbers(fields[4:], where, findings)
        if params is not None:
            tree.lenses[sensor] = read_lens(fields[3], params[0], params[1], params[2:], where, findings)


def _depth_lens(fields: list[str], where: str, findings: Findings) -> Lens | None:
    """The lens of a depth camera. An unusable lens only gives a warning, because the capture works without depth."""
    faults = Findings()
    params = _numbers(fields[4:], where, faults)
    if params and len(params) >= 2 and len(fields) >= 6:
        lens = read_lens(fields[3], params[0], params[1], params[2:], where, faults)
        if lens is not None:
            return lens
    findings.warning(f"depth camera {fields[0]!r} has no known lens", where, "its depth images are skipped")
    return None


def _read_rigs(path: Path, tree: SensorTree, findings: Findings) -> None:
    for where, fields in _rows(path, 9, findings):
        pose = _pose(fields[2:9], where, findings)
        if pose is None:
            findings.warning(f"sensor {fields[1]!r} has no pose on its rig", where, "the rig cannot place it")
        else:
            tree.mounts.setdefault(fields[1], []).append((fields[0], pose))


def _read_trajectories(path: Path, tree: SensorTree, findings: Findings) -> None:
    for where, fields in _rows(path, 9, findings):
        timestamp = _timestamp(fields[0], where, findings)
        if timestamp is not None:
            tree.poses[fields[1], timestamp] = _pose(fields[2:9], where, findings)


def _read_records(sensors: Path, tree: SensorTree, findings: Findings) -> list[RawFrame]:
    frames = []
    for where, fields in _rows(sensors / "records_camera.txt", 3, findings, maxsplit=2):
        timestamp = _timestamp(fields[0], where, findings)
        if timestamp is None or not fields[2]:
            continue
        device, name = fields[1], fields[2]
        where = f"{name}, {where}"
        if device not in tree.lenses:
            findings.error(f"the record names camera {device!r}, which sensors.txt does not list", where, "no lens")
        pose = tree.world_to(device, timestamp)
        image = sensors / "records_data" / name
        lens = tree.lenses.get(device)
        frames.append(
            RawFrame(name, image, lens, None if pose is None else inverse(pose), where, device, float(timestamp))
        )
    frames.sort(key=lambda f: f.timestamp)  # the order of the trajectory; records may have any order
    return _on_rigs(frames, tree)


def _on_rigs(frames: list[RawFrame], tree: SensorTree) -> list[RawFrame]:
    """The frames, with the id of each rig that carries several cameras."""
    if not tree.mounts:
        return with_rigs(frames, [frame.timestamp for frame in frames])
    rigs = {sensor: tree.rig_of(sensor) for sensor in {frame.sensor for frame in frames}}
    cameras = Counter(rigs.values())
    return [replace(f, rig=rigs[f.sensor]) if cameras[rigs[f.sensor]] > 1 else f for f in frames]


def _read_depths(sensors: Path, tree: SensorTree, frames: list[RawFrame], findings: Findings) -> list[DepthFile]:
    """Depth images: float32 in meters, row by row, or PNG, TIFF, or .npy files.

    Each belongs to the image with an equal timestamp and a similar viewing direction. Depth images without a pose or a
    lens are skipped. Faults in their list are only warnings."""
    depths, faults = [], Findings()
    at_time: dict[float, list[RawFrame]] = {}
    for frame in frames:
        at_time.setdefault(frame.timestamp, []).append(frame)
    try:
        for where, fields in _rows(sensors / "records_depth.txt", 3, faults, maxsplit=2):
            timestamp = _timestamp(fields[0], where, faults)
            lens = tree.depth_lenses.get(fields[1])
            pose = None if timestamp is None else tree.world_to(fields[1], timestamp)
            if lens is not None and pose is not None:
                placed, file = inverse(pose), sensors / "records_data" / fields[2]
                is_raw = file.suffix.lower() not in (".png", ".tif", ".tiff", ".npy")
                name = _nearest_frame_name(placed, at_time.get(float(timestamp or 0), []))
                depths.append(DepthFile(file, lens, placed, name, is_raw=is_raw, unit=1.0 if is_raw else 0.001))
    except InputError as error:
        faults.error(str(error).rstrip("."), "records_depth.txt", "")
    for fault in faults:
        findings.warning(fault.message, fault.where, "the depth image is skipped")
    return depths


def _nearest_frame_name(pose: NDArray[np.float64], frames: list[RawFrame]) -> str:
    """The name of the frame whose viewing direction is nearest to that of `pose` (4, 4); "" if none is within 30
    degrees, because such a camera shows other surfaces."""
    poses = [(f.name, f.camera_to_world) for f in frames if f.camera_to_world is not None]
    alike = [(float(p[:3, 2] @ pose[:3, 2]), -float(np.linalg.norm(p[:3, 3] - pose[:3, 3])), name) for name, p in poses]
    best = max(alike, default=(0.0, 0.0, ""))
    return best[2] if best[0] > _ALIKE else ""


def _read_lidar(sensors: Path, tree: SensorTree, findings: Findings) -> tuple[Cloud | None, list[ScanFile]]:
    """All points in the world frame, and the LiDAR scans that have a pose."""
    clouds, scans = [], []
    files, found = FolderFiles(sensors / "records_data"), dict[Path, Path]()
    for where, fields in _rows(sensors / "records_lidar.txt", 3, findings, maxsplit=2):
        timestamp = _timestamp(fields[0], where, findings)
        if timestamp is None:
            continue
        path = sensors / "records_data" / fields[2]
        if not os.path.lexists(path):
            moved = files.find(path)
            if moved is None:
                findings.warning(
                    "the point cloud is missing", f"{fields[2]}, {where}", "the capture is used without it"
                )
                continue
            found[path] = path = moved
        try:
            cloud = read_cloud(path, findings)
        except InputError as error:
            findings.error(*_cloud_fault(path, fields[2], where, error))
            continue
        pose = tree.world_to(fields[1], timestamp)
        if pose is not None:
            to_world = inverse(pose)
            points = cloud.points.astype(np.float64) @ to_world[:3, :3].T + to_world[:3, 3]
            clouds.append(Cloud(stored_points(points), cloud.colors))
            scans.append(ScanFile(path, fields[1], to_world))
        elif tree.has_any_pose(fields[1]):
            findings.warning("the cloud has no pose at its timestamp", f"{fields[2]}, {where}", "it is skipped")
        else:
            findings.note("the cloud's sensor has no pose at all", where, "it is assumed to be in the world frame")
            clouds.append(cloud)
    report_moved("point cloud", found, sensors.parent, findings)
    return merge(clouds), scans


def _cloud_fault(path: Path, name: str, where: str, error: InputError) -> tuple[str, str, str]:
    if file_size(path) == 0:
        message = "the point cloud is empty (0 bytes)"
    else:
        message = str(error).rstrip(".")
    return message, f"{name}, {where}", "without it, the floor cannot be measured and training has no initial points"


def _read_points(path: Path, findings: Findings) -> Cloud | None:
    rows = array("d")
    for where, fields in _rows(path, 3, findings):
        values = _numbers(fields[:6], where, findings)
        if values is not None:
            rows.extend((values + [128.0] * 3)[:6])
    if not rows:
        return None
    table = np.array(rows).reshape(-1, 6)
    colors = np.clip(np.nan_to_num(table[:, 3:]), 0, 255).astype(np.uint8)
    return usable_cloud(table[:, :3], colors, "sfm", path.name, findings)


@dataclass
class SensorTree:
    """The content of the sensor files. Poses are (4, 4); None if the file omits the pose or it is not rigid."""

    kinds: dict[str, str] = field(default_factory=dict)
    lenses: dict[str, Lens | None] = field(default_factory=dict)
    depth_lenses: dict[str, Lens | None] = field(default_factory=dict)
    mounts: dict[str, list[tuple[str, Pose]]] = field(default_factory=dict)  # sensor -> (rig, rig to sensor)
    poses: dict[tuple[str, int], Pose | None] = field(default_factory=dict)  # (device, timestamp) -> world to device
    _ways: dict[str, list[tuple[str, Pose | None]]] = field(default_factory=dict)

    @cached_property
    def _posed(self) -> set[str]:
        return {device for device, _ in self.poses}

    def _carriers(self, device: str) -> list[tuple[str, Pose | None]]:
        """The device and the rigs that carry it, nearest first (rigs may be nested).

        Each has the transform from the carrier to the device, None for the device itself. A rig that is reachable in
        several ways is listed once."""
        if device not in self._ways:
            ways: dict[str, Pose | None] = {device: None}
            edge = [device]
            for _ in range(_NESTED):
                reached = []
                for carried in edge:
                    way = ways[carried]
                    for rig, mount in self.mounts.get(carried, []):
                        if rig not in ways and len(ways) < _CARRIERS:
                            ways[rig] = mount if way is None else way @ mount
                            reached.append(rig)
                edge = reached
            self._ways[device] = list(ways.items())
        return self._ways[device]

    def world_to(self, device: str, timestamp: int) -> Pose | None:
        """The world-to-device pose (4, 4) of a device: its own, or through a rig that carries it. None if unknown."""
        for carrier, way in self._carriers(device):
            pose = self.poses.get((carrier, timestamp))
            if pose is not None:
                return pose if way is None else way @ pose
        return None

    def rig_of(self, device: str) -> str:
        """The outermost rig that carries a device, "" if there is none."""
        carrier = self._carriers(device)[-1][0]
        return "" if carrier == device else carrier

    def has_any_pose(self, device: str) -> bool:
        return any(carrier in self._posed for carrier, _ in self._carriers(device))
