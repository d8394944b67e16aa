"""Images in the folder of a capture that no frame uses are reported; masks, depth and smaller copies are not."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import capture_samples as sample
import pytest

from nvsim.capture.check import check


def said_of(folder: Path, **options: str) -> list[str]:
    return [str(f) for f in check(folder, **options).findings if "are registered" in f.message]


def nerfstudio(folder: Path, frames: int = 12) -> Path:
    """A capture of 12 images of which the first `frames` are listed."""
    path = sample.write_nerfstudio(folder, sample.walk(), sample.room(400))
    tree = json.loads(path.read_text())
    tree["frames"] = tree["frames"][:frames]
    path.write_text(json.dumps(tree))
    return folder


def kapture(folder: Path, frames: int) -> Path:
    sample.write_kapture(folder, sample.walk(), sample.room(400))
    records = folder / "sensors" / "records_camera.txt"
    records.write_text("\n".join(records.read_text().splitlines()[: frames + 1]) + "\n")
    return folder


def colmap(folder: Path, frames: int) -> Path:
    sample.write_colmap(folder, sample.walk(frames), sample.room(400), binary=True)
    sample.write_images(folder / "images", 12)
    return folder


@pytest.mark.parametrize("write", [nerfstudio, kapture, colmap])
def test_images_without_a_frame_are_counted_and_named_in_every_format(tmp_path: Path, write) -> None:
    (said,) = said_of(write(tmp_path, 9))
    assert said.startswith("warning: 9 of 12 images are registered; 3 images have no pose")
    assert "009.png, 010.png, 011.png" in said


@pytest.mark.parametrize("write", [nerfstudio, kapture, colmap])
def test_a_capture_that_uses_all_its_images_is_no_finding(tmp_path: Path, write) -> None:
    assert not said_of(write(tmp_path, 12))


def test_images_of_a_camera_folder_without_any_frame_are_counted(tmp_path: Path) -> None:
    sample.write_colmap(tmp_path, sample.walk(), sample.room(400), binary=False)
    shutil.move(tmp_path / "images", tmp_path / "moved")
    shutil.move(tmp_path / "moved", tmp_path / "images" / "left")
    sample.write_images(tmp_path / "images" / "right", 5)
    lists = tmp_path / "sparse" / "0" / "images.txt"
    lists.write_text("".join(line.replace(" 1 0", " 1 left/0") for line in lists.read_text().splitlines(True)))
    (said,) = said_of(tmp_path)
    assert "12 of 17 images are registered; 5 images have no pose" in said and "right" in said


ADDED = (
    *("images_2", "images_4", "masks", "depth", "images/masks", "images/depth", "normals", "semantic", "thumbnails"),
    *("../elsewhere", "images/.cache", "renders"),
)


@pytest.mark.parametrize("folder", ADDED)
def test_folders_that_hold_something_else_are_not_counted(tmp_path: Path, folder: str) -> None:
    nerfstudio(tmp_path / "walk")
    sample.write_images(tmp_path / "walk" / folder, 20)
    assert not said_of(tmp_path / "walk")


@pytest.mark.parametrize("name", ["000_mask.png", "000.mask.png", "depth_000.png", "000_depth_0001.png", "notes.txt"])
def test_files_that_hold_something_else_are_not_counted(tmp_path: Path, name: str) -> None:
    nerfstudio(tmp_path)
    shutil.copy(tmp_path / "images" / "000.png", tmp_path / "images" / name)
    assert not said_of(tmp_path)


def test_frames_that_the_user_left_out_are_not_unused_images(tmp_path: Path) -> None:
    nerfstudio(tmp_path)
    assert not said_of(tmp_path, leave_out="images/003.png,images/004.png")
    shutil.move(tmp_path / "images", tmp_path / "elsewhere")
    assert not said_of(tmp_path, leave_out="images/003.png", images=str(tmp_path / "elsewhere"))


def test_images_of_two_models_listed_together_are_all_used(tmp_path: Path) -> None:
    sample.write_colmap(tmp_path, sample.walk(), sample.room(400), binary=False)
    shutil.copytree(tmp_path / "sparse" / "0", tmp_path / "sparse" / "1")
    for model, kept in (("0", range(7)), ("1", range(7, 12))):
        path = tmp_path / "sparse" / model / "images.txt"
        lines = path.read_text().splitlines()[1:]
        path.write_text("\n".join("\n".join(lines[2 * i : 2 * i + 2]) for i in kept) + "\n")
    listed = tmp_path / "both.captures"
    listed.write_text("sparse/0\nsparse/1\n")
    assert not said_of(listed) and len(said_of(tmp_path)) == 1
