"""A video without poses: frames are chosen, points tracked, and camera poses found that are the true ones."""

from __future__ import annotations

import copy
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.footage.extraction import ExtractedFrames, extract_frames
from nvsim.footage.sources import need_footage
from nvsim.poses import from_images
from nvsim.poses.from_images import FoundPoses, find_poses
from nvsim.poses.image_pairs import neighbor_pairs
from nvsim.poses.image_set import ImageSet, UnknownCamera, times_of
from nvsim.poses.mapping import consistent_pairs, keep_images, poses_of, triangulate_with_poses
from nvsim.poses.match_database import keypoints_of, write_geometries
from nvsim.poses.pieces import split_into_pieces
from nvsim.poses.pose_graph import transform_pose
from nvsim.poses.tracks import Tracks
from tests.unit import textured_room as room

FAR = 52
"""Frames until the camera goes back."""


def walk() -> NDArray[np.float64]:
    """(2 * FAR, 4, 4) camera to world: a third of a round in a room of 6 by 4 meters, and back beside it."""
    there = room.walk(3 * FAR)[:FAR]
    back = there[::-1].copy()
    back[:, :3, 3] += np.linspace(0, 1, FAR)[:, None] * (0.1, -0.1, 0.15)
    return np.concatenate([there, back])


def write_video(path: Path, images: list[NDArray[np.uint8]]) -> Path:
    height, width = images[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 12.0, (width, height))
    assert writer.isOpened()
    for image in images:
        writer.write(image)
    writer.release()
    return path


def images_of(frames: ExtractedFrames) -> ImageSet:
    return ImageSet(
        frames.folder,
        frames.names,
        (UnknownCamera(frames.width, frames.height),),
        np.zeros(len(frames.names), np.int64),
        frames.clips,
        times_of(frames.seconds, frames.clips),
        Tracks(frames.point, frames.frame, frames.places),
    )


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[ImageSet, FoundPoses, list[str]]:
    folder = tmp_path_factory.mktemp("video")
    path = write_video(folder / "walk.avi", [room.render(pose) for pose in walk()])
    images = images_of(extract_frames(need_footage(path), folder / "frames"))
    steps: list[str] = []
    return images, find_poses(images, folder, lambda step, done, total: steps.append(step)), steps


def true_center(name: str) -> NDArray[np.float64]:
    number = int(Path(name).stem.split("_")[1])
    return np.asarray(walk()[number, :3, 3])


def fitted(found: NDArray[np.float64], true: NDArray[np.float64]) -> NDArray[np.float64]:
    """`found` (N, 3) after the similarity that takes it nearest to `true` (Umeyama 1991)."""
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    u, s, vt = np.linalg.svd(b.T @ a)
    sign = np.array([1, 1, np.linalg.det(u @ vt)])
    return np.asarray((s * sign).sum() / (a**2).sum() * a @ (u @ np.diag(sign) @ vt).T + true.mean(axis=0))


def test_nearly_all_frames_are_placed_where_the_camera_was(found: tuple[ImageSet, FoundPoses, list[str]]) -> None:
    images, poses, _ = found
    model = poses.model
    numbers = sorted(model.reg_image_ids())
    assert len(numbers) >= 0.9 * len(images.names) > 25
    assert len(numbers) + len(poses.left_out) == len(images.names)
    true = np.array([true_center(model.images[n].name) for n in numbers])
    centers = np.array([model.images[n].projection_center() for n in numbers])
    path = np.linalg.norm(np.diff(true, axis=0), axis=1).sum()
    off = np.linalg.norm(fitted(centers, true) - true, axis=1)
    assert off.max() < 0.03 * path


def test_the_focal_length_is_found(found: tuple[ImageSet, FoundPoses, list[str]]) -> None:
    assert found[1].focal[0] == pytest.approx(room.FOCAL, rel=0.05)
    assert found[1].residual < 1.5
    model = found[1].model
    model.update_point_3d_errors()
    assert all(point.error < 4.0 for point in model.points3D.values())


def test_points_have_the_colors_of_their_pixels(found: tuple[ImageSet, FoundPoses, list[str]]) -> None:
    images, poses, _ = found
    model = poses.model
    image = model.images[min(model.reg_image_ids())]
    pixels = np.asarray(cv2.imread(str(images.folder / image.name)))[..., ::-1]
    seen = [p for p in image.points2D if p.has_point3D()]
    off = [
        np.abs(model.points3D[p.point3D_id].color.astype(float) - pixels[int(p.xy[1]), int(p.xy[0])]).mean()
        for p in seen
    ]
    assert len(seen) > 50 and np.median(off) < 25
    colors = np.array([model.points3D[p.point3D_id].color for p in seen])
    assert colors.std(axis=0).max() > 25


def test_the_way_back_closes_loops(found: tuple[ImageSet, FoundPoses, list[str]]) -> None:
    _, poses, steps = found
    assert poses.loops > 0
    assert list(dict.fromkeys(steps)) == ["features", "matches", "relative poses", "mapping", "loops"]
    names = [name for piece in poses.pieces for name in piece]
    assert len(set(names)) == len(names) <= len(found[0].names)
    assert len(poses.pieces[0]) == poses.model.num_reg_images() >= max(map(len, poses.pieces))


def test_a_bend_is_straightened_by_what_both_stretches_show(
    found: tuple[ImageSet, FoundPoses, list[str]], tmp_path: Path
) -> None:
    images, poses, _ = found
    path = images.folder.parent / "database.db"
    keypoints = keypoints_of(images, from_images.features_of_all(images, lambda step, done, total: None))
    matches = from_images._matches(keypoints, neighbor_pairs(images.clips), True, lambda step, done, total: None)
    cameras = {number - 1: camera for number, camera in poses.model.cameras.items()}
    views = consistent_pairs(from_images._relative_poses(images, cameras, keypoints, matches, lambda *_: None))
    write_geometries(path, views)
    inputs = from_images._MappingInputs(images, keypoints, [], views, path, tmp_path, lambda step, done, total: None)
    straight = poses_of(poses.model)
    last = sorted(straight)[len(straight) // 2]
    pivot = np.asarray(poses.model.images[last].projection_center())
    move = np.array([0.15, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0])  # 15 percent larger, and turned by 6 degrees
    bent = {n: transform_pose(one, move, pivot) if n > last else one for n, one in straight.items()}
    model = triangulate_with_poses(bent, dict(poses.model.cameras.items()), path, tmp_path / "bent")
    assert last in from_images._bends(model, inputs)
    mended, joined, pieces = from_images._joined_again(model, views, inputs)
    assert len(pieces[0]) >= 0.9 * len(straight)
    true = np.array([true_center(mended.images[n].name) for n in pieces[0]])
    far = np.linalg.norm(np.diff(true, axis=0), axis=1).sum()

    def off(one: dict[int, pycolmap.Rigid3d]) -> float:
        centers = np.array([one[n].inverse().translation for n in pieces[0]])
        return float(np.linalg.norm(fitted(centers, true) - true, axis=1).max())

    assert off(poses_of(mended)) < 0.03 * far < off(bent)
    assert len(joined) > len(views)
    closed, again, loops = from_images._close_loops(mended, joined, inputs, False)
    assert loops and off(poses_of(closed)) < 0.03 * far
    same, _, known = from_images._close_loops(closed, again, inputs, False, loops)
    assert set(loops) <= set(known) and off(poses_of(same)) < 0.03 * far


def test_images_with_nothing_in_common_are_refused_in_a_sentence(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    names = tuple(f"{k}.png" for k in range(6))
    for name in names:
        noise = cv2.resize(
            rng.integers(0, 255, (30, 40, 3)).astype(np.uint8), (320, 240), interpolation=cv2.INTER_CUBIC
        )
        assert cv2.imwrite(str(tmp_path / name), noise)
    camera = np.zeros(6, np.int64)
    images = ImageSet(tmp_path, names, (UnknownCamera(320, 240),), camera, camera, np.arange(6.0))
    (tmp_path / "work").mkdir()
    with pytest.raises(InputError, match="too little in common") as raised:
        find_poses(images, tmp_path / "work")
    assert "\n" not in str(raised.value)


def test_the_largest_piece_is_first_also_if_another_model_has_it(
    found: tuple[ImageSet, FoundPoses, list[str]],
) -> None:
    images, poses, _ = found
    numbers = sorted(poses.model.reg_image_ids())
    small, large = copy.deepcopy(poses.model), copy.deepcopy(poses.model)
    keep_images(small, numbers[:12])
    keep_images(large, numbers[10:])
    separate = split_into_pieces(small, [numbers[:9], numbers[9:12]], [small, large], images.times)
    counts = [piece.num_reg_images() for piece in separate]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > 9 and 9 in counts
