"""Photographs become upright images of limited size with the camera data of EXIF, and then a capture."""

from __future__ import annotations

import os
import random
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from textured_room import FOCAL, WIDTH, render, walk

from nvsim.capture.read import read
from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.footage.photographs import store_photographs
from nvsim.footage.sources import Footage, find_footage
from nvsim.reconstruction.report import read_report

ORIENTATION, MAKE, TIME, FOCAL_LENGTH, FOCAL_35 = 0x0112, 0x010F, 0x9003, 0x920A, 0xA405
PLANE_RESOLUTION, PLANE_UNIT = 0xA20E, 0xA210


def photograph(path: Path, size: tuple[int, int] = (400, 300), kind: str = "JPEG", **tags: object) -> Path:
    """A gray image of `size` whose upper left quarter is white as it is stored."""
    pixels = np.full((size[1], size[0], 3), 90, np.uint8)
    pixels[: size[1] // 2, : size[0] // 2] = 255
    exif = Image.Exif()
    numbers = {k: v for k, v in globals().items() if k in tags}
    for name, value in tags.items():
        target = exif if name in ("ORIENTATION", "MAKE") else exif.get_ifd(0x8769)
        target[numbers[name]] = value
    Image.fromarray(pixels).save(path, kind, exif=exif)
    return path


def folder_of(path: Path) -> Footage:
    found = find_footage(path)
    assert found is not None and found.kind == "photographs"
    return found


def brightest_quarter(path: Path) -> tuple[bool, bool]:
    """Whether it is the lower one, and the right one, in the stored file without regard to Exif."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    h, w = image.shape
    quarters = [
        [image[: h // 2, : w // 2], image[: h // 2, w // 2 :]],
        [image[h // 2 :, : w // 2], image[h // 2 :, w // 2 :]],
    ]
    low, right = divmod(int(np.argmax([[q.mean() for q in row] for row in quarters])), 2)
    return bool(low), bool(right)


def test_photographs_are_stored_upright_and_shrunk_with_their_focal_length(tmp_path: Path) -> None:
    photograph(tmp_path / "a.jpg", (1600, 1200), ORIENTATION=6, FOCAL_35=26)  # turned right to be seen
    photograph(tmp_path / "b.jpg", (1600, 1200), FOCAL_35=26)
    photograph(tmp_path / "c.jpg", (1600, 1200), FOCAL_35=52)
    stored = store_photographs(folder_of(tmp_path), tmp_path / "images")
    assert stored.names == ("a.jpg", "b.jpg", "c.jpg") and not stored.unreadable
    sizes = [(stored.cameras[k].width, stored.cameras[k].height) for k in stored.camera]
    assert sizes == [(960, 1280), (1280, 960), (1280, 960)]
    assert len(stored.cameras) == 3
    # 35 mm film has a diagonal of 43.27 mm.
    focal = [stored.cameras[k].focal for k in stored.camera]
    assert focal == pytest.approx([26 / 43.267 * 1600, 26 / 43.267 * 1600, 52 / 43.267 * 1600], rel=1e-3)
    assert brightest_quarter(stored.folder / "a.jpg") == (False, True)
    assert brightest_quarter(stored.folder / "b.jpg") == (False, False)


def test_the_focal_length_in_millimeters_needs_the_resolution_of_the_sensor(tmp_path: Path) -> None:
    inches = {"PLANE_RESOLUTION": 2000.0, "PLANE_UNIT": 2}
    photograph(tmp_path / "a.jpg", FOCAL_LENGTH=5.0, **inches)
    photograph(tmp_path / "b.jpg", FOCAL_LENGTH=5.0)
    photograph(tmp_path / "c.jpg", FOCAL_LENGTH=0.01, **inches)  # impossible
    stored = store_photographs(folder_of(tmp_path), tmp_path / "images")
    assert [stored.cameras[k].focal for k in stored.camera] == [pytest.approx(5 * 2000 / 25.4), None, None]


def test_upright_small_files_are_copied_as_they_are(tmp_path: Path) -> None:
    for name, kind in (("a.jpg", "JPEG"), ("b.png", "PNG"), ("c.webp", "WEBP"), ("b.tif", "TIFF")):
        photograph(tmp_path / name, kind=kind)
    stored = store_photographs(folder_of(tmp_path), tmp_path / "images")
    assert set(stored.names) == {"a.jpg", "b.png.png", "c.jpg", "b.tif.jpg"}
    assert (stored.folder / "a.jpg").read_bytes() == (tmp_path / "a.jpg").read_bytes()
    assert (stored.folder / "b.png.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_photographs_come_in_order_of_time_if_all_have_one(tmp_path: Path) -> None:
    for name, second in (("a", 30), ("b", 10), ("c", 20)):
        photograph(tmp_path / f"{name}.jpg", TIME=f"2026:05:01 10:00:{second}")
    assert store_photographs(folder_of(tmp_path), tmp_path / "out").names == ("b.jpg", "c.jpg", "a.jpg")
    photograph(tmp_path / "IMG_2.jpg")
    assert store_photographs(folder_of(tmp_path), tmp_path / "out").names == ("a.jpg", "b.jpg", "c.jpg", "IMG_2.jpg")


def test_damaged_photographs_are_named_and_too_few_are_refused(tmp_path: Path) -> None:
    for name in "abcd":
        photograph(tmp_path / f"{name}.jpg")
    (tmp_path / "b.jpg").write_bytes((tmp_path / "a.jpg").read_bytes()[:300])
    stored = store_photographs(folder_of(tmp_path), tmp_path / "out")
    assert stored.unreadable == ("b.jpg",) and stored.names == ("a.jpg", "c.jpg", "d.jpg")
    (tmp_path / "c.jpg").write_bytes(b"\xff\xd8 no image")
    with pytest.raises(InputError, match="2 photographs that can be decoded; give at least 3"):
        store_photographs(folder_of(tmp_path), tmp_path / "out")


def test_heic_is_read(tmp_path: Path) -> None:
    pillow_heif = pytest.importorskip("pillow_heif")
    pillow_heif.register_heif_opener()
    for name in "abc":
        photograph(tmp_path / f"{name}.heic", kind="HEIF")
    stored = store_photographs(folder_of(tmp_path), tmp_path / "out")
    assert stored.names == ("a.jpg", "b.jpg", "c.jpg")
    assert brightest_quarter(stored.folder / "a.jpg") == (False, False)


def test_shuffled_photographs_become_a_capture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    poses = walk(60)
    names = [f"{k:02d}.png" for k in range(len(poses))]
    random.Random(3).shuffle(names)
    (tmp_path / "photos").mkdir()
    for name, pose in zip(names, poses, strict=True):
        assert cv2.imwrite(str(tmp_path / "photos" / name), render(pose))
    (tmp_path / "photos" / "broken.jpg").write_bytes(b"no image")
    out = tmp_path / "house"
    assert main(["poses", str(tmp_path / "photos"), "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert "broken.jpg" in said.out + said.err
    report = read_report(out)
    assert report is not None and report.frames == 61 and report.with_pose >= 55
    assert "broken.jpg" in report.left_out
    assert report.focal_px == pytest.approx([FOCAL], rel=0.02) and report.size_px[0] == WIDTH
    found = {Path(f.name).name: f.camera_to_world[:3, 3] for f in read(out, scale=1.0).frames}
    both = [(found[name], pose[:3, 3]) for name, pose in zip(names, poses, strict=True) if name in found]
    a, b = (np.array(side) for side in zip(*both, strict=True))
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    u, size, vt = np.linalg.svd(b.T @ a)
    sign = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    laid = (size * sign).sum() / (a**2).sum() * a @ (u * sign @ vt).T
    assert np.linalg.norm(laid - b, axis=1).max() < 0.05
    # A second run uses what there is.
    before = os.stat(out / "poses.json").st_mtime_ns
    assert main(["poses", str(tmp_path / "photos"), "--out", str(out)]) == 0
    assert os.stat(out / "poses.json").st_mtime_ns == before
