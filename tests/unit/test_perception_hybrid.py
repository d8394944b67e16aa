"""The fusion of the three roles, with toy providers whose answers are known."""

from __future__ import annotations

import cv2
import numpy as np

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.perception.hybrid import HybridConfig, HybridFloor, large_regions, normal_picture, spread_points

CAMERA = Camera(Intrinsics.from_fov(120, 80, 1.4), camera_pose(np.zeros(3), 0.0))
IMAGE = np.zeros((80, 120, 3), np.uint8)
FLOOR = np.zeros((80, 120), bool)
FLOOR[50:] = True
DESK = np.zeros((80, 120), bool)
DESK[20:30, 70:110] = True


class Looks:
    """A semantic role that misses the left part of the floor, and takes a poster and a speck for floor."""

    def floor_probability(self, image, camera):
        looks = FLOOR.astype(np.float32) * 0.9
        looks[:, :40] = 0.2
        looks[5:15, 5:35] = 0.95
        looks[22:24, 80:82] = 0.95
        return looks


class Normals:
    def normals(self, image, camera):
        normals = np.zeros((80, 120, 3), np.float32)
        normals[..., 1] = -1
        normals[FLOOR | DESK] = (0, 0, 1)
        return normals


class Flood:
    """The prompted role: the flat-colored regions of the picture that hold the points."""

    def __init__(self):
        self.prompts = []

    def mask(self, picture, points, camera):
        self.prompts.append(points)
        found = np.zeros(picture.shape[:2], bool)
        for x, y in points:
            marks = np.zeros((82, 122), np.uint8)
            cv2.floodFill(picture.copy(), marks, (int(x), int(y)), (0, 0, 0))
            found |= marks[1:-1, 1:-1] > 0
        return found


def test_the_prompted_mask_recovers_floor_that_the_semantic_role_missed():
    flood = Flood()
    found = HybridFloor(Looks(), Normals(), flood, HybridConfig(area=0.01)).segment(CAMERA, IMAGE)
    assert np.array_equal(found.mask, FLOOR)
    assert not found.candidates[:, :40].any() and not found.candidates[DESK].any()
    (points,) = flood.prompts
    assert points.shape == (3, 2) and FLOOR[points[:, 1].astype(int), points[:, 0].astype(int)].all()


def test_without_candidates_the_mask_is_empty_and_nothing_is_prompted():
    class Nothing:
        def floor_probability(self, image, camera):
            return np.zeros((80, 120), np.float32)

    flood = Flood()
    assert not HybridFloor(Nothing(), Normals(), flood).segment(CAMERA, IMAGE).mask.any()
    assert flood.prompts == []


def test_small_regions_are_dropped_and_large_ones_kept_whole():
    mask = FLOOR.copy()
    mask[5:8, 5:8] = True
    assert np.array_equal(large_regions(mask, 0.01), FLOOR)
    assert large_regions(np.zeros((5, 5), bool), 0.01).sum() == 0


def test_prompt_points_lie_inside_apart_from_each_other_and_repeat():
    points = spread_points(FLOOR, 3)
    assert np.array_equal(points, spread_points(FLOOR, 3))
    gaps = np.linalg.norm(points[:, None] - points[None], axis=2)[np.triu_indices(3, 1)]
    assert gaps.min() > 20
    assert ((points[:, 1] > 54) & (points[:, 1] < 76)).all()
    assert len(spread_points(np.eye(1, dtype=bool), 3)) == 1


def test_normal_picture_colors_a_floor_as_the_prompted_model_expects():
    picture = normal_picture(np.array([[[0, 0, 1.0], [-1, 0, 0]]], np.float32))
    assert picture.tolist() == [[[127, 127, 255], [0, 127, 127]]]


class Given:
    """A prompted role that answers what it is told to."""

    def __init__(self, mask):
        self.answer = mask

    def mask(self, picture, points, camera):
        return self.answer


def test_a_prompted_mask_that_leaves_what_is_plausible_is_given_up_for_the_candidates():
    everything = np.ones((80, 120), bool)
    hybrid = HybridFloor(Looks(), Normals(), Given(everything), HybridConfig(area=0.01))
    found = hybrid.segment(CAMERA, IMAGE)
    assert found.failure == "beyond" and np.array_equal(found.mask, found.candidates)
    # Floor that only one of both roles knows is what prompts are there to find.
    assert (
        HybridFloor(Looks(), Normals(), Given(FLOOR | DESK), HybridConfig(area=0.01)).segment(CAMERA, IMAGE).failure
        == ""
    )


def test_a_prompted_mask_that_misses_the_candidates_gets_them():
    some = np.zeros((80, 120), bool)
    some[50:, 100:] = True
    found = HybridFloor(Looks(), Normals(), Given(some), HybridConfig(area=0.01)).segment(CAMERA, IMAGE)
    assert found.failure == "short" and np.array_equal(found.mask, found.candidates | some)


def test_what_is_missing_in_a_frame_without_candidates_is_said():
    class Nothing:
        def floor_probability(self, image, camera):
            return np.zeros((80, 120), np.float32)

    class Poster:
        def floor_probability(self, image, camera):
            looks = np.zeros((80, 120), np.float32)
            looks[5:15, 5:35] = 1
            return looks

    class Upright:
        def normals(self, image, camera):
            return np.tile(np.float32([0, -1, 0]), (80, 120, 1))

    def failure(looks, normals):
        return HybridFloor(looks, normals, Flood()).segment(CAMERA, IMAGE).failure

    assert failure(Nothing(), Normals()) == "no-looks"
    assert failure(Poster(), Upright()) == "no-flat"
    assert failure(Poster(), Normals()) == "no-candidates"
