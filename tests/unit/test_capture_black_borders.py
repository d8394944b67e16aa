"""Black borders of images are left out, with the masks and depth images of their frames."""

from __future__ import annotations

import json
from collections.abc import Callable
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
from nvsim.geometry.lens import Lens

WIDTH, HEIGHT, COUNT = 160, 120, 12
FOCAL, MIDDLE = 110.0, (81.0, 58.5)


def picture(seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(30, 255, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 2)


def black_corners() -> np.ndarray:
    """(H, W) bool: the pixels that undistortion of a strongly bent image leaves black."""
    column, row = np.meshgrid(np.arange(WIDTH) - 79.5, np.arange(HEIGHT) - 59.5)
    outside = 1 + 2.2e-5 * (column**2 + row**2)
    return (np.abs(column) * outside > 84) | (np.abs(row) * outside > 65)


def black_bars(left: int, top: int, right: int, bottom: int) -> np.ndarray:
    black = np.ones((HEIGHT, WIDTH), bool)
    black[top : HEIGHT - bottom, left : WIDTH - right] = False
    return black


def write(folder: Path, black: np.ndarray | list[np.ndarray], suffix: str = ".jpg", **more: object) -> Path:
    """A capture whose images are black where `black` is True, with masks and depth images."""
    for kind in ("images", "masks", "depth"):
        (folder / kind).mkdir(parents=True)
    frames, flip = [], np.diag([1.0, -1.0, -1.0, 1.0])
    for i, pose in enumerate(sample.walk(COUNT)):
        image = picture(i)
        image[black if isinstance(black, np.ndarray) else black[i]] = 0
        mask = np.full((HEIGHT, WIDTH), 255, np.uint8)
        mask[60:70, 30:50] = 0
        depth = 1000 + np.arange(WIDTH * HEIGHT, dtype=np.uint16).reshape(HEIGHT, WIDTH) // 8
        for kind, pixels, ending in (("images", image, suffix), ("masks", mask, ".png"), ("depth", depth, ".png")):
            cv2.imwrite(str(folder / kind / f"{i}{ending}"), pixels)
        frames.append({
            "file_path": f"images/{i}{suffix}", "mask_path": f"masks/{i}.png", "depth_file_path": f"depth/{i}.png",
            "transform_matrix": (pose @ flip).tolist(),
        })  # fmt: skip
    (folder / "cloud.ply").write_bytes(sample.ply(sample.room()))
    lens = {"w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "fl_y": FOCAL, "cx": MIDDLE[0], "cy": MIDDLE[1]}
    tree = {"camera_model": "OPENCV", "unit": "meter", "ply_file_path": "cloud.ply", **lens, **more, "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(tree))
    return folder


def with_focal_lengths(folder: Path, focal: Callable[[int], float]) -> Path:
    """Gives image i the focal length focal(i)."""
    listed = folder / "transforms.json"
    tree = json.loads(listed.read_text())
    for i, frame in enumerate(tree["frames"]):
        frame["fl_x"] = frame["fl_y"] = focal(i)
    listed.write_text(json.dumps(tree))
    return folder


def borders(folder: Path) -> set[tuple[int, int, int, int]]:
    return {f.lens.border for f in read(folder).frames}


@pytest.mark.parametrize("turns", range(4))
def test_a_lens_with_a_border_shows_the_rest_of_the_image(tmp_path: Path, turns: int) -> None:
    image = picture(0)
    cv2.imwrite(str(tmp_path / "a.png"), image)
    lens = Lens("PINHOLE", WIDTH, HEIGHT, (FOCAL, FOCAL + 1, *MIDDLE), turns, (3, 5, 8, 13))
    frame = Frame("a", tmp_path / "a.png", lens, np.eye(4))
    cut = np.rot90(image[5 : HEIGHT - 13, 3 : WIDTH - 8], turns)
    np.testing.assert_array_equal(read_image(frame, frame.intrinsics)[..., ::-1], cut)
    rest = Lens("PINHOLE", WIDTH - 11, HEIGHT - 18, (FOCAL, FOCAL + 1, MIDDLE[0] - 3, MIDDLE[1] - 5), turns)
    assert frame.intrinsics == pytest.approx(rest.pinhole)
    half = frame.intrinsics.scaled(60, 60)
    half = replace(half, cx=half.cx + 0.3)  # not the view of the whole image, so it is sampled
    cv2.imwrite(str(tmp_path / "rest.png"), np.rot90(cut, -turns))
    of_rest = read_image(Frame("b", tmp_path / "rest.png", rest, np.eye(4)), half)
    assert np.abs(read_image(frame, half).astype(int) - of_rest)[2:-2, 2:-2].max() <= 1


@pytest.mark.parametrize("k1", [-0.2, 0.25])
def test_no_pixel_of_the_border_is_seen_after_undistortion(tmp_path: Path, k1: float) -> None:
    border = (6, 4, 9, 2)
    image = np.full((HEIGHT, WIDTH, 3), 200, np.uint8)
    image[black_bars(*border)] = 0
    cv2.imwrite(str(tmp_path / "a.png"), image)
    lens = Lens("OPENCV", WIDTH, HEIGHT, (FOCAL, FOCAL, *MIDDLE, k1, 0.02, 0.001, -0.002), 0, border)
    frame = Frame("a", tmp_path / "a.png", lens, np.eye(4))
    assert (frame.intrinsics.width, frame.intrinsics.height) == (WIDTH - 15, HEIGHT - 6)
    assert read_image(frame, frame.intrinsics)[1:-1, 1:-1].min() > 90  # at the very edge, half a pixel may be black


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_the_largest_rectangle_without_black_pixels_remains(tmp_path: Path, suffix: str) -> None:
    black = black_corners()
    ((left, top, right, bottom),) = borders(write(tmp_path, black, suffix))
    assert not black[top : HEIGHT - bottom, left : WIDTH - right].any()
    for grown in np.eye(4, dtype=int):
        l, t, r, b = np.array([left, top, right, bottom]) - 2 - grown  # 2 pixels are the margin
        assert black[t : HEIGHT - b, l : WIDTH - r].any()
    assert 0.75 < (HEIGHT - top - bottom) * (WIDTH - left - right) / (WIDTH * HEIGHT) < 0.95


def test_bars_of_a_converted_video_are_cut_off(tmp_path: Path) -> None:
    assert borders(write(tmp_path, black_bars(0, 12, 0, 12))) == {(0, 14, 0, 14)}


def test_each_camera_has_its_own_border(tmp_path: Path) -> None:
    """The cameras differ in their lens only. Where every image has its own lens, those of one size are compared."""
    bars, whole = black_bars(0, 12, 0, 12), np.zeros((HEIGHT, WIDTH), bool)
    black = [bars if i % 2 else whole for i in range(COUNT)]
    found = read(with_focal_lengths(write(tmp_path / "two", black), lambda i: FOCAL + i % 2)).frames
    assert [f.lens.border[1] for f in found] == [14 * (f.lens.focal[0] > FOCAL) for f in found]
    assert borders(with_focal_lengths(write(tmp_path / "each", bars), lambda i: FOCAL + i / 10)) == {(0, 14, 0, 14)}


def test_the_note_states_the_border_and_masks_and_depth_fit_the_rest(tmp_path: Path) -> None:
    folder = write(tmp_path / "a", black_bars(10, 0, 0, 6), ".png")
    report = check(folder)
    (note,) = (f for f in report.findings if "black border" in f.message)
    assert note.severity == "note" and note.message.startswith("12 of 12 images") and not report.refused
    assert "left 12" in note.consequence and "bottom 8" in note.consequence
    capture = read(folder)
    plain = read(write(tmp_path / "b", np.zeros((HEIGHT, WIDTH), bool), ".png"))
    assert {f.lens.border for f in plain.frames} == {(0, 0, 0, 0)}
    rows, columns = slice(0, HEIGHT - 8), slice(12, WIDTH)
    for frame, whole, depth, own in zip(capture.frames, plain.frames, capture.depths, plain.depths, strict=True):
        k, all_of_it = frame.intrinsics, whole.intrinsics
        np.testing.assert_array_equal(read_image(frame, k), read_image(whole, all_of_it)[rows, columns])
        usable, of_all = usable_pixels(frame, k), usable_pixels(whole, all_of_it)
        assert usable is not None and of_all is not None
        np.testing.assert_array_equal(usable, of_all[rows, columns])
        found, expected = inverse_depth(depth, frame.camera), inverse_depth(own, whole.camera)
        np.testing.assert_allclose(found, expected[rows, columns], rtol=1e-5)


def test_a_stored_capture_keeps_the_border(tmp_path: Path) -> None:
    capture = read(write(tmp_path / "a", black_bars(10, 0, 0, 6)))
    store.save_capture(capture, tmp_path)
    loaded = store.load_capture(tmp_path)
    assert [f.lens for f in loaded.frames] == [f.lens for f in capture.frames]
    assert store.fingerprint(loaded) == store.fingerprint(capture)
    uncut = [replace(f, lens=replace(f.lens, border=(0, 0, 0, 0))) for f in capture.frames]
    assert store.fingerprint(replace(capture, frames=tuple(uncut))) != store.fingerprint(capture)
    tree = json.loads((tmp_path / "capture.json").read_text())
    tree["lenses"][0]["border"] = [100, 0, 60, 0]
    (tmp_path / "capture.json").write_text(json.dumps(tree))
    with pytest.raises(Exception, match="damaged"):
        store.load_capture(tmp_path)


def test_dark_surfaces_are_no_border(tmp_path: Path) -> None:
    """A black object at the edge of half of the images, and a black object inside all of them."""
    black = [black_bars(20, 0, 0, 0) if i % 2 else np.zeros((HEIGHT, WIDTH), bool) for i in range(COUNT)]
    for image in black:
        image[50:70, 60:80] = True
    assert borders(write(tmp_path / "black", black)) == {(0, 0, 0, 0)}
    dark = write(tmp_path / "dark", np.zeros((HEIGHT, WIDTH), bool))
    for i, path in enumerate(sorted((dark / "images").iterdir())):
        image = cv2.imread(str(path))
        image[:, :20] = np.random.default_rng(i).integers(2, 11, (HEIGHT, 20, 1))
        cv2.imwrite(str(path), image)
    assert borders(dark) == {(0, 0, 0, 0)}


def test_a_border_of_half_the_image_is_reported_and_kept(tmp_path: Path) -> None:
    folder = write(tmp_path, black_bars(0, 30, 0, 30))
    assert borders(folder) == {(0, 0, 0, 0)}
    (warning,) = (f for f in check(folder).findings if "black border" in f.message)
    assert warning.severity == "warning" and "50%" in warning.message


def test_images_that_are_black_everywhere_have_no_border(tmp_path: Path) -> None:
    folder = write(tmp_path, np.ones((HEIGHT, WIDTH), bool))
    assert borders(folder) == {(0, 0, 0, 0)}
    found = [f.message for f in check(folder).findings]
    assert any("are blank" in message for message in found) and not any("border" in message for message in found)
