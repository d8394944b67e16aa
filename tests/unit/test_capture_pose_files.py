"""Raw exports of Polycam and recordings of a depth camera: the reader returns what was written, in each layout."""

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
from nvsim.errors import InputError

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


LAYOUTS = {"Polycam": polycam, "7-Scenes": seven_scenes, "ScanNet": scannet}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_poses_lenses_and_depth_come_back(tmp_path: Path, layout: str) -> None:
    poses = sample.walk(12)
    capture = read(LAYOUTS[layout](tmp_path / "scan", poses))
    np.testing.assert_allclose([f.camera_to_world for f in capture.frames], poses, atol=1e-9)
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
