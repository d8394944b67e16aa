"""Read captures whose poses are in one text file: recordings in the layouts of TUM RGB-D (rgb.txt, groundtruth.txt),
of ARKitScenes (lowres_wide/ID_TIME.png, lowres_wide.traj), and of Replica as NICE-SLAM renders it
(results/frame000000.jpg, traj.txt).

Poses have OpenCV axes, in meters unless a SLAM program without depth computed them. They are camera-to-world, those of
ARKitScenes world-to-camera. Rows are `time x y z qx qy qz qw` (TUM; SLAM programs write them too), or
`time rx ry rz x y z` with the rotation as a vector (ARKitScenes). Each image gets the pose of its time. Formats:
https://cvg.cit.tum.de/data/datasets/rgbd-dataset, https://github.com/apple/ARKitScenes/blob/main/DATA.md, and
https://github.com/cvg/nice-slam.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture import nerfstudio_fields
from nvsim.capture.findings import Findings
from nvsim.capture.pose_files import files_by_stem, intrinsics_file, read_lenses
from nvsim.capture.raw import (
    LOST_FRAME,
    RawCapture,
    RawFrame,
    checked_pose,
    lines_of,
    natural_order,
    pose_from_quaternion,
    read_lens,
    read_text,
)
from nvsim.capture.types import DepthFile
from nvsim.errors import InputError
from nvsim.geometry.lens import Lens
from nvsim.plain_text import count_text

_IMAGES, _DEPTHS = "rgb.txt", "depth.txt"
_TRAJECTORIES = ("groundtruth.txt", "CameraTrajectory.txt", "KeyFrameTrajectory.txt", "trajectory.txt")
_SAME_MOMENT = 0.02  # seconds between an image and its depth image or its pose, as in TUM's associate.py
_LARGEST_GAP = 0.15  # seconds between two poses that are interpolated
_TUM_UNIT = 1 / 5000  # meters per value of a depth image
_FREIBURG = {
    "freiburg1": (517.3, 516.5, 318.6, 255.3, 0.2624, -0.9531, -0.0054, 0.0026, 1.1633, 0, 0, 0),
    "freiburg2": (520.9, 521.0, 325.1, 249.7, 0.2312, -0.7849, -0.0033, -0.0001, 0.9172, 0, 0, 0),
    "freiburg3": (535.4, 539.2, 320.1, 247.6, 0, 0, 0, 0, 0, 0, 0, 0),
}
"""Part of the name of a folder -> the lens that the dataset states for it: FULL_OPENCV, 640x480."""
_ARKIT_POSES, _ARKIT_IMAGES = "lowres_wide.traj", ("wide", "vga_wide", "lowres_wide")  # the largest images first
_MILLIMETER = 0.001
_REPLICA_POSES, _REPLICA_LENS, _REPLICA_IMAGES = "traj.txt", "cam_params.json", "results"


def find_tum(path: Path) -> Path | None:
    """`path` if it has the list of images and a trajectory of TUM RGB-D; otherwise None."""
    found = (path / _IMAGES).is_file() and any((path / name).is_file() for name in _TRAJECTORIES)
    return path if found else None


def read_tum(folder: Path, findings: Findings) -> RawCapture:
    """The capture of a recording in TUM's format. Images without a pose of their time are skipped with a warning.

    Raises InputError if a list or the intrinsics are missing or unusable."""
    images = _listed(folder / _IMAGES)
    if not images:
        raise InputError(f"{folder / _IMAGES} lists no images; write it again.")
    trajectory = next(folder / name for name in _TRAJECTORIES if (folder / name).is_file())
    times, poses = _trajectory(trajectory, "time x y z qx qy qz qw", _pose_of_quaternion, findings)
    depths = _listed(folder / _DEPTHS) if (folder / _DEPTHS).is_file() else []
    depth_times = np.array([at for at, _ in depths])
    lens = _tum_lens(folder, [file for _, file in images], findings)
    frames: list[RawFrame] = []
    found: list[DepthFile] = []
    for at, file in images:
        pose = pose_at(at, times, poses)
        if pose is None:
            continue
        frames.append(RawFrame(file, folder / file, lens, pose, file, timestamp=at))
        if lens is not None and len(depths):
            nearest = int(np.abs(depth_times - at).argmin())
            if abs(depth_times[nearest] - at) <= _SAME_MOMENT:
                found.append(DepthFile(folder / depths[nearest][1], lens, pose, file, unit=_TUM_UNIT))
    if not frames:
        raise InputError(f"No image of {folder} has a pose: the times in {_IMAGES} and {trajectory.name} do not agree.")
    if len(frames) < len(images):
        without = count_text(len(images) - len(frames), "image")
        findings.warning(f"{without} of {len(images)} without a pose of that time", trajectory.name, "they are skipped")
    is_measured = trajectory.name == _TRAJECTORIES[0]  # of the others, only those of a SLAM with depth have meters
    because = "" if is_measured or not found else "depth images belong to the trajectory"
    metric = True if is_measured or found else None
    return RawCapture(folder, "TUM", tuple(frames), None, metric, (), tuple(found), because)


def _listed(path: Path) -> list[tuple[float, str]]:
    """Time in seconds and name of each file in a list of TUM RGB-D, in the order of time."""
    found = []
    for number, line in lines_of(read_text(path)):
        words = line.split(maxsplit=1)
        if not words or words[0].startswith("#"):
            continue
        try:
            at, name = float(words[0]), words[1].strip()
        except (ValueError, IndexError):
            at, name = math.nan, ""
        if not math.isfinite(at):
            raise InputError(f"{path}, line {number}: write `time file`, as TUM's format does.")
        found.append((at, name))
    return sorted(found)


def _pose_of_quaternion(row: NDArray[np.float64], where: str, findings: Findings) -> NDArray[np.float64] | None:
    x, y, z, w = row[3:]
    return pose_from_quaternion(np.array([w, x, y, z]), row[:3], where, findings)


def _pose_of_vector(row: NDArray[np.float64], where: str, findings: Findings) -> NDArray[np.float64] | None:
    import cv2  # the window reads the table of formats before it loads OpenCV

    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(row[:3])[0].T
    pose[:3, 3] = -pose[:3, :3] @ row[3:]
    return checked_pose(pose, where, findings)


def _trajectory(
    path: Path,
    columns: str,
    pose_of: Callable[[NDArray[np.float64], str, Findings], NDArray[np.float64] | None],
    findings: Findings,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (N,) float64, increasing, and poses (N, 4, 4) of the rows of a trajectory. The numbers after the time are
    given to `pose_of`. Damaged rows are errors in `findings`. Raises InputError if no row is usable."""
    rows: dict[float, NDArray[np.float64]] = {}
    count = len(columns.split())
    for number, line in lines_of(read_text(path)):
        words = line.replace(",", " ").split()
        if not words or words[0].startswith("#"):
            continue
        where = f"{path.name}:{number}"
        try:
            row = np.array([float(word) for word in words[:count]])
        except ValueError:
            row = np.array([])
        if len(row) < count or not math.isfinite(row[0]):
            findings.error(f"the line is not `{columns}`", where, "the pose is ignored")
            continue
        pose = pose_of(row[1:], where, findings)
        if pose is not None:
            rows[float(row[0])] = pose
    if not rows:
        raise InputError(f"{path} holds no pose ({columns}); write it again.")
    times = np.array(sorted(rows))
    return times, np.array([rows[at] for at in times])


def pose_at(at: float, times: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """The pose (4, 4) at the time `at` in seconds, between its two neighbors if these are near each other, otherwise
    the nearest one; None if none is near. `times` (N,) increase, `poses` is (N, 4, 4)."""
    after = int(np.searchsorted(times, at))
    before = after - 1
    if before >= 0 and after < len(times) and times[after] - times[before] <= _LARGEST_GAP:
        share = (at - times[before]) / (times[after] - times[before])
        mean = (1 - share) * poses[before] + share * poses[after]
        u, _, v = np.linalg.svd(mean[:3, :3])  # the rotation nearest to the mean of two similar ones
        mean[:3, :3] = u @ v
        return np.asarray(mean)
    nearest = min((i for i in (before, after) if 0 <= i < len(times)), key=lambda i: abs(times[i] - at))
    return poses[nearest] if abs(times[nearest] - at) <= _SAME_MOMENT else None


def _tum_lens(folder: Path, images: list[str], findings: Findings) -> Lens | None:
    """The lens of color and depth images: that of a file with intrinsics, else the one that the dataset states."""
    stated = next((v for name, v in _FREIBURG.items() if name in folder.resolve().name), None)
    if stated is not None and intrinsics_file(folder) is None:
        return read_lens("FULL_OPENCV", 640, 480, stated, folder.name, findings)
    files = {file: folder / file for file in images if (folder / file).is_file()}
    return read_lenses(folder, files, {}, findings)[0]


def find_arkit(path: Path) -> Path | None:
    """`path`, or the folder of frames in it, if it is a recording of ARKitScenes; otherwise None."""
    for folder in (path, path / f"{path.name}_frames"):
        if (folder / _ARKIT_POSES).is_file() and any((folder / name).is_dir() for name in _ARKIT_IMAGES):
            return folder
    return None


def read_arkit(folder: Path, findings: Findings) -> RawCapture:
    """The capture of a recording of ARKitScenes: the largest images that are there, their lenses, and the depth of the
    LiDAR scanner. Depth with the lowest confidence is ignored, and images without a pose or a lens of their time are
    skipped with a warning.

    Raises InputError if no image has a pose and a lens."""
    images = next(folder / name for name in _ARKIT_IMAGES if (folder / name).is_dir())
    times, poses = _trajectory(folder / _ARKIT_POSES, "time rx ry rz x y z", _pose_of_vector, findings)
    lenses, depths, confidences = (
        _by_time(folder / name) for name in (f"{images.name}_intrinsics", "lowres_depth", "confidence")
    )
    frames: list[RawFrame] = []
    found: list[DepthFile] = []
    listed = _by_time(images)
    for at, file in listed.items():
        pose, lens_file = pose_at(at, times, poses), _nearest(lenses, at)
        lens = None if pose is None or lens_file is None else _arkit_lens(lens_file, findings)
        if pose is None or lens is None:
            continue
        name = f"{images.name}/{file.name}"
        frames.append(RawFrame(name, file, lens, pose, name, timestamp=at))
        depth = _nearest(depths, at)
        if depth is not None:
            confidence = confidences.get(_time_of(depth))
            found.append(DepthFile(depth, lens, pose, name, unit=_MILLIMETER, confidence=confidence))
    if not frames:
        raise InputError(f"No image in {images} has a pose and a lens of its time; copy the recording again.")
    if len(frames) < len(listed):
        without = count_text(len(listed) - len(frames), "image")
        findings.warning(f"{without} of {len(listed)} without a pose or a lens of that time", images.name, "skipped")
    return RawCapture(folder, "ARKitScenes", tuple(frames), None, True, (), tuple(found))


def _time_of(file: Path) -> float:
    """The seconds in a file name ID_SECONDS.png; not a number for other names."""
    try:
        return float(file.stem.rpartition("_")[2])
    except ValueError:
        return math.nan


def _by_time(folder: Path) -> dict[float, Path]:
    """The files in a folder by the seconds in their names, in the order of time. Empty if there is no folder."""
    files = sorted(folder.iterdir()) if folder.is_dir() else []
    return dict(sorted((at, file) for file in files if math.isfinite(at := _time_of(file))))


def _nearest(files: dict[float, Path], at: float) -> Path | None:
    """The file of the same moment, None if there is none."""
    times = np.array(list(files))
    i = int(np.abs(times - at).argmin()) if len(times) else -1
    return list(files.values())[i] if i >= 0 and abs(times[i] - at) <= _SAME_MOMENT else None


def _arkit_lens(file: Path, findings: Findings) -> Lens | None:
    """The lens in a file `width height fx fy cx cy`."""
    try:
        width, height, *params = map(float, read_text(file).split())
    except ValueError:
        width, height, params = math.nan, math.nan, []
    if len(params) != 4 or not np.isfinite([width, height, *params]).all():
        findings.error("the file is not `width height fx fy cx cy`", file.name, LOST_FRAME)
        return None
    return read_lens("PINHOLE", width, height, params, file.name, findings)


def find_replica(path: Path) -> Path | None:
    """`path` if it has the images and the trajectory of a Replica scene of NICE-SLAM; otherwise None."""
    return path if (path / _REPLICA_POSES).is_file() and (path / _REPLICA_IMAGES).is_dir() else None


def read_replica(folder: Path, findings: Findings) -> RawCapture:
    """The capture of a Replica scene that NICE-SLAM rendered: 16 numbers of a pose in each line of traj.txt.

    Raises InputError if the lens is missing or the counts of poses and images differ."""
    files = files_by_stem(folder / _REPLICA_IMAGES)
    names = sorted((name for name in files if name.startswith("frame")), key=natural_order)
    lines = [(n, line.split()) for n, line in lines_of(read_text(folder / _REPLICA_POSES)) if line.strip()]
    if len(lines) != len(names):
        counts = f"{count_text(len(lines), 'pose')} for {count_text(len(names), 'image')}"
        raise InputError(f"{folder / _REPLICA_POSES} holds {counts}; copy the scene again.")
    lens, unit = _replica_lens(folder, findings)
    frames: list[RawFrame] = []
    found: list[DepthFile] = []
    for index, (name, (number, words)) in enumerate(zip(names, lines, strict=True)):
        where = f"{_REPLICA_POSES}:{number}"
        try:
            matrix = np.array([float(word) for word in words]).reshape(4, 4)
        except ValueError:
            findings.error("the line does not hold the 16 numbers of a pose", where, "the frame is skipped")
            continue
        pose = checked_pose(matrix, where, findings)
        listed = f"{_REPLICA_IMAGES}/{files[name].name}"
        frames.append(RawFrame(listed, files[name], lens, pose, where, timestamp=float(index)))
        depth = files.get(name.replace("frame", "depth"))
        if lens is not None and pose is not None and depth is not None:
            found.append(DepthFile(depth, lens, pose, listed, unit=unit))
    return RawCapture(folder, "Replica", tuple(frames), None, True, (), tuple(found))


def _replica_lens(folder: Path, findings: Findings) -> tuple[Lens | None, float]:
    """The lens, and meters per value of a depth image, from cam_params.json in the scene or in the folder above."""
    file = next((p for p in (folder / _REPLICA_LENS, folder.parent / _REPLICA_LENS) if p.is_file()), None)
    if file is None:
        raise InputError(f"{folder} has no lens: {_REPLICA_LENS} is missing there and in the folder above; copy it.")
    camera = nerfstudio_fields.load_object(file).get("camera")
    keys = ("w", "h", "fx", "fy", "cx", "cy", "scale")
    if not isinstance(camera, dict):
        raise InputError(f'{file} has no object "camera"; copy it again.')
    values = [nerfstudio_fields.number(camera, key, file.name) for key in keys]
    if any(value is None for value in values) or not values[-1]:
        raise InputError(f"{file} does not hold the numbers {', '.join(keys)}; copy it again.")
    w, h, fx, fy, cx, cy, scale = (float(value or 0) for value in values)
    return read_lens("PINHOLE", w, h, (fx, fy, cx, cy), file.name, findings), 1 / scale
