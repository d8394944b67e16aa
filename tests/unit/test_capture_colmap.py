"""COLMAP models as other programs leave them: without observations, with rigs, in parts, elsewhere, incomplete."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path

import capture_samples as sample
import numpy as np
import pytest

from nvsim.capture.check import check
from nvsim.capture.findings import OTHER_MODELS, Findings
from nvsim.capture.formats import read_raw
from nvsim.capture.raw import natural_order
from nvsim.capture.read import read
from nvsim.errors import InputError


def written(folder: Path, binary: bool = False, count: int = 12) -> Path:
    return sample.write_colmap(folder, sample.walk(count), sample.room(400), binary)


def messages(folder: Path, **options: str) -> str:
    return "\n".join(str(finding) for finding in check(folder, **options).findings)


def image_lines(names: list[str], camera: int = 1) -> list[str]:
    rows = [sample.world_to_camera(pose) for pose in sample.walk(len(names))]
    return [
        f"{i + 1} {' '.join(map(repr, map(float, row)))} {camera} {name}"
        for i, (row, name) in enumerate(zip(rows, names, strict=True))
    ]


OBSERVATIONS = {
    "none": lambda i: [],
    "an empty line": lambda i: [""],
    "a line": lambda i: ["1.5 2.5 -1 7.0 8.0 12"],
    "whole numbers like those of an image": lambda i: ["80 60 -1 81 61 -1 82 62 -1 83 63 5"],
    "a mixture": lambda i: [[], [""], ["80 60 -1"], ["1 2 3 4 5 6 7 8 9 10 11 12"]][i % 4],
    "blank lines and comments": lambda i: ["", "# next", ""],
}


@pytest.mark.parametrize("observations", OBSERVATIONS)
def test_images_txt_keeps_every_image_with_or_without_observation_lines(tmp_path: Path, observations: str) -> None:
    written(tmp_path)
    names = [f"{i:03d}.png" for i in range(12)]
    lines = ["# images"]
    for i, line in enumerate(image_lines(names)):
        lines += [line, *OBSERVATIONS[observations](i)]
    (tmp_path / "sparse" / "0" / "images.txt").write_text("\n".join(lines) + "\n")
    capture = read(tmp_path)
    assert [frame.name for frame in capture.frames] == names
    np.testing.assert_allclose([frame.camera_to_world for frame in capture.frames], sample.walk(), atol=1e-9)


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_images_txt_keeps_names_with_spaces_and_names_that_are_numbers(tmp_path: Path, newline: str) -> None:
    written(tmp_path)
    names = ["a walk/my photo 1.png", "0001", "12 of 30.png", "2nd floor.png"]
    text = newline.join(image_lines(names)) + newline
    (tmp_path / "sparse" / "0" / "images.txt").write_bytes(text.encode())
    raw = read_raw(tmp_path, Findings())
    assert {frame.name for frame in raw.frames} == set(names)


def test_images_txt_with_a_broken_line_names_the_line(tmp_path: Path) -> None:
    written(tmp_path)
    first, second, third = image_lines(["a.png", "b.png", "c.png"])
    broken = " ".join(second.split()[:4] + ["b.png"])
    (tmp_path / "sparse" / "0" / "images.txt").write_text(f"{first}\n{broken}\n{third}\n")
    with pytest.raises(InputError, match=r"images\.txt, line 2"):
        read(tmp_path)


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("name", ["points3D.ply", "points3d.PLY", "input.ply"])
def test_a_ply_file_replaces_missing_points(tmp_path: Path, binary: bool, name: str) -> None:
    points = sample.room(500)
    written(tmp_path, binary)
    model = tmp_path / "sparse" / "0"
    (model / ("points3D.bin" if binary else "points3D.txt")).unlink()
    (model / name).write_bytes(sample.ply(points))
    cloud = read(tmp_path).cloud
    assert cloud is not None and cloud.kind == "sfm"
    np.testing.assert_array_equal(cloud.points, points)


def test_a_ply_file_replaces_an_empty_list_of_points(tmp_path: Path) -> None:
    written(tmp_path, binary=True)
    model = tmp_path / "sparse" / "0"
    (model / "points3D.bin").write_bytes(bytes(8))
    (model / "points3D.ply").write_bytes(sample.ply(sample.room(300)))
    cloud = read(tmp_path).cloud
    assert cloud is not None and len(cloud.points) == 300


# Rigs -----------------------------------------------------------------------------------------------------------------


def rig_model(folder: Path, moments: int = 5) -> dict[str, np.ndarray]:
    """A model with a rig of two cameras and a third camera of its own, written by pycolmap in binary and text; the
    camera-to-world poses (4, 4) that pycolmap gives, by name."""
    pycolmap = pytest.importorskip("pycolmap")

    def rigid(pose: np.ndarray) -> object:
        return pycolmap.Rigid3d(pose[:3])

    def sensor(camera: int) -> object:
        return pycolmap.sensor_t(pycolmap.SensorType.CAMERA, camera)

    model = pycolmap.Reconstruction()
    params = [sample.FOCAL, sample.FOCAL, sample.WIDTH / 2, sample.HEIGHT / 2]
    for camera in (1, 2, 3):
        size = {"width": sample.WIDTH, "height": sample.HEIGHT}
        model.add_camera(pycolmap.Camera(model="PINHOLE", **size, params=params, camera_id=camera))
    mount = np.linalg.inv(sample.walk(3, seed=5)[1])
    rig = pycolmap.Rig(rig_id=1)
    rig.add_ref_sensor(sensor(1))
    rig.add_sensor(sensor(2), rigid(mount))
    alone = pycolmap.Rig(rig_id=2)
    alone.add_ref_sensor(sensor(3))
    model.add_rig(rig)
    model.add_rig(alone)
    image = 0
    for moment, pose in enumerate(sample.walk(moments)):
        for number, cameras in ((1, (1, 2)), (2, (3,))):
            frame = pycolmap.Frame(frame_id=10 * moment + number, rig_id=number)
            frame.rig_from_world = rigid(np.linalg.inv(pose))
            first = image
            for camera in cameras:
                image += 1
                frame.add_data_id(pycolmap.data_t(sensor(camera), image))
            model.add_frame(frame)
            for k, camera in enumerate(cameras, first + 1):
                name = f"camera{camera}/{moment:03d}.png"
                model.add_image(pycolmap.Image(name=name, image_id=k, camera_id=camera, frame_id=frame.frame_id))
            model.register_frame(frame.frame_id)
    for extension in ("bin", "txt"):
        place = folder / extension / "sparse" / "0"
        place.mkdir(parents=True)
        model.write_binary(str(place)) if extension == "bin" else model.write_text(str(place))
        for camera in (1, 2, 3):
            sample.write_images(folder / extension / "images" / f"camera{camera}", moments)
    found = {}
    for taken in model.images.values():
        found[taken.name] = np.linalg.inv(np.vstack([taken.cam_from_world().matrix(), [0, 0, 0, 1]]))
    return found


def without_poses(model: Path) -> None:
    """Replaces the poses in the list of images with zeros, so that only the frames tell where the images are."""
    path = model / "images.txt"
    lines = []
    for line in path.read_text().splitlines():
        fields = line.split()
        is_image = len(fields) == 10 and not line.startswith("#")
        lines.append(" ".join([fields[0], *"0" * 7, *fields[8:]]) if is_image else line)
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("extension", ["bin", "txt"])
def test_poses_on_rigs_are_those_of_pycolmap(tmp_path: Path, extension: str) -> None:
    truth = rig_model(tmp_path)
    findings = Findings()
    raw = read_raw(tmp_path / extension, findings)
    assert len(raw.frames) == len(truth) == 15 and not list(findings)
    for frame in raw.frames:
        np.testing.assert_allclose(frame.camera_to_world, truth[frame.name], atol=1e-9)
    assert {frame.rig for frame in raw.frames if frame.sensor != "3"} == {"1"}
    assert {frame.rig for frame in raw.frames if frame.sensor == "3"} == {""}


def test_poses_of_rig_images_come_from_frames_if_the_list_of_images_has_none(tmp_path: Path) -> None:
    truth = rig_model(tmp_path)
    without_poses(tmp_path / "txt" / "sparse" / "0")
    for frame in read(tmp_path / "txt").frames:
        turned = frame.camera_to_world[:3, 3]
        assert np.isfinite(turned).all()
    raw = read_raw(tmp_path / "txt", Findings())
    for frame in raw.frames:
        np.testing.assert_allclose(frame.camera_to_world, truth[frame.name], atol=1e-9)


def test_a_pose_that_contradicts_its_frame_is_a_warning_and_the_frame_counts(tmp_path: Path) -> None:
    truth = rig_model(tmp_path)
    path = tmp_path / "txt" / "sparse" / "0" / "images.txt"
    lines = path.read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if line.endswith("camera2/002.png"))
    fields = lines[at].split()
    lines[at] = " ".join([*fields[:5], str(float(fields[5]) + 0.5), *fields[6:]])
    path.write_text("\n".join(lines) + "\n")
    findings = Findings()
    frames = {frame.name: frame for frame in read_raw(tmp_path / "txt", findings).frames}
    (warning,) = findings
    assert "differs from that of the rig's frame" in warning.message and "camera2/002.png" in warning.where
    np.testing.assert_allclose(frames["camera2/002.png"].camera_to_world, truth["camera2/002.png"], atol=1e-9)


def test_the_trajectory_of_a_rig_is_that_of_its_first_camera(tmp_path: Path) -> None:
    rig_model(tmp_path)
    summary = check(tmp_path / "bin").summary
    assert summary is not None and summary.cameras == 3 and len(summary.paths) == 2
    assert all(len(path) == 5 for path in summary.paths)


def test_a_truncated_list_of_frames_is_named(tmp_path: Path) -> None:
    rig_model(tmp_path)
    path = tmp_path / "bin" / "sparse" / "0" / "frames.bin"
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(InputError, match=r"frames\.bin ends in the middle of frame record"):
        read(tmp_path / "bin")


# Several models -------------------------------------------------------------------------------------------------------


def in_parts(folder: Path, first: int = 5) -> Path:
    """A model of 12 images in two parts that share none: sparse/0 with the `first` ones, sparse/1 with the others."""
    written(folder, binary=False)
    lines = image_lines([f"{i:03d}.png" for i in range(12)])
    shutil.copytree(folder / "sparse" / "0", folder / "sparse" / "1")
    (folder / "sparse" / "0" / "images.txt").write_text("\n\n".join(lines[:first]) + "\n\n")
    (folder / "sparse" / "1" / "images.txt").write_text("\n\n".join(lines[first:]) + "\n\n")
    return folder


def test_the_check_names_every_model_and_how_to_select_another(tmp_path: Path) -> None:
    report = check(in_parts(tmp_path))
    (finding,) = [f for f in report.findings if f.message == OTHER_MODELS]
    assert finding.severity == "warning" and finding.where == "sparse/0 (5 images), sparse/1 (7 images, read)"
    assert "--model sparse/0" in finding.consequence
    assert report.summary is not None and report.summary.images == 7
    assert "7 of 12 images are registered; 5 images have no pose" in messages(tmp_path)


@pytest.mark.parametrize("name", ["0", "sparse/0", "sparse/0/"])
def test_model_selects_by_number_or_folder(tmp_path: Path, name: str) -> None:
    in_parts(tmp_path)
    capture = read(tmp_path, model=name)
    assert [frame.name for frame in capture.frames] == [f"{i:03d}.png" for i in range(5)]
    assert len(read(capture.source).frames) == 5, "the source alone says which model it was"


def test_a_model_that_does_not_exist_is_refused_with_the_list_of_models(tmp_path: Path) -> None:
    in_parts(tmp_path)
    assert "no model '7'; give --model one of sparse/0, sparse/1" in messages(tmp_path, model="7")
    sample.write_nerfstudio(tmp_path / "other", sample.walk(), sample.room(400))
    assert "holds no COLMAP model" in messages(tmp_path / "other", model="1")


def test_a_named_model_only_notes_the_others(tmp_path: Path) -> None:
    in_parts(tmp_path)
    for place, model in ((tmp_path, "0"), (tmp_path / "sparse" / "0", "")):
        (finding,) = [f for f in check(place, model=model).findings if f.message == OTHER_MODELS]
        assert finding.severity == "note" and "sparse/1 (7 images)" in finding.where


def test_models_of_the_same_images_are_no_finding(tmp_path: Path) -> None:
    written(tmp_path)
    for other in ("sparse/geo", "sparse_text", "colmap/sparse/0"):
        shutil.copytree(tmp_path / "sparse" / "0", tmp_path / other)
    assert OTHER_MODELS not in messages(tmp_path)


def test_a_model_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    in_parts(tmp_path)
    (tmp_path / "sparse" / "0" / "images.txt").write_text("nonsense\n")
    (finding,) = [f for f in check(tmp_path).findings if f.message == OTHER_MODELS]
    assert "sparse/0 (cannot be read: " in finding.where and "line 1" in finding.where


# Layouts and near misses ----------------------------------------------------------------------------------------------

LAYOUTS = (
    *("dense/sparse", "dense/0/sparse", "colmap_sparse/0", "undistorted/sparse", "sparse/geo", "colmap/dense/0/sparse"),
    *("sfm/0", "distorted/sparse/0", "sparse_text", "outputs/sfm_superpoint/models/0", "model", "colmap_export"),
)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_models_in_common_layouts_are_read_with_a_note_that_names_the_folder(tmp_path: Path, layout: str) -> None:
    capture = written(tmp_path / "capture")
    (capture / layout).parent.mkdir(parents=True, exist_ok=True)
    shutil.move(capture / "sparse" / "0", tmp_path / "moved")
    if layout.split("/")[0] != "sparse":
        (capture / "sparse").rmdir()
    shutil.move(tmp_path / "moved", capture / layout)
    if layout.startswith(("dense", "undistorted")):  # these hold undistorted images of their own
        shutil.move(capture / "images", (capture / layout).parent / "images")
    report = check(capture)
    assert not report.refused and report.summary is not None and report.summary.images == 12
    if layout != "distorted/sparse/0":
        assert any(layout.rpartition("/")[2] in f.where for f in report.findings if f.severity == "note")


@pytest.mark.parametrize("binary", [False, True])
def test_an_incomplete_model_names_what_is_there_and_what_is_missing(tmp_path: Path, binary: bool) -> None:
    extension = "bin" if binary else "txt"
    model = written(tmp_path / "above" / "walk", binary) / "sparse" / "0"
    (model / f"images.{extension}").unlink()
    for place in (tmp_path / "above", tmp_path / "above" / "walk", model / f"cameras.{extension}"):
        said = messages(place)
        assert f"has cameras.{extension} and points3D.{extension}, but no images.bin or images.txt" in said
    (model / f"cameras.{extension}").unlink()
    assert "no cameras.bin or cameras.txt and no images.bin or images.txt" in messages(tmp_path / "above")


def test_a_model_half_in_text_is_named(tmp_path: Path) -> None:
    written(tmp_path, binary=True)
    (tmp_path / "sparse" / "0" / "images.bin").unlink()
    (tmp_path / "sparse" / "0" / "images.txt").write_text("\n".join(image_lines(["000.png"])))
    assert "a COLMAP model is all .bin or all .txt" in messages(tmp_path)


def test_a_database_without_a_model_asks_for_the_mapper(tmp_path: Path) -> None:
    sample.write_images(tmp_path / "images", 3)
    (tmp_path / "thumbs.db").write_bytes(b"no database")
    with sqlite3.connect(tmp_path / "colmap.db") as database:
        database.execute("create table images (name text)")
    database.close()
    assert "colmap.db is a COLMAP database without a model; run COLMAP's mapper" in messages(tmp_path)


def test_the_only_capture_one_folder_down_is_read_with_a_note(tmp_path: Path) -> None:
    sample.write_nerfstudio(tmp_path / "scan", sample.walk(), sample.room(400))
    (tmp_path / "notes").mkdir()
    report = check(tmp_path)
    assert not report.refused and report.source == tmp_path / "scan" / "transforms.json"
    assert any("the only one below it is read" in f.message and f.where == "scan" for f in report.findings)


def test_several_captures_one_folder_down_are_named(tmp_path: Path) -> None:
    sample.write_nerfstudio(tmp_path / "first", sample.walk(), sample.room(400))
    written(tmp_path / "second")
    assert "holds 2 captures in the folders below it (first, second); name one of them" in messages(tmp_path)


@pytest.mark.parametrize(
    ("files", "said"),
    [
        (("images/a.jpg", "images/b.jpg"), "2 images, but no poses"),
        (("walk.mp4",), "a video, but no poses"),
        (("keyframes/images/1.jpg",), "lacks the folder cameras or images of a raw export of Polycam"),
        (("keyframes/cameras/1.json", "keyframes/images/1.jpg"), "is not valid JSON"),
        (("keyframes/cameras/1.txt", "keyframes/images/1.jpg"), "holds no poses"),
        (("color/1.jpg", "depth/1.png", "pose/1.txt"), "is not an image"),
        (("reconstruction.json", "images/a.jpg"), "an OpenSfM reconstruction"),
        (("two.captures",), "name the file itself (two.captures)"),
    ],
)
def test_what_lies_there_instead_of_a_capture_is_named(tmp_path: Path, files: tuple[str, ...], said: str) -> None:
    for name in files:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"x")
    assert said in messages(tmp_path)


def test_names_are_ordered_by_their_numbers() -> None:
    names = ["f2.jpg", "f10.jpg", "f1.jpg", "b/f1.jpg", "f01b.jpg", "f.jpg"]
    assert sorted(names, key=natural_order) == ["b/f1.jpg", "f1.jpg", "f01b.jpg", "f2.jpg", "f10.jpg", "f.jpg"]
