"""Gains per image: their gradient against finite differences, and that they find what a metering camera did."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nvsim.training.config import TrainingConfig
from nvsim.training.floor_paint import initial_floor_paint
from nvsim.training.initialize import initial_gaussians
from nvsim.training.model_fit import HOLD, Exposure, ModelFit
from nvsim.training.synthetic import synthetic_room


def test_gradient_by_the_gains_is_that_of_finite_differences():
    rng = np.random.default_rng(0)
    rgb, background = rng.random((6, 5, 3)).astype("f4"), rng.random((3, 6, 5)).astype("f4")
    d_rgb, d_background = rng.normal(size=(6, 5, 3)).astype("f4"), rng.normal(size=(3, 6, 5)).astype("f4")
    log_gain = np.array([0.2, -0.1, 0.05])

    def loss(at):
        gain = np.exp(at)
        held = HOLD * (at**2).sum() / 2
        return (d_rgb * gain * rgb).sum() + (d_background * gain[:, None, None] * background).sum() + held

    expected = [(loss(log_gain + h) - loss(log_gain - h)) / 2e-4 for h in 1e-4 * np.eye(3)]
    exposure = Exposure(2, 0.0)
    exposure.log_gains[1] = log_gain
    exposed, behind = rgb.copy(), background.copy()
    exposure.apply(1, exposed, behind)
    back = d_rgb.copy(), d_background.copy()
    exposure.learn(1, exposed, behind, *back)
    np.testing.assert_allclose(exposure.state()["exposure.first"][1] / 0.1, expected, rtol=2e-4)
    np.testing.assert_allclose(back[0], d_rgb * np.exp(log_gain), rtol=1e-5)
    np.testing.assert_allclose(back[1], d_background * np.exp(log_gain)[:, None, None], rtol=1e-5)
    assert not exposure.log_gains[0].any()


def test_learned_gains_are_those_of_a_camera_that_meters_as_it_goes():
    room, rng = synthetic_room(8, 64, 48, 3000), np.random.default_rng(1)
    gains = np.exp(rng.uniform(-0.3, 0.3, 8))
    views = [
        replace(v, image=np.clip(np.round(v.image * g), 0, 255).astype(np.uint8))
        for v, g in zip(room.views, gains, strict=True)
    ]
    config = replace(TrainingConfig(steps=400, gaussian_cap=3000, exposure=True), coarse_share=0.0)
    start = initial_gaussians(views, room.cloud, room.floor, config, rng)
    fit = ModelFit(start, *initial_floor_paint(views, room.floor, config, 0), room.floor, config, len(views))
    inlier = np.ones((48, 64), np.bool_)
    for step in range(1, config.steps + 1):
        index = step % len(views)
        fit.differentiate(views[index], inlier, 1, index)
        fit.move(step)
    found = fit.exposure.log_gains.mean(axis=1)
    truth = np.log(gains)
    assert np.corrcoef(found, truth)[0, 1] > 0.95
    assert np.abs(found - truth).mean() < 0.1
