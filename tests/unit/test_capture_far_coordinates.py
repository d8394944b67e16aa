"""Captures in map coordinates keep their accuracy: an origin is taken off in double precision and put back."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import capture_samples as sample
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nvsim.capture.alignment import to_aligned_frame, to_capture_frame
from nvsim.capture.check import check
from nvsim.capture.findings import Findings
from nvsim.capture.pointcloud import parse_pcd, read_cloud
from nvsim.capture.read import read
from nvsim.capture.store import fingerprint, load_capture, save_capture
from nvsim.capture.types import Alignment
from nvsim.evaluation.views import aligned_pose
from nvsim.graph.types import Edge, NavGraph, Viewpoint
from nvsim.project.stages.exported import export_r2r

UTM = np.array([356_000.25, 4_150_000.5, 25.0])
SOUTHERN = np.array([356_000.25, 9_999_000.5, 25.0])
EARTH_CENTERED = np.array([4_157_000.3, 664_000.7, 4_775_000.1])


def far_poses(origin: np.ndarray) -> np.ndarray:
    poses = sample.walk()
    poses[:, :3, 3] += origin
    return poses


def ply_of_doubles(points: np.ndarray) -> bytes:
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
    return header.encode() + points.astype("<f8").tobytes()


def write(folder: Path, origin: np.ndarray = UTM, **more: object) -> Path:
    path = sample.write_nerfstudio(folder, far_poses(origin), sample.room(), **more)
    (folder / "cloud.ply").write_bytes(ply_of_doubles(sample.room().astype(np.float64) + origin))
    return path


@pytest.mark.parametrize("origin", [UTM, SOUTHERN, EARTH_CENTERED, np.array([20_000_000.0, 5.0, 1.0])])
def test_poses_and_cloud_are_as_exact_as_near_the_origin(tmp_path: Path, origin: np.ndarray) -> None:
    capture = read(write(tmp_path, origin))
    assert capture.cloud is not None and capture.cloud.points.dtype == np.float32
    taken = np.array(capture.alignment.origin)
    assert np.array_equal(taken % 100, np.zeros(3)) and np.abs(origin - taken).max() < 1000
    left = origin - taken
    np.testing.assert_allclose(capture.cloud.points, sample.room() + left, atol=1e-4)
    np.testing.assert_allclose(capture.positions, sample.walk()[:, :3, 3] + left, atol=1e-8)
    np.testing.assert_allclose(
        to_capture_frame(capture.positions, capture.alignment), far_poses(origin)[:, :3, 3], atol=1e-8
    )


def test_a_note_says_which_origin_was_taken_off(tmp_path: Path) -> None:
    report = check(write(tmp_path))
    assert not report.refused and [f.severity for f in report.findings] == ["note", "note"]
    assert "(356000, 4150000, 0) is subtracted" in report.findings[0].message


def test_map_coordinates_are_meters(tmp_path: Path) -> None:
    path = write(tmp_path, colmap_im_id=1)
    tree = json.loads(path.read_text())
    del tree["ply_file_path"]
    path.write_text(json.dumps(tree))
    assert read(path).alignment.scale_known
    assert any("because the coordinates are map coordinates" in f.message for f in check(path).findings)


def test_a_capture_near_the_origin_or_wide_in_fine_units_keeps_its_origin(tmp_path: Path) -> None:
    assert read(write(tmp_path / "near", np.array([300.0, -700.0, 2.0]))).alignment.origin == (0, 0, 0)
    poses = sample.walk()
    poses[:, :3, 3] *= 1000  # millimeters
    poses[:, :3, 3] += [1200, 1500, 0]
    path = sample.write_nerfstudio(tmp_path / "fine", poses, 1000 * sample.room())
    assert read(path, scale=0.001).alignment.origin == (0, 0, 0)


@pytest.mark.parametrize("tilt", [0.0, 40.0])
def test_a_far_capture_is_turned_and_scaled_about_its_own_origin(tmp_path: Path, tilt: float) -> None:
    rotation = Rotation.from_euler("x", tilt, degrees=True).as_matrix()
    poses, points = sample.turn(rotation, sample.walk(24), sample.room(20000))
    poses[:, :3, 3] += UTM
    path = sample.write_nerfstudio(tmp_path, poses, points)
    (tmp_path / "cloud.ply").write_bytes(ply_of_doubles(points.astype(np.float64) + UTM))
    capture = read(path, scale=2.0)
    assert np.ptp(capture.positions[:, 2]) < 0.01 and np.abs(capture.positions).max() < 500
    np.testing.assert_allclose(to_capture_frame(capture.positions, capture.alignment), poses[:, :3, 3], atol=1e-8)


def test_kapture_scans_and_colmap_points_are_as_exact(tmp_path: Path) -> None:
    folder = sample.write_kapture(tmp_path / "kapture", far_poses(UTM), sample.room())
    (folder / "sensors" / "records_data" / "lidar0" / "merged.ply").write_bytes(
        ply_of_doubles(sample.room().astype(np.float64) + UTM)
    )
    colmap = sample.write_colmap(tmp_path / "colmap", far_poses(UTM), sample.room(500) + UTM, binary=True)
    for path, points in ((folder, sample.room()), (colmap, sample.room(500))):
        capture = read(path)
        assert capture.cloud is not None
        np.testing.assert_allclose(capture.cloud.points + np.array(capture.alignment.origin), points + UTM, atol=2e-4)


def test_a_cloud_of_coarse_numbers_is_warned_of(tmp_path: Path) -> None:
    path = write(tmp_path)
    (tmp_path / "cloud.ply").write_bytes(sample.ply(sample.room() + UTM))
    assert any("whose steps are 0.25 units" in f.message for f in check(path).findings if f.severity == "warning")


def test_clouds_keep_doubles_until_the_origin_is_off(tmp_path: Path) -> None:
    points = sample.room(200).astype(np.float64) + UTM
    (tmp_path / "a.ply").write_bytes(ply_of_doubles(points))
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.ply", Findings()).points, points)
    text = "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
    header = "FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH 200\nHEIGHT 1\nPOINTS 200\nDATA ascii\n"
    np.testing.assert_array_equal(parse_pcd(tmp_path / "a.pcd", (header + text).encode())["y"], points[:, 1])


def test_the_origin_is_stored_and_older_files_without_one_load(tmp_path: Path) -> None:
    capture = read(write(tmp_path / "capture"))
    save_capture(capture, tmp_path / "stored")
    stored = load_capture(tmp_path / "stored")
    assert stored.alignment.origin == capture.alignment.origin == (356_000.0, 4_150_000.0, 0.0)
    assert fingerprint(stored) == fingerprint(capture)
    path = tmp_path / "stored" / "capture.json"
    tree = json.loads(path.read_text())
    del tree["alignment"]["origin"]
    path.write_text(json.dumps(tree))
    older = load_capture(tmp_path / "stored")
    assert older.alignment.origin == (0, 0, 0) and fingerprint(older) != fingerprint(capture)


def test_a_second_capture_is_brought_to_the_origin_of_the_first(tmp_path: Path) -> None:
    first = read(write(tmp_path / "a"))
    second = read(write(tmp_path / "b", UTM + [700.0, 0, 0]), alignment=first.alignment)
    assert second.alignment.origin == first.alignment.origin and second.cloud is not None
    np.testing.assert_allclose(second.positions - first.positions, np.tile([700.0, 0, 0], (12, 1)), atol=1e-8)
    np.testing.assert_allclose(second.cloud.points, first.cloud.points + [700.0, 0, 0], atol=2e-4)  # type: ignore[union-attr]


def test_poses_of_novel_views_lose_the_origin_as_those_of_frames_do() -> None:
    rotation = Rotation.from_euler("z", 30, degrees=True).as_matrix()
    alignment = Alignment(rotation, 2.0, True, (356_000.0, 4_150_000.0, 0.0))
    pose = far_poses(UTM)[3]
    np.testing.assert_allclose(aligned_pose(pose, alignment)[:3, 3], to_aligned_frame(pose[:3, 3], alignment))
    np.testing.assert_allclose(to_capture_frame(aligned_pose(pose, alignment)[:3, 3], alignment), pose[:3, 3])


def test_the_exported_graph_gets_the_origin_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    alignment = Alignment(np.eye(3), 0.5, True, (356_000.0, 4_150_000.0, 0.0))
    places = {"a" * 32: (1.0, 2.0, 0.0), "b" * 32: (2.0, 2.0, 0.0)}
    viewpoints = {id: Viewpoint(id, place, 1.4) for id, place in places.items()}
    graph = NavGraph("room", viewpoints, {("a" * 32, "b" * 32): Edge("a" * 32, "b" * 32)})
    project = SimpleNamespace(
        need_graph=lambda: graph,
        need_capture=lambda: SimpleNamespace(alignment=alignment),
    )
    monkeypatch.setattr("nvsim.project.stages.exported.occupancy_of", lambda project: None)
    path = export_r2r(project, tmp_path, "room", "capture", force=True)  # type: ignore[arg-type]
    exported = {row["image_id"]: np.array(row["pose"]).reshape(4, 4)[:2, 3] for row in json.loads(path.read_text())}
    np.testing.assert_allclose(exported["a" * 32], [356_002.0, 4_150_004.0], atol=1e-6)
