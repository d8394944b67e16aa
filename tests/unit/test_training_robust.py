"""The two masks of transients."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from nvsim.training.config import RobustConfig
from nvsim.training.robust import BlockMask, QuantileMask, inliers

IMAGE = np.zeros((120, 160, 3), np.uint8)


def test_robust_mask_rejects_a_pasted_square_and_nothing_else() -> None:
    rng = np.random.default_rng(0)
    mask = BlockMask(RobustConfig(), 10, 3, 160, 120)
    for visit in range(4):
        error = rng.uniform(0, 0.06, (3, 120, 160) if visit % 2 else (3, 60, 80)).astype(np.float32)
        scale = error.shape[1] / 120
        error[:, int(40 * scale) : int(72 * scale), int(64 * scale) : int(96 * scale)] = 0.5
        mask.end(1, error)
    inlier = np.ones((120, 160), bool)
    mask.begin(10, 1, IMAGE, inlier)
    assert not inlier[40:72, 64:96].any()
    assert (~inlier).sum() <= (32 + 16) * (32 + 16)  # one block more on each side
    mask.begin(10, 0, IMAGE, inlier)  # a view that was never visited
    assert inlier.all()


def test_robust_mask_keeps_a_pattern_that_is_still_blurred() -> None:
    mask = BlockMask(RobustConfig(), 10, 1, 160, 120)
    error = np.zeros((3, 120, 160), np.float32)
    error[:, 40:72, 64:96] = np.where(np.indices((32, 32)).sum(axis=0) % 2, 0.5, -0.5)
    mask.end(0, error)
    inlier = np.ones((120, 160), bool)
    mask.begin(10, 0, IMAGE, inlier)
    assert inlier.all()


def test_robust_mask_leaves_an_image_alone_that_is_wrong_all_over() -> None:
    mask = BlockMask(RobustConfig(), 10, 1, 160, 120)
    mask.end(0, np.random.default_rng(0).uniform(0.2, 0.6, (3, 120, 160)).astype(np.float32))
    inlier = np.ones((120, 160), bool)
    mask.begin(10, 0, IMAGE, inlier)
    assert inlier.all()


def test_the_worst_share_is_masked_but_not_where_neighbors_are_right() -> None:
    error = np.random.default_rng(0).random((40, 60)).astype(np.float32)
    error[10:25, 20:40] += 3
    error[3, 3] = 5
    found = inliers(error, 0.2)
    good = error <= np.quantile(error, 0.8)
    votes = ndimage.convolve(good.astype(float), np.full((5, 5), 1 / 25), mode="constant")
    np.testing.assert_array_equal(found, good | (votes > 0.4))
    assert found[3, 3] and not found[14:21, 24:36].any()


def test_the_share_follows_the_mean_error_between_its_extremes() -> None:
    mask = QuantileMask(RobustConfig(kind="quantile", start=0.0, renewal=0.5), 100)
    clear, black = np.ones((120, 160), np.float32), np.zeros((120, 160, 3), np.float32)
    for step, shade in ((1, 0.5), (2, 0.1), (3, 0.3)):
        inlier = np.ones((120, 160), bool)
        judge = mask.begin(step, 0, IMAGE, inlier)
        judge(black, clear, np.full((3, 120, 160), shade, np.float32))
    np.testing.assert_allclose(mask.extremes, [0.5, 0.1], atol=1e-6)
    assert abs(mask.share(0.3) - 0.2) < 1e-4
    other = QuantileMask(RobustConfig(kind="quantile"), 100)
    other.restore(mask.state())
    assert other.share(0.3) == mask.share(0.3)
    mask.begin(50, 0, IMAGE, inlier)(black, clear, np.full((3, 120, 160), 0.2, np.float32))
    np.testing.assert_allclose(mask.extremes, [0.2, 0.1], atol=1e-6)
