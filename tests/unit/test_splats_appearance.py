"""Appearance without torch: compare with the formulas, test the cache between calls, and read a model folder back."""

from __future__ import annotations

import json

import numpy as np
import pytest

from nvsim.errors import InputError
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.appearance import LinearAppearance, NetworkAppearance
from nvsim.splats.files import load_model, save_model
from nvsim.splats.scene import memory_of
from nvsim.splats.types import Embedding, Gaussians, SubmapModel

MIDDLE = np.array([1.0, 2.0, 1.3])
E, F, N = 5, 3, 40


def random(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng([seed, *shape]).normal(size=shape).astype(np.float32)


def gaussians() -> Gaussians:
    return Gaussians(random(N, 3), random(N, 3), random(N, 4), random(N), random(N, 4, 3))


def position_embedding() -> Embedding:
    weights = {"embed.0.weight": random(16, 27), "embed.0.bias": random(16)}
    return Embedding({**weights, "embed.1.weight": random(E, 16), "embed.1.bias": random(E)})


def index_embedding(nearest: bool) -> Embedding:
    return Embedding({"index.vectors": random(6, E), "index.positions": random(6, 3)}, nearest=nearest)


def linear() -> LinearAppearance:
    weights = {"matrix.weight": random(3 * F, E), "matrix.bias": random(3 * F)}
    return LinearAppearance(position_embedding(), weights, random(N, F), MIDDLE)


def network(cell: float = 0.1) -> NetworkAppearance:
    weights = {}
    for name, out, inputs in (("colour.0", 12, E + F), ("colour.1", 7, 12), ("base", 3, 7), ("rest", 9, 7)):
        weights |= {f"{name}.weight": random(out, inputs), f"{name}.bias": random(out)}
    return NetworkAppearance(position_embedding(), weights, random(N, F), MIDDLE, cell)


def model(appearance: LinearAppearance | NetworkAppearance) -> SubmapModel:
    return SubmapModel(gaussians(), None, None, FloorSurface.flat(0.0), appearance=appearance)


def test_an_index_embedding_is_the_mean_or_that_of_the_nearest_camera() -> None:
    mean, nearest = index_embedding(False), index_embedding(True)
    np.testing.assert_allclose(mean.at(MIDDLE), mean.weights["index.vectors"].mean(axis=0), rtol=1e-6)
    place = nearest.weights["index.positions"][4] + 1e-3
    np.testing.assert_array_equal(nearest.at(place), nearest.weights["index.vectors"][4])


def test_linear_colors_add_the_matrix_times_the_features_at_every_position() -> None:
    appearance, g = linear(), gaussians()
    before = g.sh.copy()
    for place in (MIDDLE, MIDDLE + 0.01, MIDDLE + 2):
        e = appearance.embedding.at(place).astype(np.float64)
        matrix = (appearance.weights["matrix.weight"] @ e + appearance.weights["matrix.bias"]).reshape(3, F)
        expected = before.copy()
        expected[:, 0] += appearance.features @ matrix.T
        found = appearance.colored(g, place)
        np.testing.assert_allclose(found.sh, expected, atol=1e-5)
        assert found.means is g.means
    np.testing.assert_array_equal(g.sh, before)


def test_the_color_network_is_evaluated_where_the_camera_is_and_ignores_own_colors() -> None:
    appearance, g = network(cell=0.0), gaussians()
    w, e = appearance.weights, appearance.embedding.at(MIDDLE)
    for n in (0, 17, N - 1):
        h = np.concatenate([e, appearance.features[n]]).astype(np.float64)
        for layer in ("colour.0", "colour.1"):
            h = np.maximum(w[f"{layer}.weight"] @ h + w[f"{layer}.bias"], 0)
        found = appearance.colored(g, MIDDLE).sh[n]
        np.testing.assert_allclose(found[0], w["base.weight"] @ h + w["base.bias"], rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(found[1:].ravel(), w["rest.weight"] @ h + w["rest.bias"], rtol=1e-4, atol=1e-5)


def test_within_a_cell_the_colors_are_those_of_its_center_and_do_not_depend_on_the_way() -> None:
    appearance, exact, g = network(), network(cell=0.0), gaussians()
    first = appearance.colored(g, np.array([1.01, 2.02, 1.33])).sh.copy()
    appearance.colored(g, np.array([3.0, 0.0, 1.0]))
    again = appearance.colored(g, np.array([1.09, 2.07, 1.38])).sh
    np.testing.assert_array_equal(first, again)
    np.testing.assert_allclose(first, exact.colored(g, np.array([1.05, 2.05, 1.35])).sh, atol=1e-5)


@pytest.mark.parametrize("make", [linear, network])
def test_baked_gaussians_are_those_of_the_middle_and_stay(make) -> None:
    whole = model(make())
    baked = whole.baked()
    expected = whole.gaussians_at(MIDDLE).sh.copy()
    whole.gaussians_at(MIDDLE + 3)
    np.testing.assert_array_equal(baked.sh, expected)


@pytest.mark.parametrize("make", [linear, network])
def test_a_model_folder_brings_the_appearance_back(make, tmp_path) -> None:
    saved = model(make())
    save_model(saved, tmp_path / "model")
    found = load_model(tmp_path / "model")
    for place in (MIDDLE, MIDDLE + 2):
        np.testing.assert_array_equal(found.gaussians_at(place).sh, saved.gaussians_at(place).sh)
    np.testing.assert_array_equal(found.appearance.middle, MIDDLE)
    assert memory_of(found) == memory_of(saved) > memory_of(SubmapModel(gaussians(), None, None, saved.floor))


def test_a_model_written_before_there_was_appearance_loads(tmp_path) -> None:
    save_model(SubmapModel(gaussians(), None, None, FloorSurface.flat(0.0)), tmp_path / "model")
    path = tmp_path / "model" / "model.json"
    data = json.loads(path.read_text())
    del data["appearance"]
    path.write_text(json.dumps(data))
    assert load_model(tmp_path / "model").appearance is None


def test_an_unknown_kind_of_appearance_is_refused(tmp_path) -> None:
    save_model(model(linear()), tmp_path / "model")
    path = tmp_path / "model" / "model.json"
    path.write_text(path.read_text().replace('"kind": "linear"', '"kind": "other"'))
    with pytest.raises(InputError, match="damaged"):
        load_model(tmp_path / "model")
