"""Videos and photographs are recognized by their names, and decoded or refused in one sentence."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from textured_video import HEIGHT, WIDTH, shifted, texture, view, write_video

from nvsim.errors import InputError
from nvsim.footage.decoding import video_facts, video_frames
from nvsim.footage.sources import find_footage, need_footage
from nvsim.reconstruction.footage_check import check_footage


def touch(folder: Path, *names: str) -> Path:
    folder.mkdir(exist_ok=True)
    for name in names:
        (folder / name).write_bytes(b"x")
    return folder


def names(path: Path) -> list[str]:
    return [f.name for f in need_footage(path).files]


def test_photographs_are_in_natural_order(tmp_path: Path) -> None:
    folder = touch(tmp_path / "a", "IMG_10.jpg", "IMG_2.JPG", "IMG_1.png", "notes.txt")
    assert names(folder) == ["IMG_1.png", "IMG_2.JPG", "IMG_10.jpg"]
    found = need_footage(folder)
    assert found.kind == "photographs" and found.description == "3 photographs"


def test_names_that_mix_digits_and_letters_have_an_order(tmp_path: Path) -> None:
    folder = touch(tmp_path / "a", "10.jpg", "a.jpg", "2.jpg", "0²3.jpg", "٣.jpg", "9" * 40 + ".jpg")
    assert len(names(folder)) == 6
    assert [n for n in names(folder) if n.isascii()] == ["2.jpg", "10.jpg", "9" * 40 + ".jpg", "a.jpg"]


def test_a_folder_with_a_video_is_a_video_even_beside_photographs(tmp_path: Path) -> None:
    folder = touch(tmp_path / "a", "1.jpg", "2.jpg", "3.jpg", "walk_10.MP4", "walk_9.mov")
    found = need_footage(folder)
    assert found.kind == "video" and names(folder) == ["walk_9.mov", "walk_10.MP4"] and found.description == "2 videos"


def test_a_single_video_file_is_footage_and_a_single_photograph_is_none(tmp_path: Path) -> None:
    folder = touch(tmp_path / "a", "walk.mp4", "1.jpg")
    found = need_footage(folder / "walk.mp4")
    assert found.files == (folder / "walk.mp4",) and found.description == "a video"
    assert find_footage(folder / "1.jpg") is None


def test_hidden_files_and_folders_below_do_not_count(tmp_path: Path) -> None:
    folder = touch(tmp_path / "a", "._walk.mp4", ".1.jpg", "1.jpg", "2.jpg")
    touch(folder / "clip.mp4", "3.jpg")
    assert find_footage(folder) is None
    touch(folder, "3.jpg")
    assert names(folder) == ["1.jpg", "2.jpg", "3.jpg"]


@pytest.mark.parametrize("name", ["", "missing", "notes.txt", "\0"])
def test_anything_else_is_refused_in_a_sentence(tmp_path: Path, name: str) -> None:
    touch(tmp_path, "notes.txt")
    with pytest.raises(InputError, match="check the path.$") as raised:
        need_footage(tmp_path / name)
    assert "\n" not in str(raised.value)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    plane = texture()
    images = [view(plane, shifted(100 + 5 * k, 100)) for k in range(30)]
    return write_video(tmp_path_factory.mktemp("video") / "video.avi", images, 24.0)


def test_a_video_is_decoded_in_order_and_no_faster_than_asked(video: Path) -> None:
    facts = video_facts(video)
    assert (facts.frames, facts.rate, facts.width, facts.height) == (30, 24.0, WIDTH, HEIGHT)
    every = list(video_frames(video, 100.0))
    assert [f.number for f in every] == list(range(30))
    some = list(video_frames(video, 12.0))
    assert [f.number for f in some] == list(range(0, 30, 2))
    assert np.allclose([f.seconds for f in some], [f.number / 24 for f in some], atol=1e-3)
    expected = view(texture(), shifted(150, 100))
    assert np.abs(every[10].image.mean(axis=2) - expected).mean() < 5


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"This is not a video.\n" * 200, "cannot be decoded"),
        (b"\0" * 4096, "cannot be decoded"),
    ],
    ids=["empty", "text", "zeros"],
)
@pytest.mark.parametrize("suffix", ["mp4", "avi", "mkv"])
def test_a_file_that_is_no_video_is_refused_in_one_sentence(
    tmp_path: Path, content: bytes, message: str, suffix: str
) -> None:
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(content)
    for read in (video_facts, lambda p: list(video_frames(p))):
        with pytest.raises(InputError) as raised:
            read(path)
        said = str(raised.value)
        assert said.startswith(str(path)) and message in said and "\n" not in said and said.endswith(".")


def test_a_missing_file_is_refused_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be opened"):
        video_facts(tmp_path / "missing.mp4")


@pytest.mark.parametrize("share", [0.0005, 0.002, 0.02, 0.5])
def test_a_truncated_video_gives_its_first_frames_or_one_sentence(tmp_path: Path, video: Path, share: float) -> None:
    path = tmp_path / "cut.avi"
    path.write_bytes(video.read_bytes()[: int(os.path.getsize(video) * share)])
    try:
        found = list(video_frames(path, 100.0))
    except InputError as error:
        assert share < 0.5 and str(error).endswith("try again.") and "\n" not in str(error)
    else:
        assert 1 <= len(found) < 30 and [f.number for f in found] == list(range(len(found)))


def test_depth_images_and_masks_are_no_photographs(tmp_path: Path) -> None:
    for i in range(4):
        for name in (f"{i}.color.png", f"{i}.depth.png", f"mask_{i}.png"):
            (tmp_path / name).write_bytes(b"x")
    found = find_footage(tmp_path)
    assert found is not None
    assert [f.name for f in found.files] == [f"{i}.color.png" for i in range(4)]
    assert len(found.others) == 8
    words = "8 images are not used because of names like 0.depth.png, as depth images and masks have"
    assert found.others_text == words
    assert words in [finding.message for finding in check_footage(found, True).findings]
    only = tmp_path / "only"
    only.mkdir()
    for i in range(4):
        (only / f"sky {i}.jpg").write_bytes(b"x")
    again = find_footage(only)
    assert again is not None and len(again.files) == 4 and not again.others
