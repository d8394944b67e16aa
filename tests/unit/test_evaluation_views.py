"""Figures of pictures against closed forms and a slow reference; tables; novel views."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from nvsim.building.config import BuildingConfig
from nvsim.building.generation import BESIDE, TURNED, camera_list_text, novel_cameras
from nvsim.building.scene import make_scene
from nvsim.building.truth import occupancy
from nvsim.capture.types import Alignment, Frame
from nvsim.errors import InputError
from nvsim.evaluation.scores import mean_scores, rounded_metrics, score, ssim_map
from nvsim.evaluation.table import Column, csv_table, text_table
from nvsim.evaluation.truth import read_true_mask
from nvsim.evaluation.views import novel_score, read_novel_views
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.lens import Lens

HEIGHT, WIDTH = 48, 64


class Picture:
    """A random frame whose render is off by 0.1 on the floor, 0.2 on a person and 0.02 elsewhere."""

    def __init__(self) -> None:
        rng = np.random.default_rng(1)
        self.image = (0.3 + 0.4 * rng.random((HEIGHT, WIDTH, 3))).astype(np.float32)
        self.floor = np.zeros((HEIGHT, WIDTH), bool)
        self.floor[30:] = True
        self.valid = np.ones((HEIGHT, WIDTH), bool)
        self.valid[:10, :10] = False
        off = np.where(self.floor, 0.1, np.where(self.valid, 0.02, 0.2))
        self.rendered = (self.image + off[..., None]).astype(np.float32)
        self.alpha = np.where(self.floor, 0.03, 0.97).astype(np.float32)

    def score(self, distance=None):
        return score(self.image, self.rendered, self.alpha, self.floor, self.valid, distance)


@pytest.mark.parametrize("turns", range(4))
def test_true_masks_of_stored_images_fit_the_upright_view_without_border(tmp_path: Path, turns: int) -> None:
    mask = np.random.default_rng(2).random((HEIGHT, WIDTH)) > 0.5
    cv2.imwrite(str(tmp_path / "mask.png"), mask.astype(np.uint8) * 255)
    lens = Lens("PINHOLE", WIDTH, HEIGHT, (50.0, 50.0, 32.0, 24.0), turns, (4, 2, 6, 8))
    frame = Frame("a", tmp_path / "a.png", lens, np.eye(4))
    k = frame.intrinsics
    found = read_true_mask(tmp_path / "mask.png", frame, k.width, k.height)
    np.testing.assert_array_equal(found, np.rot90(mask[2:-8, 4:-6], turns))
    assert read_true_mask(tmp_path / "mask.png", frame, 20, 30).shape == (30, 20)


def test_psnr_of_a_region_is_that_of_its_own_error() -> None:
    p = Picture()
    got = p.score()
    assert got["psnr_floor"] == pytest.approx(20.0, abs=1e-3)
    assert got["psnr_nonfloor"] == pytest.approx(-20 * np.log10(0.02), abs=1e-3)
    n_floor, n_all = p.floor.sum(), p.valid.sum()
    mean = (n_floor * 0.01 + (n_all - n_floor) * 0.0004) / n_all
    assert got["psnr"] == pytest.approx(-10 * np.log10(mean), abs=1e-3)
    assert (got["alpha_floor"], got["alpha_nonfloor"]) == (pytest.approx(0.03), pytest.approx(0.97))
    # Uniform noise of width 0.4 about its mean.
    assert got["psnr_floor_constant"] == pytest.approx(-10 * np.log10(0.4**2 / 12), abs=0.1)


def test_a_frame_without_floor_has_no_floor_figures_and_does_not_count_in_their_mean() -> None:
    p = Picture()
    p.floor[:] = False
    got = p.score()
    assert all(np.isnan(got[k]) for k in ("psnr_floor", "ssim_floor", "alpha_floor", "psnr_floor_constant"))
    means = mean_scores([got, {"psnr_floor": 20.0, "psnr": 10.0}])
    assert means["psnr_floor"] == 20.0 and means["lpips"] is None
    assert means["psnr"] == pytest.approx((got["psnr"] + 10.0) / 2, abs=1e-4)
    assert rounded_metrics({"frame": 3, "psnr": 30.12347, "psnr_floor": float("nan")}) == {
        "frame": 3, "psnr": 30.1235, "psnr_floor": None,
    }  # fmt: skip


def test_corrected_psnr_forgives_exposure_and_white_balance_but_no_detail() -> None:
    p = Picture()
    p.valid[:] = True
    blur = cv2.GaussianBlur(p.image, (0, 0), 2.0)
    warm = (blur @ np.diag([0.9, 0.8, 0.6]) + 0.05).astype(np.float32)
    plain_score, warm_score = (score(p.image, r, p.alpha, p.floor, p.valid) for r in (blur, warm))
    assert warm_score["psnr"] < plain_score["psnr"] - 1
    assert warm_score["psnr_corrected"] == pytest.approx(plain_score["psnr_corrected"], abs=0.01)
    assert plain_score["psnr"] - 0.01 <= plain_score["psnr_corrected"] < 40


def slow_ssim(a: NDArray[np.float64], b: NDArray[np.float64], y: int, x: int) -> float:
    """One channel at one pixel, written out from Wang et al. 2004."""
    taps = np.exp(-((np.arange(11) - 5.0) ** 2) / (2 * 1.5**2))
    window = np.outer(taps, taps) / taps.sum() ** 2
    pa, pb = (i[y - 5 : y + 6, x - 5 : x + 6] for i in (a, b))
    ma, mb = (window * pa).sum(), (window * pb).sum()
    va, vb = (window * (pa - ma) ** 2).sum(), (window * (pb - mb) ** 2).sum()
    vab = (window * (pa - ma) * (pb - mb)).sum()
    c1, c2 = 0.01**2, 0.03**2
    return (2 * ma * mb + c1) * (2 * vab + c2) / ((ma**2 + mb**2 + c1) * (va + vb + c2))


def test_ssim_matches_a_slow_reference_and_is_averaged_over_the_region() -> None:
    rng = np.random.default_rng(2)
    a, b = rng.random((2, HEIGHT, WIDTH, 3)).astype(np.float32)
    found = ssim_map(a, b)
    for y, x in ((5, 5), (20, 31), (40, 58)):
        expected = np.mean([slow_ssim(a[..., c].astype(float), b[..., c].astype(float), y, x) for c in range(3)])
        assert found[y, x] == pytest.approx(expected, abs=2e-5)
    p = Picture()
    got, similar = p.score(), ssim_map(p.image, np.clip(p.rendered, 0, 1))
    assert got["ssim_nonfloor"] == pytest.approx(similar[p.valid & ~p.floor].mean())
    assert got["ssim_floor"] == pytest.approx(similar[p.floor].mean())
    assert got["ssim"] == pytest.approx(similar[p.valid].mean())
    same = score(p.image, p.image, p.alpha, p.floor, p.valid)
    assert same["ssim"] == pytest.approx(1.0, abs=1e-6) and same["psnr"] == pytest.approx(100.0)


def test_lpips_of_a_region_sees_the_frame_itself_elsewhere() -> None:
    p, seen = Picture(), []

    def distance(a: NDArray[np.float32], b: NDArray[np.float32]) -> float:
        seen.append(np.abs(a - b).max(axis=2) > 1e-6)
        return float(len(seen))

    got = p.score(distance)
    assert (got["lpips"], got["lpips_nonfloor"], got["lpips_floor"]) == (1.0, 2.0, 3.0)
    for found, region in zip(seen, (p.valid, p.valid & ~p.floor, p.valid & p.floor), strict=True):
        np.testing.assert_array_equal(found, region)


COLUMNS = [Column("row", "row"), Column("a", "PSNR", "all", 1, "high"), Column("b", "seconds", "", 0)]


def test_the_table_is_aligned_marks_the_best_and_says_what_is_missing() -> None:
    rows = [{"row": "first", "a": 20.04, "b": 3.0}, {"row": "second one", "a": 31.26, "a_spread": 0.11}]
    lines = text_table(COLUMNS, rows, mark_best=True).splitlines()
    assert lines[1].split() == ["row", "|", "PSNR", "|", "seconds"]
    assert lines[-1].split() == ["second", "one", "|", "31.3", "±0.1*", "|", "-"]
    assert lines[-2].split() == ["first", "|", "20.0", "|", "3"]
    assert len({line.index("|") for line in lines if "|" in line}) == 1
    assert lines[0].strip(" |") == "all"


def test_csv_leaves_out_what_is_missing() -> None:
    text = csv_table(["row", "a"], [{"row": "x, y", "a": 1.5}, {"row": "z", "a": None}])
    assert list(csv.reader(io.StringIO(text))) == [["row", "a"], ["x, y", "1.5"], ["z", ""]]


K = Intrinsics(WIDTH, HEIGHT, 40.0, 40.0, WIDTH / 2, HEIGHT / 2)


def truth(folder: Path, cameras: list[Camera]) -> Path:
    (folder / "novel").mkdir(parents=True)
    (folder / "novel_floor").mkdir()
    (folder / "holdout_frames.txt").write_text(camera_list_text(K, cameras))
    for i in range(len(cameras)):
        cv2.imwrite(str(folder / f"novel/{i:03d}.png"), np.full((HEIGHT, WIDTH, 3), 128, np.uint8))
    floor = np.zeros((HEIGHT, WIDTH), np.uint8)
    floor[30:] = 255
    cv2.imwrite(str(folder / "novel_floor/000.png"), floor)
    return folder


def test_novel_views_are_read_into_the_aligned_frame(tmp_path: Path) -> None:
    cameras = [
        Camera(K, camera_pose(np.array([1.0, 2.0, 1.3]), 0.4)),
        Camera(K, camera_pose(np.array([3.0, 2.0, 1.3]), 2.0)),
    ]
    folder = truth(tmp_path, cameras)
    plain_views = read_novel_views(folder, Alignment.identity())
    assert [v.name for v in plain_views] == ["000", "001"]
    assert [v.floor is not None for v in plain_views] == [True, False]
    for view, camera in zip(plain_views, cameras, strict=True):
        np.testing.assert_allclose(view.camera.camera_to_world, camera.camera_to_world, atol=1e-7)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    (turned, _) = read_novel_views(folder, Alignment(quarter, 2.0))
    np.testing.assert_allclose(turned.camera.position, [-4.0, 2.0, 2.6], atol=1e-7)
    np.testing.assert_allclose(turned.camera.rotation, quarter @ cameras[0].rotation, atol=1e-7)


def test_novel_figures_are_of_the_whole_of_steep_rays_and_of_the_true_floor(tmp_path: Path) -> None:
    camera = Camera(K, camera_pose(np.array([1.0, 2.0, 1.3]), 0.4))
    (view,) = read_novel_views(truth(tmp_path, [camera]), Alignment.identity())
    image = view.image()
    # A level camera looks steeper down than asin(0.35) where (v - cy) / |ray| > 0.35.
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5 - K.cx, np.arange(HEIGHT) + 0.5 - K.cy)
    down = v / np.sqrt(u**2 + v**2 + K.fx**2) > 0.35
    rendered = (image + np.where(down, 0.1, 0.01)[..., None]).astype(np.float32)
    alpha = np.where(np.arange(HEIGHT)[:, None] >= 30, 0.25, 1.0) * np.ones((1, WIDTH), np.float32)
    got = novel_score(view, image, rendered, alpha.astype(np.float32))
    assert got["novel_psnr_down"] == pytest.approx(20.0, abs=1e-3)
    mean = down.mean() * 0.01 + (1 - down.mean()) * 0.0001
    assert got["novel_psnr"] == pytest.approx(-10 * np.log10(mean), abs=1e-3)
    assert got["novel_alpha_floor"] == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("novel/000.png 1 2 3\n", "line 1"),
        ("# PINHOLE 4 3 fx 1 fy 1 cx 2 cy 1\nnovel/000.png " + "x " * 16, "line 2"),
        ("novel/000.png " + "1 " * 16, "PINHOLE"),
    ],
)
def test_a_listing_that_is_wrong_is_refused_in_a_sentence(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "holdout_frames.txt").write_text(text)
    with pytest.raises(InputError, match=words):
        read_novel_views(tmp_path, Alignment.identity())
    with pytest.raises(InputError, match="missing"):
        read_novel_views(tmp_path / "nowhere", Alignment.identity())


def test_the_building_s_novel_views_lie_beside_its_walk_and_look_away_from_it() -> None:
    scene = make_scene(BuildingConfig(seed=3, size="small", width=48, height=36))
    grid = occupancy(scene)
    cameras = novel_cameras(scene, grid, np.random.default_rng(0))
    assert len(cameras) == 12
    for camera in cameras:
        away = np.linalg.norm(scene.walk[:, :2] - camera.position[:2], axis=1)
        assert BESIDE[0] <= away.min() <= BESIDE[1]
        assert grid.states_at(camera.position[:2]) == 0
        # Where the walk turns in place several frames are equally near.
        headings = scene.walk[away < away.min() + 1e-6, 2]
        cosines = np.column_stack([np.sin(headings), np.cos(headings)]) @ camera.rotation[:2, 2]
        angles = np.degrees(np.arccos(cosines))
        assert ((angles > TURNED[0] - 0.01) & (angles < TURNED[1] + 0.01)).any()
