"""How the bundled networks are made: examples that are true, and a training that a kill does not change."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from nvsim.building.config import BuildingConfig
from nvsim.building.generation import scan
from nvsim.building.painting import paint_face
from nvsim.building.plan import HEIGHT, Rect
from nvsim.building.rendering import render
from nvsim.building.scene import make_scene, textures_of
from nvsim.building.solids import Paint
from nvsim.building.truth import floor_mask, normals
from nvsim.capture.types import Cloud
from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.networks.installed import model_at
from nvsim.perception.cloud_labels import FLOOR, OTHER, UNKNOWN, CloudLabels
from nvsim.perception.normals_network import NormalsNetwork
from nvsim.perception.semantic_network import SemanticNetwork
from nvsim.recipes import examples, furniture, interiors, patterns
from nvsim.recipes.config import RecipeConfig
from nvsim.recipes.examples import Example, Shards, batch, is_complete_shard, write_shard
from nvsim.recipes.interiors import interior
from nvsim.recipes.kitchens import kitchen
from nvsim.recipes.making import _captured_shares
from nvsim.recipes.network import export
from nvsim.recipes.training import CHECKPOINT, Training, train, weights_of

CONFIG = RecipeConfig(steps=2, batch=1, save_every=1)


@pytest.fixture(autouse=True)
def _looks_at_little(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    if "train" in request.node.name or "kill" in request.node.name or "cut_off" in request.node.name:
        monkeypatch.setattr(examples, "CUT", (64, 96))


@pytest.fixture(scope="module")
def views() -> list[Example]:
    return interior(3, 3, upright=False)


@pytest.fixture(scope="module")
def shards(tmp_path_factory: pytest.TempPathFactory, views: list[Example]) -> Shards:
    folder = tmp_path_factory.mktemp("examples")
    write_shard(folder / "lying", views)
    write_shard(folder / "upright", interior(4, 2, upright=True))
    assert is_complete_shard(folder / "lying")
    return Shards([folder / "lying", folder / "upright"])


def test_an_interior_is_the_same_each_time_and_its_floor_faces_up(views: list[Example]) -> None:
    again = interior(3, 3, upright=False)
    for one, other in zip(views, again, strict=True):
        assert np.array_equal(one.image, other.image) and np.array_equal(one.floor, other.floor)
        assert np.allclose(one.normals[one.floor == 1], (0, 0, 1))
        seen = one.normals.any(axis=-1)
        facing = np.sum(one.normals * one.camera.rays(), axis=-1)
        assert (facing[seen] < 1e-3).all(), "what a camera sees is turned towards it"


def test_the_furniture_of_a_kitchen_stands_in_its_room() -> None:
    for seed in range(40):
        rng = np.random.default_rng(seed)
        rect = Rect(1.0, 2.0, 1.0 + rng.uniform(1.5, 6), 2.0 + rng.uniform(1.5, 6))
        boxes = list(kitchen(rect, rng))
        assert seed or len(boxes) > 10
        for box in boxes:
            inside = rect.expanded(1e-3)
            assert inside.x0 <= box.lo[0] < box.hi[0] <= inside.x1 and inside.y0 <= box.lo[1] < box.hi[1] <= inside.y1
            assert 0 <= box.lo[2] < box.hi[2] < HEIGHT


def test_fronts_of_one_color_have_equal_doors() -> None:
    paint = Paint("front", (0.6, 0.1, 0.1), (0.9, 0.9, 0.9))
    first, second = (patterns.paint_pale(paint, (0, 0), 2.4, 0.7, 0.0125, np.random.default_rng(k)) for k in (1, 2))
    assert first.shape == (56, 192, 3) and 0 <= first.min() <= first.max() <= 1
    joints = [np.flatnonzero(np.diff(image.mean(axis=(0, 2))) > 0.005) for image in (first, second)]
    assert len(joints[0]) >= 2 and np.array_equal(*joints)


def test_cut_and_mirrored_examples_keep_their_geometry(shards: Shards) -> None:
    for seed in range(6):
        found = batch(shards, [1, 1], 4, np.random.default_rng(seed))
        assert found.images.shape[2:] in ((192, 256), (256, 192)) and found.rays.shape == found.images.shape
        assert np.allclose(np.linalg.norm(found.rays, axis=1), 1, atol=0.02)
        seen = np.abs(found.normals).sum(axis=1) > 0.5
        facing = (found.normals * found.rays).sum(axis=1)
        assert (facing[seen] < 0.1).mean() > 0.999, "but for a degree of tilt that is not known"
        floor = found.floor > 0
        assert not floor.any() or np.abs(found.normals.transpose(0, 2, 3, 1)[floor] - (0, -1, 0)).max() < 0.02


def test_a_training_that_was_cut_off_ends_with_the_same_weights(shards: Shards, tmp_path: Path) -> None:
    torch.set_num_threads(1)
    whole = train(tmp_path / "a", shards, [1, 1], CONFIG)

    class Killed(Exception):
        pass

    def kill(event: object) -> None:
        if getattr(event, "done", 0) == 1:
            raise Killed

    with pytest.raises(Killed):
        train(tmp_path / "b", shards, [1, 1], CONFIG, listen=kill)
    resumed = train(tmp_path / "b", shards, [1, 1], CONFIG)
    for name, weight in whole.state_dict().items():
        assert torch.equal(weight, resumed.state_dict()[name]), name
    started = Training(CONFIG)
    started.initialize_from(tmp_path / "a")
    assert torch.equal(started.network.floor[0].weight, whole.floor[0].weight)
    save_file({"average/floor.0.weight": whole.floor[0].weight}, tmp_path / CHECKPOINT)
    with pytest.raises(InputError, match="has a different network"):
        started.initialize_from(tmp_path)
    (tmp_path / "b" / CHECKPOINT).write_bytes(b"something else")
    with pytest.raises(Exception, match="delete it to begin again"):
        train(tmp_path / "b", shards, [1, 1], CONFIG)


def test_an_export_answers_as_the_network_does(views: list[Example], tmp_path: Path) -> None:
    network = Training(CONFIG).finished()
    path = export(network, tmp_path)
    assert path.stat().st_size <= 6e6
    example = views[0]
    floor = SemanticNetwork(model_at(tmp_path / "semantic.toml").open("cpu"))
    probability = floor.floor_probability(example.image, example.camera)
    chain = floor._chain
    shown = chain.show(example.image, lambda place: np.zeros((1, 3, place.rows, place.columns), np.float32))
    with torch.no_grad():
        logits, directions = network(*(torch.from_numpy(shown.values[n].astype(np.float32)) for n in ("photo", "rays")))
    for name, weight in weights_of(path).items():  # a later training may begin with the file
        assert torch.allclose(weight, network.state_dict()[name], rtol=1e-3, atol=1e-4), name
    assert np.abs(shown.values["floor"] - logits.numpy()).max() < 0.02 * max(1, float(logits.abs().max()))
    assert probability.shape == example.floor.shape and 0 <= probability.min() <= probability.max() <= 1
    untrained = NormalsNetwork(model_at(tmp_path / "normals.toml").open("cpu"))
    found = untrained.camera_normals(example.image, example.camera)  # which way it faces is chance, and not asked
    assert np.allclose(np.linalg.norm(found, axis=-1), 1, atol=1e-3) and directions.shape[1] == 3


def test_the_command_makes_examples_trains_and_goes_on(tmp_path: Path) -> None:
    asked = ["--interiors", "1", "--views", "2", "--batch", "1", "--save-every", "1"]
    assert main(["models", "train", str(tmp_path), "--steps", "1", *asked]) == 0
    first = (tmp_path / "interior.onnx").read_bytes()
    assert main(["models", "train", str(tmp_path), "--steps", "2", *asked]) == 0
    assert (tmp_path / "interior.onnx").read_bytes() != first
    assert main(["models", "train", str(tmp_path), "--steps", "0"]) == 2
    assert main(["models", "train", str(tmp_path / "n"), "--start", str(tmp_path / "examples")]) == 2


def test_a_building_without_usable_camera_positions_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interiors, "_NEAREST", np.inf)
    monkeypatch.setattr(interiors, "_TRIES", 3)
    with pytest.raises(InputError, match="Only 0 of 2 views"):
        interior(3, 2, upright=False)


def test_projects_without_examples_take_no_share_of_the_others() -> None:
    config = RecipeConfig(interiors=6, captures_share=0.4)
    shares = _captured_shares([2, 0, 1, 0], config)
    assert shares == pytest.approx([1, 1, 2])
    assert sum(shares) / (sum(shares) + config.interiors) == pytest.approx(config.captures_share)
    assert _captured_shares([0, 0], config) == []


def test_what_hangs_from_a_ceiling_begins_there_and_stays_in_its_room() -> None:
    room, hung = Rect(1.0, 2.0, 6.0, 5.0), []
    for seed in range(40):
        hung += list(furniture.under_the_ceiling(room, np.random.default_rng(seed)))
    lo, hi = (np.array([getattr(box, end) for box in hung]) for end in ("lo", "hi"))
    assert len(hung) > 20 and (hi[:, 2] == HEIGHT).all() and (lo[:, 2] > HEIGHT - 0.5).all()
    assert (lo[:, :2] >= (room.x0, room.y0)).all() and (hi[:, :2] <= (room.x1 + 1e-9, room.y1 + 1e-9)).all()
    assert (hi > lo).all()


def test_ceilings_are_of_all_brightness_and_pale_faces_have_little_color() -> None:
    scene = make_scene(BuildingConfig(size="small"))
    paint, rng = Paint("drawers", (0.5, 0.3, 0.1)), np.random.default_rng(0)
    plans = [patterns.paint_ceiling(scene.plan, 0.2, rng).mean() for _ in range(20)]
    assert min(plans) < 0.45 and max(plans) > 0.7
    faces = [paint_face(paint, (0.0, 0.0), 1.0, 1.0, 0.05, rng)]
    faces += [patterns.paint_pale(paint, (0.0, 0.0), 1.0, 1.0, 0.05, rng) for _ in range(10)]
    tones = [face.mean(axis=(0, 1)) for face in faces]
    colorful, *pale = (float(np.ptp(tone) / tone.mean()) for tone in tones)
    assert max(pale) < 0.5 * colorful and np.ptp([tone.mean() for tone in tones[1:]]) > 0.2


def test_what_a_cloud_says_for_certain_is_true() -> None:
    scene = make_scene(BuildingConfig(seed=5, size="small", people=False))
    textures = textures_of(scene)
    cloud = scan(scene, textures, np.random.default_rng(0))
    labels = CloudLabels(replace(cloud, points=cloud.points[::2], colors=None))
    right = called = 0
    angles = []
    for frame in (3, 17):
        camera = Camera(Intrinsics.from_fov(160, 120, 1.3), scene.camera(frame).camera_to_world)
        view = render(camera, scene.solids, textures, np.empty((0, 5)), np.empty((0, 3)))
        said, found = labels.of(camera, FloorSurface.flat(0.0))
        truth = np.where(floor_mask(scene, view), FLOOR, OTHER)
        known = said != UNKNOWN
        assert known.mean() > 0.6
        right, called = right + int((said == truth)[known].sum()), called + int(known.sum())
        true = normals(scene, view)
        there = found.any(axis=-1) & true.any(axis=-1)
        angles.append(np.degrees(np.arccos(np.clip((found * true).sum(axis=-1)[there], -1, 1))))
    assert right / called > 0.975
    assert np.median(np.concatenate(angles)) < 4


def test_a_few_points_before_the_floor_are_no_thing_for_certain_and_a_board_of_many_is() -> None:
    """Depth cameras leave points in the air beside edges, half as dense as surfaces are."""
    floor, board, mixed = (
        np.stack(np.meshgrid(np.arange(x, x + wide, step), np.arange(y, y + deep, step)), -1).reshape(-1, 2)
        for x, y, wide, deep, step in ((-3, -3, 6, 6, 0.03), (-0.5, 0.3, 0.4, 0.4, 0.03), (0.1, 0.3, 0.4, 0.4, 0.06))
    )
    heights = (0.0, 0.7, 0.7)
    points = np.concatenate([np.c_[xy, np.full(len(xy), z)] for xy, z in zip((floor, board, mixed), heights)])
    camera = Camera(Intrinsics.from_fov(160, 120, 1.2), camera_pose(np.array([0.0, 0.0, 1.5]), 0.0, np.radians(-60)))
    said, _ = CloudLabels(Cloud(points.astype(np.float32), None, "lidar")).of(camera, FloorSurface.flat(0.0))

    def at(x: float) -> np.ndarray:
        (column, row), _ = camera.project(np.array([x, 0.5, 0.7]))
        return said[int(row) - 5 : int(row) + 6, int(column) - 5 : int(column) + 6]

    assert (at(-0.3) == OTHER).mean() > 0.9 and (at(0.3) == UNKNOWN).mean() > 0.9
    assert (said == FLOOR).mean() > 0.5


def test_a_cloud_says_nothing_of_what_has_another_color_than_it() -> None:
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.arange(-3, 3, 0.03), np.arange(-3, 3, 0.03)), -1).reshape(-1, 2)
    points = np.column_stack([grid + rng.normal(0, 0.003, grid.shape), np.zeros(len(grid))]).astype(np.float32)
    brown = np.full((len(points), 3), (150, 110, 70), np.uint8)
    labels = CloudLabels(Cloud(points, brown, "lidar"))
    camera = Camera(Intrinsics.from_fov(160, 120, 1.2), camera_pose(np.array([0.0, 0.0, 1.5]), 0.0, np.radians(-60)))
    image = np.full((120, 160, 3), (105, 77, 49), np.uint8)  # the same floor, darker exposed
    image[40:80, 60:100] = 20  # a seat, which the cloud lacks
    blind, seen = (labels.of(camera, FloorSurface.flat(0.0), shown) for shown in (None, image))
    assert (blind[0][44:76, 64:96] == FLOOR).mean() > 0.95
    assert (seen[0][44:76, 64:96] == UNKNOWN).all() and not seen[1][44:76, 64:96].any()
    beside = np.ones((120, 160), bool)
    beside[36:84, 56:104] = False
    assert np.array_equal(seen[0][beside], blind[0][beside]) and np.array_equal(seen[1][beside], blind[1][beside])
