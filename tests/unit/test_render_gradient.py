"""The hand-written gradients of the rasterizer against torch's own, through a reference that shares no code with it."""

from __future__ import annotations

import numpy as np
import pytest
import reference_splatting as reference
import torch

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.render.autograd import Statistics, rasterize

NAMES = ("means", "log_scales", "quats", "opacity_logits", "sh")
CAMERA = Camera(Intrinsics(41, 35, 30.0, 33.0, 17.0, 20.5), camera_pose(np.array([0.3, -0.4, 1.2]), 0.4, -0.1))


def scene(count=60, degree=3, seed=0):
    r = np.random.default_rng(seed)
    local = r.uniform([-1.6, -1.3, 0.8], [1.6, 1.3, 5.0], (count, 3)) * [1, 1, 1]
    local[:, :2] *= local[:, 2:] / 2.5
    means = local @ CAMERA.rotation.T + CAMERA.position
    return [
        torch.tensor(a, dtype=torch.float32)
        for a in (
            means,
            r.normal(-2.2, 0.6, (count, 3)),
            r.normal(size=(count, 4)) * 1.7,
            r.normal(0.5, 1.5, count),
            r.normal(0, 0.3, (count, (degree + 1) ** 2, 3)),
        )
    ]


def weights(seed=1):
    r = torch.Generator().manual_seed(seed)
    h, w = CAMERA.intrinsics.height, CAMERA.intrinsics.width
    return torch.randn(h, w, 3, generator=r), torch.randn(h, w, generator=r), torch.randn(h, w, generator=r) * 0.1


def gradients(function, tensors, **options):
    leaves = [t.clone().requires_grad_() for t in tensors]
    outputs = function(*leaves, CAMERA, **options)
    loss = sum((o * g.to(o.dtype)).sum() for o, g in zip(outputs, weights()))
    return torch.autograd.grad(loss, leaves)


def relative(a, b):
    return float((a.double() - b).norm() / b.norm())


@pytest.mark.parametrize("antialiased", [True, False])
def test_gradients_of_color_alpha_and_depth_equal_those_of_the_reference(antialiased):
    tensors = scene()
    expected = gradients(reference.splat, [t.double() for t in tensors], antialiased=antialiased)
    found = gradients(rasterize, tensors, antialiased=antialiased, depth=True)
    for name, a, b in zip(NAMES, found, expected):
        assert relative(a, b) < 2e-4, name


@pytest.mark.parametrize("antialiased", [True, False])
def test_gradients_equal_finite_differences_of_the_reference(antialiased):
    tensors = [t.double() for t in scene(count=25, seed=3)]
    found = gradients(rasterize, [t.float() for t in tensors], antialiased=antialiased, depth=True)
    generator = torch.Generator().manual_seed(5)

    def loss(arguments):
        outputs = reference.splat(*arguments, CAMERA, antialiased=antialiased)
        return sum(float((o * g.double()).sum()) for o, g in zip(outputs, weights()))

    for i, name in enumerate(NAMES):
        direction = torch.randn(tensors[i].shape, generator=generator, dtype=torch.float64)
        step = 1e-6
        ends = [[t + s * step * direction if j == i else t for j, t in enumerate(tensors)] for s in (1, -1)]
        expected = (loss(ends[0]) - loss(ends[1])) / (2 * step)
        along = float((found[i].double() * direction).sum())
        scale = float(found[i].double().norm())
        assert abs(along - expected) < 5e-3 * scale, name


def test_gradients_are_exact_where_the_jacobian_is_clamped():
    tensors = scene(count=12, seed=4)
    local = torch.tensor([[3.1, 0.2, 1.4], [-3.0, 0.4, 1.2], [0.3, 2.9, 1.2], [0.2, -2.9, 1.3]] * 3)
    local = local + 0.05 * torch.arange(12)[:, None]  # no two at one depth
    tensors[0] = (local.double() @ torch.as_tensor(CAMERA.rotation.T) + torch.as_tensor(CAMERA.position)).float()
    tensors[1] = torch.tensor([-0.2, -0.5, 0.1]).repeat(12, 1)
    expected = gradients(reference.splat, [t.double() for t in tensors])
    found = gradients(rasterize, tensors, depth=True)
    for name, a, b in zip(NAMES, found, expected):
        assert relative(a, b) < 2e-4, name


def test_coefficients_above_the_asked_degree_get_no_gradient():
    tensors = scene(count=20)
    found = gradients(rasterize, tensors, sh_degree=1)[4]
    expected = gradients(reference.splat, [t.double() for t in tensors], degree=1)[4]
    assert (found[:, 4:] == 0).all()
    assert (found[:, 1:4] != 0).any()
    # the reference also has a depth term, which the coefficients do not enter
    assert relative(found, expected) < 2e-4


def test_gaussians_out_of_view_get_zero_gradients():
    tensors = scene(count=20)
    tensors[0][::2] = torch.as_tensor(CAMERA.position - 2 * CAMERA.rotation[:, 2]).float()
    for name, gradient in zip(NAMES, gradients(rasterize, tensors)):
        assert (gradient[::2] == 0).all(), name
        assert (gradient[1::2] != 0).any(), name


def test_several_views_may_wait_for_their_gradients_and_sum_up():
    tensors = scene(count=30)
    other = Camera(CAMERA.intrinsics, camera_pose(np.array([0.5, -0.5, 1.1]), 0.6, 0.0))
    single = []
    for camera in (CAMERA, other):
        leaves = [t.clone().requires_grad_() for t in tensors]
        rgb, _ = rasterize(*leaves, camera)
        single.append(torch.autograd.grad(rgb.sum(), leaves))
    leaves = [t.clone().requires_grad_() for t in tensors]
    images = [rasterize(*leaves, camera)[0] for camera in (CAMERA, other)]
    both = torch.autograd.grad(images[0].sum() + images[1].sum(), leaves)
    for a, b, c in zip(*single, both):
        torch.testing.assert_close(a + b, c)


def test_a_second_backward_pass_over_one_forward_pass_is_refused():
    leaves = [t.clone().requires_grad_() for t in scene(count=5)]
    rgb, _ = rasterize(*leaves, CAMERA)
    rgb.sum().backward(retain_graph=True)
    with pytest.raises(RuntimeError, match="once per forward pass"):
        rgb.sum().backward()


def test_absolute_gradients_equal_the_sum_over_pixels_of_one_pixel_at_a_time():
    tensors = scene(count=15)
    count = len(tensors[0])
    statistics = Statistics.zeros(count)
    leaves = [t.clone().requires_grad_() for t in tensors]
    rgb, _ = rasterize(*leaves, CAMERA, statistics=statistics)
    k = CAMERA.intrinsics
    pixels = [divmod(int(p), k.width) for p in np.random.default_rng(6).choice(k.width * k.height, 24, replace=False)]
    weight = torch.zeros(k.height, k.width, 3)
    for y, x in pixels:
        weight[y, x] = weights()[0][y, x]
    (rgb * weight).sum().backward()

    # A shift of the projected center of each Gaussian alone, made by hand in the reference's place of it.
    shift = torch.zeros(count, 2, dtype=torch.float64, requires_grad=True)
    doubles = [t.double() for t in tensors]
    image = shifted(doubles, shift)
    totals = torch.zeros(count, 2, dtype=torch.float64)
    for y, x in pixels:
        loss = (image[y, x] * weight[y, x].double()).sum()
        totals += torch.autograd.grad(loss, shift, retain_graph=True)[0].abs()
    expected = totals.norm(dim=1) * 0.5 * max(k.width, k.height)
    drawn = statistics.count > 0
    assert drawn.any()
    np.testing.assert_allclose(statistics.gradient[drawn], expected[drawn].numpy(), rtol=2e-3, atol=1e-3)
    assert (statistics.radius[drawn] > 0).all()
    assert (statistics.radius[~drawn] == 0).all()


def shifted(tensors, shift):
    """The reference image with every center moved by `shift` pixels, the footprint's shape unchanged: a change of the
    principal point per Gaussian has that effect, and nothing else depends on it within the clamps."""
    means, log_scales, quats, opacity_logits, sh = tensors
    k = CAMERA.intrinsics
    pose = torch.as_tensor(CAMERA.world_to_camera)
    local = means @ pose[:3, :3].T + pose[:3, 3]
    order = torch.argsort(local[:, 2])
    through = torch.ones(k.height, k.width, dtype=torch.float64)
    image = torch.zeros(k.height, k.width, 3, dtype=torch.float64)
    pixels = torch.stack(torch.meshgrid(torch.arange(k.width), torch.arange(k.height), indexing="xy"), -1) + 0.5
    for i in order.tolist():
        x, y, z = local[i]
        if z <= reference.NEAR:
            continue
        j = torch.tensor([[k.fx / z, 0, -k.fx * x / z**2], [0, k.fy / z, -k.fy * y / z**2]], dtype=torch.float64)
        half = j @ pose[:3, :3] @ reference.rotations(quats[i]) @ torch.diag(log_scales[i].exp())
        cov = half @ half.T
        wide = cov + reference.EPS2D * torch.eye(2)
        opacity = torch.sigmoid(opacity_logits[i]) * torch.sqrt(torch.det(cov) / torch.det(wide))
        d = pixels - torch.stack([k.fx * x / z + k.cx, k.fy * y / z + k.cy]) - shift[i]
        power = -0.5 * torch.einsum("hwi,ij,hwj->hw", d, torch.inverse(wide), d)
        alpha = (opacity * power.exp()).clamp(max=reference.ALPHA_MAX)
        alpha = torch.where(alpha < reference.ALPHA_MIN, torch.zeros_like(alpha), alpha)
        direction = torch.nn.functional.normalize(means[i] - torch.as_tensor(CAMERA.position), dim=0)
        basis = reference.polynomial_basis(direction, 3)
        color = ((basis[:, None] * sh[i]).sum(0) + 0.5).clamp(min=0)
        image = image + (through * alpha)[..., None] * color
        through = through * (1 - alpha)
    return image


def test_tensors_of_another_kind_are_refused():
    tensors = scene(count=5)
    with pytest.raises(ValueError, match="float32"):
        rasterize(tensors[0].double(), *tensors[1:], CAMERA)
    with pytest.raises(ValueError, match="statistics of 4"):
        rasterize(*tensors, CAMERA, statistics=Statistics.zeros(4))
