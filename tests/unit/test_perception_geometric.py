"""The geometric provider in a box room with a box in it: every pixel's truth follows from a ray and slabs."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest

from nvsim.capture.types import Alignment, Capture, Cloud, Frame
from nvsim.errors import InputError
from nvsim.evaluation.floor import MaskWithTruth, floor_figures
from nvsim.events import Progress
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.lens import Lens
from nvsim.perception.geometric import GeometricConfig, GeometricFloor
from nvsim.perception.obstacles import ObstacleConfig, split_obstacles
from nvsim.perception.refine import RefineConfig, refine
from nvsim.perception.segment import SegmentConfig, mask_path, read_mask, read_mask_and_doubt, segment_capture
from nvsim.perception.support import FloorSupport, SupportConfig, observe

ROOM = np.array([[0, 0, 0], [6, 5, 2.6]], float)
BOX = np.array([[2.5, 2.0, 0], [3.5, 2.8, 0.7]], float)
FLAT = FloorSurface.flat(0.0)
EYES = [(0.8, 0.8, 0.6), (5.2, 0.8, -0.7), (0.8, 4.2, 2.4), (5.2, 4.2, -2.3), (3.0, 0.6, 0.0), (0.7, 2.4, 1.57)]
INTRINSICS = Intrinsics.from_fov(240, 180, 1.4)


def camera(k: int) -> Camera:
    x, y, heading = EYES[k]
    return Camera(INTRINSICS, camera_pose(np.array([x, y, 1.2]), heading))


def truth(view: Camera, person: np.ndarray | None = None, box: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Floor mask and image: tiles on the floor, plain walls, a red box (and a person)."""
    rays, eye = view.rays().astype(float), view.position
    with np.errstate(divide="ignore"):
        leave = np.where(rays > 0, (ROOM[1] - eye) / rays, (ROOM[0] - eye) / rays)
    axis = leave.argmin(axis=-1)
    floor = (axis == 2) & (rays[..., 2] < 0)
    hit = eye + leave.min(axis=-1)[..., None] * rays
    tiles = (np.floor(hit[..., 0] / 0.4) + np.floor(hit[..., 1] / 0.4)) % 2
    image = np.where(floor, 90 + 60 * tiles, 200 + 15 * axis)[..., None].repeat(3, axis=-1)
    for solid, color in [(BOX, (180, 40, 40))] * box + ([] if person is None else [(person, (30, 160, 50))]):
        with np.errstate(divide="ignore"):
            a, b = (solid[0] - eye) / rays, (solid[1] - eye) / rays
        enter, out = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
        struck = (enter < out) & (enter > 0)
        floor &= ~struck
        image[struck] = color
    noise = np.random.default_rng(0).normal(0, 2, image.shape)
    return floor, np.clip(image + noise, 0, 255).astype(np.uint8)


def scan(spacing: float = 0.05, noise: float = 0.008) -> Cloud:
    def sheet(low, high, fixed, value):
        axes = [np.arange(low[i] + spacing / 2, high[i], spacing) if i != fixed else [value] for i in range(3)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)

    room = [sheet(*ROOM, axis, ROOM[side][axis]) for axis, side in ((0, 0), (0, 1), (1, 0), (1, 1), (2, 0))]
    floor = room[-1]
    under = ((floor[:, :2] > BOX[0, :2]) & (floor[:, :2] < BOX[1, :2])).all(axis=1)
    room[-1] = floor[~under]
    box = [sheet(*BOX, axis, BOX[side][axis]) for axis, side in ((0, 0), (0, 1), (1, 0), (1, 1), (2, 1))]
    points = np.concatenate(room + box)
    points += np.random.default_rng(1).normal(0, noise, points.shape)
    return Cloud(points.astype(np.float32))


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


@pytest.fixture(scope="module")
def provider() -> GeometricFloor:
    provider = GeometricFloor(scan(), FLAT)
    provider.learn([camera(k) for k in range(len(EYES))], lambda k: truth(camera(k))[1])
    return provider


@pytest.mark.parametrize("k", range(len(EYES)))
def test_mask_of_a_box_room_agrees_with_the_ray_cast_truth(provider, k):
    floor, image = truth(camera(k))
    assert iou(provider.segment(camera(k), image).mask, floor) > 0.95


def test_learning_from_a_view_keeps_half_of_its_projection_in_memory():
    """Color, occlusion, and two distances are 12 bytes per pixel, and the cells of the floor here 18. A projection and
    its observation have 26 instead of the 12."""
    config = GeometricConfig(longest_side=100)
    provider = GeometricFloor(scan(), FLAT, config)
    images = [truth(camera(k))[1] for k in range(len(EYES))]
    size = camera(0).intrinsics.limited_to(config.longest_side)

    def peak(rounds: int) -> int:
        views = list(range(len(EYES))) * rounds
        tracemalloc.start()
        try:
            provider.learn([camera(k) for k in views], lambda i: images[views[i]])
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(1)
    few, many = 2, 8
    grown = (peak(many) - peak(few)) / ((many - few) * len(EYES) * size.width * size.height)
    assert grown < 37


def test_floor_of_the_next_room_is_not_seen_under_the_wall():
    points = scan().points
    points = points[(np.abs(points[:, 2]) < 0.04) | (points[:, 2] > 0.12)]  # the scan's lowest row misses the foot
    beyond = points[np.abs(points[:, 2]) < 0.04] + np.array([0, 5.1, 0], np.float32)
    cloud = Cloud(np.concatenate([points, beyond]))
    floor, image = truth(camera(0))
    assert iou(GeometricFloor(cloud, FLAT).segment(camera(0), image).mask, floor) > 0.93


def test_the_depth_of_the_image_itself_says_what_the_cloud_does_not():
    """A cloud without the box, and of the floor only its far half: the image's own depth knows both."""
    points = scan().points
    boxed = ((points > BOX[0] - 0.05) & (points < BOX[1] + 0.05)).all(axis=1) & (points[:, 2] > 0.05)
    near = (np.abs(points[:, 2]) < 0.05) & (points[:, 1] < 2.5)
    view = camera(0)
    floor, image = truth(view)
    rays = view.rays().astype(float)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.where(rays[..., 2] < 0, -view.position[2] / rays[..., 2], 0)
        struck = np.minimum((BOX[0] - view.position) / rays, (BOX[1] - view.position) / rays).max(axis=-1)
    hidden = (along > 0) & ~floor & (struck > 0) & (struck < along)
    depth = np.where(hidden, struck, np.where(floor, along, 0)) * (rays @ view.rotation[:, 2])
    provider = GeometricFloor(Cloud(points[~boxed & ~near]), FLAT)
    provider.learn([camera(k) for k in range(len(EYES))], lambda k: truth(camera(k))[1])
    blind = provider.segment(view, image)
    assert blind.doubtful is None
    found = provider.segment(view, image, depth.astype(np.float32))
    assert iou(found.mask, floor) > max(0.95, iou(blind.mask, floor) + 0.2)
    assert found.doubtful is not None and not (found.doubtful & found.mask).any()
    assert found.doubtful[hidden].mean() < 0.05
    nothing = provider.segment(view, image, np.zeros_like(depth, np.float32))
    assert nothing.doubtful is not None and nothing.doubtful.any() and nothing.doubtful[~floor].mean() < 0.02


def test_one_point_of_a_scan_supports_its_cell_and_one_that_images_gave_does_not():
    def supported(points: np.ndarray, normals: np.ndarray | None) -> bool:
        cloud = Cloud(points.astype(np.float32), normals=normals)
        return bool(
            observe([camera(0)], [np.zeros((180, 240), bool)], FLAT, cloud).is_supported(np.array([1.02, 1.02]))
        )

    one = np.array([[1.02, 1.02, 0.0]])
    up = np.array([[0.0, 0.0, 1.0]], np.float32)
    assert supported(one, None) and supported(one, 0 * up) and not supported(one, up)
    assert supported(np.repeat(one, 7, axis=0), np.repeat(up, 7, axis=0))


def test_without_a_cloud_everything_below_the_horizon_is_floor_at_most():
    floor, image = truth(camera(0))
    found = GeometricFloor(None, FLAT, GeometricConfig(refine=RefineConfig(most=0))).segment(camera(0), image)
    assert (found.mask | ~floor).all() and not found.mask[:85].any()


def test_a_person_whom_the_cloud_does_not_know_is_taken_out(provider):
    person = np.array([[1.9, 1.9, 0], [2.2, 2.2, 1.7]])
    floor, image = truth(camera(0), person)
    empty, _ = truth(camera(0))
    standing = empty & ~floor
    found = provider.segment(camera(0), image).mask
    assert standing.sum() > 300 and found[standing].mean() < 0.25


def test_gloss_on_the_floor_stays_floor_where_a_network_is_sure_of_it(provider):
    floor, image = truth(camera(0))
    deep = cv2.distanceTransform(floor.astype(np.uint8), cv2.DIST_L2, 3)
    row, column = np.unravel_index(deep.argmax(), deep.shape)
    y, x = np.mgrid[: floor.shape[0], : floor.shape[1]]
    gloss = (x - column) ** 2 + (y - row) ** 2 < (0.6 * deep.max()) ** 2
    image[gloss] = 250
    for likely, kept in ((0.3, 0.2), (0.9, 1.0)):
        found = provider.segment(camera(0), image, looks=np.full(floor.shape, likely, np.float32)).mask
        assert found[gloss].mean() <= kept and found[floor & ~gloss].mean() > 0.9
    assert found[gloss].mean() > 0.95


@pytest.mark.parametrize("k", [0, 2])
def test_a_network_fills_holes_of_the_scan_and_decides_at_edges(k: int) -> None:
    whole = scan()
    on_floor = np.abs(whole.points[:, 2]) < 0.04
    inside = ((whole.points[:, :2] > (1.5, 1.0)) & (whole.points[:, :2] < (4.5, 4.0))).all(axis=1)
    holed = GeometricFloor(Cloud(whole.points[~(on_floor & inside)]), FLAT)
    floor, image = truth(camera(k))
    alone = holed.segment(camera(k), image).mask
    everywhere, hardly = np.ones(floor.shape, np.float32), np.full(floor.shape, 0.01, np.float32)
    filled = holed.segment(camera(k), image, looks=everywhere).mask
    assert iou(alone, floor) < 0.7 and iou(filled, floor) > 0.93, "nor is a wall floor, whatever a network says"
    assert np.array_equal(holed.segment(camera(k), image, looks=hardly).mask, alone), "a network misses floor"
    unsure = np.full(floor.shape, 0.4, np.float32)
    assert np.array_equal(holed.segment(camera(k), image, looks=unsure).mask, alone)
    likely = holed.segment(camera(k), image, looks=np.full(floor.shape, 0.8, np.float32)).mask
    away, deep = (cv2.distanceTransform(side.astype(np.uint8), cv2.DIST_L2, 3) for side in (~alone, alone))
    assert deep[~likely].max() < 3 and away[likely].max() < 4, "no hole is filled, and edges move by a pixel or two"
    assert likely.sum() > alone.sum()
    nowhere = np.where(np.arange(floor.shape[1]) < floor.shape[1] // 2, 0.0, 0.01) * np.ones(floor.shape)
    half = holed.segment(camera(k), image, looks=nowhere.astype(np.float32)).mask
    assert not half[:, : floor.shape[1] // 2 - 8].any(), "somebody who walks by is in no scan"
    assert (half == alone)[:, floor.shape[1] // 2 + 8 :].mean() > 0.99


def test_floor_at_its_rim_takes_more_of_a_network_than_floor_amid_floor() -> None:
    provider = GeometricFloor(scan(), FLAT, GeometricConfig(refine=RefineConfig(most=0)))
    floor, image = truth(camera(0))
    alone, hardly, barely = (
        provider.segment(camera(0), image, looks=np.full(floor.shape, likely, np.float32)).mask
        for likely in (0.01, 0.001, 0.0001)
    )
    deep = cv2.distanceTransform(alone.astype(np.uint8), cv2.DIST_L2, 3)
    assert np.array_equal(hardly, deep >= 2.5) and hardly.any() and not barely.any()


def test_beside_the_depth_of_images_a_network_says_what_the_cloud_draws_wrongly() -> None:
    """A wall with a hole in its points, beyond which there is floor, and a box whose points stand for too much."""
    points = scan().points
    low_wall = (points[:, 1] > ROOM[1, 1] - 0.05) & (points[:, 2] < 1.2)
    beyond = np.random.default_rng(3).uniform((0.5, ROOM[1, 1] + 0.1, 0), (5.5, ROOM[1, 1] + 3, 0), (20_000, 3))
    thick = points[(points[:, 2] > 0.05) & ((points > BOX[0] - 0.01) & (points < BOX[1] + 0.01)).all(axis=1)]
    swollen = [thick + np.array([x, y, 0]) for x in (-0.3, 0, 0.3) for y in (-0.3, 0, 0.3)]
    cloud = Cloud(np.concatenate([points[~low_wall], beyond, *swollen]).astype(np.float32))
    provider, view = GeometricFloor(cloud, FLAT), camera(0)
    floor, image = truth(view)
    unknown = np.zeros(floor.shape, np.float32)
    sure = np.where(floor, 0.95, 0.01).astype(np.float32)
    found = provider.segment(view, image, unknown, sure).mask
    alone = provider.segment(view, image, unknown, np.full(floor.shape, 0.5, np.float32)).mask
    assert (alone & ~floor).sum() > 200 and (floor & ~alone).sum() > 200
    assert iou(found, floor) > 0.95 > iou(alone, floor) + 0.1
    rays = view.rays().astype(float)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.where(rays[..., 2] < 0, -view.position[2] / rays[..., 2], 0)
    before = np.where(along > 0, 0.6 * along * (rays @ view.rotation[:, 2]), 0).astype(np.float32)
    assert not provider.segment(view, image, before, np.ones_like(sure)).mask.any(), "the image's own depth comes first"


def test_a_front_of_which_an_image_knows_no_depth_is_no_floor_if_a_network_sees_that_it_stands() -> None:
    """A box that the cloud lacks, of the floor's color to a network of looks."""
    points = scan().points
    cloud = Cloud(points[~((points > BOX[0] - 0.02) & (points < BOX[1] + 0.02)).all(axis=1)])
    provider, view = GeometricFloor(cloud, FLAT), camera(0)
    floor, image = truth(view)
    below = truth(view, box=False)[0]
    box = below & ~floor
    unknown, looks = np.zeros(floor.shape, np.float32), np.where(below, 0.4, 0.01).astype(np.float32)
    blind = provider.segment(view, image, unknown, looks).mask
    stands = np.where(box, 0.0, 1.0).astype(np.float32)
    told = provider.segment(view, image, unknown, looks, stands).mask
    assert (blind & box).sum() > 0.9 * box.sum() > 100 and (told & box).sum() < 0.1 * box.sum()
    assert iou(told, floor) > 0.95 > iou(blind, floor)
    sure = np.where(below, 0.99, 0.01).astype(np.float32)
    assert (provider.segment(view, image, unknown, sure, stands).mask & box).sum() > 0.9 * box.sum(), "looks are sure"


def test_refinement_moves_a_shifted_border_back_to_the_edge_of_the_image():
    floor, image = truth(camera(0))
    shifted = np.roll(floor, 2, axis=0)
    scale = np.full(floor.shape, 100.0, np.float32)
    back = refine(shifted, scale, image, RefineConfig(reach=0.04))
    assert iou(back, floor) > iou(shifted, floor) + 0.01


def test_a_blurred_border_runs_where_half_of_the_edge_is_on_either_side():
    floor = np.broadcast_to(np.arange(60)[:, None] >= 31, (60, 80))
    image = np.where(floor, 60, 200)[..., None].repeat(3, axis=-1).astype(np.uint8)
    image = cv2.GaussianBlur(image, (0, 0), 1.2)
    scale = np.full(floor.shape, 100.0, np.float32)
    for shift in (-1, 1):
        found = refine(np.roll(floor, shift, axis=0), scale, image, RefineConfig(least=0.5, reach=0.0, most=1.0))
        assert np.array_equal(found[3:-3], floor[3:-3])


def test_floor_that_the_scan_shows_below_a_sofa_is_seen_and_the_next_room_behind_a_pane_is_not():
    """A sofa on short legs, and a pane, whose lowest scanned points are 0.12 m above the floor, with floor behind."""
    x, y = (a.ravel().astype(np.float32) for a in np.meshgrid(np.arange(0, 4, 0.04), np.arange(0, 4, 0.04)))
    floor = np.column_stack([x, y, 0 * x])
    top = floor[(np.abs(x - 1) < 0.4) & (np.abs(y - 2) < 0.8)] + np.array([0, 0, 0.4], np.float32)
    edge = np.arange(1.2, 2.8, 0.04)
    sides = [np.column_stack([0 * edge + at, edge, 0 * edge + z]) for at in (0.6, 1.4) for z in (0.12, 0.2, 0.3)]
    pane = [np.column_stack([0 * edge + 3, edge, 0 * edge + z]) for z in np.arange(0.12, 2, 0.04)]
    cloud = Cloud(np.concatenate([floor, top, *sides, *pane]).astype(np.float32))
    points = split_obstacles(cloud, FLAT, ObstacleConfig()).points
    feet = points[(points[:, 2] < 0.1) & (np.abs(points[:, 1] - 2) < 0.6)]  # corners have no room for half a disc
    assert len(feet) > 50 and (feet[:, 0] > 2).all()
    alone = Cloud(np.concatenate([floor[x > 1.4], *sides]).astype(np.float32))
    kept = split_obstacles(alone, FLAT, ObstacleConfig()).points
    assert (kept[:, 2] < 0.1).sum() > 50, "nothing says that floor goes on below it"


def test_support_is_the_floor_of_the_room_and_neither_the_box_nor_beyond_the_walls():
    views = [camera(k) for k in range(len(EYES))]
    masks = [truth(v)[0] for v in views]
    grid = np.stack(np.meshgrid(np.arange(-1, 7, 0.11), np.arange(-1, 6, 0.11)), -1)
    inside = ((grid > ROOM[0, :2] + 0.25) & (grid < ROOM[1, :2] - 0.25)).all(-1)
    beyond = ((grid < ROOM[0, :2] - 0.25) | (grid > ROOM[1, :2] + 0.25)).any(-1)
    near_box = ((grid > BOX[0, :2] - 0.1) & (grid < BOX[1, :2] + 0.1)).all(-1)
    core = ((grid > BOX[0, :2] + 0.1) & (grid < BOX[1, :2] - 0.1)).all(-1)
    seen = np.zeros(grid.shape[:2], bool)
    for view, mask in zip(views, masks):
        pixel, depth = view.project(np.dstack([grid, np.zeros(grid.shape[:2])]))
        column, row = np.floor(pixel[..., 0]).astype(int), np.floor(pixel[..., 1]).astype(int)
        framed = (depth > 0) & (column >= 0) & (column < 240) & (row >= 0) & (row < 180)
        near = np.hypot(*(np.moveaxis(grid, -1, 0) - view.position[:2, None, None])) < 5.8
        seen |= framed & near & mask[row.clip(0, 179), column.clip(0, 239)]
    for cloud, known in ((None, seen), (scan(), np.ones_like(seen))):
        support = observe(views, masks, FLAT, cloud, SupportConfig(views=1)).is_supported(grid)
        assert support[inside & ~near_box & known].mean() > 0.97
        assert not support[beyond].any() and not support[core].any()


def test_glass_that_masks_look_through_still_takes_support_away():
    views = [camera(k) for k in range(len(EYES))]
    masks = [truth(v)[0] for v in views]
    pane = np.stack(np.meshgrid(np.arange(0.05, 6, 0.1), [3.65], np.arange(0.05, 2, 0.1)), -1).reshape(-1, 3)
    cloud = Cloud(np.concatenate([scan().points, pane.astype(np.float32)]))
    support = observe(views, masks, FLAT, cloud, SupportConfig(spacing=0.1))
    along = np.column_stack([np.arange(0.55, 5.5, 0.1), np.full(50, 3.65)])
    assert support.is_supported(along).mean() < 0.05
    assert support.is_supported(along + [0, 0.3]).mean() > 0.95


def test_support_is_read_as_written_and_a_broken_file_is_refused(tmp_path: Path):
    support = FloorSupport(np.random.default_rng(0).random((7, 9)) > 0.5, (-1.5, 2.0), 0.08)
    support.save(tmp_path / "support.npz")
    again = FloorSupport.load(tmp_path / "support.npz")
    assert np.array_equal(again.cells, support.cells) and (again.origin, again.spacing) == ((-1.5, 2.0), 0.08)
    assert not support.is_supported(np.array([[100.0, 0.0], [np.inf, 0.0]])).any()
    (tmp_path / "broken.npz").write_bytes((tmp_path / "support.npz").read_bytes()[:60])
    for name in ("broken.npz", "absent.npz"):
        with pytest.raises(InputError, match=name):
            FloorSupport.load(tmp_path / name)


@pytest.fixture()
def capture(tmp_path: Path) -> Capture:
    lens = Lens("PINHOLE", 240, 180, (INTRINSICS.fx, INTRINSICS.fy, INTRINSICS.cx, INTRINSICS.cy))
    frames = []
    for k in range(len(EYES)):
        path = tmp_path / f"{k}.png"
        cv2.imwrite(str(path), truth(camera(k))[1][..., ::-1])
        frames.append(Frame(path.name, path, lens, camera(k).camera_to_world))
    return Capture(tmp_path, "nerfstudio", tuple(frames), scan(), Alignment.identity())


def test_stage_writes_every_mask_once_resumes_and_scores_well(capture: Capture, tmp_path: Path):
    masks, exact = tmp_path / "masks", tmp_path / "truth"
    exact.mkdir()
    for k in range(len(EYES)):
        cv2.imwrite(str(exact / mask_path(masks, k).name), truth(camera(k))[0].astype(np.uint8) * 255)
    events: list[object] = []
    segment_capture(capture, lambda i: FLAT, masks, listen=events.append, todo=[0, 1, 2])
    assert sorted(p.name for p in masks.iterdir()) == ["000000.png", "000001.png", "000002.png"]
    before = {p.name: p.stat().st_mtime_ns for p in masks.iterdir()}
    segment_capture(capture, lambda i: FLAT, masks, listen=events.append)
    assert all((masks / name).stat().st_mtime_ns == when for name, when in before.items())
    assert events[-1] == Progress("floors", 6, 6, events[-1].detail)
    at_once = tmp_path / "at_once"
    segment_capture(capture, lambda i: FLAT, at_once, SegmentConfig(threads=1))
    names = [f"{k:06d}.png" for k in range(6)]
    assert all((masks / n).read_bytes() == (at_once / n).read_bytes() for n in names)
    figures = floor_figures(MaskWithTruth(n, read_mask(masks / n), read_mask(exact / n)) for n in names)
    assert figures["miou"] > 0.95 and figures["frames"] == 6 and len(figures["per_frame"]) == 6
    assert figures["worst"][0]["iou"] == min(r["iou"] for r in figures["per_frame"])


def test_what_may_be_floor_is_told_from_floor_at_any_size(tmp_path: Path):
    path = mask_path(tmp_path, 0)
    picture = np.zeros((90, 120), np.uint8)
    picture[60:], picture[30:60, :60] = 255, 96
    cv2.imwrite(str(path), picture)
    for width, height in ((120, 90), (40, 30), (240, 180)):
        mask, doubtful = read_mask_and_doubt(path, width, height)
        row, column = height // 3, width // 2
        assert mask[2 * row + 1 :].all() and not mask[: 2 * row - 1].any()
        assert doubtful is not None and not (doubtful & mask).any()
        assert doubtful[row + 1 : 2 * row - 1, : column - 1].all() and not doubtful[:, column + 1 :].any()
    cv2.imwrite(str(path), np.where(picture == 96, 0, picture))
    assert read_mask_and_doubt(path, 40, 30)[1] is None


@pytest.mark.parametrize("turned", [False, True])
def test_a_mask_that_shrinks_on_one_side_has_the_floor_of_most_pixels(tmp_path: Path, turned: bool) -> None:
    stripes = np.tile(np.array([255, 255, 255, 0, 0, 255, 255, 255], np.uint8), (30, 5))
    cv2.imwrite(str(tmp_path / "000000.png"), stripes.T if turned else stripes)
    width, height = (30, 5) if turned else (5, 30)
    assert read_mask(tmp_path / "000000.png", width, height).all()


def test_masks_are_read_at_any_size_and_missing_ones_are_named(tmp_path: Path):
    mask = np.zeros((90, 120), np.uint8)
    mask[60:] = 255
    cv2.imwrite(str(tmp_path / "000003.png"), mask)
    small = read_mask(tmp_path / "000003.png", 40, 30)
    assert small.shape == (30, 40) and small[20:].all() and not small[:20].any()
    (tmp_path / "000004.png").write_bytes(b"nothing")
    for name in ("000004.png", "000005.png"):
        with pytest.raises(InputError, match=name):
            read_mask(tmp_path / name)


def test_evaluation_leaves_out_frames_without_floor():
    rows = np.arange(100)[:, None].repeat(100, axis=1)
    masks = [MaskWithTruth("a.png", rows >= 40, rows >= 50), MaskWithTruth("b.png", rows >= 100, rows >= 100)]
    figures = floor_figures(masks)
    assert figures["miou"] == pytest.approx(50 / 60) and figures["frames"] == 1
    assert figures["recall"] == 1.0 and figures["precision"] == pytest.approx(50 / 60)


def test_a_sparse_cloud_is_enough_to_find_the_floor_that_looks_the_same():
    dense = scan(0.02, 0.02)
    sparse = Cloud(dense.points[np.random.default_rng(2).permutation(len(dense.points))[:2500]], None, "sfm")
    floor, image = truth(camera(0))
    found = GeometricFloor(sparse, FLAT).segment(camera(0), image).mask
    assert iou(found, floor) > 0.75
