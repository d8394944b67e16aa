"""The fused cloud: averages in cells, equal in one part and in many, and with bounded memory."""

from __future__ import annotations

import gc
import shutil
import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest

from nvsim.capture.types import Alignment, Capture, DepthFile, Frame
from nvsim.depth import estimate, fusion
from nvsim.depth.config import DepthConfig
from nvsim.depth.estimate import estimate_depth
from nvsim.depth.fusion import FusedCloud, Map, fuse, joined, normals_of
from nvsim.depth.planes import find_planes
from nvsim.geometry.camera import Camera, Intrinsics
from nvsim.geometry.lens import Lens

LENS = Intrinsics(80, 60, 60.0, 60.0, 40.0, 30.0)
VOXEL = 0.05


def pose_at(x: float, y: float = 0.0) -> np.ndarray:
    """A camera that looks along +y, level."""
    pose = np.eye(4)
    pose[:3, :3], pose[:2, 3] = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), (x, y)
    return pose


def noisy_map(index: int) -> Map:
    """A wall 2 m before the camera with noise, and holes."""
    rng = np.random.default_rng(index)
    inverse = rng.normal(0.5, 0.01, (60, 80)).astype(np.float32)
    inverse[rng.random(inverse.shape) < 0.2] = 0
    return (
        inverse,
        rng.uniform(1e6, 9e6, (60, 80)).astype(np.float32),
        rng.integers(0, 256, (60, 80, 3), dtype=np.uint8),
    )


def row_of_cameras(count: int) -> list[Camera]:
    """Cameras in the order of a trajectory that comes back: neighbors in space are far apart in time."""
    return [Camera(LENS, pose_at(0.3 * (i if i % 2 else count - i))) for i in range(count)]


def fused(count: int) -> FusedCloud:
    return joined(fuse(row_of_cameras(count), noisy_map, VOXEL, 3, 2))


def test_points_are_averaged_in_cells_by_what_their_distance_makes_of_them() -> None:
    count = 6
    cells: dict[tuple[int, ...], list[tuple[float, np.ndarray, np.ndarray]]] = {}
    for i, camera in enumerate(row_of_cameras(count)):
        inverse, weight, image = noisy_map(i)
        rays = camera.rays().astype(np.float64)
        rays /= (rays @ camera.rotation[:, 2])[..., None]
        for v, u in np.argwhere(inverse > 0):
            point = camera.position + rays[v, u] / inverse[v, u]
            say = float(weight[v, u]) * float(inverse[v, u]) ** 4
            cells.setdefault(tuple(np.floor(point / VOXEL).astype(int)), []).append((say, point, image[v, u]))
    expected = {key: seen for key, seen in cells.items() if len(seen) >= 3}
    cloud = fused(count)
    assert abs(len(cloud.points) - len(expected)) < 0.01 * len(expected)  # rays are rounded to single precision
    matched = 0
    for point, color, views in zip(cloud.points, cloud.colors, cloud.views, strict=True):
        seen = expected.get(tuple(np.floor(point.astype(np.float64) / VOXEL).astype(int)), [])
        if len(seen) == views:
            weights = [say for say, _, _ in seen]
            matched += np.allclose(point, np.average([p for _, p, _ in seen], axis=0, weights=weights), atol=1e-4)
            assert np.abs(color - np.average([c for _, _, c in seen], axis=0, weights=weights)).max() < 1.5
    assert matched > 0.95 * len(cloud.points)


def test_a_cloud_that_is_fused_in_many_parts_is_the_same_bit_by_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, parts = fused(40), list(fuse(row_of_cameras(40), noisy_map, VOXEL, 3, 2))
    planes = find_planes(part.seen for part in parts)
    assert len(parts) == 1 and planes
    monkeypatch.setattr(fusion, "_MOST_CELLS", 700)
    monkeypatch.setattr(fusion, "_STRIP", 500)
    many = list(fuse(row_of_cameras(40), noisy_map, VOXEL, 3, 2))
    assert len(many) > 20
    again = fused(40)
    for name in ("points", "colors", "normals", "views"):
        assert np.array_equal(getattr(again, name), getattr(whole, name)), name
    for one, other in zip(find_planes(part.seen for part in many), planes, strict=True):
        assert all(np.array_equal(getattr(one, name), value) for name, value in vars(other).items())


def test_maps_are_read_again_only_for_parts_that_they_show(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fusion, "_MOST_CELLS", 4000)
    read: list[int] = []

    def counted(index: int) -> Map:
        read.append(index)
        return noisy_map(index)

    cameras = [Camera(LENS, pose_at(3.0 * (i % 16), 3.0 * (i // 16))) for i in range(256)]
    parts = list(fuse(cameras, counted, VOXEL, 3, 1))
    assert len(read) < 20 * 256 < len(parts) * 256 / 10


def test_normals_of_distant_points_use_the_whole_cloud(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.normal(0, 0.3, (3000, 3)), rng.normal(0, 40, (60, 3))]).astype(np.float32)
    whole = normals_of(points, -points)
    monkeypatch.setattr(fusion, "_STRIP", 400)
    assert np.array_equal(normals_of(points, -points), whole)


def corridor(folder: Path, frames: int) -> Capture:
    """A capture of `frames` frames along a wall. All frames have one image and one depth image of the wall."""
    cv2.imwrite(str(folder / "image.png"), np.full((60, 80, 3), 128, np.uint8))
    cv2.imwrite(str(folder / "depth.png"), np.full((60, 80), 2000, np.uint16))
    lens = Lens("PINHOLE", 80, 60, (60.0, 60.0, 40.0, 30.0))
    taken = tuple(Frame(f"{i}", folder / "image.png", lens, pose_at(0.4 * i)) for i in range(frames))
    depths = tuple(DepthFile(folder / "depth.png", lens, f.camera_to_world, f.name, unit=0.001) for f in taken)
    return Capture(folder, "nerfstudio", taken, None, Alignment.identity(), depths=depths)


def test_memory_grows_with_the_cloud_and_not_with_the_images(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fusion, "_MOST_CELLS", 8000)
    monkeypatch.setattr(fusion, "_STRIP", 4000)
    monkeypatch.setattr(estimate, "_KEPT_MAPS", 8)
    monkeypatch.setattr(estimate, "_KEPT_VIEWS", 8)
    monkeypatch.setattr(DepthConfig, "checking_maps", 2)
    config = DepthConfig(longest_side=80, voxel=0.03, threads=1)

    def peak_and_size(frames: int) -> tuple[int, int]:
        """Bytes at the peak, and of the cloud."""
        capture = corridor(tmp_path, frames)
        gc.collect()
        tracemalloc.start()
        try:
            cloud = estimate_depth(capture, tmp_path / f"{frames}", config)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        shutil.rmtree(tmp_path / f"{frames}")
        return peak, sum(getattr(cloud, name).nbytes for name in ("points", "colors", "normals", "views"))

    peak_and_size(4)  # compiles the kernels
    small, small_size = peak_and_size(8)
    for _ in range(3):  # threads that read ahead, and what earlier tests left, add to some of the peaks
        large, large_size = peak_and_size(80)
        assert large_size > 8 * small_size
        if large - small < 3 * (large_size - small_size) + 72 * 5_000:
            break
    else:
        pytest.fail(f"{large} bytes at the peak, {small} for a tenth of the images")
