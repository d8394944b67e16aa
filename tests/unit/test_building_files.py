"""A small built-in building on disk: its capture, its truth, and that they agree."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from nvsim.building import BuildingConfig, generate
from nvsim.building.baking import LEVELS
from nvsim.building.scene import make_scene, textures_of
from nvsim.errors import InputError
from nvsim.events import Event, Progress
from nvsim.occupancy.ros import read_ros_map
from nvsim.occupancy.types import FREE, OCCUPIED

CONFIG = BuildingConfig(seed=3, size="small", width=160, height=120)


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("building")
    generate(folder, CONFIG)
    return folder


def transforms(folder: Path) -> dict[str, object]:
    data: dict[str, object] = json.loads((folder / "capture" / "transforms.json").read_text())
    return data


def poses(folder: Path) -> NDArray[np.float64]:
    """OpenCV poses (N, 4, 4) of the frames, from the OpenGL ones in the file."""
    frames = transforms(folder)["frames"]
    assert isinstance(frames, list)
    return np.array([f["transform_matrix"] for f in frames]) @ np.diag([1, -1, -1, 1])


def cloud(folder: Path) -> NDArray[np.float64]:
    data = (folder / "capture" / "points.ply").read_bytes()
    body = data[data.index(b"end_header\n") + 11 :]
    table = np.frombuffer(body, [("xyz", "<f4", 3), ("rgb", "u1", 3)])
    return table["xyz"].astype(float)


def picture(path: Path) -> NDArray[np.generic]:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image


def lifted(folder: Path, frame: int) -> NDArray[np.float64]:
    """(H, W, 3) world points of a depth image."""
    t, depth = transforms(folder), picture(folder / f"ground_truth/depth/{frame:05d}.png") / 1000.0
    v, u = np.mgrid[0 : depth.shape[0], 0 : depth.shape[1]] + 0.5
    rays = np.stack([(u - t["cx"]) / t["fl_x"], (v - t["cy"]) / t["fl_y"], np.ones_like(u)], axis=-1)
    pose = poses(folder)[frame]
    return (rays * depth[..., None]) @ pose[:3, :3].T + pose[:3, 3]


def test_every_frame_has_its_image_and_masks(building: Path) -> None:
    frames = transforms(building)["frames"]
    assert isinstance(frames, list) and 55 <= len(frames) <= 95
    for kind in ("floor", "transient"):
        assert len(list((building / "ground_truth" / kind).glob("*.png"))) == len(frames)
    for frame in frames:
        assert picture(building / "capture" / frame["file_path"]).shape == (CONFIG.height, CONFIG.width, 3)


def test_floor_mask_is_where_the_depth_meets_the_ground(building: Path) -> None:
    for depth in sorted((building / "ground_truth/depth").glob("*.png")):
        floor = picture(building / "ground_truth/floor" / depth.name) > 0
        height = lifted(building, int(depth.stem))[..., 2]
        assert np.abs(height[floor]).max(initial=0) < 0.005
        feet = picture(building / "ground_truth/transient" / depth.name) > 0
        assert (height[~floor & ~feet] > -0.005).all()
        # What is at floor height is floor, but for the feet of walls and furniture
        assert (np.abs(height[~floor]) < 0.003).mean() < 0.02


def test_normals_agree_with_the_depth(building: Path) -> None:
    name = "00030"
    normal = picture(building / f"ground_truth/normals/{name}.png")[..., ::-1] / 127.5 - 1
    points = lifted(building, 30)
    across, down = points[1:-1, 2:] - points[1:-1, :-2], points[2:, 1:-1] - points[:-2, 1:-1]
    measured = np.cross(down, across)
    measured /= np.linalg.norm(measured, axis=-1, keepdims=True) + 1e-12
    agree = np.abs((measured * normal[1:-1, 1:-1]).sum(-1)) > 0.95
    towards = ((points - poses(building)[30, :3, 3]) * normal).sum(-1) <= 0.01
    assert agree.mean() > 0.7 and towards.all()


def test_people_are_in_some_frames_and_never_floor(building: Path) -> None:
    seen = []
    for path in sorted((building / "ground_truth/transient").glob("*.png")):
        person, floor = picture(path) > 0, picture(building / "ground_truth/floor" / path.name) > 0
        assert not (person & floor).any()
        seen.append(bool(person.any()))
    assert 0 < sum(seen) < len(seen) / 2


def test_occupancy_agrees_with_the_cloud(building: Path) -> None:
    grid, points = read_ros_map(building / "ground_truth/map.yaml"), cloud(building)
    solid = points[(points[:, 2] > 0.16) & (points[:, 2] < 1.44)]
    near = ndimage.distance_transform_edt(grid.cells != OCCUPIED) * grid.resolution
    row, column = np.moveaxis(grid.index(solid[:, :2]), -1, 0)
    assert (near[row, column] < 0.08).mean() > 0.999
    floor = points[np.abs(points[:, 2]) < 0.02]
    assert (grid.states_at(floor[:, :2]) == FREE).mean() > 0.85
    hit = np.zeros(grid.cells.shape, bool)
    hit[row, column] = True
    edge = (grid.cells == OCCUPIED) & ndimage.binary_dilation(grid.cells == FREE)
    assert ndimage.binary_dilation(hit, iterations=2)[edge].mean() > 0.7


def test_the_cloud_stays_inside_with_centimeter_noise(building: Path) -> None:
    scene, points = make_scene(CONFIG), cloud(building)
    assert len(points) > 20_000
    assert (points[:, :2] > -0.05).all() and (
        points[:, :2] < np.array([scene.plan.extent.x1, scene.plan.extent.y1]) + 0.05
    ).all()
    height = points[np.abs(points[:, 2]) < 0.04, 2]
    assert 0.001 < height.std() < 0.015


def test_glass_blocks_the_map_but_hardly_the_scanner(building: Path) -> None:
    scene, points = make_scene(CONFIG), cloud(building)
    grid = read_ros_map(building / "ground_truth/map.yaml")
    (pane,) = [b for b in scene.boxes if b.glass]
    lo, hi = np.array(pane.lo), np.array(pane.hi)
    middle = (lo + hi)[:2] / 2
    assert grid.states_at(middle) == OCCUPIED
    inside = (points > lo - (0.04, 0.04, -0.1)).all(1) & (points < hi + (0.04, 0.04, -0.1)).all(1)
    area = max(hi[0] - lo[0], hi[1] - lo[1]) * 2.5
    assert 0 < inside.sum() < 0.5 * area / 0.045**2


def test_the_step_is_an_obstacle(building: Path) -> None:
    scene, grid = make_scene(CONFIG), read_ros_map(building / "ground_truth/map.yaml")
    steps = [b for b in scene.boxes if b.hi[2] == 0.15]
    assert steps
    for b in steps:
        assert grid.states_at(np.array([(b.lo[0] + b.hi[0]) / 2, (b.lo[1] + b.hi[1]) / 2])) == OCCUPIED


def test_floors_have_visible_texture() -> None:
    scene = make_scene(CONFIG)
    textures = textures_of(scene)
    assert textures.chain.shape[1] == LEVELS
    start, rows, columns = textures.chain[scene.floor_surface, 0]
    image = textures.texels[start : start + rows * columns].reshape(rows, columns, 3) / 255
    gray = image @ np.array([0.299, 0.587, 0.114])
    for room in scene.plan.rooms:
        r = room.rects[0]
        contrast = [
            gray[int(y * 100) : int(y * 100) + 50, int(x * 100) : int(x * 100) + 50].std()
            for y in np.arange(r.y0 + 0.5, r.y1 - 1, 0.25)
            for x in np.arange(r.x0 + 0.5, r.x1 - 1, 0.25)
        ]
        assert np.median(contrast) >= 0.09 and np.percentile(contrast, 20) >= 0.08


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(building: Path, tmp_path: Path) -> None:
    generate(tmp_path / "again", CONFIG)
    files = sorted(p.relative_to(building) for p in building.rglob("*") if p.is_file())
    assert files == sorted(p.relative_to(tmp_path / "again") for p in (tmp_path / "again").rglob("*") if p.is_file())
    assert all((building / f).read_bytes() == (tmp_path / "again" / f).read_bytes() for f in files)
    other = make_scene(BuildingConfig(seed=4, size="small"))
    assert other.plan != make_scene(CONFIG).plan


def test_a_finished_building_is_left_alone_and_an_unfinished_one_is_not(building: Path, tmp_path: Path) -> None:
    events: list[Event] = []
    before = (building / "capture/points.ply").stat().st_mtime_ns
    generate(building, CONFIG, events.append)
    assert (building / "capture/points.ply").stat().st_mtime_ns == before
    assert events == [Progress("building", 1, 1, "already there")]
    tiny = BuildingConfig(seed=3, size="small", width=48, height=36, people=False)
    (tmp_path / "capture/images").mkdir(parents=True)
    (tmp_path / "capture/images/00999.jpg").write_bytes(b"of a longer walk")
    generate(tmp_path, tiny, events.append)
    assert not (tmp_path / "capture/images/00999.jpg").exists()
    last = events[-1]
    assert isinstance(last, Progress) and last.done == last.total


def test_a_folder_that_is_a_file_is_refused_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(InputError, match="taken"):
        generate(tmp_path / "taken", BuildingConfig(size="small", width=48, height=36))
