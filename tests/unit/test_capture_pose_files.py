"""Raw exports of Polycam, recordings of a depth camera, and those with one trajectory file: the reader returns what was
written, in each layout."""

from __future__ import annotations

import json
from pathlib import Path

import capture_samples as sample
import cv2
import numpy as np
import pytest

from nvsim.capture.check import check
from nvsim.capture.depth_images import read_depth_image
from nvsim.capture.read import read
from nvsim.capture.store import fingerprint, load_capture, save_capture
from nvsim.capture.trajectory_files import pose_at
from nvsim.errors import InputError
from nvsim.geometry.rotation import quaternion_from_matrix

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
Z_UP_TO_Y_UP = np.linalg.inv([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])


def depth_image(path: Path, millimeters: int = 1500) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    values = np.full((sample.HEIGHT // 2, sample.WIDTH // 2), millimeters, np.uint16)
    values[0, 0] = 65_535
    assert cv2.imwrite(str(path), values)


def polycam(folder: Path, poses: np.ndarray, cameras: str = "corrected_cameras", images: str = "images") -> Path:
    """A raw export: JSON files with the fields t_ij of the pose in a world with y up, and timestamps as names."""
    inside = folder / "keyframes"
    names = sample.write_images(inside / images, len(poses))
    (inside / cameras).mkdir()
    for i, (name, pose) in enumerate(zip(names, poses)):
        stem = str(1_000_000 + 50_000 * i)
        (inside / images / name).rename(inside / images / f"{stem}.jpg")
        matrix = Z_UP_TO_Y_UP @ pose @ FLIP
        fields = {f"t_{r}{c}": matrix[r, c] for r in range(3) for c in range(4)}
        lens = {"fx": sample.FOCAL, "fy": sample.FOCAL, "cx": 32.0, "cy": 24.0, "width": 64, "height": 48}
        (inside / cameras / f"{stem}.json").write_text(json.dumps({**fields, **lens, "blur_score": 90.0}))
        depth_image(inside / "depth" / f"{stem}.png")
    return folder


def seven_scenes(folder: Path, poses: np.ndarray, intrinsics: bool = True) -> Path:
    names = sample.write_images(folder, len(poses))
    for i, (name, pose) in enumerate(zip(names, poses)):
        (folder / name).rename(folder / f"frame-{i:06d}.color.png")
        np.savetxt(folder / f"frame-{i:06d}.pose.txt", pose, delimiter="\t")
        depth_image(folder / f"frame-{i:06d}.depth.png")
    if intrinsics:
        np.savetxt(folder / "camera-intrinsics.txt", [[sample.FOCAL, 0, 32], [0, sample.FOCAL, 24], [0, 0, 1]])
    return folder


def scannet(folder: Path, poses: np.ndarray) -> Path:
    names = sample.write_images(folder / "color", len(poses))
    (folder / "pose").mkdir()
    for i, (name, pose) in enumerate(zip(names, poses)):
        (folder / "color" / name).rename(folder / "color" / f"{i}.jpg")
        np.savetxt(folder / "pose" / f"{i}.txt", pose)
        depth_image(folder / "depth" / f"{i}.png")
    for name, size in (("color", 2.0), ("depth", 0.5)):  # the color images are smaller copies
        k = np.eye(4)
        k[:2, :3] = size * np.array([[sample.FOCAL, 0, 32], [0, sample.FOCAL, 24]])
        (folder / "intrinsic").mkdir(exist_ok=True)
        np.savetxt(folder / "intrinsic" / f"intrinsic_{name}.txt", k)
    return folder


def tum(folder: Path, poses: np.ndarray, trajectory: str = "groundtruth.txt") -> Path:
    """Images every 0.1 s. The trajectory has poses 5 ms before and after each image, so they must be interpolated."""
    names = sample.write_images(folder / "rgb", len(poses))
    rows, images, depths = ["# time x y z qx qy qz qw"], ["# color images"], ["# depth images"]
    for i, (name, pose) in enumerate(zip(names, poses)):
        at = 1_305_031_102.1 + 0.1 * i
        images.append(f"{at:.6f} rgb/{name}")
        depths.append(f"{at + 0.012:.6f} depth/{i}.png")
        depth_image(folder / "depth" / f"{i}.png", 7500)
        q = quaternion_from_matrix(pose[:3, :3])
        for shift in (-0.005, 0.005):
            x, y, z = pose[:3, 3] + shift
            rows.append(f"{at + shift:.6f} {x:.12f} {y:.12f} {z:.12f} {q[1]:.12f} {q[2]:.12f} {q[3]:.12f} {q[0]:.12f}")
    for name, lines in (("rgb.txt", images), ("depth.txt", depths), (trajectory, rows)):
        (folder / name).write_text("\n".join(lines) + "\n")
    np.savetxt(folder / "camera-intrinsics.txt", [[sample.FOCAL, 0, 32], [0, sample.FOCAL, 24], [0, 0, 1]])
    return folder


def replica(folder: Path, poses: np.ndarray) -> Path:
    names = sample.write_images(folder / "room0" / "results", len(poses))
    for i, name in enumerate(names):
        (folder / "room0" / "results" / name).rename(folder / "room0" / "results" / f"frame{i:06d}.jpg")
        depth_image(folder / "room0" / "results" / f"depth{i:06d}.png", 9750)
    np.savetxt(folder / "room0" / "traj.txt", np.reshape(poses, (-1, 16)))
    lens = {"w": 64, "h": 48, "fx": sample.FOCAL, "fy": sample.FOCAL, "cx": 32, "cy": 24, "scale": 6500.0}
    (folder / "cam_params.json").write_text(json.dumps({"camera": lens}))
    return folder / "room0"


def arkit(folder: Path, poses: np.ndarray) -> Path:
    """Images every 0.1 s in a folder ID_frames. Trajectory and lenses have times that differ by milliseconds."""
    inside = folder / f"{folder.name}_frames"
    names = sample.write_images(inside / "lowres_wide", len(poses))
    (inside / "lowres_wide_intrinsics").mkdir()
    rows = []
    for i, (name, pose) in enumerate(zip(names, poses)):
        at = 6790.5 + 0.1 * i
        (inside / "lowres_wide" / name).rename(inside / "lowres_wide" / f"41069021_{at:.3f}.png")
        lens = inside / "lowres_wide_intrinsics" / f"41069021_{at - 0.001:.3f}.pincam"
        lens.write_text(f"64 48 {sample.FOCAL} {sample.FOCAL} 32 24")
        depth_image(inside / "lowres_depth" / f"41069021_{at:.3f}.png")
        inverse = np.linalg.inv(pose)
        row = [*cv2.Rodrigues(inverse[:3, :3])[0][:, 0], *inverse[:3, 3]]
        rows += [" ".join([f"{at + shift:.6f}", *map(repr, map(float, row))]) for shift in (-0.004, 0.004)]
    (inside / "lowres_wide.traj").write_text("\n".join(rows) + "\n")
    return folder


LAYOUTS = {
    "Polycam": polycam,
    "7-Scenes": seven_scenes,
    "ScanNet": scannet,
    "TUM": tum,
    "Replica": replica,
    "ARKitScenes": arkit,
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_poses_lenses_and_depth_come_back(tmp_path: Path, layout: str) -> None:
    poses = sample.walk(12)
    capture = read(LAYOUTS[layout](tmp_path / "scan", poses))
    np.testing.assert_allclose([f.camera_to_world for f in capture.frames], poses, atol=1e-6)
    assert capture.alignment.is_identity and capture.alignment.scale_known
    assert all(f.image_path.is_file() for f in capture.frames)
    lens = capture.frames[0].lens
    np.testing.assert_allclose(np.array(lens.params) / lens.width, np.array((sample.FOCAL, sample.FOCAL, 32, 24)) / 64)
    assert len(capture.depth_of_frames) == 12
    depth = capture.depths[3]
    own = depth.lens.pinhole
    np.testing.assert_allclose((own.fx / own.width, own.cy / own.height), (sample.FOCAL / 64, 0.5))
    values = read_depth_image(depth)
    assert values[0, 0] == 0 and values[1, 1] == 1.5
    report = check(tmp_path / "scan")
    assert not report.refused, report.findings
    assert not any(finding.severity == "error" for finding in report.findings), report.findings


def test_frames_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    poses = sample.walk(12)
    names = [f.name for f in read(scannet(tmp_path / "scan", poses)).frames]
    assert names == [f"color/{i}.jpg" for i in range(12)]
    frames = read(polycam(tmp_path / "phone", poses)).frames
    np.testing.assert_allclose([f.timestamp for f in frames], 1 + 0.05 * np.arange(12))


def test_optimized_poses_and_images_of_polycam_are_preferred(tmp_path: Path) -> None:
    folder = polycam(tmp_path, sample.walk(8, seed=1), cameras="cameras")
    assert any("no optimized poses" in f.message for f in check(folder).findings)
    better = sample.walk(8, seed=2)
    polycam(tmp_path / "more", better, images="corrected_images")
    for name in ("corrected_cameras", "corrected_images"):
        (tmp_path / "more" / "keyframes" / name).rename(folder / "keyframes" / name)
    capture = read(folder / "keyframes")
    np.testing.assert_allclose([f.camera_to_world for f in capture.frames], better, atol=1e-9)
    assert capture.frames[0].name == "corrected_images/1000000.jpg"
    assert not any("optimized" in f.message for f in check(folder).findings)


def test_depth_with_the_lowest_confidence_is_ignored(tmp_path: Path) -> None:
    folder = polycam(tmp_path / "scan", sample.walk(8))
    confidence = np.full((sample.HEIGHT // 2, sample.WIDTH // 2), 54, np.uint8)
    confidence[5] = 0
    (folder / "keyframes" / "confidence").mkdir()
    place = folder / "keyframes" / "confidence" / "1000000.png"
    assert cv2.imwrite(str(place), confidence)
    capture = read(folder)
    values = read_depth_image(capture.depths[0])
    assert (values[5] == 0).all() and values[6, 1] == 1.5
    assert (read_depth_image(capture.depths[1])[5] > 0).all()
    save_capture(capture, tmp_path)
    loaded = load_capture(tmp_path)
    assert loaded.depths[0].confidence == place and loaded.depths[1].confidence is None
    before = fingerprint(loaded)
    assert cv2.imwrite(str(place), confidence[:4])
    assert fingerprint(loaded) != before
    with pytest.raises(InputError, match="does not have the size"):
        read_depth_image(loaded.depths[0])


def test_frames_without_a_pose_are_warnings_and_damaged_files_are_errors(tmp_path: Path) -> None:
    folder = seven_scenes(tmp_path / "scan", sample.walk(12))
    (folder / "frame-000002.pose.txt").write_text("-inf -inf -inf -inf\n" * 4)
    (folder / "frame-000003.pose.txt").write_text("1 2 3\n")
    (folder / "frame-000004.color.png").unlink()
    (folder / "frame-000005.pose.txt").write_text("")
    report = check(folder)
    said = {f.where.split(":")[0]: (f.severity, f.message) for f in report.findings}
    assert said["frame-000002.pose.txt"] == ("warning", "the tracking was lost (the pose is not finite)")
    assert said["frame-000003.pose.txt"] == ("error", "the pose file holds no 4x4 matrix of numbers; write it again")
    assert said["frame-000005.pose.txt"] == (
        "error",
        "the pose file is empty (0 bytes); copy it again from the source",
    )
    assert said["frame-000004.pose.txt"][0] == "error" and "missing" in said["frame-000004.pose.txt"][1]


def test_missing_intrinsics_are_one_sentence_or_those_of_a_kinect(tmp_path: Path) -> None:
    folder = seven_scenes(tmp_path / "scan", sample.walk(8), intrinsics=False)
    with pytest.raises(InputError, match=r"has no intrinsics \(the 3x3 matrix camera-intrinsics.txt\)"):
        read(folder)
    for i in range(8):
        assert cv2.imwrite(str(folder / f"frame-{i:06d}.color.png"), np.full((480, 640, 3), 90, np.uint8))
    assert any("assumed to be those of a Kinect" in f.message for f in check(folder).findings)
    assert read(folder).frames[0].lens.params == (525, 525, 320, 240)
    assert read(folder).depths[0].lens.params == (585, 585, 320, 240)


def test_a_pose_is_interpolated_between_near_neighbors_only() -> None:
    poses = np.array([np.eye(4)] * 3)
    poses[1, :2, :2] = [[0, -1, 0][:2], [1, 0, 0][:2]]
    poses[:, 0, 3] = 1, 3, 5
    times = np.array([0.0, 0.1, 1.0])
    middle = pose_at(0.05, times, poses)
    half = np.sqrt(0.5)
    np.testing.assert_allclose(middle[:2, :2], [[half, -half], [half, half]], atol=1e-12)
    assert middle[0, 3] == 2
    assert pose_at(0.985, times, poses)[0, 3] == 5 and pose_at(1.015, times, poses)[0, 3] == 5
    assert pose_at(0.5, times, poses) is None and pose_at(-0.021, times, poses) is None


def test_images_between_poses_are_warnings_and_damaged_rows_are_errors(tmp_path: Path) -> None:
    folder = tum(tmp_path / "scan", sample.walk(12), "CameraTrajectory.txt")
    rows = (folder / "CameraTrajectory.txt").read_text().splitlines()
    del rows[3:5]
    (folder / "CameraTrajectory.txt").write_text("\n".join(rows))
    said = {f.where: (f.severity, f.message) for f in check(folder).findings}
    names = sorted(p.name for p in (folder / "rgb").iterdir())
    assert [f.name for f in read(folder).frames] == [f"rgb/{name}" for i, name in enumerate(names) if i != 1]
    assert said["CameraTrajectory.txt"] == ("warning", "1 image of 12 without a pose of that time")
    rows[2], rows[3] = f"nan {rows[2].partition(' ')[2]}", "1 2 3"
    (folder / "CameraTrajectory.txt").write_text("\n".join(rows))
    said = {f.where: (f.severity, f.message) for f in check(folder).findings}
    for line in (3, 4):
        assert said[f"CameraTrajectory.txt:{line}"] == ("error", "the line is not `time x y z qx qy qz qw`")
    (folder / "rgb.txt").write_text(f"1.0 rgb/{names[0]}\n")
    with pytest.raises(InputError, match=r"No image of .* has a pose: the times in rgb.txt and CameraTrajectory.txt"):
        read(folder)
    for text in ("now rgb/1.png", "nan rgb/1.png", "1.0"):
        (folder / "rgb.txt").write_text(f"# color\n{text}\n")
        with pytest.raises(InputError, match="line 2: write `time file`"):
            read(folder)


def test_a_slam_trajectory_without_depth_has_no_known_scale(tmp_path: Path) -> None:
    folder = tum(tmp_path, sample.walk(12), "KeyFrameTrajectory.txt")
    assert read(folder).alignment.scale_known
    assert any("depth images belong to the trajectory" in f.message + f.consequence for f in check(folder).findings)
    (folder / "depth.txt").unlink()
    assert not read(folder).alignment.scale_known
    (folder / "KeyFrameTrajectory.txt").rename(folder / "groundtruth.txt")
    assert read(folder).alignment.scale_known


def test_the_lens_of_a_tum_sequence_is_that_of_the_dataset(tmp_path: Path) -> None:
    folder = tum(tmp_path / "rgbd_dataset_freiburg1_room", sample.walk(8))
    (folder / "camera-intrinsics.txt").unlink()
    for file in (folder / "rgb").iterdir():
        assert cv2.imwrite(str(file), np.full((480, 640, 3), 90, np.uint8))
    lens = read(folder).frames[0].lens
    assert lens.model == "FULL_OPENCV" and lens.params[:5] == (517.3, 516.5, 318.6, 255.3, 0.2624)


def test_a_replica_scene_needs_a_pose_for_each_image_and_a_lens(tmp_path: Path) -> None:
    folder = replica(tmp_path / "scans", sample.walk(8))
    text = (folder / "traj.txt").read_text()
    (folder / "traj.txt").write_text(text.splitlines()[0])
    with pytest.raises(InputError, match="holds 1 pose for 8 images"):
        read(folder)
    (folder / "traj.txt").write_text(text)
    (tmp_path / "scans" / "cam_params.json").write_text('{"camera": {"w": 64}}')
    with pytest.raises(InputError, match="does not hold the numbers w, h, fx"):
        read(folder)
    (tmp_path / "scans" / "cam_params.json").unlink()
    with pytest.raises(InputError, match="cam_params.json is missing"):
        read(folder)


def test_an_arkit_recording_without_poses_or_lenses_of_its_time_is_one_sentence_or_a_warning(tmp_path: Path) -> None:
    folder = arkit(tmp_path / "41069021", sample.walk(8)) / "41069021_frames"
    lenses = sorted((folder / "lowres_wide_intrinsics").iterdir())
    lenses[2].unlink()
    lenses[4].write_text("64 48 40")
    (folder / "lowres_wide" / ".DS_Store").write_text("")
    report = check(tmp_path / "41069021")
    said = {f.message: f.severity for f in report.findings}
    assert said["the file is not `width height fx fy cx cy`"] == "error"
    assert said["2 images of 8 without a pose or a lens of that time"] == "warning"
    (folder / "confidence").mkdir()
    confidence = np.full((sample.HEIGHT // 2, sample.WIDTH // 2), 2, np.uint8)
    confidence[3] = 0
    lenses[4].write_text("64 48 40 40 32 24")
    name = sorted((folder / "lowres_depth").iterdir())[0].name
    assert cv2.imwrite(str(folder / "confidence" / name), confidence)
    values = read_depth_image(read(folder).depths[0])
    assert (values[3] == 0).all() and (values[4] > 0).all()
    (folder / "lowres_wide.traj").write_text("1.0 0 0 0 0 0 0\n")
    with pytest.raises(InputError, match="No image in .*lowres_wide has a pose and a lens of its time"):
        read(folder)
    (folder / "lowres_wide.traj").write_text("1.0 0 0\n")
    with pytest.raises(InputError, match=r"holds no pose \(time rx ry rz x y z\)"):
        read(folder)
