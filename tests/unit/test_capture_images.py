"""Images: undistorted as OpenCV does it, filtered when they shrink, refused when broken."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import capture_samples as sample
import cv2
import numpy as np
import pytest

from nvsim.capture.check import check
from nvsim.capture.images import decode, read_image
from nvsim.capture.read import read
from nvsim.capture.types import Frame
from nvsim.errors import InputError
from nvsim.files.images import orientation_of
from nvsim.geometry.camera import Intrinsics
from nvsim.geometry.lens import Lens

WIDTH, HEIGHT = 320, 240
PIXEL = (210.0, 205.0, 158.3, 121.6)


def smooth(seed: int = 0) -> np.ndarray:
    """(H, W, 3) without detail finer than some pixels, so that interpolation hardly matters."""
    noise = np.random.default_rng(seed).uniform(0, 255, (HEIGHT // 16, WIDTH // 16, 3))
    return cv2.resize(noise, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)


def frame(tmp_path: Path, image: np.ndarray, lens: Lens) -> Frame:
    path = tmp_path / "image.png"
    assert cv2.imwrite(str(path), image[..., ::-1])
    return Frame("image.png", path, lens, np.eye(4))


def opencv_matrix(k: Intrinsics) -> np.ndarray:
    return np.array([[k.fx, 0, k.cx - 0.5], [0, k.fy, k.cy - 0.5], [0, 0, 1]])


def test_a_pinhole_of_the_same_size_is_read_pixel_by_pixel(tmp_path: Path) -> None:
    image = np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    one = frame(tmp_path, image, Lens("PINHOLE", WIDTH, HEIGHT, PIXEL))
    assert np.array_equal(read_image(one, one.intrinsics), image)


def test_undistortion_is_opencvs(tmp_path: Path) -> None:
    k = np.array([-0.15, 0.03, 0.002, -0.001])
    one = frame(tmp_path, smooth(), Lens("OPENCV", WIDTH, HEIGHT, (*PIXEL, *k)))
    stored = opencv_matrix(Intrinsics(WIDTH, HEIGHT, *PIXEL))
    expected = cv2.undistort(smooth(), stored, k, None, opencv_matrix(one.intrinsics))
    difference = np.abs(read_image(one, one.intrinsics).astype(int) - expected)[2:-2, 2:-2]
    assert difference.mean() < 0.1 and difference.max() <= 3


def test_fisheye_undistortion_is_opencvs(tmp_path: Path) -> None:
    k = np.array([0.05, -0.02, 0.004, -0.001])
    one = frame(tmp_path, smooth(), Lens("OPENCV_FISHEYE", WIDTH, HEIGHT, (*PIXEL, *k)))
    stored = opencv_matrix(Intrinsics(WIDTH, HEIGHT, *PIXEL))
    expected = cv2.fisheye.undistortImage(smooth(), stored, k, None, opencv_matrix(one.intrinsics))
    difference = np.abs(read_image(one, one.intrinsics).astype(int) - expected)[2:-2, 2:-2]
    assert difference.mean() < 0.1 and difference.max() <= 3


@pytest.mark.parametrize("distorted", [False, True])
def test_shrinking_averages_areas_instead_of_skipping_pixels(tmp_path: Path, distorted: bool) -> None:
    checkers = np.indices((HEIGHT, WIDTH)).sum(axis=0) % 2 * 255
    image = np.repeat(checkers[..., None], 3, axis=2).astype(np.uint8)
    lens = Lens("OPENCV", WIDTH, HEIGHT, (*PIXEL, 1e-9 if distorted else 0.0, 0, 0, 0))
    one = frame(tmp_path, image, lens)
    small = read_image(one, one.intrinsics.scaled(WIDTH // 4, HEIGHT // 4))
    assert small.shape == (HEIGHT // 4, WIDTH // 4, 3)
    assert np.abs(small.astype(int) - 127.5).max() < 8


def test_another_pinhole_sees_the_world_where_it_should(tmp_path: Path) -> None:
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    cv2.circle(image, (200, 90), 6, (255, 0, 0), -1)
    lens = Lens("PINHOLE", WIDTH, HEIGHT, PIXEL)
    target = Intrinsics(160, 120, 150.0, 150.0, 70.0, 65.0)
    red = read_image(frame(tmp_path, image, lens), target)[..., 0] > 128
    rows, columns = np.nonzero(red)
    x, y = (200.5 - lens.params[2]) / lens.params[0], (90.5 - lens.params[3]) / lens.params[1]
    assert columns.mean() + 0.5 == pytest.approx(150 * x + 70, abs=0.3)
    assert rows.mean() + 0.5 == pytest.approx(150 * y + 65, abs=0.3)


def test_an_orientation_tag_does_not_turn_the_pixels_of_a_posed_image(tmp_path: Path) -> None:
    ok, data = cv2.imencode(".jpg", smooth())
    assert ok
    tag = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"
    segment = b"\xff\xe1" + (len(tag) + 2).to_bytes(2, "big") + tag
    path = tmp_path / "turned.jpg"
    path.write_bytes(data.tobytes()[:2] + segment + data.tobytes()[2:])
    assert cv2.imread(str(path)).shape[:2] == (WIDTH, HEIGHT), "the tag is one that viewers follow"
    one = Frame("turned.jpg", path, Lens("PINHOLE", WIDTH, HEIGHT, PIXEL), np.eye(4))
    assert read_image(one, one.intrinsics).shape[:2] == (HEIGHT, WIDTH)


@pytest.mark.parametrize("extension", [".jpg", ".png"])
@pytest.mark.parametrize("kept", [0.0, 0.02, 0.5, 0.98])
def test_a_broken_image_is_refused_by_name(tmp_path: Path, extension: str, kept: float) -> None:
    data = cv2.imencode(extension, smooth())[1].tobytes()
    path = tmp_path / f"broken{extension}"
    path.write_bytes(data[: int(len(data) * kept)])
    one = Frame(path.name, path, Lens("PINHOLE", WIDTH, HEIGHT, PIXEL), np.eye(4))
    with pytest.raises(InputError, match=f"broken{extension}"):
        read_image(one, one.intrinsics)


def test_a_missing_image_a_text_and_one_of_another_size_are_refused_by_name(tmp_path: Path) -> None:
    one = frame(tmp_path, smooth(), Lens("PINHOLE", WIDTH, HEIGHT + 1, PIXEL))
    with pytest.raises(InputError, match="image.png is 320x240 pixels but its camera is 320x241"):
        read_image(one, one.intrinsics)
    one.image_path.write_text("not an image")
    with pytest.raises(InputError, match="image.png is not an image"):
        read_image(one, one.intrinsics)
    one.image_path.unlink()
    with pytest.raises(InputError, match="image.png"):
        read_image(one, one.intrinsics)


def tagged(image: np.ndarray, orientation: int) -> bytes:
    """A JPEG with an Exif orientation."""
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
    tag = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0" + bytes([orientation]) + b"\0\0\0\0\0\0\0"
    return data[:2] + b"\xff\xe1" + (len(tag) + 2).to_bytes(2, "big") + tag + data[2:]


@pytest.mark.parametrize("orientation", range(1, 9))
def test_an_image_that_fits_its_camera_only_turned_is_turned_as_opencv_does(tmp_path: Path, orientation: int) -> None:
    path = tmp_path / "phone.jpg"
    path.write_bytes(tagged(smooth(), orientation))
    assert orientation_of(path.read_bytes()) == orientation
    if orientation < 5:  # width and height stay, so the pixels are those that the pose belongs to
        with pytest.raises(InputError, match="pixels but its camera is"):
            decode(path, (HEIGHT, WIDTH))
        return
    upright = cv2.imread(str(path))[..., ::-1]
    np.testing.assert_array_equal(decode(path, (HEIGHT, WIDTH)), upright)
    np.testing.assert_array_equal(decode(path, (WIDTH, HEIGHT)), decode(path))


def test_a_turned_capture_is_read_with_a_note(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    image = np.random.default_rng(0).integers(0, 255, (sample.WIDTH, sample.HEIGHT, 3), np.uint8)
    for name in (f"{i:03d}.png" for i in range(12)):  # the content decides, not the extension
        (tmp_path / "images" / name).write_bytes(tagged(image, 6))
    report = check(path)
    assert not report.refused
    assert any(f.message.startswith("12 images fit their camera only after") for f in report.findings)
    frame = read(path).frames[0]
    assert read_image(frame, frame.intrinsics).shape == (sample.HEIGHT, sample.WIDTH, 3)


@pytest.mark.parametrize("size", [(32, 24), (31, 24), (16, 12), (128, 96), (48, 36)])
def test_a_lens_is_scaled_to_images_of_the_same_proportions(tmp_path: Path, size: tuple[int, int]) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room(), k1=0.1, cx=30.0)
    sample.write_images(tmp_path / "images", 12, *size)
    lens = read(path).frames[0].lens
    across, down = size[0] / sample.WIDTH, size[1] / sample.HEIGHT
    assert (lens.width, lens.height) == size and lens.distortion[0] == 0.1
    np.testing.assert_allclose(lens.params[:4], (40 * across, 40 * down, 30 * across, 24 * down))
    (note,) = [f.message for f in check(path).findings if "the camera is" in f.message]
    assert note == f"12 images are {size[0]}x{size[1]} pixels and the camera is 64x48"


def test_many_sizes_of_one_camera_are_one_note(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    for i, size in enumerate(((32, 24), (16, 12), (48, 36), (128, 96))):
        cv2.imwrite(str(tmp_path / "images" / f"{i:03d}.png"), np.full((*size[::-1], 3), 90, np.uint8))
    (note,) = [f for f in check(path).findings if "the camera is" in f.message]
    assert note.message == "4 images have 4 sizes and the camera is 64x48" and note.consequence.endswith("by 0.25 to 2")


def test_undistorted_images_do_not_replace_the_original_ones(tmp_path: Path) -> None:
    sample.write_colmap(tmp_path, sample.walk(), sample.room(), binary=False)
    undistorted = tmp_path / "dense" / "0"
    sample.write_colmap(undistorted, sample.walk(), sample.room(), binary=False)
    assert not check(tmp_path).refused
    shutil.rmtree(tmp_path / "images")  # published without the original images
    assert not check(tmp_path).refused  # the same images
    sample.write_images(undistorted / "images", 12, 32, 24)
    for source in (tmp_path, tmp_path / "sparse" / "0"):
        (found,) = [f for f in check(source).findings if "another COLMAP model" in f.message]
        assert found.message.startswith("12 images have") and f"import {undistorted} instead" in found.consequence
        with pytest.raises(InputError, match="another COLMAP model"):
            read(source)
    assert not check(undistorted).refused  # scaled, with a note


def test_a_lens_without_a_size_is_scaled_by_its_principal_point(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    tree = json.loads(path.read_text())
    del tree["w"], tree["h"]
    path.write_text(json.dumps(tree))
    sample.write_images(tmp_path / "images", 12, 16, 12)
    np.testing.assert_allclose(read(path).frames[0].lens.params[:4], (10, 10, 8, 6))


@pytest.mark.parametrize("size", [(48, 64), (40, 24), (62, 48), (60, 45)])
def test_an_image_of_other_proportions_or_cropped_a_little_is_refused(tmp_path: Path, size: tuple[int, int]) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    sample.write_images(tmp_path / "images", 12, *size)
    assert any(f"{size[0]}x{size[1]} pixels but its camera is 64x48" in f.message for f in check(path).findings)
    assert check(path).refused


def test_a_resized_lens_sees_the_same_view() -> None:
    for lens in (
        Lens("OPENCV", 640, 480, (500, 490, 320, 250, 0.1, -0.05, 0.001, 0.002)),
        Lens("SIMPLE_RADIAL", 640, 480, (500, 320, 250, 0.1)),
    ):
        half = lens.resized(320, 240)
        rays = np.random.default_rng(0).uniform(-0.4, 0.4, (50, 2))
        np.testing.assert_allclose(half.distort(rays), lens.distort(rays) / 2)
