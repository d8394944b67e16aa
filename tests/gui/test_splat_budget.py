"""Fewer Gaussians: the choice of the Gaussians, and the values that belong to them."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np

from nvsim.benchmarks.random_room import random_room
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.appearance import LinearAppearance
from nvsim.splats.types import Embedding, SubmapModel
from nvsim_app.drawing.renderer_choice import SplatBudget, largest_gaussians


def model(count: int = 500) -> SubmapModel:
    return SubmapModel(random_room(count), None, None, FloorSurface.flat(0.0))


def test_the_ones_that_cover_most_stay_in_their_order() -> None:
    g = random_room(400)
    rows = largest_gaussians(g, 100)
    opacity = 1 / (1 + np.exp(-g.opacity_logits.astype(float)))
    extents = np.sort(np.exp(g.log_scales.astype(float)), axis=1)
    cover = opacity * extents[:, 1] * extents[:, 2]
    assert (np.diff(rows) > 0).all() and len(rows) == 100
    left_out = np.setdiff1d(np.arange(400), rows)
    assert cover[rows].min() >= cover[left_out].max() * (1 - 1e-5)


def test_no_budget_and_a_large_one_change_nothing() -> None:
    m, budget = model(), SplatBudget()
    assert budget.limit_model(m, 0) is m and budget.limit_model(m, 500) is m


def test_the_thinned_model_is_kept_until_model_or_budget_change() -> None:
    m, budget = model(), SplatBudget()
    few = budget.limit_model(m, 50)
    assert len(few.gaussians) == 50 and budget.limit_model(m, 50) is few
    assert len(budget.limit_model(m, 60).gaussians) == 60
    assert budget.limit_model(model(), 60) is not budget.limit_model(m, 60)


def test_colors_that_depend_on_the_position_stay_with_their_gaussians() -> None:
    m = model()
    rng = np.random.default_rng(0)
    embedding = Embedding.__new__(Embedding)
    appearance = LinearAppearance(embedding, {}, rng.random((500, 3)).astype(np.float32), np.zeros(3))
    appearance._kept.sh = "of all"
    few = SplatBudget().limit_model(replace(m, appearance=appearance), 50)
    rows = largest_gaussians(m.gaussians, 50)
    assert few.appearance is not None
    assert np.array_equal(few.appearance.features, appearance.features[rows])
    assert isinstance(few.appearance._kept, threading.local) and not hasattr(few.appearance._kept, "sh")
