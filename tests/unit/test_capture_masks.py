"""Masks of a capture: found where each format stores them, checked, and ignored pixels count for nothing."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import capture_samples as sample
import cv2
import numpy as np
import pytest

from nvsim.capture.check import check
from nvsim.capture.findings import Findings
from nvsim.capture.masks import usable_pixels
from nvsim.capture.read import read, read_usable
from nvsim.capture.store import fingerprint, load_capture, save_capture
from nvsim.capture.types import Capture, Frame, MaskFile
from nvsim.errors import InputError
from nvsim.geometry.camera import camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.lens import Lens
from nvsim.perception.support import observe
from nvsim.poses.features import find_features
from nvsim.training.config import Preset, RobustConfig, preset
from nvsim.training.robust import QuantileMask
from nvsim.training.synthetic import synthetic_room
from nvsim.training.trainer import train_submap

COUNT = 5
LOWER = np.zeros((sample.HEIGHT, sample.WIDTH), bool)
LOWER[sample.HEIGHT // 2 :] = True


def write_mask(path: Path, usable: np.ndarray, white: int = 255) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), usable.astype(np.uint8) * white)


def nerfstudio(folder: Path, key: str = "masks/{}", **more: object) -> Path:
    """A capture whose frames name a mask that ignores the lower half."""
    path = sample.write_nerfstudio(folder, sample.walk(COUNT), sample.room(3000), **more)
    tree = json.loads(path.read_text())
    for frame in tree["frames"]:
        name = Path(frame["file_path"]).name
        frame["mask_path"] = key.format(name)
        write_mask(folder / "masks" / name, ~LOWER)
    path.write_text(json.dumps(tree))
    return path


def masks(capture: Capture) -> list[np.ndarray]:
    found = [usable_pixels(f, f.intrinsics) for f in capture.frames]
    assert all(m is not None for m in found)
    return [m for m in found if m is not None]


def warnings(path: Path) -> list[str]:
    return [f.message for f in check(path).findings if f.severity == "warning"]


def test_mask_path_ignores_black_pixels(tmp_path: Path) -> None:
    capture = read(nerfstudio(tmp_path))
    assert all(np.array_equal(mask, ~LOWER) for mask in masks(capture))
    report = check(tmp_path)
    assert report.summary is not None and report.summary.masks == COUNT
    assert any("5 of 5 images have a mask" in f.message for f in report.findings)
    assert not warnings(tmp_path)


def see_through(path: Path, dtype: type = np.uint8, opacity: float = 0.0) -> None:
    """Gives the lower half of the images an opacity, and the rest full opacity."""
    for file in sorted((path.parent / "images").iterdir()):
        most = np.iinfo(dtype).max
        pixels = (cv2.imread(str(file)).astype(float) / 255 * most).astype(dtype)
        alpha = np.where(LOWER, opacity * most, most).astype(dtype)
        assert cv2.imwrite(str(file), np.dstack([pixels, alpha]))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_transparent_pixels_are_ignored(tmp_path: Path, dtype: type) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(COUNT), sample.room(3000))
    see_through(path, dtype)
    capture = read(path)
    assert all(np.array_equal(mask, ~LOWER) for mask in masks(capture))
    save_capture(capture, tmp_path)
    assert [f.mask for f in load_capture(tmp_path).frames] == [f.mask for f in capture.frames]
    report = check(path)
    assert any("5 of 5 images have transparent pixels" in f.message for f in report.findings)
    assert not [f for f in report.findings if f.severity == "warning"]


def test_an_image_that_is_transparent_everywhere_is_named(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(COUNT), sample.room(3000))
    see_through(path)
    first = tmp_path / "images" / "000.png"
    pixels = cv2.imread(str(first), cv2.IMREAD_UNCHANGED)
    pixels[..., 3] = 0
    cv2.imwrite(str(first), pixels)
    (warning,) = (f for f in check(path).findings if f.severity == "warning")
    assert "are transparent" in warning.message and "000.png" in warning.frames[0]
    assert "hidden colors are used" in warning.consequence


def test_an_opaque_alpha_channel_is_no_mask(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(COUNT), sample.room(3000))
    see_through(path, opacity=1.0)
    assert {f.mask for f in read(path).frames} == {None}


def test_a_listed_mask_precedes_transparent_pixels(tmp_path: Path) -> None:
    path = nerfstudio(tmp_path)
    see_through(path)
    assert {f.mask.ignored for f in read(path).frames if f.mask} == {"black"}


def test_one_mask_for_all_frames_stands_at_the_top(tmp_path: Path) -> None:
    write_mask(tmp_path / "rig.png", ~LOWER)
    path = sample.write_nerfstudio(tmp_path, sample.walk(COUNT), sample.room(3000), mask_path="rig.png")
    assert all(np.array_equal(mask, ~LOWER) for mask in masks(read(path)))


def test_dynamic_masks_of_instant_ngp_ignore_white_pixels(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(COUNT), sample.room(3000), aabb_scale=4)
    for name in ("000", "002"):
        write_mask(tmp_path / "images" / f"dynamic_mask_{name}.png", LOWER)
    frames = read(path, scale=1.0).frames
    assert [f.mask is not None for f in frames] == [True, False, True, False, False]
    mask = usable_pixels(frames[0], frames[0].intrinsics)
    assert mask is not None and np.array_equal(mask, ~LOWER)


@pytest.mark.parametrize("name", ["{}.png", "{}"])
def test_colmap_masks_lie_in_a_folder_beside_the_images(tmp_path: Path, name: str) -> None:
    sample.write_colmap(tmp_path, sample.walk(COUNT), sample.room(3000), binary=True)
    for image in (tmp_path / "images").iterdir():
        write_mask(tmp_path / "masks" / name.format(image.name), ~LOWER)
    assert all(np.array_equal(mask, ~LOWER) for mask in masks(read(tmp_path, scale=1.0)))


@pytest.mark.parametrize("white", [1, 255])
def test_masks_of_zeros_and_ones_are_read_like_black_and_white(tmp_path: Path, white: int) -> None:
    path = nerfstudio(tmp_path)
    for mask in (tmp_path / "masks").iterdir():
        write_mask(mask, ~LOWER, white)
    assert all(np.array_equal(mask, ~LOWER) for mask in masks(read(path)))


def test_a_mask_of_half_the_size_is_resampled(tmp_path: Path) -> None:
    path = nerfstudio(tmp_path)
    for mask in (tmp_path / "masks").iterdir():
        write_mask(mask, ~LOWER[::2, ::2])
    assert not warnings(path)
    assert all(np.array_equal(mask, ~LOWER) for mask in masks(read(path)))


def lose(path: Path) -> None:
    path.unlink()


def widen(path: Path) -> None:
    write_mask(path, np.ones((40, 40), bool))


def damage(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:40])


def blacken(path: Path) -> None:
    write_mask(path, np.zeros_like(LOWER))


@pytest.mark.parametrize(
    ("harm", "words"),
    [(lose, "missing"), (widen, "does not fit"), (damage, "the mask"), (blacken, "ignores the whole image")],
)
def test_a_mask_that_cannot_be_used_is_a_warning_and_left_out(tmp_path: Path, harm: object, words: str) -> None:
    path = nerfstudio(tmp_path)
    assert callable(harm)
    harm(tmp_path / "masks" / "001.png")
    assert len([w for w in warnings(path) if words in w]) == 1
    report = check(path)
    assert not report.refused and report.capture is not None
    assert [f.mask is not None for f in report.capture.frames] == [True, False, True, True, True]


def test_masks_are_stored_and_change_the_fingerprint(tmp_path: Path) -> None:
    capture = read(nerfstudio(tmp_path))
    save_capture(capture, tmp_path / "stored")
    again = load_capture(tmp_path / "stored")
    assert [f.mask for f in again.frames] == [f.mask for f in capture.frames]
    assert fingerprint(again) == fingerprint(capture)
    without = replace(capture, frames=tuple(replace(f, mask=None) for f in capture.frames))
    assert fingerprint(without) != fingerprint(capture)


def test_a_mask_is_undistorted_like_its_image(tmp_path: Path) -> None:
    lens = Lens("OPENCV", 320, 240, (210.0, 205.0, 158.3, 121.6, -0.15, 0.03, 0.002, -0.001))
    usable = np.ones((240, 320), bool)
    usable[40:90, 50:120] = False
    write_mask(tmp_path / "mask.png", usable)
    frame = Frame("a", tmp_path / "a.png", lens, np.eye(4), mask=MaskFile(tmp_path / "mask.png"))
    k = frame.intrinsics
    found = usable_pixels(frame, k)
    assert found is not None
    mapping = np.rint(lens.undistort_map(k)).astype(int)
    expected = usable[mapping[..., 1].clip(0, 239), mapping[..., 0].clip(0, 319)]
    assert not (found & ~expected).any()  # what any ignored pixel is part of is ignored
    assert np.count_nonzero(found != expected) < 400  # a border of a pixel
    small = usable_pixels(frame, k.limited_to(80))
    assert small is not None and small.shape == (60, 80) and 0.05 < (~small).mean() < 0.09


def test_a_mask_that_vanished_after_the_import_is_named(tmp_path: Path) -> None:
    frame = read(nerfstudio(tmp_path)).frames[0]
    assert frame.mask is not None
    frame.mask.path.unlink()
    with pytest.raises(InputError, match="000.png"):
        usable_pixels(frame, frame.intrinsics)


def test_no_feature_is_found_in_ignored_pixels() -> None:
    image = np.random.default_rng(0).integers(0, 255, (120, 160, 3)).astype(np.uint8)
    image = cv2.GaussianBlur(image, (0, 0), 2)
    usable = np.ones((120, 160), bool)
    usable[:, :80] = False
    everywhere, found = find_features(image), find_features(image, usable=usable)
    assert (everywhere.places[:, 0] < 80).any() and len(found) and (found.places[:, 0] > 80).all()


def test_ignored_pixels_say_neither_floor_nor_anything_else() -> None:
    from nvsim.geometry.camera import Camera, Intrinsics

    camera = Camera(Intrinsics(64, 48, 40, 40, 32, 24), camera_pose(np.array([0, 0, 1.4]), 0.0, -0.6))
    cameras, place = [camera] * 8, np.array([0.0, 1.5])
    floor, nothing = np.ones((48, 64), bool), np.zeros((48, 64), bool)
    masks = [floor] * 2 + [nothing] * 6  # something stands there in most of the images
    assert not observe(cameras, masks, FloorSurface.flat(0.0), None).is_supported(place)
    ignored = [None, None, *[nothing] * 6]
    assert observe(cameras, masks, FloorSurface.flat(0.0), None, usable=ignored).is_supported(place)
    assert not observe(cameras, masks, FloorSurface.flat(0.0), None, usable=[nothing] * 8).is_supported(place)


@pytest.mark.parametrize("name", ["nvsim", "splatfacto-w"])
def test_what_training_sees_in_ignored_pixels_does_not_change_the_model(name: Preset) -> None:
    room = synthetic_room(4, 80, 60, 2000)
    config = replace(preset(name), steps=8, threads=1)
    rng, models = np.random.default_rng(0), []
    for _ in range(2):
        views = []
        for view in room.views:
            usable = np.ones(view.floor.shape, bool)
            usable[10:40, 20:50] = False
            image = view.image.copy()
            image[~usable] = rng.integers(0, 255, (np.count_nonzero(~usable), 3))
            views.append(replace(view, image=image, usable=usable))
        models.append(train_submap(views, room.cloud, room.floor, config))
    assert np.array_equal(models[0].gaussians.means, models[1].gaussians.means)
    assert np.array_equal(models[0].gaussians.sh, models[1].gaussians.sh)


def test_ignored_pixels_are_not_the_worst_of_an_image() -> None:
    image = np.zeros((32, 32, 3), np.uint8)
    drawn = np.zeros((32, 32, 3), np.float32)
    drawn[:16] = 1.0  # wrong where the mask ignores it
    drawn[20:24, 20:24] = 0.5  # and where it does not
    usable = np.ones((32, 32), bool)
    usable[:16] = False
    robust = QuantileMask(RobustConfig(kind="quantile", start=0.0), 100)
    for _ in range(2):
        inlier = usable.copy()
        robust.begin(1, 0, image, inlier)(drawn, np.zeros((32, 32), np.float32), np.zeros((3, 32, 32), np.float32))
        drawn *= 1.5
    assert not inlier[21:23, 21:23].any()


def test_findings_of_a_mask_path_that_is_no_text_are_warnings(tmp_path: Path) -> None:
    path = nerfstudio(tmp_path)
    tree = json.loads(path.read_text())
    tree["frames"][0]["mask_path"] = 7
    path.write_text(json.dumps(tree))
    findings = Findings()
    assert read_usable(path, "", "", findings).frames[0].mask is None
    assert [f.severity for f in findings] == ["warning"]
