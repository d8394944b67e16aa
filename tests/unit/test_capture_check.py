"""The data check reports all problems at once, each with its place and its effect."""

from __future__ import annotations

import json
from pathlib import Path

import capture_samples as sample
import cv2
import numpy as np
import pytest

from nvsim.capture.check import Report, check


def found(report: Report, text: str) -> list:
    return [f for f in report.findings if text in f.message]


def test_a_good_capture_has_no_finding(tmp_path: Path) -> None:
    report = check(sample.write_nerfstudio(tmp_path, sample.walk(), sample.room(), unit="meter"))
    assert report.findings == () and not report.refused and report.format == "nerfstudio"


def test_all_faults_are_found_in_one_pass_with_their_places(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(20), sample.room())
    images = tmp_path / "images"
    (images / "001.png").unlink()
    (images / "002.png").write_bytes(b"")
    (images / "003.png").write_bytes((images / "003.png").read_bytes()[:-30])
    (images / "004.png").write_text("no image")
    cv2.imwrite(str(images / "005.png"), np.zeros((10, 20, 3), np.uint8))
    tree = json.loads(path.read_text())
    frames = tree["frames"]
    frames[6]["transform_matrix"][0][0] = float("nan")
    frames[7]["transform_matrix"][0] = [-v for v in frames[7]["transform_matrix"][0]]
    del frames[8]["transform_matrix"]
    frames[9]["file_path"] = "images/010.png"
    del frames[11]["file_path"]
    frames[12] = "frame"
    path.write_text(json.dumps(tree))
    report = check(path)
    expected = {
        "missing": 1,
        "empty (0 bytes)": 2,
        "truncated": 3,
        "not an image": 4,
        "20x10 pixels but its camera is 64x48": 5,
        "not a finite number": 6,
        "negative determinant": 7,
        "the frame has no pose": 8,
        "listed twice": 9,
        "'file_path' is missing": 11,
        "not a JSON object": 12,
    }
    for text, frame in expected.items():
        if text == "missing":
            text = "the image is missing"
        matches = found(report, text)
        assert len(matches) == 1, (text, report.findings)
        assert f"frame {frame}" in matches[0].where and matches[0].severity == "error" and matches[0].consequence
    assert report.refused and len([f for f in report.findings if f.severity == "error"]) == len(expected)


def test_records_without_pose_are_warned_of_with_file_and_line(tmp_path: Path) -> None:
    folder = sample.write_kapture(tmp_path, sample.walk(), sample.room())
    trajectory = folder / "sensors" / "trajectories.txt"
    lines = trajectory.read_text().splitlines()
    trajectory.write_text("\n".join(lines[:4] + lines[5:]) + "\n")
    report = check(folder)
    (finding,) = found(report, "no pose")
    assert finding.severity == "warning" and finding.where == "cam0/002.png, records_camera.txt, line 4"
    assert not report.refused


@pytest.mark.parametrize("together", [1, 2])
def test_cameras_far_from_all_others_are_named(tmp_path: Path, together: int) -> None:
    poses = sample.walk(30)
    for i in range(together):
        poses[4 + i, :3, 3] += [80.0, i * 0.2, 0]
    report = check(sample.write_nerfstudio(tmp_path, poses, sample.room(), unit="meter"))
    assert [f.where for f in found(report, "outlier")] == [
        f"transforms.json, frame {4 + i} (images/{4 + i:03d}.png)" for i in range(together)
    ]
    assert all(f.severity == "warning" for f in report.findings)


def test_cameras_that_surround_an_object_are_named(tmp_path: Path) -> None:
    poses = sample.walk(24)
    outwards = poses.copy()
    for pose in poses:
        forward = [0, 0, 0.9] - pose[:3, 3]
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    for name, own, expected in [("around", poses, 1), ("outwards", outwards, 0), ("from one side", poses[:8], 0)]:
        report = check(sample.write_nerfstudio(tmp_path / name, own, sample.room(), unit="meter"))
        assert len(found(report, "surround one object")) == expected, name


def test_a_long_corridor_has_no_outlier(tmp_path: Path) -> None:
    poses = sample.walk(60)
    poses[:, 0, 3], poses[:, 1, 3] = np.linspace(0, 60, 60), 0
    points = np.concatenate([sample.room() + [x, 0, 0] for x in range(0, 61, 6)]).astype(np.float32)
    assert check(sample.write_nerfstudio(tmp_path, poses, points, unit="meter")).findings == ()


def test_a_camera_hanging_upside_down_is_named(tmp_path: Path) -> None:
    poses = sample.walk(30)
    poses[3, :3, :2] *= -1
    (finding,) = found(check(sample.write_nerfstudio(tmp_path, poses, sample.room())), "upside down")
    assert "frame 3" in finding.where


@pytest.mark.parametrize(
    "displace",
    [lambda p: p + [200, 0, 0], lambda p: p * 1000 + [0, 0, 0], lambda p: p / 1000],
    ids=["elsewhere", "millimetres", "kilometres"],
)
def test_a_cloud_that_does_not_meet_the_cameras_is_an_error(tmp_path: Path, displace) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), displace(sample.room()).astype(np.float32))
    report = check(path, scale=1.0)
    (finding,) = found(report, "does not match")
    assert finding.severity == "error" and report.refused


def test_cameras_that_look_at_the_ceiling_have_no_floor_in_view(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(pitch_degrees=-50), sample.room(20000))
    (finding,) = found(check(path), "no floor in view")
    assert finding.severity == "warning" and "never traversable" in finding.consequence


def test_a_point_cloud_without_floor_is_reported(tmp_path: Path) -> None:
    points = sample.room(20000)
    report = check(sample.write_nerfstudio(tmp_path, sample.walk(), points[points[:, 2] > 0.05]))
    assert [f.severity for f in found(report, "no floor below the cameras")] == ["warning"]


def test_an_unknown_scale_asks_for_the_camera_height(tmp_path: Path) -> None:
    folder = sample.write_colmap(tmp_path, sample.walk(), sample.room(), binary=True)
    (finding,) = found(check(folder), "scale is unknown")
    assert "--camera-height" in finding.consequence and finding.severity == "warning"
    assert not found(check(folder, camera_height=1.4), "scale")
    assert check(folder, camera_height=-1).refused


def test_what_cannot_be_read_at_all_is_a_report_too(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "nowhere"):
        report = check(path)
        assert report.refused and len(report.findings) == 1
