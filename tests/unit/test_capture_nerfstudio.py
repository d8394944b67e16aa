"""The content of a transforms.json beside poses: its unit, unused fields, and folders in place of files."""

from __future__ import annotations

import json
from pathlib import Path

import capture_samples as sample
import measured_room
import numpy as np
import pytest

from nvsim.capture.check import check
from nvsim.capture.multi_capture import write_list
from nvsim.capture.read import read
from nvsim.errors import InputError


def images_alone(folder: Path, count: int = 12, **more: object) -> Path:
    path = sample.write_nerfstudio(folder, sample.walk(count), sample.room(), **more)
    tree = json.loads(path.read_text())
    del tree["ply_file_path"]
    path.write_text(json.dumps(tree))
    return path


def edit_frames(path: Path, **more: object) -> None:
    tree = json.loads(path.read_text())
    for frame in tree["frames"]:
        frame.update(more)
    path.write_text(json.dumps(tree))


def test_a_file_without_a_mark_of_its_unit_is_not_in_meters(tmp_path: Path) -> None:
    path = images_alone(tmp_path, k1=0.002, k2=-0.003, p1=1e-5, p2=-2e-5)  # as COLMAP's older converter wrote it
    assert not read(path).alignment.scale_known
    assert read(path, scale=0.6).alignment.scale == 0.6


@pytest.mark.parametrize("unit", ["m", "meter", "Metres"])
def test_a_file_may_say_that_its_unit_is_the_meter(tmp_path: Path, unit: str) -> None:
    assert read(images_alone(tmp_path, unit=unit)).alignment.scale_known


def test_depth_images_of_a_sensor_are_a_mark_of_meters_unless_colmap_wrote_them(tmp_path: Path) -> None:
    path = measured_room.write_nerfstudio(tmp_path, measured_room.poses())
    assert read(path).alignment.scale_known
    assert any("because depth images of a sensor" in f.message for f in check(path).findings)
    edit_frames(path, colmap_im_id=1)
    assert not read(path).alignment.scale_known


def test_a_scan_is_a_mark_of_meters_and_a_note_says_so(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    (note,) = [f for f in check(path).findings if "meters" in f.message]
    assert note.severity == "note" and "cloud.ply seems to be a LiDAR scan" in note.message
    assert "the cameras are then 1.40 m above the floor" in note.consequence and "--scale" in note.consequence
    assert not [f for f in check(path, scale=0.6).findings if "meters" in f.message]


@pytest.mark.parametrize("name", ["points3D.ply", "sparse_points.ply", "reconstruction.ply"])
def test_a_cloud_of_features_is_no_mark_of_meters(tmp_path: Path, name: str) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room(), ply_file_path=name)
    (tmp_path / "cloud.ply").rename(tmp_path / name)
    capture = read(path)
    assert not capture.alignment.scale_known and capture.cloud is not None and capture.cloud.kind == "sfm"


def test_a_walk_without_a_mark_joins_one_in_meters(tmp_path: Path) -> None:
    marked = sample.write_nerfstudio(tmp_path / "a", sample.walk(), sample.room())
    unmarked = images_alone(tmp_path / "b")
    write_list([unmarked, marked], tmp_path / "both.captures")
    assert read(tmp_path / "both.captures").alignment.scale_known
    edit_frames(unmarked, colmap_im_id=1)
    with pytest.raises(InputError, match="not in one unit"):
        read(tmp_path / "both.captures")


def test_known_fields_that_are_not_used_are_named_in_one_warning(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room(), train_filenames=["images/000.png"])
    edit_frames(path, semantics="s/0.png", normal_path="n/0.png", rolling_shutter_time=0.03, sharpness=12.5)
    (warning,) = [f.message for f in check(path).findings if f.severity == "warning"]
    assert warning.startswith("NVSim does not use ")
    assert all(field in warning for field in ("train_filenames", "semantics", "normal_path", "rolling_shutter_time"))
    assert "sharpness" not in warning


def test_fields_that_nothing_is_known_of_are_a_note(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room(), thermal_calibration=[1, 2])
    (note,) = [f for f in check(path).findings if "does not know" in f.message]
    assert note.severity == "note" and "thermal_calibration" in note.message


def test_used_fields_bookkeeping_and_empty_fields_are_not_named(tmp_path: Path) -> None:
    more = {"applied_transform": np.eye(4)[:3].tolist(), "orientation_override": "none", "scene_box": {"near": 0.1}}
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room(), **more)
    edit_frames(path, sharpness=3.0, is_bad=False, semantics=None, timestamp=1.0)
    assert not [f for f in check(path).findings if "NVSim does not" in f.message]


def test_distortion_params_are_the_lens(tmp_path: Path) -> None:
    single = read(sample.write_nerfstudio(tmp_path / "a", sample.walk(), sample.room(), k1=0.1, k2=0.02, p1=0.003))
    values = [0.1, 0.02, 0, 0, 0.003, 0]
    listed = read(sample.write_nerfstudio(tmp_path / "b", sample.walk(), sample.room(), distortion_params=values))
    assert listed.frames[0].lens == single.frames[0].lens and listed.frames[0].lens.is_distorted
    wrong = sample.write_nerfstudio(tmp_path / "c", sample.walk(), sample.room(), distortion_params=[0.1])
    with pytest.raises(InputError, match="distortion_params"):
        read(wrong)


def split(folder: Path, **sizes: int) -> Path:
    """The frames of a capture dealt out to transforms_NAME.json, so many each, the rest to the last."""
    path = sample.write_nerfstudio(folder, sample.walk(), sample.room())
    tree = json.loads(path.read_text())
    path.unlink()
    frames = tree["frames"]
    for name, size in sizes.items():
        (folder / f"transforms_{name}.json").write_text(json.dumps({**tree, "frames": frames[:size]}))
        frames = frames[size:]
    return folder


def test_the_files_of_a_split_are_one_capture_in_the_order_of_the_names(tmp_path: Path) -> None:
    split(tmp_path, test=3, val=2, train=7)
    capture = read(tmp_path)
    assert [f.name for f in capture.frames] == [f"images/{i:03d}.png" for i in range(12)]
    assert capture.cloud is not None and capture.source == tmp_path
    notes = " ".join(f.message for f in check(tmp_path).findings)
    assert "transforms_train.json (7), transforms_val.json (2), transforms_test.json (3) are read as one" in notes


def test_blenders_files_without_sizes_and_extensions_are_read(tmp_path: Path) -> None:
    split(tmp_path, train=8, test=4)
    for path in tmp_path.glob("*.json"):
        frames = json.loads(path.read_text())["frames"]
        for frame in frames:
            frame["file_path"] = "./" + frame["file_path"].removesuffix(".png")
        path.write_text(json.dumps({"camera_angle_x": 1.2, "frames": frames}))
    capture = read(tmp_path)
    assert len(capture.frames) == 12 and not capture.alignment.scale_known
    assert (capture.frames[0].lens.width, capture.frames[0].lens.height) == (sample.WIDTH, sample.HEIGHT)


def test_a_frame_in_two_files_of_a_split_counts_once(tmp_path: Path) -> None:
    split(tmp_path, train=12)
    (tmp_path / "transforms_val.json").write_bytes((tmp_path / "transforms_train.json").read_bytes())
    assert len(read(tmp_path).frames) == 12


def test_a_single_file_of_a_split_is_read_and_the_others_named(tmp_path: Path) -> None:
    split(tmp_path, train=8, test=4)
    assert len(read(tmp_path / "transforms_train.json").frames) == 8
    notes = " ".join(f.message for f in check(tmp_path / "transforms_train.json").findings)
    assert "transforms_test.json beside transforms_train.json is not read" in notes
    (tmp_path / "transforms_test.json").unlink()
    assert len(read(tmp_path).frames) == 8


@pytest.mark.parametrize("name", ["transform.json", "transforms_opencv.json", "Transforms.json"])
def test_the_only_file_that_is_nearly_a_transforms_json_is_read(tmp_path: Path, name: str) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    path.rename(tmp_path / name)
    assert len(read(tmp_path).frames) == 12
    (tmp_path / "transforms_b.json").write_text("{}")
    with pytest.raises(InputError, match="name the one to read"):
        read(tmp_path)


def test_a_capture_of_sdfstudio_is_named(tmp_path: Path) -> None:
    (tmp_path / "meta_data.json").write_text("{}")
    with pytest.raises(InputError, match="SDFStudio"):
        read(tmp_path)
