"""The scene model: the submap that renders each place, and the models that stay in memory."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.model import render_model
from nvsim.render.scene import render_scene
from nvsim.splats import files as files_module
from nvsim.splats import scene as scene_module
from nvsim.splats.files import load_model, memory_needed, save_model
from nvsim.splats.scene import SceneModel, memory_of
from nvsim.splats.types import FloorTexture, Gaussians, SubmapModel
from nvsim.submaps.split import Submap, SubmapConfig, split


def submap_model(color):
    """One big Gaussian around (x, 5, 1.5) for each x, of one color."""
    f = np.float32
    means = np.array([[x, 5, 1.5] for x in (0, 10, 20)], f)
    sh = np.tile(((np.array(color) - 0.5) / 0.28209479177387814).astype(f), (3, 1, 1))
    g = Gaussians(means, np.zeros((3, 3), f), np.tile([1, 0, 0, 0], (3, 1)).astype(f), np.full(3, 5, f), sh)
    return SubmapModel(g, None, None, FloorSurface.flat(0))


COLORS = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


@pytest.fixture
def folders(tmp_path):
    for i, color in enumerate(COLORS):
        save_model(submap_model(color), tmp_path / str(i))
    return [tmp_path / str(i) for i in range(3)]


SUBMAPS = [Submap(i, (i,), (i,), np.array([[10.0 * i, 0.0, 1.5]])) for i in range(3)]


def test_the_nearest_submap_draws(folders):
    scene = SceneModel(SUBMAPS, folders)
    for i, color in enumerate(COLORS):
        camera = Camera(Intrinsics.from_fov(32, 24, 1.0), camera_pose(np.array([10.0 * i + 0.1, 0.0, 1.5]), 0.0))
        index, output = render_scene(scene, camera)
        assert index == i
        np.testing.assert_allclose(output.rgb[12, 16], color, atol=0.05)


def test_a_submap_without_a_model_leaves_its_place_to_the_next(folders):
    scene = SceneModel(SUBMAPS, [folders[0], None, folders[2]])
    assert scene.indices == (0, 2)
    assert scene.model_at(np.array([11.0, 0, 1.5]))[0] == 2
    with pytest.raises(ValueError, match="at least one"):
        SceneModel(SUBMAPS, [None, None, None])
    with pytest.raises(ValueError, match="3 submaps but 1 folders"):
        SceneModel(SUBMAPS, folders[:1])


def test_another_submap_is_asked_where_it_was_trained_on_the_nearest_frame(tmp_path):
    rng = np.random.default_rng(3)
    positions = np.cumsum(rng.normal(0, 0.4, (120, 3)), axis=0) * [1, 1, 0.1]
    submaps = split(positions, SubmapConfig(count=4, overlap=1.0))
    scene = SceneModel(submaps, [tmp_path] * 4)
    answers = []
    for place in positions[rng.integers(0, 120, 60)] + rng.normal(0, 0.3, (60, 3)):
        frame = int(np.argmin(np.linalg.norm(positions - place, axis=1)))
        trained = [s for s in submaps if frame in s.frames and frame not in s.core]
        near = sorted(trained, key=lambda s: np.linalg.norm(s.positions - place, axis=1).min())
        answers.append(scene.second(place))
        assert answers[-1] == (near[0].index if near else None)
    assert None in answers and len(set(answers)) > 2
    assert SceneModel(SUBMAPS[:1], [tmp_path]).second(np.zeros(3)) is None


def test_a_submap_knows_the_places_whose_nearest_frame_it_was_trained_on(tmp_path):
    rng = np.random.default_rng(4)
    positions = np.cumsum(rng.normal(0, 0.4, (120, 3)), axis=0) * [1, 1, 0.1]
    submaps = split(positions, SubmapConfig(count=4, overlap=1.0))
    scene, places = SceneModel(submaps, [tmp_path] * 4), positions[::3] + rng.normal(0, 0.3, (40, 3))
    frames = [int(np.argmin(np.linalg.norm(positions - place, axis=1))) for place in places]
    for s in submaps:
        assert scene.trained_at(s.index, places).tolist() == [frame in s.frames for frame in frames]


def test_the_submap_of_a_stair_has_no_opinion_on_the_floors_that_it_joins(tmp_path):
    t = np.linspace(0, 2 * np.pi, 60)
    room = np.column_stack([3 * np.cos(t), 3 * np.sin(t), np.full(60, 1.3)])
    stair = np.column_stack([np.linspace(3, 7, 20), np.zeros(20), np.linspace(1.3, 4.3, 20)])
    positions = np.concatenate([room, stair, room + [0, 0, 3]])
    submaps = split(positions, SubmapConfig(count=3, overlap=1.5))
    scene = SceneModel(submaps, [tmp_path] * 3)
    climbing = next(s.index for s in submaps if np.ptp(s.positions[:, 2]) > 1)
    foot, step = np.array([3.0, 0.0, 1.3]), np.array([4.0, 0.0, 2.1])
    assert scene.nearest(foot) != climbing and scene.second(foot) is None
    assert scene.nearest(step) == climbing and scene.second(step) not in (None, climbing)


def test_models_load_when_asked_for_and_the_least_recently_used_goes(folders):
    scene = SceneModel(SUBMAPS, folders, memory_budget=2 * memory_of(submap_model(COLORS[0])))
    assert scene.loaded == ()
    first = scene.model(0)
    assert scene.model(0) is first
    scene.model(1)
    scene.model(0)
    scene.model(2)
    assert scene.loaded == (0, 2)
    assert scene.model(0) is first


def test_what_a_model_needs_is_known_before_it_is_read(tmp_path):
    model = submap_model(COLORS[0])
    model.texture = FloorTexture((np.zeros((40, 30, 3), np.float32),), (0.0, 0.0), (1.0, 1.0))
    save_model(model, tmp_path / "0")
    needed = memory_needed(tmp_path / "0")
    assert memory_of(model) <= needed <= 1.01 * memory_of(model)


def test_room_is_made_before_a_model_is_read(folders, monkeypatch):
    size = memory_of(submap_model(COLORS[0]))
    scene = SceneModel(SUBMAPS, folders, memory_budget=2 * size)
    taken = []
    load = scene_module.load_model
    monkeypatch.setattr(scene_module, "load_model", lambda f: taken.append(scene.memory) or load(f))
    for i in (0, 1, 2, 0, 2, 1):
        scene.model(i)
    assert max(taken) <= 2 * size, "what is set aside counts"


def settled(scene, expected, seconds=5.0):
    """Whether the models in memory become `expected` while a thread may still be loading."""
    end = time.monotonic() + seconds
    while scene.loaded != expected and time.monotonic() < end:
        time.sleep(0.005)
    return scene.loaded == expected


def test_the_next_model_is_loaded_ahead_near_its_border(folders):
    scene = SceneModel(SUBMAPS, folders)
    assert scene.model_at(np.array([2.0, 0, 1.5]))[0] == 0
    assert not settled(scene, (1, 0), seconds=0.2), "far from the border nothing is read"
    assert scene.model_at(np.array([4.0, 0, 1.5]))[0] == 0
    assert settled(scene, (1, 0)), "the one in use is the last to go"


def test_nothing_is_loaded_ahead_that_does_not_fit_beside_what_is_used(folders):
    size = memory_of(submap_model(COLORS[0]))
    scene = SceneModel(SUBMAPS, folders, memory_budget=2 * size - 1)
    scene.model_at(np.array([4.0, 0, 1.5]))
    assert not settled(scene, (1, 0), seconds=0.2) and scene.loaded == (0,)
    roomy = SceneModel(SUBMAPS, folders, memory_budget=2 * size)
    roomy.model(2)
    roomy.model_at(np.array([4.0, 0, 1.5]))
    assert settled(roomy, (1, 0)), "the least recently used made room"


def test_a_damaged_submap_fails_only_when_it_is_used(folders):
    (folders[1] / "model.json").write_text("{")
    scene = SceneModel(SUBMAPS, folders)
    for _ in range(3):
        assert scene.model_at(np.array([4.0, 0, 1.5]))[0] == 0
    with pytest.raises(InputError, match="damaged"):
        scene.model_at(np.array([6.0, 0, 1.5]))


def test_walking_in_many_threads_never_exceeds_the_budget(folders, monkeypatch):
    size = memory_of(submap_model(COLORS[0]))
    scene = SceneModel(SUBMAPS, folders, memory_budget=2 * size)
    load, over = scene_module.load_model, []

    def slow(folder):
        over.append(scene.memory)
        time.sleep(0.002)
        return load(folder)

    monkeypatch.setattr(scene_module, "load_model", slow)

    def walk(seed):
        for x in np.random.default_rng(seed).uniform(-5, 25, 40):
            index, model = scene.model_at(np.array([x, 0, 1.5]))
            assert index == min(2, max(0, round(x / 10))) and len(model.gaussians) == 3

    threads = [threading.Thread(target=walk, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=60)
        assert not thread.is_alive()
    assert max(over) <= 2 * size


def test_a_model_that_comes_back_is_hashed_again_only_when_its_files_changed(folders, monkeypatch):
    read = files_module.read_gaussians
    monkeypatch.setattr(files_module, "read_gaussians", lambda p, hashed: asked.append(hashed) or read(p, hashed))
    asked = []
    load_model(folders[0])
    load_model(folders[0])
    assert asked == [True, False]
    path = next(folders[0].glob("gaussians-*.ply"))
    data = bytearray(path.read_bytes())
    data[-3] ^= 1
    path.write_bytes(data)
    with pytest.raises(InputError, match="its content does not match model.json"):
        load_model(folders[0])


def test_the_model_asked_for_stays_even_when_it_exceeds_the_budget(folders):
    scene = SceneModel(SUBMAPS, folders, memory_budget=1)
    for i in range(3):
        scene.model(i)
        assert scene.loaded == (i,)


def test_many_threads_load_a_model_once(folders, monkeypatch):
    calls = []
    load = scene_module.load_model
    monkeypatch.setattr(scene_module, "load_model", lambda folder: calls.append(folder) or load(folder))
    scene = SceneModel(SUBMAPS, folders)
    threads = [threading.Thread(target=scene.model, args=(i % 3,)) for i in range(24)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(calls) == folders


def test_a_model_that_vanished_is_an_input_error(folders):
    scene = SceneModel(SUBMAPS, folders)
    (folders[1] / "model.json").unlink()
    with pytest.raises(InputError, match=r"model\.json"):
        scene.model(1)
    assert scene.loaded == ()


def test_without_colors_models_take_a_fifth_of_the_memory_and_show_the_same_shapes(tmp_path):
    r = np.random.default_rng(0)
    arrays = (r.normal(0, 1, (500, 3)), r.normal(-3, 0.3, (500, 3)), r.normal(size=(500, 4)), r.normal(0, 1, 500))
    gaussians = Gaussians(*(np.float32(a) for a in arrays), r.normal(0, 0.3, (500, 16, 3)).astype(np.float32))
    save_model(SubmapModel(gaussians, None, None, FloorSurface.flat(0.0)), tmp_path / "m")
    place = [Submap(0, (0,), (0,), np.zeros((1, 3)))]
    colored, gray = (SceneModel(place, [tmp_path / "m"], colors=c) for c in (True, False))
    camera = Camera(Intrinsics.from_fov(40, 40, 1.5), camera_pose(np.array([0.0, -3.0, 0.0]), 0.0))
    whole, shape = (render_model(s.model(0), camera, frozenset({"alpha", "normal", "depth"})) for s in (colored, gray))
    for name in ("alpha", "normal", "depth"):
        np.testing.assert_array_equal(getattr(shape, name), getattr(whole, name))
    assert gray.memory < 0.25 * colored.memory
