"""Gaussian splatting as its equations say, in float64 torch without tiles: slow and plain, to hold kernels against."""

from __future__ import annotations

import math

import torch
from scipy.special import sph_harm_y

EPS2D, NEAR, ALPHA_MIN, ALPHA_MAX, MARGIN = 0.3, 0.05, 1 / 255, 0.99, 0.15


def real_basis(directions, degree):
    """Real spherical harmonics without the Condon-Shortley phase, times (-1)^m: from scipy, for values only."""
    x, y, z = directions.unbind(-1)
    theta, phi = torch.acos(z.clamp(-1, 1)).numpy(), torch.atan2(y, x).numpy()
    columns = []
    for l in range(degree + 1):
        for m in range(-l, l + 1):
            value = sph_harm_y(l, abs(m), theta, phi)
            part = value.real if m >= 0 else value.imag
            columns.append(torch.as_tensor(part * (math.sqrt(2) if m else 1.0)))
    return torch.stack(columns, -1)


def polynomial_basis(d, degree):
    """The spherical harmonics as polynomials, so that torch can differentiate them."""
    x, y, z = d.unbind(-1)
    one = torch.ones_like(x)
    s = math.sqrt
    pi = math.pi
    b = [0.5 * s(1 / pi) * one]
    if degree > 0:
        b += [-s(3 / (4 * pi)) * y, s(3 / (4 * pi)) * z, -s(3 / (4 * pi)) * x]
    if degree > 1:
        b += [
            0.5 * s(15 / pi) * x * y,
            -0.5 * s(15 / pi) * y * z,
            0.25 * s(5 / pi) * (3 * z * z - 1),
            -0.5 * s(15 / pi) * x * z,
            0.25 * s(15 / pi) * (x * x - y * y),
        ]
    if degree > 2:
        b += [
            -0.25 * s(35 / (2 * pi)) * y * (3 * x * x - y * y),
            0.5 * s(105 / pi) * x * y * z,
            -0.25 * s(21 / (2 * pi)) * y * (5 * z * z - 1),
            0.25 * s(7 / pi) * z * (5 * z * z - 3),
            -0.25 * s(21 / (2 * pi)) * x * (5 * z * z - 1),
            0.25 * s(105 / pi) * z * (x * x - y * y),
            -0.25 * s(35 / (2 * pi)) * x * (x * x - 3 * y * y),
        ]
    return torch.stack(b, -1)


def rotations(quats):
    w, x, y, z = torch.nn.functional.normalize(quats, dim=-1).unbind(-1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(r, -1) for r in rows], -2)


def splat(means, log_scales, quats, opacity_logits, sh, camera, antialiased=True, degree=None):
    """float64 tensors -> rgb (H, W, 3), alpha (H, W), expected depth (H, W), normal (H, W, 3)."""
    k = camera.intrinsics
    pose = torch.as_tensor(camera.world_to_camera)
    w, t = pose[:3, :3], pose[:3, 3]
    local = means @ w.T + t
    keep = (local[:, 2] > NEAR).nonzero().squeeze(1)
    keep = keep[torch.argsort(local[keep, 2].detach(), stable=True)]
    means, log_scales, quats, opacity_logits, sh = (a[keep] for a in (means, log_scales, quats, opacity_logits, sh))
    x, y, z = local[keep].unbind(-1)
    limits = [
        (-(k.cx + MARGIN * k.width) / k.fx, (k.width - k.cx + MARGIN * k.width) / k.fx),
        (-(k.cy + MARGIN * k.height) / k.fy, (k.height - k.cy + MARGIN * k.height) / k.fy),
    ]
    tx, ty = (x / z).clamp(*limits[0]), (y / z).clamp(*limits[1])
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [torch.stack([k.fx / z, zero, -k.fx * tx / z], -1), torch.stack([zero, k.fy / z, -k.fy * ty / z], -1)], -2
    )
    r = rotations(quats)
    half = r * log_scales.exp()[:, None, :]
    cov3 = half @ half.transpose(1, 2)
    cov = jacobian @ w @ cov3 @ w.T @ jacobian.transpose(1, 2)
    filtered = cov + EPS2D * torch.eye(2, dtype=cov.dtype)
    opacity = torch.sigmoid(opacity_logits)
    if antialiased:
        opacity = opacity * torch.sqrt(torch.linalg.det(cov) / torch.linalg.det(filtered))
    conic = torch.linalg.inv(filtered)
    eye = torch.as_tensor(camera.position)
    directions = torch.nn.functional.normalize(means - eye, dim=-1)
    degree = round(math.sqrt(sh.shape[1])) - 1 if degree is None else degree
    b = polynomial_basis(directions, degree)
    color = ((b[:, :, None] * sh[:, : b.shape[1]]).sum(1) + 0.5).clamp(min=0)
    shortest = torch.gather(r, 2, log_scales.argmin(1)[:, None, None].expand(-1, 3, 1)).squeeze(2)
    normal = torch.where((shortest * directions).sum(-1, keepdim=True) > 0, -shortest, shortest)

    pixels = torch.stack(
        torch.meshgrid(torch.arange(k.width) + 0.5, torch.arange(k.height) + 0.5, indexing="xy"), -1
    ).double()
    center = torch.stack([k.fx * x / z + k.cx, k.fy * y / z + k.cy], -1)
    d = pixels[None] - center[:, None, None]  # [N, H, W, 2]
    power = -0.5 * torch.einsum("nhwi,nij,nhwj->nhw", d, conic, d)
    alpha = (opacity[:, None, None] * power.exp()).clamp(max=ALPHA_MAX)
    alpha = torch.where(alpha < ALPHA_MIN, torch.zeros_like(alpha), alpha)
    through = torch.cumprod(1 - alpha, 0)
    weight = alpha * torch.cat([torch.ones_like(through[:1]), through[:-1]])
    total = weight.sum(0)
    depth = (weight * z[:, None, None]).sum(0)
    depth = torch.where(total < 1e-3, torch.zeros_like(depth), depth / total.clamp(min=1e-3))
    return torch.einsum("nhw,nc->hwc", weight, color), total, depth, torch.einsum("nhw,nc->hwc", weight, normal)
