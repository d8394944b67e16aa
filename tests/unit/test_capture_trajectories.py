"""The trajectory of a capture does not depend on how many cameras its source lists; only a rig takes several images at
a moment."""

from __future__ import annotations

from pathlib import Path

import capture_samples as sample
import numpy as np
import pytest

from nvsim.capture.check import check
from nvsim.capture.read import read
from nvsim.capture.store import fingerprint, load_capture, save_capture
from nvsim.capture.trajectories import trajectories


def colmap(folder: Path, cameras: list[int], names: list[str] | None = None, poses: np.ndarray | None = None) -> Path:
    """A model in text whose i-th image has the camera cameras[i]."""
    poses = sample.walk(len(cameras)) if poses is None else poses
    sample.write_colmap(folder, poses, sample.room(400), binary=False)
    model = folder / "sparse" / "0"
    lens = (
        f"PINHOLE {sample.WIDTH} {sample.HEIGHT} {sample.FOCAL} {sample.FOCAL} {sample.WIDTH / 2} {sample.HEIGHT / 2}"
    )
    (model / "cameras.txt").write_text("".join(f"{camera} {lens}\n" for camera in sorted(set(cameras))))
    lines = []
    for i, (camera, pose) in enumerate(zip(cameras, poses, strict=True)):
        name = f"{i:03d}.png" if names is None else names[i]
        (folder / "images" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "images" / f"{i:03d}.png").rename(folder / "images" / name)
        lines.append(f"{i + 1} {' '.join(map(repr, map(float, sample.world_to_camera(pose))))} {camera} {name}\n\n")
    (model / "images.txt").write_text("".join(lines))
    return folder


def length_of(folder: Path) -> float:
    summary = check(folder).summary
    assert summary is not None
    return summary.length


COUNT = 12
TRUTH = float(np.linalg.norm(np.diff(sample.walk(COUNT)[:, :3, 3], axis=0), axis=1).sum())
CAMERAS = {
    "one camera": [1] * COUNT,
    "a camera for each image": list(range(1, COUNT + 1)),
    "cameras in the opposite order": list(range(COUNT, 0, -1)),
    "two images of each camera": [1 + i // 2 for i in range(COUNT)],
    "a zoom that changes on the way": [1 + i % 2 for i in range(COUNT)],
    "one after the other": [1] * 4 + [2] * 8,
    "one photo by another camera": [2] + [1] * (COUNT - 1),
}


@pytest.mark.parametrize("cameras", CAMERAS)
def test_the_length_of_the_trajectory_does_not_depend_on_the_cameras(tmp_path: Path, cameras: str) -> None:
    assert length_of(colmap(tmp_path, CAMERAS[cameras])) == pytest.approx(TRUTH, abs=1e-3)


def test_names_with_numbers_of_any_length_are_in_their_order(tmp_path: Path) -> None:
    names = [f"frame{i}.png" for i in range(COUNT)]
    assert length_of(colmap(tmp_path, [1] * COUNT, names)) == pytest.approx(TRUTH, abs=1e-3)


def beside(poses: np.ndarray, offset: tuple[float, float, float]) -> np.ndarray:
    """The poses (N, 4, 4) of a camera at `offset` in the axes of another, looking the same way."""
    mount = np.eye(4)
    mount[:3, 3] = offset
    return poses @ mount


@pytest.mark.parametrize("order", ["left,right", "in turn"])
def test_a_rig_of_two_cameras_in_folders_is_one_trajectory(tmp_path: Path, order: str) -> None:
    left = sample.walk(COUNT)
    right = beside(left, (0.2, 0.0, 0.0))
    poses = np.concatenate([left, right])
    names = [f"{camera}/{i:03d}.png" for camera in ("left", "right") for i in range(COUNT)]
    cameras = [1] * COUNT + [2] * COUNT
    if order == "in turn":
        turns = np.arange(2 * COUNT).reshape(2, COUNT).T.reshape(-1)
        poses, names, cameras = poses[turns], [names[i] for i in turns], [cameras[i] for i in turns]
    capture = read(colmap(tmp_path, cameras, names, poses))
    (indices,) = trajectories(capture)
    assert {capture.frames[i].sensor for i in indices} == {"1"} and len(indices) == COUNT
    assert length_of(tmp_path) == pytest.approx(TRUTH, abs=1e-3)


def test_two_walks_with_the_same_names_are_no_rig(tmp_path: Path) -> None:
    names = [f"{phone}/IMG_{i:03d}.png" for phone in ("first", "second") for i in range(COUNT)]
    poses = np.concatenate([sample.walk(COUNT), sample.walk(COUNT, seed=7)[::-1]])
    capture = read(colmap(tmp_path, [1] * COUNT + [2] * COUNT, names, poses))
    (indices,) = trajectories(capture)
    assert len(indices) == 2 * COUNT and not any(frame.rig for frame in capture.frames)


def test_the_cameras_of_a_kapture_rig_are_one_trajectory(tmp_path: Path) -> None:
    poses = sample.walk(COUNT)
    rig = np.eye(4)
    sample.write_kapture(tmp_path, poses, sample.room(400), rig)
    sensors = tmp_path / "sensors"
    names = sample.write_images(sensors / "records_data" / "cam1", COUNT)
    lines = (sensors / "sensors.txt").read_text()
    camera = next(line for line in lines.splitlines() if line.startswith("cam0"))
    (sensors / "sensors.txt").write_text(lines + camera.replace("cam0", "cam1") + "\n")
    with open(sensors / "rigs.txt", "a") as rigs:
        rigs.write(sample.csv("rig", "cam1", 1.0, 0.0, 0.0, 0.0, -0.2, 0.0, 0.0))
    with open(sensors / "records_camera.txt", "a") as records:
        records.writelines(sample.csv(1000 + i, "cam1", f"cam1/{name}") for i, name in enumerate(names))
    capture = read(tmp_path)
    assert len(capture.frames) == 2 * COUNT and {frame.rig for frame in capture.frames} == {"rig"}
    assert length_of(tmp_path) == pytest.approx(TRUTH, abs=1e-3)


def test_a_stored_capture_keeps_its_rigs(tmp_path: Path) -> None:
    left = sample.walk(COUNT)
    names = [f"{camera}/{i:03d}.png" for camera in ("left", "right") for i in range(COUNT)]
    poses = np.concatenate([left, beside(left, (0.2, 0.0, 0.0))])
    capture = read(colmap(tmp_path / "walk", [1] * COUNT + [2] * COUNT, names, poses))
    (tmp_path / "stored").mkdir()
    save_capture(capture, tmp_path / "stored")
    stored = load_capture(tmp_path / "stored")
    assert [f.rig for f in stored.frames] == [f.rig for f in capture.frames] == ["1"] * (2 * COUNT)
    assert fingerprint(stored) == fingerprint(capture)
