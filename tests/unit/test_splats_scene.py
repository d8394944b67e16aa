"""The scene model: who answers where, and what stays in memory."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.scene import render_scene
from nvsim.splats import scene as scene_module
from nvsim.splats.files import save_model
from nvsim.splats.scene import SceneModel, memory_of
from nvsim.splats.types import Gaussians, SubmapModel
from nvsim.submaps.types import Submap


def submap_model(colour):
    """One big Gaussian around (x, 5, 1.5) for each x, of one colour."""
    f = np.float32
    means = np.array([[x, 5, 1.5] for x in (0, 10, 20)], f)
    sh = np.tile(((np.array(colour) - 0.5) / 0.28209479177387814).astype(f), (3, 1, 1))
    g = Gaussians(means, np.zeros((3, 3), f), np.tile([1, 0, 0, 0], (3, 1)).astype(f), np.full(3, 5, f), sh)
    return SubmapModel(g, None, None, FloorSurface.flat(0))


COLOURS = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


@pytest.fixture
def folders(tmp_path):
    for i, colour in enumerate(COLOURS):
        save_model(submap_model(colour), tmp_path / str(i))
    return [tmp_path / str(i) for i in range(3)]


SUBMAPS = [Submap(i, (i,), (i,), np.array([[10.0 * i, 0.0, 1.5]])) for i in range(3)]


def test_the_nearest_submap_draws(folders):
    scene = SceneModel(SUBMAPS, folders)
    for i, colour in enumerate(COLOURS):
        camera = Camera(Intrinsics.from_fov(32, 24, 1.0), look(np.array([10.0 * i + 0.1, 0.0, 1.5]), 0.0))
        index, output = render_scene(scene, camera)
        assert index == i
        np.testing.assert_allclose(output.rgb[12, 16], colour, atol=0.05)


def test_a_submap_without_a_model_leaves_its_place_to_the_next(folders):
    scene = SceneModel(SUBMAPS, [folders[0], None, folders[2]])
    assert scene.indices == (0, 2)
    assert scene.model_at(np.array([11.0, 0, 1.5]))[0] == 2
    with pytest.raises(ValueError, match="at least one"):
        SceneModel(SUBMAPS, [None, None, None])
    with pytest.raises(ValueError, match="3 submaps but 1 folders"):
        SceneModel(SUBMAPS, folders[:1])


def test_models_load_when_asked_for_and_the_least_recently_used_goes(folders):
    scene = SceneModel(SUBMAPS, folders, memory_budget=2 * memory_of(submap_model(COLOURS[0])))
    assert scene.loaded == ()
    first = scene.model(0)
    assert scene.model(0) is first
    scene.model(1)
    scene.model(0)
    scene.model(2)
    assert scene.loaded == (0, 2)
    assert scene.model(0) is first


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
