"""The readers return what was written, in every format, whatever way the format has of saying it."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import capture_samples as sample
import numpy as np
import pytest

from nvsim.capture.check import check
from nvsim.capture.formats import FORMATS, describe_content
from nvsim.capture.raw import whole_number
from nvsim.capture.read import read
from nvsim.errors import InputError


def test_nerfstudio_poses_come_back_in_opencv_axes(tmp_path: Path) -> None:
    poses, points = sample.walk(), sample.room()
    capture = read(sample.write_nerfstudio(tmp_path, poses, points))
    assert capture.format == "nerfstudio"
    np.testing.assert_allclose([f.camera_to_world for f in capture.frames], poses, atol=1e-12)
    assert capture.alignment.is_identity and capture.alignment.scale_known
    assert capture.cloud is not None and np.array_equal(capture.cloud.points, points)
    assert [f.name for f in capture.frames][:2] == ["images/000.png", "images/001.png"]


def test_frames_may_have_lenses_of_their_own(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    tree = json.loads(path.read_text())
    tree["frames"][3] |= {"fl_x": 55.0, "k1": 0.1, "camera_model": "OPENCV_FISHEYE"}
    path.write_text(json.dumps(tree))
    lenses = [f.lens for f in read(path).frames]
    assert lenses[3].model == "OPENCV_FISHEYE" and lenses[3].params[:2] == (55.0, sample.FOCAL)
    assert lenses[3].distortion == (0.1, 0, 0, 0)
    assert {lens.model for i, lens in enumerate(lenses) if i != 3} == {"PINHOLE"}


def test_camera_angle_alone_gives_the_lens_and_the_image_its_size(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    tree = json.loads(path.read_text())
    kept = {"camera_angle_x": 2 * np.arctan(sample.WIDTH / 2 / 33.0), "frames": tree["frames"]}
    for frame in kept["frames"]:
        frame["file_path"] = "./" + frame["file_path"].removesuffix(".png")
    path.write_text(json.dumps(kept))
    capture = read(path)
    lens = capture.frames[0].lens
    assert (lens.width, lens.height) == (sample.WIDTH, sample.HEIGHT)
    np.testing.assert_allclose(lens.params, (33.0, 33.0, 32.0, 24.0))
    assert not capture.alignment.scale_known


@pytest.mark.parametrize(
    ("more", "known"),
    [
        ({}, True),
        ({"applied_scale": 0.25}, False),
        ({"aabb_scale": 16}, False),
        ({"ply_file_path": "sparse_pc.ply"}, False),
    ],
)
def test_marks_of_an_arbitrary_unit_leave_the_scale_unknown(tmp_path: Path, more: dict, known: bool) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room(), **more)
    (tmp_path / "sparse_pc.ply").write_bytes((tmp_path / "cloud.ply").read_bytes())
    assert read(path).alignment.scale_known is known


@pytest.mark.parametrize("binary", [False, True])
def test_colmap_poses_points_and_names_come_back(tmp_path: Path, binary: bool) -> None:
    poses, points = sample.walk(), sample.room(2000)
    capture = read(sample.write_colmap(tmp_path, poses, points, binary))
    np.testing.assert_allclose([f.camera_to_world for f in capture.frames], poses, atol=1e-9)
    assert capture.cloud is not None and capture.cloud.kind == "sfm" and not capture.alignment.scale_known
    np.testing.assert_allclose(capture.cloud.points, points, atol=1e-6)
    assert capture.cloud.colors is not None and (capture.cloud.colors == (10, 20, 30)).all()
    assert all(f.image_path == tmp_path / "images" / f.name for f in capture.frames)


@pytest.mark.parametrize("inside", ["sparse", "sparse/0", "sparse/0/images.txt"])
def test_colmap_is_found_from_any_folder_of_it(tmp_path: Path, inside: str) -> None:
    sample.write_colmap(tmp_path, sample.walk(), sample.room(500), binary=False)
    assert len(read(tmp_path / inside).frames) == 12


def test_kapture_composes_the_rig_with_the_trajectory(tmp_path: Path) -> None:
    poses, points = sample.walk(), sample.room()
    plain = read(sample.write_kapture(tmp_path / "plain", poses, points))
    rig = np.eye(4)
    rig[:3, :3] = sample.walk(3, seed=9)[2, :3, :3]
    rig[:3, 3] = [0.3, -0.2, 0.1]
    rigged = read(sample.write_kapture(tmp_path / "rig", poses, points, rig))
    for capture in (plain, rigged):
        np.testing.assert_allclose([f.camera_to_world for f in capture.frames], poses, atol=1e-9)
        assert capture.alignment.scale_known and capture.frames[0].sensor == "cam0"
        assert capture.cloud is not None and np.array_equal(capture.cloud.points, points)


def test_kapture_lidar_clouds_are_placed_by_their_sensor(tmp_path: Path) -> None:
    poses, points = sample.walk(), sample.room()
    folder = sample.write_kapture(tmp_path, poses, points)
    sensors = folder / "sensors"
    shift = np.array([1.0, 2.0, 0.5], np.float32)  # lidar-to-world, so world-to-lidar is its negative
    (sensors / "records_data" / "lidar0" / "merged.ply").write_bytes(sample.ply(points - shift))
    text = (sensors / "trajectories.txt").read_text()
    text = text.replace("0, lidar0, 1, 0, 0, 0, 0, 0, 0", "0, lidar0, 1, 0, 0, 0, -1, -2, -0.5")
    (sensors / "trajectories.txt").write_text(text)
    cloud = read(folder).cloud
    assert cloud is not None
    np.testing.assert_allclose(cloud.points, points, atol=1e-5)


def test_a_kapture_record_without_exact_pose_is_left_out(tmp_path: Path) -> None:
    folder = sample.write_kapture(tmp_path, sample.walk(), sample.room())
    trajectory = folder / "sensors" / "trajectories.txt"
    lines = trajectory.read_text().splitlines()
    partial = lines[5].split(",")
    lines[5] = ",".join([*partial[:2], *[""] * 7])
    trajectory.write_text("\n".join([line for i, line in enumerate(lines) if i != 7]))
    assert len(read(folder).frames) == 10


def test_a_colmap_model_with_a_cloud_is_preferred_to_a_transforms_json_without(tmp_path: Path) -> None:
    sample.write_colmap(tmp_path, sample.walk(), sample.room(500), binary=True)
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room(500))
    assert read(tmp_path).format == "nerfstudio"
    tree = json.loads(path.read_text())
    del tree["ply_file_path"]
    path.write_text(json.dumps(tree))
    assert read(tmp_path).format == "colmap"
    assert read(path).format == "nerfstudio"
    (note,) = [f.message for f in check(tmp_path).findings if "is beside it" in f.message]
    assert note.startswith("transforms.json has no point cloud and a COLMAP model")


def test_a_kapture_tree_is_preferred_to_all_that_lies_beside_it(tmp_path: Path) -> None:
    sample.write_kapture(tmp_path, sample.walk(), sample.room(500))
    sample.write_colmap(tmp_path, sample.walk(), sample.room(500), binary=True)
    sample.write_nerfstudio(tmp_path, sample.walk(), sample.room(500))
    assert read(tmp_path).format == read(tmp_path / "sensors" / "sensors.txt").format == "kapture"


def test_what_is_no_capture_is_told_of_every_format(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    said_of_folder, said_of_file = (check(place).findings[0].message for place in (tmp_path, tmp_path / "notes.txt"))
    for row in FORMATS:
        assert row.description in said_of_folder and row.description in said_of_file
    (tmp_path / "sensors").mkdir()
    assert "sensors.txt is missing" in check(tmp_path).findings[0].message


def edit(path: Path, change) -> None:
    tree = json.loads(path.read_text())
    change(tree)
    path.write_text(json.dumps(tree))


BAD_FRAMES = {
    "missing file_path": (lambda f: f.pop("file_path"), "'file_path' is missing"),
    "missing pose": (lambda f: f.pop("transform_matrix"), "no pose"),
    "NaN": (lambda f: f["transform_matrix"][0].__setitem__(1, float("nan")), "not a finite number"),
    "mirrored": (lambda f: [r.__setitem__(0, -r[0]) for r in f["transform_matrix"]], "negative determinant"),
    "scaled": (lambda f: [r.__setitem__(0, 2 * r[0]) for r in f["transform_matrix"]], "not rigid"),
    "3x3": (lambda f: f.__setitem__("transform_matrix", [[1, 0, 0]] * 3), "not a 4x4 matrix"),
    "text in matrix": (lambda f: f["transform_matrix"][1].__setitem__(1, "one"), "not a number"),
    "missing image": (lambda f: f.__setitem__("file_path", "images/none.png"), "image is missing"),
    "duplicate": (lambda f: f.__setitem__("file_path", "images/000.png"), "listed twice"),
}


@pytest.mark.parametrize("fault", BAD_FRAMES)
def test_a_bad_frame_is_named_in_one_sentence(tmp_path: Path, fault: str) -> None:
    change, message = BAD_FRAMES[fault]
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    edit(path, lambda tree: change(tree["frames"][5]))
    with pytest.raises(InputError, match=message) as caught:
        read(path)
    assert "frame 5" in str(caught.value) and "\n" not in str(caught.value)


def test_a_path_that_does_not_exist_an_empty_folder_and_a_stranger_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        read(tmp_path / "nowhere")
    with pytest.raises(InputError, match="empty folder"):
        read(tmp_path)
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(InputError, match="no capture"):
        read(tmp_path)
    with pytest.raises(InputError, match="not a capture"):
        read(tmp_path / "notes.txt")


def test_a_pipe_is_refused_instead_of_waited_for(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    os.mkfifo(tmp_path / "pipe.json")
    with pytest.raises(InputError, match="it is a pipe"):
        read(tmp_path / "pipe.json")
    (tmp_path / "cloud.ply").unlink()
    os.mkfifo(tmp_path / "cloud.ply")
    (tmp_path / "images" / "004.png").unlink()
    os.mkfifo(tmp_path / "images" / "004.png")
    with pytest.raises(InputError, match="cloud.ply: it is a pipe.*image is missing.*frame 4"):
        read(path)


def test_a_json_that_is_cut_off_is_refused_with_its_line(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    path.write_text(path.read_text()[:500])
    with pytest.raises(InputError, match=r"line 1, column \d+"):
        read(path)


def test_every_empty_image_is_named(tmp_path: Path) -> None:
    folder = sample.write_kapture(tmp_path, sample.walk(), sample.room())
    for i in (2, 7):
        (folder / "sensors" / "records_data" / "cam0" / f"{i:03d}.png").write_bytes(b"")
    with pytest.raises(InputError, match=r"empty \(0 bytes\)") as caught:
        read(folder)
    assert "cam0/002.png" in str(caught.value) and "cam0/007.png" in str(caught.value)
    assert "003.png" not in str(caught.value)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
def test_a_truncated_colmap_file_is_named_with_its_record(tmp_path: Path, name: str) -> None:
    sample.write_colmap(tmp_path, sample.walk(), sample.room(100), binary=True)
    path = tmp_path / "sparse" / "0" / name
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(InputError, match=f"{name} ends in the middle of .* record"):
        read(tmp_path)


def test_a_bad_line_of_a_text_file_is_named(tmp_path: Path) -> None:
    sample.write_colmap(tmp_path / "c", sample.walk(), sample.room(100), binary=False)
    images = tmp_path / "c" / "sparse" / "0" / "images.txt"
    images.write_text(images.read_text() + "13 1 0 0\n")
    with pytest.raises(InputError, match="images.txt, line 26"):
        read(tmp_path / "c")
    folder = sample.write_kapture(tmp_path / "k", sample.walk(), sample.room())
    trajectory = folder / "sensors" / "trajectories.txt"
    trajectory.write_text(trajectory.read_text() + "1005, cam0, one, 0, 0, 0, 0, 0, 0\n")
    with pytest.raises(InputError, match="trajectories.txt, line 15"):
        read(folder)


@pytest.mark.parametrize("binary", [False, True])
def test_points_at_infinity_are_left_out_of_a_colmap_cloud(tmp_path: Path, binary: bool) -> None:
    points = sample.room(300)
    points[[5, 6, 7], [0, 1, 2]] = [np.inf, np.nan, 1e30]
    cloud = read(sample.write_colmap(tmp_path, sample.walk(), points, binary)).cloud
    assert cloud is not None and len(cloud.points) == 297 and np.isfinite(cloud.points).all()


@pytest.mark.parametrize("focal", [0.0, -5.0, 1e-30, 1e30])
def test_a_focal_length_that_no_camera_has_is_refused(tmp_path: Path, focal: float) -> None:
    with pytest.raises(InputError, match="camera parameters"):
        read(sample.write_nerfstudio(tmp_path, sample.walk(), sample.room(), fl_x=focal))


def test_an_unsupported_camera_model_is_named_with_those_that_are(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room(), camera_model="ORTHOPHOTO")
    with pytest.raises(InputError, match="ORTHOPHOTO.*OPENCV_FISHEYE"):
        read(path)


def test_a_converted_reconstruction_has_no_meters_but_a_cloud(tmp_path: Path) -> None:
    folder = sample.write_kapture(tmp_path, sample.walk(), sample.room(900))
    sensors = folder / "sensors"
    (sensors / "records_lidar.txt").unlink()
    listed = (sensors / "sensors.txt").read_text().replace("lidar0, scan, lidar\n", "")
    (sensors / "sensors.txt").write_text(listed)
    (folder / "reconstruction").mkdir()
    rows = [sample.csv(*map(float, p), 10.0, 20.0, 30.0) for p in sample.room(900)]
    (folder / "reconstruction" / "points3d.txt").write_text("# kapture format: 1.1\n" + "".join(rows))
    capture = read(folder)
    assert not capture.alignment.scale_known and capture.cloud is not None and capture.cloud.kind == "sfm"
    np.testing.assert_allclose(capture.cloud.points, sample.room(900), atol=1e-6)
    assert capture.cloud.colors is not None and (capture.cloud.colors == (10, 20, 30)).all()


def test_frames_come_in_the_order_of_the_walk(tmp_path: Path) -> None:
    poses = sample.walk()
    folder = sample.write_kapture(tmp_path / "kapture", poses, sample.room())
    records = folder / "sensors" / "records_camera.txt"
    head, *rows = records.read_text().splitlines()
    records.write_text("\n".join([head, *rows[::-1]]))
    times = [f.timestamp for f in read(folder).frames]
    assert times == sorted(times)
    path = sample.write_nerfstudio(tmp_path / "ngp", poses, sample.room(), aabb_scale=4)
    edit(path, lambda tree: tree["frames"].reverse())
    assert [f.name for f in read(path).frames] == [f"images/{i:03d}.png" for i in range(12)]
    for image in (path.parent / "images").iterdir():
        image.rename(image.with_name(f"{int(image.stem)}.png"))
    path.write_text(re.sub(r"images/0*([0-9]+)\.png", r"images/\1.png", path.read_text()))
    assert [f.name for f in read(path).frames] == [f"images/{i}.png" for i in range(12)]


@pytest.mark.parametrize("text", ["1_000", " 1", "1.0", "", "\u0661", "1" * 21, "0x1"])
def test_whole_numbers_of_a_file_are_ascii_digits(text: str) -> None:
    with pytest.raises(ValueError):
        whole_number(text)
    assert [whole_number(t) for t in ("0", "-7", "+3", "18446744073709551615")] == [0, -7, 3, 18446744073709551615]


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("a.mp4",), "a video,"),
        (("a.mp4", "b.MOV"), "2 videos,"),
        (("a.jpg",), "1 image,"),
        (("a.jpg", "b.jpg"), "2 images,"),
    ],
)
def test_a_folder_without_poses_is_described_with_the_number_of_its_files(
    tmp_path: Path, names: tuple[str, ...], words: str
) -> None:
    for name in names:
        (tmp_path / name).write_bytes(b"x")
    assert f"holds no capture: {words} but no poses" in describe_content(tmp_path)
