"""The loss and its gradients against torch's own arithmetic and against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from nvsim.training.config import LossConfig
from nvsim.training.loss.floor_aware import FloorAwareLoss
from nvsim.training.loss.ssim import RADIUS, SEGMENT, STRIP, TAPS, planes, ssim_forward, ssim_gradient, tiles

HEIGHT, WIDTH = 19, 27
PIXELS = HEIGHT * WIDTH
ONLY_NOTHING = LossConfig(ssim=0.0, suppression=0.0, floor=0.0, fill=0.0)


def blur(image: torch.Tensor) -> torch.Tensor:
    taps = torch.from_numpy(TAPS).to(image)
    window = (taps[:, None] * taps[None, :]).expand(image.shape[1], 1, 11, 11)
    return torch.nn.functional.conv2d(image, window, groups=image.shape[1], padding=5)


def mean_ssim(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Of planar images (3, H, W), written out plainly."""
    a, b = a[None], b[None]
    mean_a, mean_b = blur(a), blur(b)
    variance_a, variance_b = blur(a * a) - mean_a**2, blur(b * b) - mean_b**2
    covariance = blur(a * b) - mean_a * mean_b
    numerator = (2 * mean_a * mean_b + 0.01**2) * (2 * covariance + 0.03**2)
    return (numerator / ((mean_a**2 + mean_b**2 + 0.01**2) * (variance_a + variance_b + 0.03**2))).mean()


class Sample:
    """Random images, a floor in the lower third, a transient in a corner."""

    def __init__(self) -> None:
        rng = np.random.default_rng(3)
        self.rgb = rng.random((HEIGHT, WIDTH, 3), np.float32)
        self.alpha = rng.random((HEIGHT, WIDTH), np.float32)
        self.background = rng.random((3, HEIGHT, WIDTH), np.float32)
        self.image = rng.integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
        self.floor = np.zeros((HEIGHT, WIDTH), bool)
        self.floor[12:] = True
        self.inlier = np.ones((HEIGHT, WIDTH), bool)
        self.inlier[8:15, :6] = False
        self.doubtful: np.ndarray | None = None

    def loss(self, config: LossConfig):
        loss = FloorAwareLoss(config, WIDTH, HEIGHT)
        masks = (self.floor, self.inlier, self.doubtful)
        return loss, loss(self.rgb, 1 - self.alpha, self.background, self.image, *masks)


@pytest.fixture
def sample() -> Sample:
    return Sample()


def plain(sample: Sample, config: LossConfig) -> tuple[torch.Tensor, list[torch.Tensor]]:
    """The whole loss by torch in double precision, and its inputs."""
    rgb, alpha, background = (
        torch.from_numpy(a).double().requires_grad_() for a in (sample.rgb, sample.alpha, sample.background)
    )
    image = torch.from_numpy(sample.image).double().permute(2, 0, 1) / 255
    floor, inlier = torch.from_numpy(sample.floor).double(), torch.from_numpy(sample.inlier).double()
    if config.suppression == 0 and config.floor == 0 and not config.mask_floor:
        floor = torch.zeros_like(floor)
    drawn = rgb.permute(2, 0, 1) + (1 - alpha) * background
    w = inlier * (1 - floor)
    total = (1 - config.ssim) * (w * (drawn - image).abs()).mean()
    total = total + config.ssim * (1 - mean_ssim(w * drawn, w * image))
    total = total + config.suppression * (floor * alpha).mean()
    total = total + config.floor * (floor * inlier * ((background - image) ** 2 + 1e-4).sqrt()).mean()
    sure = 1 - torch.from_numpy(np.zeros_like(sample.floor) if sample.doubtful is None else sample.doubtful).double()
    total = total + config.fill * ((1 - floor) * sure * inlier * (1 - alpha)).mean()
    return total, [rgb, alpha, background]


def compare(a: np.ndarray, b: np.ndarray, lit: np.ndarray | None = None) -> tuple[float, np.ndarray]:
    """Mean SSIM of (3, H, W) images and d(sum of SSIM) / da, by the kernels."""
    _, height, width = a.shape
    images, slopes = planes(2, height, width), planes(3, height, width)
    for x in range(width):
        for plane, values in zip(images, (a + b, a - b), strict=True):
            plane[:, x // SEGMENT].reshape(3, -1, SEGMENT)[:, RADIUS:-RADIUS, x % SEGMENT] = values[:, :, x]
    lit = np.ones(tiles(height, width), np.uint8) if lit is None else lit
    sums = np.zeros((3, len(lit)))
    ssim_forward(images, lit, height, width, 2, slopes, sums)
    out = np.zeros((STRIP, lit.shape[1] * SEGMENT), np.float32)
    lines = np.zeros((3, STRIP, out.shape[1] + 2 * RADIUS), np.float32)
    gradient = np.zeros_like(a)
    for channel in range(3):
        for strip in range(len(lit)):
            out[:] = 0
            scratch = lines, np.empty((3, SEGMENT), np.float32)
            ssim_gradient(images, slopes, lit, channel, strip, height, *scratch, out)
            rows = gradient[channel, strip * STRIP : (strip + 1) * STRIP]
            rows[:] = out[: len(rows), :width]
    return float(sums.sum() / a.size), gradient


@pytest.mark.parametrize("shape", [(3, 40, 33), (3, 7, 5), (3, 16, 64), (3, 11, 300)])
def test_ssim_and_its_gradient_match_plain_torch(shape: tuple[int, int, int]) -> None:
    rng = np.random.default_rng(0)
    a, b = rng.random(shape, np.float32), rng.random(shape, np.float32)
    b[:, :3] = a[:, :3]
    value, gradient = compare(a, b)
    variable = torch.from_numpy(a).double().requires_grad_()
    expected = mean_ssim(variable, torch.from_numpy(b).double())
    expected.backward()
    assert value == pytest.approx(expected.item(), abs=1e-5)
    np.testing.assert_allclose(gradient / a.size, variable.grad.numpy(), atol=1e-5 * float(variable.grad.abs().max()))


def test_ssim_leaves_out_black_tiles_without_a_difference() -> None:
    rng = np.random.default_rng(2)
    a, b = rng.random((2, 3, 60, 700), np.float32)
    dark = np.zeros((60, 700), bool)
    dark[20:, 100:] = True
    dark[:, 400:] = True
    a[:, dark] = b[:, dark] = 0
    lit = np.zeros(tiles(60, 700), np.uint8)
    for y, x in np.argwhere(~dark):
        lit[y // STRIP, x // SEGMENT] = 1
    assert 0 < lit.sum() < lit.size
    value, gradient = compare(a, b, lit)
    expected_value, expected = compare(a, b)
    assert value == pytest.approx(expected_value, abs=1e-6)
    np.testing.assert_array_equal(gradient[:, ~dark], expected[:, ~dark])


def test_ssim_of_an_image_with_itself_is_one() -> None:
    a = np.random.default_rng(1).random((3, 20, 30), np.float32)
    value, gradient = compare(a, a)
    assert value == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(gradient, 0, atol=1e-4)


@pytest.mark.parametrize("doubt", [False, True], ids=["sure", "doubtful"])
@pytest.mark.parametrize(
    "config",
    [
        LossConfig(),
        LossConfig(fill=0.0),
        LossConfig(suppression=0.0, floor=0.0, fill=0.0),
        LossConfig(suppression=0.0, floor=0.0, fill=0.0, mask_floor=True),
        LossConfig(ssim=0.0),
    ],
    ids=["nvsim", "splatfacto-i", "3dgs", "masked", "l1"],
)
def test_total_and_gradients_match_torch(sample: Sample, config: LossConfig, doubt: bool) -> None:
    if doubt:
        sample.doubtful = np.random.default_rng(5).random((HEIGHT, WIDTH)) < 0.3
    loss, values = sample.loss(config)
    expected, (rgb, alpha, background) = plain(sample, config)
    expected.backward()
    assert values.total == pytest.approx(expected.item(), rel=1e-5)
    for ours, reference in (
        (loss.d_rgb, rgb.grad),
        (loss.d_alpha, alpha.grad),
        (loss.d_background, background.grad),
    ):
        np.testing.assert_allclose(ours, reference.numpy(), atol=2e-5 * float(reference.abs().max()))


def test_suppression_is_the_mean_alpha_under_the_mask(sample: Sample) -> None:
    _, values = sample.loss(LossConfig())
    assert values.suppression == pytest.approx(sample.alpha[sample.floor].sum() / PIXELS, rel=1e-5)


def test_fill_is_the_mean_light_let_through_elsewhere(sample: Sample) -> None:
    _, values = sample.loss(LossConfig())
    elsewhere = ~sample.floor & sample.inlier
    assert values.fill == pytest.approx((1 - sample.alpha[elsewhere]).sum() / PIXELS, rel=1e-5)


def test_what_may_be_floor_is_reconstructed_but_not_filled(sample: Sample) -> None:
    before, full = sample.loss(LossConfig())
    sample.doubtful = ~sample.floor
    after, values = sample.loss(LossConfig())
    assert values.fill == 0 and values.l1 == full.l1
    np.testing.assert_array_equal(after.d_rgb, before.d_rgb)


def test_each_term_is_switched_off_by_its_weight(sample: Sample) -> None:
    loss, values = sample.loss(ONLY_NOTHING)
    assert values.total == pytest.approx(values.l1)
    only_suppression, _ = sample.loss(LossConfig(ssim=0.0, suppression=2.0, floor=0.0, fill=0.0))
    np.testing.assert_allclose(only_suppression.d_alpha[sample.floor], 2.0 / PIXELS, rtol=1e-5)
    assert not only_suppression.d_background[:, sample.floor].any()
    assert loss.d_background.any()


def test_background_learns_floor_pixels_from_the_floor_loss_alone(sample: Sample) -> None:
    loss, _ = sample.loss(LossConfig())
    off = (sample.background - sample.image.transpose(2, 0, 1) / 255.0) * (sample.floor & sample.inlier)
    expected = off / np.sqrt(off**2 + 1e-4) / (3 * PIXELS)
    np.testing.assert_allclose(loss.d_background[:, sample.floor], expected[:, sample.floor], rtol=1e-4, atol=1e-9)
    assert loss.d_background[:, ~sample.floor].any()


def test_a_transient_moves_nothing_but_the_alpha_on_the_floor(sample: Sample) -> None:
    config = LossConfig(ssim=0.0)
    loss, before = sample.loss(config)
    out = ~sample.inlier
    assert not loss.d_rgb[out].any()
    assert not loss.d_background[:, out].any()
    assert not loss.d_alpha[out & ~sample.floor].any()
    sample.image[out] = 255 - sample.image[out]
    _, after = sample.loss(config)
    assert after.total == before.total


def test_error_is_of_the_background_on_the_floor_and_of_the_image_elsewhere(sample: Sample) -> None:
    loss, _ = sample.loss(LossConfig())
    true = sample.image / 255.0
    background = sample.background.transpose(1, 2, 0)
    drawn = sample.rgb + (1 - sample.alpha)[..., None] * background
    expected = np.where(sample.floor[..., None], background - true, drawn - true)
    np.testing.assert_allclose(loss.error.transpose(1, 2, 0), expected, atol=1e-5)
