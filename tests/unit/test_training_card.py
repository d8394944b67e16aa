"""Training with the Gaussians on a card, held to training on the CPU; gsplat's torch reference stands in for a card."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from gsplat_reference import INSTALLED, stand_in

from nvsim.errors import InputError
from nvsim.events import Event, Metric
from nvsim.render import backends
from nvsim.render.sky import pack_camera
from nvsim.training import trainer
from nvsim.training.appearance import in_view, mark_in_view
from nvsim.training.checkpoint import fingerprint
from nvsim.training.config import TrainingConfig, preset
from nvsim.training.devices import choice
from nvsim.training.devices.card import CardGroup
from nvsim.training.floor_paint import initial_floor_paint
from nvsim.training.initialize import initial_gaussians
from nvsim.training.model_fit import ModelFit
from nvsim.training.optimizer import ParameterGroup
from nvsim.training.strategies.choice import strategy_of
from nvsim.training.synthetic import SyntheticRoom, synthetic_room

needs_gsplat = pytest.mark.skipif(not INSTALLED, reason="gsplat is not installed")
WIDTH, HEIGHT = 40, 30


@pytest.fixture(scope="module")
def room() -> SyntheticRoom:
    return synthetic_room(6, WIDTH, HEIGHT, 400)


@pytest.fixture
def use_card(monkeypatch: pytest.MonkeyPatch) -> Callable[[bool], None]:
    stand_in(monkeypatch)

    def use(card: bool) -> None:
        monkeypatch.setattr(choice, "gpu_name", lambda device: "cpu" if card else None)

    return use


def small(name: str, **changes: object) -> TrainingConfig:
    config = dataclasses.replace(preset(name), steps=200, gaussian_cap=150, coarse_share=0.0, threads=1)
    return dataclasses.replace(config, **changes)  # type: ignore[arg-type]


def fit_of(room: SyntheticRoom, config: TrainingConfig) -> ModelFit:
    start = initial_gaussians(room.views, room.cloud, room.floor, config, np.random.default_rng(0))
    paint = initial_floor_paint(room.views, room.floor, config, 0)
    return ModelFit(start, *paint, room.floor, config, len(room.views))


@needs_gsplat
@pytest.mark.parametrize("name", ["nvsim", "splatfacto-i", "3dgs"])
def test_a_step_on_the_card_is_a_step_on_the_cpu(
    room: SyntheticRoom, use_card: Callable[[bool], None], name: str
) -> None:
    config = small(name, exposure=name == "nvsim")
    fits = []
    for card in (False, True):
        use_card(card)
        fits.append(fit_of(room, config))
    cpu, card_ = fits
    inlier = np.ones((HEIGHT, WIDTH), np.bool_)
    for step in range(1, 4):
        index = step % len(room.views)
        values = [f.differentiate(room.views[index], inlier, config.sh_degree, index) for f in fits]
        assert values[1].total == pytest.approx(values[0].total, rel=2e-3)
        if step == 1:
            for field in ("means", "log_scales", "quats", "opacity_logits"):
                a, b = (getattr(f.held.gradients, field) for f in fits)
                assert np.linalg.norm(a - b) < 0.02 * np.linalg.norm(a) + 1e-7, field  # round ones do not turn
            for group in cpu.groups:
                a, b = (f.groups[group].gradient for f in fits)
                assert np.linalg.norm(a - b) <= 0.02 * np.linalg.norm(a) + 1e-7, group
            np.testing.assert_allclose(
                card_.held.sums[:, 0], cpu.held.sums[:, 0], rtol=0.05, atol=0.02 * cpu.held.sums[:, 0].max()
            )
        for f in fits:
            f.move(step)
    a, b = (f.state() for f in fits)
    assert a.keys() == b.keys() and all(a[n].shape == b[n].shape and a[n].dtype == b[n].dtype for n in a)
    for name_ in ("means.values", "log_scales.values", "features.values"):
        if name_ in a:
            # Adam's first steps go by the sign of a gradient, which rounding may turn where it is almost nothing.
            assert np.mean(np.abs(a[name_] - b[name_]) > 1e-3) < 0.02, name_


@needs_gsplat
@pytest.mark.parametrize(("name", "strategy"), [("nvsim", "capped"), ("splatfacto-i", "adaptive"), ("nvsim", "mcmc")])
def test_strategies_change_what_is_on_the_card(
    room: SyntheticRoom, use_card: Callable[[bool], None], name: str, strategy: str
) -> None:
    use_card(True)
    base = small(name)
    densify = dataclasses.replace(base.densify, strategy=strategy, every=4, start=0.0, prune_opacity=0.005)
    adaptive = dataclasses.replace(densify.adaptive, reset=0.02, gradient=1e-6, pause=0.0)
    config = dataclasses.replace(base, densify=dataclasses.replace(densify, adaptive=adaptive), seed_share=0.5)
    fit, rng = fit_of(room, config), np.random.default_rng(1)
    strategy_, inlier = strategy_of(config, room.floor, rng), np.ones((HEIGHT, WIDTH), np.bool_)
    before = len(fit.held)
    for step in range(1, 5):
        fit.differentiate(room.views[step], inlier, config.sh_degree, step)
        strategy_.before_update(fit.held, step)
        fit.move(step)
        strategy_.after_update(fit.held, step)
    assert before < len(fit.held) <= config.gaussian_cap
    shapes = {n: len(a) for n, a in fit.held.state().items()}
    assert set(shapes.values()) == {len(fit.held)}
    left = fit.gaussians.opacity_logits
    left[:] = -3.0  # as a reset does, in place
    np.testing.assert_array_equal(fit.state()["opacity_logits.values"], np.float32(-3.0))
    fit.held.reset_moments("opacity_logits")
    assert not fit.state()["opacity_logits.second"].any()


@needs_gsplat
@pytest.mark.parametrize("first_on_card", [False, True])
def test_a_run_goes_on_on_the_other_device(
    room: SyntheticRoom, use_card: Callable[[bool], None], tmp_path: Path, first_on_card: bool
) -> None:
    config = small("nvsim", steps=60, checkpoint_seconds=0.0)
    use_card(first_on_card)
    path = tmp_path / "checkpoint.npz"
    stop_after(30, config, room, path)
    use_card(not first_on_card)
    heard: list[Event] = []
    model = trainer.train_submap(room.views, room.cloud, room.floor, config, checkpoint=path, listen=heard.append)
    steps = [e.step for e in heard if isinstance(e, Metric) and e.name == "loss"]
    assert min(steps) > 30
    use_card(False)
    path.unlink()
    whole = trainer.train_submap(room.views, room.cloud, room.floor, config)
    assert len(model.gaussians) == pytest.approx(len(whole.gaussians), rel=0.1)
    assert model.info["training_psnr"] == pytest.approx(whole.info["training_psnr"], abs=0.5)


def stop_after(steps: int, config: TrainingConfig, room: SyntheticRoom, path: Path) -> None:
    run = trainer._TrainingRun(room.views, room.cloud, room.floor, config, 0, 0, lambda event: None)
    run.save_to(path, fingerprint(room.views, room.cloud, room.floor, config, 0))
    while run._step < steps:
        run._advance()
    run._save(path)


def test_adam_on_the_card_is_that_of_the_cpu() -> None:
    r = np.random.default_rng(0)
    start, rates = r.normal(size=(7, 4, 3)).astype(np.float32), r.random(12).astype(np.float32)
    ours, theirs = ParameterGroup.of(start.copy(), rates), CardGroup.of(start, rates, "cpu")
    for count in range(1, 6):
        slope = r.normal(size=start.shape).astype(np.float32)
        ours.gradient[:] = slope
        theirs.values.grad = torch.from_numpy(slope.copy())
        ours.step(count, 0.9)
        theirs.step(count, 0.9)
    np.testing.assert_allclose(theirs.values.detach().numpy(), ours.values, rtol=1e-4, atol=1e-5)


def test_the_card_leaves_out_what_the_cpu_leaves_out(room: SyntheticRoom) -> None:
    r = np.random.default_rng(0)
    means, log_scales = r.uniform(-4, 8, (4000, 3)).astype(np.float32), r.uniform(-5, 0, (4000, 3)).astype(np.float32)
    camera, seen = room.views[0].camera, np.zeros(4000, np.bool_)
    mark_in_view(means, log_scales, pack_camera(camera), np.array([WIDTH, HEIGHT], np.float32), seen)
    found = in_view(torch.from_numpy(means), torch.from_numpy(log_scales), camera).numpy()
    assert 0 < seen.sum() < 4000
    assert (found != seen).sum() <= 2  # at the rim, by rounding


def test_a_card_that_is_not_there_is_one_sentence(monkeypatch: pytest.MonkeyPatch, room: SyntheticRoom) -> None:
    monkeypatch.setattr(choice, "missing_for_gsplat", lambda: "PyTorch sees no CUDA card")
    assert choice.gpu_name("auto") is None and choice.gpu_name("cpu") is None
    config = small("3dgs", device="cuda")
    with pytest.raises(InputError, match="no CUDA card.*--device cpu"):
        trainer.train_submap(room.views, room.cloud, room.floor, config)
    monkeypatch.setattr(choice, "missing_for_gsplat", lambda: None)
    assert choice.gpu_name("auto") == choice.gpu_name("cuda") == "cuda"
    assert backends.missing_for_gsplat is not None


def test_the_device_is_no_part_of_what_a_checkpoint_belongs_to(room: SyntheticRoom) -> None:
    keys = {fingerprint(room.views, None, room.floor, small("nvsim", device=d), 0) for d in ("auto", "cpu", "cuda")}
    assert len(keys) == 1
