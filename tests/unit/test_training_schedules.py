"""Image sizes and SH degrees over a run, and the alpha loss of the ablation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from nvsim.training.config import TrainingConfig, preset
from nvsim.training.loss.alpha import alpha_loss
from nvsim.training.trainer import count_halvings, sh_degree_at


def test_images_double_in_equal_spans_until_they_are_whole() -> None:
    config = TrainingConfig(coarse_share=0.4, coarse_levels=2)
    assert [count_halvings(config, s) for s in (0.0, 0.19, 0.21, 0.39, 0.4, 0.9)] == [2, 2, 1, 1, 0, 0]
    assert count_halvings(TrainingConfig(coarse_share=0.0), 0.0) == 0
    assert count_halvings(TrainingConfig(coarse_levels=0), 0.0) == 0


def test_degrees_join_one_after_another() -> None:
    config = preset("3dgs")
    assert [sh_degree_at(config, k / 30 + 1e-9) for k in range(6)] == [0, 1, 2, 3, 3, 3]
    assert sh_degree_at(TrainingConfig(sh_degree=2, sh_interval=0.0), 0.0) == 2


def test_alpha_loss_counts_alpha_where_the_background_is_right() -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (30, 40, 3)).astype(np.uint8)
    background = np.ascontiguousarray(image.transpose(2, 0, 1) / np.float32(255))
    background[:, 10:20, 5:25] += 0.1
    background[:, 25, 30] += 0.1  # a single pixel is outvoted
    alpha, slope = rng.random((30, 40), np.float32), np.ones((30, 40), np.float32)
    value = alpha_loss(alpha, background, image, 0.15, slope)
    right = np.abs(background - image.transpose(2, 0, 1) / 255).mean(axis=0) < 0.003
    where = ndimage.convolve(right.astype(float), np.full((3, 3), 1 / 9), mode="constant") > 0.6
    assert where[25, 30] and not where[12:18, 8:22].any()
    assert value == pytest.approx(0.15 * (alpha * where).sum() / alpha.size, rel=1e-5)
    np.testing.assert_allclose(slope, 1 + 0.15 * where / alpha.size, rtol=1e-6)
