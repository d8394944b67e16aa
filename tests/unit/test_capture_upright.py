"""Sideways images are turned upright, with their lenses, poses, masks, and depth images."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import capture_samples as sample
import cv2
import numpy as np
import pytest

from nvsim.capture import store
from nvsim.capture.check import check
from nvsim.capture.depth_images import inverse_depth
from nvsim.capture.images import read_image
from nvsim.capture.masks import usable_pixels
from nvsim.capture.read import read
from nvsim.capture.types import Frame
from nvsim.geometry.camera import Camera, Intrinsics, quarter_turns
from nvsim.geometry.lens import Lens

BENT = Lens("OPENCV", 90, 60, (70.0, 71.0, 43.0, 31.0, -0.08, 0.01, 0.004, -0.006))


def sideways(lens: Lens, turns: int) -> Lens:
    """The lens of the images that `turns` quarter turns make upright, where `lens` is that of the upright images."""
    k = Intrinsics(lens.width, lens.height, *lens.focal, *lens.principal_point).turned(-turns)
    k1, k2, p1, p2 = lens.distortion
    # The tangential distortion is r^2 t + 2 (t v) v with t = (p2, p1), so t turns like a direction.
    across, down = quarter_turns(-turns)[:2, :2] @ (p2, p1)
    return Lens("OPENCV", k.width, k.height, (k.fx, k.fy, k.cx, k.cy, k1, k2, float(down), float(across)), turns)


def picture(lens: Lens, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(0, 255, (lens.height, lens.width, 3)).astype(np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 2)


@pytest.mark.parametrize("turns", range(4))
def test_a_lens_with_turns_shows_the_upright_image(tmp_path: Path, turns: int) -> None:
    image, lens = picture(BENT), sideways(BENT, turns)
    cv2.imwrite(str(tmp_path / "upright.png"), image)
    cv2.imwrite(str(tmp_path / "sideways.png"), np.rot90(image, -turns))
    upright = Frame("a", tmp_path / "upright.png", BENT, np.eye(4))
    turned = Frame("b", tmp_path / "sideways.png", lens, np.eye(4))
    assert turned.intrinsics == pytest.approx(upright.intrinsics)
    for k in (upright.intrinsics, upright.intrinsics.scaled(45, 30)):
        np.testing.assert_allclose(read_image(turned, k).astype(int), read_image(upright, k), atol=1)
    straight = replace(lens, params=(*lens.params[:4], 0.0, 0.0, 0.0, 0.0))
    whole = replace(turned, lens=straight)
    np.testing.assert_array_equal(read_image(whole, whole.intrinsics)[..., ::-1], image)


def test_quarter_turns_are_those_of_the_image() -> None:
    """A point keeps its pixel when the image, the pinhole camera, and its pose turn together."""
    k, point = Intrinsics(8, 6, 5.0, 4.0, 3.7, 2.1), np.array([0.3, -0.2, 1.0])
    marked = np.zeros((6, 8))
    column, row = Camera(k, np.eye(4)).project(point)[0].astype(int)
    marked[row, column] = 1
    for turns in range(4):
        pose = np.eye(4)
        pose[:3, :3] = quarter_turns(turns).T
        column, row = Camera(k.turned(turns), pose).project(point)[0].astype(int)
        assert np.rot90(marked, turns)[row, column] == 1


def write(folder: Path, turns: list[int], poses: np.ndarray, tag: int = 1) -> Path:
    """A capture whose image i must be turned by turns[i], with a mask and a depth image beside each image. A camera
    model belongs to each image."""
    flip, frames = np.diag([1.0, -1.0, -1.0, 1.0]), []
    for kind in ("images", "masks", "depth"):
        (folder / kind).mkdir(parents=True)
    for i, (turn, pose) in enumerate(zip(turns, poses)):
        k = Intrinsics(sample.WIDTH, sample.HEIGHT, 40.0, 41.0, 30.0, 25.0).turned(-turn)
        image = np.full((sample.HEIGHT, sample.WIDTH, 3), 40 + i, np.uint8)
        cv2.rectangle(image, (10, 10), (30, 30), (200, 100, 50), -1)
        mask = np.full(image.shape[:2], 255, np.uint8)
        mask[:10, :20] = 0
        depth = 1000 + 10 * np.arange(image[..., 0].size, dtype=np.uint16).reshape(mask.shape) // 7
        for kind, pixels in (("images", image), ("masks", mask), ("depth", depth)):
            cv2.imwrite(str(folder / kind / f"{i}.png"), np.rot90(pixels, -turn))
        stored = pose.copy()
        stored[:3, :3] = pose[:3, :3] @ quarter_turns(-turn).T
        frames.append({
            "file_path": f"images/{i}.png", "mask_path": f"masks/{i}.png", "depth_file_path": f"depth/{i}.png",
            "transform_matrix": (stored @ flip).tolist(), "w": k.width, "h": k.height,
            "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy,
        })  # fmt: skip
    (folder / "cloud.ply").write_bytes(sample.ply(sample.room()))
    tree = {"camera_model": "OPENCV", "unit": "meter", "ply_file_path": "cloud.ply", "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(tree))
    return folder


MIXED = [*([3] * 9), *([0] * 5), *([1] * 4), *([3] * 2)]


@pytest.mark.parametrize("turns", [[3] * 20, [1] * 20, MIXED, [*([0] * 14), *([2] * 6)]])
def test_a_capture_with_sideways_images_is_that_with_upright_images(tmp_path: Path, turns: list[int]) -> None:
    poses = sample.walk(20)
    upright = read(write(tmp_path / "upright", [0] * 20, poses))
    path = write(tmp_path / "sideways", turns, poses)
    turned = read(path)
    assert [f.lens.turns for f in turned.frames] == turns
    for a, b, c, d in zip(upright.frames, turned.frames, upright.depths, turned.depths, strict=True):
        np.testing.assert_allclose(b.camera_to_world, a.camera_to_world, atol=1e-9)
        assert b.intrinsics == pytest.approx(a.intrinsics)
        np.testing.assert_array_equal(read_image(b, b.intrinsics), read_image(a, a.intrinsics))
        np.testing.assert_array_equal(usable_pixels(b, b.intrinsics), usable_pixels(a, a.intrinsics))
        np.testing.assert_allclose(inverse_depth(d, b.camera), inverse_depth(c, a.camera), rtol=1e-5)
    report = check(path)
    (note,) = (f for f in report.findings if "are sideways" in f.message)
    assert f"{np.count_nonzero(turns)} of 20" in note.message and not report.refused
    assert not [f for f in report.findings if "upside down" in f.message and f is not note]


def test_a_stored_capture_keeps_the_turns(tmp_path: Path) -> None:
    turned = read(write(tmp_path / "sideways", MIXED, sample.walk(20)))
    store.save_capture(turned, tmp_path)
    loaded = store.load_capture(tmp_path)
    assert [f.lens for f in loaded.frames] == [f.lens for f in turned.frames]
    assert store.fingerprint(loaded) == store.fingerprint(turned)
    tree = json.loads((tmp_path / "capture.json").read_text())
    tree["lenses"][0]["turns"] = 4
    (tmp_path / "capture.json").write_text(json.dumps(tree))
    with pytest.raises(Exception, match="damaged"):
        store.load_capture(tmp_path)


def tagged(folder: Path, orientation: int) -> None:
    """Store the images as JPEG with an Exif orientation."""
    from PIL import Image

    for path in sorted((folder / "images").glob("*.png")):
        exif = Image.Exif()
        exif[274] = orientation
        with Image.open(path) as image:
            image.convert("RGB").save(path.with_suffix(".jpg"), exif=exif)
        path.unlink()
    listed = folder / "transforms.json"
    listed.write_text(listed.read_text().replace('.png", "mask', '.jpg", "mask'))


def tilted(poses: np.ndarray) -> np.ndarray:
    """The poses in a world whose axes say nothing about the vertical."""
    return sample.turn(cv2.Rodrigues(np.array([0.7, -0.9, 0.4]))[0], poses, np.zeros((1, 3)))[0]


@pytest.mark.parametrize(("turn", "tag"), [(3, 6), (1, 8), (3, 1)])
def test_the_orientation_tag_tells_which_end_of_the_vertical_is_up(tmp_path: Path, turn: int, tag: int) -> None:
    """Without one, the phone was held as phones are. The world of these poses tells nothing."""
    folder = write(tmp_path / "sideways", [turn] * 20, tilted(sample.walk(20)))
    (folder / "transforms.json").write_text(
        (folder / "transforms.json").read_text().replace('"ply_file_path": "cloud.ply", ', "")
    )
    tagged(folder, tag)
    assert {f.lens.turns for f in read(folder).frames} == {turn}


def test_cameras_that_look_steeply_down_are_turned_like_their_neighbors(tmp_path: Path) -> None:
    poses = sample.walk(20)
    poses[4] = sample.walk(20, pitch_degrees=85)[4]
    assert {f.lens.turns for f in read(write(tmp_path / "sideways", [3] * 20, poses)).frames} == {3}


def test_a_few_rolled_cameras_are_not_turned(tmp_path: Path) -> None:
    poses = sample.walk(20)
    roll = cv2.Rodrigues(np.array([0, 0, np.radians(50)]))[0]
    poses[3, :3, :3], poses[9, :3, :3] = poses[3, :3, :3] @ roll, poses[9, :3, :3] @ quarter_turns(2)
    assert {f.lens.turns for f in read(write(tmp_path / "level", [0] * 20, poses)).frames} == {0}
