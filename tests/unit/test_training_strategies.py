"""How a model grows: the cap, the selected Gaussians, and the look of two Gaussians that replace one."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.types import Gaussians
from nvsim.training.config import TrainingConfig, preset
from nvsim.training.initialize import gaussians_at
from nvsim.training.strategies.adaptive import Adaptive, Capped
from nvsim.training.strategies.choice import strategy_of
from nvsim.training.strategies.config import AdaptiveConfig, CappedConfig, DensifyConfig, McmcConfig
from nvsim.training.strategies.division import divide, find_removable, opacities, split
from nvsim.training.strategies.mcmc import Mcmc, relocate_opacities
from nvsim.training.strategies.types import Refinement

FLOOR = FloorSurface.flat(0.0)


class FakeModel:
    """Performs the changes of Gaussians of a training, without training."""

    def __init__(self, gaussians: Gaussians, rng: np.random.Generator) -> None:
        self.gaussians, self._rng = gaussians, rng
        self.forgotten: list[str] = []
        self.clear()

    def clear(self) -> None:
        g, n = self.gaussians, len(self.gaussians)
        self.gradients = Gaussians(*(np.zeros_like(a) for a in arrays(g)))
        self.sums = np.column_stack([self._rng.random(n), np.ones(n), self._rng.random(n)]).astype(np.float32)

    def refine(self, refinement: Refinement) -> None:
        pairs = zip(arrays(self.gaussians), arrays(refinement.born), strict=True)
        self.gaussians = Gaussians(*(np.concatenate([old[refinement.kept], born]) for old, born in pairs))
        self.clear()

    def reset_moments(self, name: str) -> None:
        self.forgotten.append(name)


def arrays(g: Gaussians) -> list[np.ndarray]:
    return [g.means, g.log_scales, g.quats, g.opacity_logits, g.sh]


def some_gaussians(count: int, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)
    made = gaussians_at(rng.uniform(0.5, 3, (count, 3)).astype(np.float32), rng.random((count, 3)), 1)
    made.quats[:] = rng.normal(size=(count, 4))
    made.log_scales += rng.normal(0, 0.3, (count, 3)).astype(np.float32)
    made.opacity_logits += rng.normal(0, 2, count).astype(np.float32)
    return made


def capped(growth: float = 0.1, cap: int = 1000) -> Capped:
    return Capped(DensifyConfig(capped=CappedConfig(growth=growth)), 100, cap, FLOOR)


@settings(max_examples=60, deadline=None)
@given(
    strategy=st.sampled_from(["capped", "adaptive", "mcmc", "none"]),
    count=st.integers(1, 300),
    cap=st.integers(100, 320),
    growth=st.floats(0, 3),
    faint=st.floats(0, 1),
    seed=st.integers(0, 100),
)
def test_the_cap_is_never_exceeded(strategy: str, count: int, cap: int, growth: float, faint: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    gaussians = some_gaussians(min(count, cap), seed)
    gaussians.opacity_logits[rng.random(len(gaussians)) < faint] = -9
    densify = DensifyConfig(
        strategy,
        every=2,
        start=0.0,
        stop=1.0,
        capped=CappedConfig(growth=growth),
        adaptive=AdaptiveConfig(reset=0.25, pause=0.05),
        mcmc=McmcConfig(growth=growth),
    )
    chosen = strategy_of(TrainingConfig(steps=20, gaussian_cap=cap, densify=densify), FLOOR, rng)
    model = FakeModel(gaussians, rng)
    for step in range(1, 21):
        chosen.before_update(model, step)
        chosen.after_update(model, step)
        assert len(model.gaussians) <= cap
        assert len({len(a) for a in arrays(model.gaussians)}) == 1


def test_the_neediest_gaussians_are_divided() -> None:
    gaussians, gradient = some_gaussians(200), np.linspace(0, 1, 200).astype(np.float32)
    gaussians.opacity_logits[:] = 0
    done = capped(0.1).refined(gaussians, gradient, True)
    np.testing.assert_array_equal(done.kept, np.arange(180))
    assert len(done.born) == 40
    assert len(capped(0.1).refined(gaussians, gradient, False).born) == 0


def test_faint_vast_broken_and_sunk_gaussians_are_removed() -> None:
    gaussians = some_gaussians(50)
    gaussians.opacity_logits[:] = 0
    gaussians.opacity_logits[3] = -6
    gaussians.log_scales[5, 1] = 2.0
    gaussians.means[7, 0] = np.nan
    gaussians.means[9, 2] = -0.2
    gaussians.opacity_logits[11] = np.nan
    assert set(np.flatnonzero(find_removable(gaussians, 0.02, 1.0, FLOOR))) == {3, 5, 7, 9, 11}
    assert set(np.flatnonzero(find_removable(gaussians, 0.02, 1.0, None))) == {3, 5, 7, 11}


def test_two_halves_lie_on_the_longest_axis_and_let_through_what_one_did() -> None:
    gaussians = gaussians_at(np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 1.0]], np.float32), np.full((2, 3), 0.5), 0)
    gaussians.log_scales[:] = np.log([0.1, 0.4, 0.2])
    gaussians.opacity_logits[:] = 1.0
    halves = divide(gaussians, np.array([0]))
    np.testing.assert_allclose(halves.means, [[1.0, 1.8, 3.0], [1.0, 2.2, 3.0]], atol=1e-6)
    assert np.prod(1 - opacities(halves)) == pytest.approx(1 - 1 / (1 + np.exp(-1.0)), rel=1e-5)


def test_the_parts_of_a_split_are_drawn_from_the_gaussian() -> None:
    one = gaussians_at(np.array([[1.0, 2.0, 3.0]], np.float32), np.full((1, 3), 0.5), 0)
    one.log_scales[:] = np.log([0.05, 0.4, 0.2])
    one.quats[:] = [[np.cos(0.3), 0, 0, np.sin(0.3)]]
    parts = split(one, np.zeros(20_000, np.int64), np.random.default_rng(0))
    turn = np.array([[np.cos(0.6), -np.sin(0.6), 0], [np.sin(0.6), np.cos(0.6), 0], [0, 0, 1]])
    covariance = turn @ np.diag([0.05, 0.4, 0.2]) ** 2 @ turn.T
    np.testing.assert_allclose(np.cov(parts.means.T), covariance, atol=4e-3)
    np.testing.assert_allclose(parts.log_scales[0], np.log(np.array([0.05, 0.4, 0.2]) / 1.6), rtol=1e-5)


def adaptive(cap: int = 10_000, **rules: float) -> Adaptive:
    settings = AdaptiveConfig(**{"screen_stop": 0.6, "reset": 0.2, "pause": 0.05, **rules})
    config = DensifyConfig("adaptive", every=10, start=0.1, stop=0.8, prune_opacity=0.1, adaptive=settings)
    return Adaptive(config, 100, cap, FLOOR, np.random.default_rng(3))


@pytest.mark.parametrize("step", [5, 30, 70, 95])
def test_clone_split_and_cull_follow_the_rules_one_gaussian_at_a_time(step: int) -> None:
    gaussians, rng = some_gaussians(400, 4), np.random.default_rng(5)
    gaussians.log_scales += rng.normal(0, 1, (400, 1)).astype(np.float32)
    sums = np.column_stack([rng.uniform(0, 4e-3, 400), rng.integers(0, 4, 400), rng.uniform(0, 0.2, 400)])
    done = adaptive().refined(gaussians, sums.astype(np.float32), step)
    kept, cloned, halved = [], [], []
    for i in range(400):
        opacity, largest = 1 / (1 + np.exp(-gaussians.opacity_logits[i])), np.exp(gaussians.log_scales[i].max())
        if opacity <= 0.1 or largest >= 1.0 or (20 < step <= 60 and sums[i, 2] > 0.15):
            continue
        needy, wide = sums[i, 0] / max(sums[i, 1], 1) > 8e-4, step <= 60 and sums[i, 2] > 0.05
        if 10 <= step <= 80 and wide or 10 <= step <= 80 and needy and largest > 0.05:
            halved.append(i)
            continue
        kept.append(i)
        if 10 <= step <= 80 and needy:
            cloned.append(i)
    np.testing.assert_array_equal(done.kept, kept)
    assert len(done.born) == len(cloned) + 2 * len(halved)
    np.testing.assert_array_equal(done.born.means[: len(cloned)], gaussians.means[cloned])
    np.testing.assert_array_equal(done.born.sh[len(cloned) :], np.tile(gaussians.sh[halved], (2, 1, 1)))


def test_under_a_cap_the_neediest_are_cloned_and_split() -> None:
    gaussians = some_gaussians(100)
    gaussians.opacity_logits[:] = 2
    sums = np.column_stack([np.linspace(0.001, 1, 100), np.ones(100), np.zeros(100)]).astype(np.float32)
    done = adaptive(cap=110).refined(gaussians, sums, 30)
    assert done.count == 110
    assert set(range(90)) <= set(done.kept)


def test_a_reset_dims_keeps_the_order_and_growth_rests_after_it() -> None:
    strategy, model = adaptive(), FakeModel(some_gaussians(200), np.random.default_rng(0))
    model.gaussians.means[:, 2] += 1
    before = model.gaussians.opacity_logits.copy()
    assert [s for s in range(1, 101) if strategy.is_reset_due(s)] == [20, 40, 60, 80]
    assert [s for s in range(1, 101) if strategy.is_paused(s)] == [s + i for s in (20, 40, 60, 80) for i in range(1, 6)]
    model.sums[:] = 0
    strategy.after_update(replace_every(model, strategy), 20)
    limit = np.float32(np.log(0.2 / 0.8))
    np.testing.assert_array_equal(model.gaussians.opacity_logits, np.minimum(before, limit))
    assert model.forgotten == ["opacity_logits"]
    order = np.argsort(before, kind="stable")
    assert all(a <= b for a, b in pairwise(model.gaussians.opacity_logits[order]))


def replace_every(model: FakeModel, strategy: Adaptive) -> FakeModel:
    """So that step 20 is no refinement."""
    strategy._config = replace(strategy._config, every=7)
    return model


@pytest.mark.parametrize(("opacity", "count"), [(0.1, 2), (0.5, 2), (0.9, 3), (0.99, 5), (0.7, 12), (0.95, 51)])
def test_relocated_gaussians_cover_what_one_did(opacity: float, count: int) -> None:
    each, shrink = relocate_opacities(np.array([opacity]), np.array([count]))
    x, sigma = np.linspace(-40, 40, 400_001), 1.7
    one = opacity * np.exp(-(x**2) / (2 * sigma**2))
    several = 1 - (1 - each[0] * np.exp(-(x**2) / (2 * (shrink[0] * sigma) ** 2))) ** count
    assert several.max() == pytest.approx(one.max(), rel=1e-6)
    assert several.sum() == pytest.approx(one.sum(), rel=1e-6)


def test_a_gaussian_that_nothing_joins_stays_as_it_is() -> None:
    each, shrink = relocate_opacities(np.array([0.3, 0.8]), np.array([1, 1]))
    np.testing.assert_allclose(each, [0.3, 0.8], rtol=1e-12)
    np.testing.assert_allclose(shrink, 1, rtol=1e-12)


def mcmc(rng: np.random.Generator, cap: int = 100_000, **settings: float) -> Mcmc:
    return Mcmc(DensifyConfig("mcmc", mcmc=McmcConfig(**settings)), 100, cap, FLOOR, rng, 5e-4, 5e-5)


def test_dead_gaussians_move_to_live_ones_by_opacity_and_none_is_lost() -> None:
    gaussians = some_gaussians(4000)
    gaussians.opacity_logits[:] = -9
    gaussians.opacity_logits[:2] = np.log([0.2 / 0.8, 0.6 / 0.4])
    done = mcmc(np.random.default_rng(0), growth=0.0).refined(gaussians)
    assert done.count == 4000 and len(done.kept) == 0
    places = (done.born.means == gaussians.means[1]).all(axis=1).mean()
    assert places == pytest.approx(0.75, abs=0.03)
    assert len(mcmc(np.random.default_rng(0), growth=0.05).refined(gaussians).born) == 4200


def test_noise_has_the_shape_of_the_gaussian_and_spares_opaque_ones() -> None:
    one = gaussians_at(np.array([[1.0, 2.0, 3.0]], np.float32), np.full((1, 3), 0.5), 0)
    one.log_scales[:] = np.log([0.05, 0.4, 0.2])
    one.opacity_logits[:] = -9
    many = Gaussians(*(np.repeat(a, 20_000, axis=0) for a in arrays(one)))
    noise = mcmc(np.random.default_rng(0)).noise(many, 10.0)
    gate = 1 / (1 + np.exp(100 * (1 / (1 + np.exp(9.0)) - 0.005)))
    np.testing.assert_allclose(noise.std(axis=0), 10 * gate * np.array([0.05, 0.4, 0.2]) ** 2, rtol=0.03)
    many.opacity_logits[:] = 0
    assert (mcmc(np.random.default_rng(0)).noise(many, 10.0) == 0).all()


def test_regularisation_is_the_slope_of_mean_opacity_and_size() -> None:
    model = FakeModel(some_gaussians(5), np.random.default_rng(0))
    mcmc(np.random.default_rng(0), opacity=0.3, scale=0.7).before_update(model, 1)
    h, g = 1e-3, model.gaussians

    def cost(logits: np.ndarray, scales: np.ndarray) -> float:
        return float(0.3 * (1 / (1 + np.exp(-logits))).mean() + 0.7 * np.exp(scales).mean())

    logits, scales = g.opacity_logits.astype(float), g.log_scales.astype(float)
    for i in range(5):
        up, down = logits.copy(), logits.copy()
        up[i] += h
        down[i] -= h
        assert model.gradients.opacity_logits[i] == pytest.approx(
            (cost(up, scales) - cost(down, scales)) / (2 * h), rel=1e-3
        )
        wide, narrow = scales.copy(), scales.copy()
        wide[i, 1] += h
        narrow[i, 1] -= h
        slope = (cost(logits, wide) - cost(logits, narrow)) / (2 * h)
        assert model.gradients.log_scales[i, 1] == pytest.approx(slope, rel=1e-3)


def test_without_a_strategy_nothing_changes() -> None:
    config = TrainingConfig(densify=DensifyConfig("none"))
    model = FakeModel(some_gaussians(50), np.random.default_rng(0))
    before = [a.copy() for a in arrays(model.gaussians)]
    for step in (1, 100, 200):
        strategy_of(config, FLOOR, np.random.default_rng(0)).after_update(model, step)
    assert all(np.array_equal(a, b) for a, b in zip(before, arrays(model.gaussians), strict=True))


def test_only_presets_that_know_the_floor_remove_what_lies_under_it() -> None:
    gaussians = some_gaussians(20)
    gaussians.opacity_logits[:] = 3
    gaussians.means[4, 2] = -1
    for name, count in (("3dgs", 20), ("splatfacto-w", 20), ("splatfacto-i", 19)):
        strategy = strategy_of(preset(name), FLOOR, np.random.default_rng(0))
        assert isinstance(strategy, Adaptive)
        assert len(strategy.refined(gaussians, np.zeros((20, 3), np.float32), 100).kept) == count
