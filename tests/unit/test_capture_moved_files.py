"""Files that are not at their path in the capture are found by name. Otherwise the error names the fix."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import capture_samples as sample
import pytest

from nvsim.capture.check import Report, check
from nvsim.capture.moved_files import FolderFiles
from nvsim.capture.read import read
from nvsim.errors import InputError


def capture_with(folder: Path, renamed: Callable[[str], str]) -> Path:
    path = sample.write_nerfstudio(folder, sample.walk(), sample.room())
    tree = json.loads(path.read_text())
    for frame in tree["frames"]:
        frame["file_path"] = renamed(frame["file_path"])
    path.write_text(json.dumps(tree))
    return path


def messages(report: Report) -> str:
    return "\n".join(f"{f.message}; {f.consequence}" for f in report.findings)


LISTED = {
    "of Windows": lambda listed: "C:\\Users\\ann\\scan\\" + listed.replace("/", "\\"),
    "absolute": lambda listed: "/home/ann/scan/" + listed,
    "with a prefix": lambda listed: "./data/scan/" + listed,
    "in another folder": lambda listed: listed.replace("images/", "rgb/"),
    "in a folder in capitals": lambda listed: listed.replace("images/", "Images/"),
    "with an extension in capitals": lambda listed: listed.replace(".png", ".PNG"),
    "with another extension": lambda listed: listed.replace(".png", ".jpg"),
    "without an extension, moved": lambda listed: "/scan/" + listed.removesuffix(".png"),
}


@pytest.mark.parametrize("listed", LISTED)
def test_moved_images_are_found_by_name_and_a_note_says_so(tmp_path: Path, listed: str) -> None:
    path = capture_with(tmp_path, LISTED[listed])
    capture = read(path)
    assert [f.image_path for f in capture.frames] == [tmp_path / "images" / f"{i:03d}.png" for i in range(12)]
    report = check(path)
    assert not report.refused and "12 images are not where the capture says, and found by name" in messages(report)


def test_jpg_and_jpeg_are_one_extension(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "a.JPEG").write_bytes(b"1")
    assert FolderFiles(tmp_path).find(tmp_path / "images" / "A.jpg") == tmp_path / "images" / "a.JPEG"
    assert FolderFiles(tmp_path).find(tmp_path / "images" / "b.jpg") is None


def test_a_missing_cloud_is_found_by_name_too(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room(), ply_file_path="D:\\scans\\room\\Cloud.ply")
    capture = read(path)
    assert capture.cloud is not None and len(capture.cloud.points) == len(sample.room())
    assert "a point cloud is not where the capture says" in messages(check(path))


def test_a_cloud_that_is_nowhere_leaves_a_capture_of_images_alone(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    (tmp_path / "cloud.ply").unlink()
    assert read(path).cloud is None
    report = check(path)
    assert not report.refused
    assert any(
        f.severity == "warning" and "cloud.ply is named in the file but missing" in f.message for f in report.findings
    )


def test_folders_that_fit_equally_well_are_named_and_none_is_taken(tmp_path: Path) -> None:
    path = capture_with(tmp_path, LISTED["in another folder"])
    shutil.copytree(tmp_path / "images", tmp_path / "copy")
    with pytest.raises(
        InputError, match="several folders hold an image of this name; name the right one with --images"
    ):
        read(path)
    assert f"found in {tmp_path / 'copy'}, {tmp_path / 'images'}" in messages(check(path))
    assert read(path, images=str(tmp_path / "copy")).frames[0].image_path == tmp_path / "copy" / "000.png"


def test_the_folder_whose_path_ends_like_the_listed_one_is_taken(tmp_path: Path) -> None:
    path = capture_with(tmp_path, LISTED["absolute"])
    shutil.copytree(tmp_path / "images", tmp_path / "copy")
    shutil.copytree(tmp_path / "images", tmp_path / "images_2")
    assert {f.image_path.parent.name for f in read(path).frames} == {"images"}


def test_downscaled_copies_are_taken_only_without_the_images(tmp_path: Path) -> None:
    path = capture_with(tmp_path, LISTED["in another folder"])
    shutil.copytree(tmp_path / "images", tmp_path / "images_4")
    shutil.copytree(tmp_path / "images", tmp_path / "images_2")
    assert {f.image_path.parent.name for f in read(path).frames} == {"images"}
    shutil.rmtree(tmp_path / "images")
    assert {f.image_path.parent.name for f in read(path).frames} == {"images_2"}


def test_a_depth_map_never_stands_in_for_an_image(tmp_path: Path) -> None:
    path = capture_with(tmp_path, LISTED["absolute"])
    (tmp_path / "images").rename(tmp_path / "depth")
    with pytest.raises(InputError, match="the image is missing"):
        read(path)


def test_images_that_are_missing_from_a_folder_are_not_taken_from_another(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    shutil.copytree(tmp_path / "images", tmp_path / "other_scan")
    (tmp_path / "images" / "003.png").unlink()
    with pytest.raises(InputError, match="the image is missing.*frame 3"):
        read(path)


def test_two_frames_never_share_an_image_that_was_found_by_name(tmp_path: Path) -> None:
    sides = iter(["left", "right"] * 6)
    path = capture_with(tmp_path, lambda listed: f"/scan/{next(sides)}/000.png")
    with pytest.raises(InputError, match="the image is missing"):
        read(path)


def test_each_camera_of_a_rig_keeps_its_own_folder(tmp_path: Path) -> None:
    names = iter([f"/scan/{side}/{i:03d}.png" for i in range(6) for side in ("left", "right")])
    path = capture_with(tmp_path, lambda listed: next(names))
    for side in ("left", "right"):
        shutil.copytree(tmp_path / "images", tmp_path / "rig" / side)
    shutil.rmtree(tmp_path / "images")
    found = [f.image_path.relative_to(tmp_path / "rig").as_posix() for f in read(path).frames]
    assert found == [f"{side}/{i:03d}.png" for i in range(6) for side in ("left", "right")]


@pytest.mark.parametrize("inside", [".", "sparse/0"])
def test_images_of_a_colmap_model_are_found_in_other_case(tmp_path: Path, inside: str) -> None:
    sample.write_colmap(tmp_path, sample.walk(), sample.room(500), binary=False)
    for i, image in enumerate(sorted((tmp_path / "images").iterdir())):
        image.rename(image.with_name(f"{i:03d}.PNG"))
    (tmp_path / "images").rename(tmp_path / "photos")
    assert read(tmp_path / inside).frames[3].image_path == tmp_path / "photos" / "003.PNG"


def test_images_of_a_kapture_tree_are_found_in_other_case(tmp_path: Path) -> None:
    data = sample.write_kapture(tmp_path, sample.walk(), sample.room()) / "sensors" / "records_data"
    (data / "cam0").rename(data / "CAM0")
    assert read(tmp_path).frames[0].image_path == data / "CAM0" / "000.png"


def test_captures_of_a_list_look_below_their_own_folders(tmp_path: Path) -> None:
    for name in ("first", "second"):
        capture_with(tmp_path / name, LISTED["absolute"])
    (tmp_path / "both.captures").write_text("first\nsecond\n")
    frames = read(tmp_path / "both.captures").frames
    assert [f.image_path.parent for f in frames[::12]] == [tmp_path / n / "images" for n in ("first", "second")]


def test_the_named_folder_precedes_what_is_found_by_name(tmp_path: Path) -> None:
    path = capture_with(tmp_path / "capture", LISTED["absolute"])
    shutil.copytree(tmp_path / "capture" / "images", tmp_path / "better")
    assert {f.image_path.parent for f in read(path, images=str(tmp_path / "better")).frames} == {tmp_path / "better"}


def test_the_named_folder_forgives_case_and_extension(tmp_path: Path) -> None:
    path = capture_with(tmp_path / "capture", lambda listed: "/old/" + Path(listed).name.replace(".png", ".PNG"))
    shutil.move(tmp_path / "capture" / "images", tmp_path / "elsewhere")
    assert read(path, images=str(tmp_path / "elsewhere")).frames[2].image_path == tmp_path / "elsewhere" / "002.png"


def test_names_with_umlauts_of_a_mac_are_found(tmp_path: Path) -> None:
    path = capture_with(tmp_path, lambda listed: listed.replace("images/", "images/k\u00fcche"))
    for image in (tmp_path / "images").iterdir():
        image.rename(image.with_name("ku\u0308che" + image.name))
    assert read(path).frames[1].image_path.name == "ku\u0308che001.png"


def test_a_depth_image_beside_the_images_is_not_taken_for_one(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    tree = json.loads(path.read_text())
    for frame in tree["frames"]:
        frame["depth_file_path"], frame["file_path"] = frame["file_path"], frame["file_path"].replace(".png", ".jpg")
    path.write_text(json.dumps(tree))
    with pytest.raises(InputError, match="the image is missing"):
        read(path)


def test_a_missing_scan_of_a_kapture_tree_is_a_warning_and_one_in_other_case_is_read(tmp_path: Path) -> None:
    data = sample.write_kapture(tmp_path, sample.walk(), sample.room()) / "sensors" / "records_data"
    (data / "lidar0" / "merged.ply").rename(data / "lidar0" / "Merged.PLY")
    assert read(tmp_path).cloud is not None and "a point cloud is not where" in messages(check(tmp_path))
    (data / "lidar0" / "Merged.PLY").unlink()
    report = check(tmp_path)
    assert not report.refused and "the point cloud is missing" in messages(report)


def test_links_that_lead_in_circles_are_walked_once(tmp_path: Path) -> None:
    path = capture_with(tmp_path, LISTED["absolute"])
    (tmp_path / "images" / "again").symlink_to(tmp_path)
    assert read(path).frames[0].image_path == tmp_path / "images" / "000.png"
