"""The network: EfficientNet-Lite0 without its last stage, and a pyramid of features that says floor and normals.

It is shown an image and, of every pixel, the ray of the camera turned level: so it knows the horizon and the field of
view, and its normals are in that level frame, in which every floor is the same. Its sides are multiples of 32.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from nvsim.r2r.features.trunk import Layer, folded, need_weights, padding, read_weights

MULTIPLE = 32
FROZEN = 5
"""Blocks of the trunk that stay as ImageNet made them: edges, colours and textures, and most of the cost of a step."""
_TAPS = {2: 24, 4: 40, 10: 112, 14: 192}
"""After which block features are taken, and their channels: of strides 4, 8, 16, 32."""
_WIDTHS = 32, 64, 64, 64
"""Channels of the pyramid at these strides."""


class _Convolution(nn.Module):
    """A convolution of the trunk with its batch norm folded in."""

    def __init__(self, layer: Layer) -> None:
        super().__init__()
        self.weight, self.bias = nn.Parameter(layer.weight.clone()), nn.Parameter(layer.bias.clone())
        self.stride, self.groups = layer.stride, layer.groups

    def forward(self, x: Tensor) -> Tensor:
        size = MULTIPLE  # any multiple of the stride is padded alike
        before, after = padding(size, self.weight.shape[-1], self.stride)
        if before == after:
            return functional.conv2d(x, self.weight, self.bias, self.stride, before, groups=self.groups)
        x = functional.pad(x, (before, after, before, after))
        return functional.conv2d(x, self.weight, self.bias, self.stride, groups=self.groups)


class _Block(nn.Module):
    def __init__(self, layers: Sequence[Layer]) -> None:
        super().__init__()
        self.layers = nn.ModuleList(map(_Convolution, layers))
        self.adds = layers[-2].stride == 1 and layers[0].weight.shape[1] * layers[0].groups == len(layers[-1].weight)

    def forward(self, x: Tensor) -> Tensor:
        y = x
        for layer in self.layers[:-1]:
            y = functional.relu6(layer(y))
        y = self.layers[-1](y)
        return x + y if self.adds else y


class _Separable(nn.Sequential):
    """A 3 x 3 depthwise convolution and a pointwise one, added to what goes in."""

    def __init__(self, width: int, dilation: int = 1) -> None:
        super().__init__(
            nn.Conv2d(width, width, 3, padding=dilation, dilation=dilation, groups=width, bias=False),
            nn.Conv2d(width, width, 1), nn.ReLU(),
        )  # fmt: skip

    def forward(self, x: Tensor) -> Tensor:
        y: Tensor = super().forward(x)
        return x + y


class _Rays(nn.Sequential):
    """What rays say of a pixel, as features."""

    def __init__(self, width: int) -> None:
        super().__init__(nn.Conv2d(3, 24, 1), nn.ReLU(), nn.Conv2d(24, width, 1))


class InteriorNetwork(nn.Module):
    """From images (N, 3, H, W), normalised as the trunk takes them, and rays (N, 3, H, W) to logits of floor
    (N, 1, H/4, W/4) and normals (N, 3, H/4, W/4), not of unit length, in the frame of the rays.

    Raises InputError where the trunk's package is not installed.
    """

    def __init__(self) -> None:
        super().__init__()
        stem, blocks, _ = folded(read_weights(need_weights()))
        self.stem = _Convolution(stem)
        self.blocks = nn.ModuleList(_Block(layers) for layers in blocks[: max(_TAPS) + 1])
        fine, wide = _WIDTHS[0], _WIDTHS[-1]
        self.lateral = nn.ModuleList(nn.Conv2d(c, width, 1) for c, width in zip(_TAPS.values(), _WIDTHS))
        self.rays = nn.ModuleList(map(_Rays, _WIDTHS))
        self.context = nn.Conv2d(wide, wide, 1)
        self.wide = nn.Sequential(_Separable(wide), _Separable(wide, 2))
        self.mixed = nn.ModuleList(
            (nn.Sequential(_Separable(wide), _Separable(wide, 2)), _Separable(wide), _Separable(fine))
        )
        self.narrow = nn.Conv2d(wide, fine, 1)
        self.floor = nn.Sequential(nn.Conv2d(fine, fine, 1), nn.ReLU(), nn.Conv2d(fine, 1, 1))
        self.normals = nn.Sequential(nn.Conv2d(fine, fine, 1), nn.ReLU(), nn.Conv2d(fine, 3, 1))
        for parameter in (*self.stem.parameters(), *self.blocks[:FROZEN].parameters()):
            parameter.requires_grad_(False)

    def forward(self, image: Tensor, rays: Tensor) -> tuple[Tensor, Tensor]:
        found = []
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, enabled=self.training):
            x = functional.relu6(self.stem(image))
            for number, block in enumerate(self.blocks[:FROZEN]):
                x = block(x)
                if number in _TAPS:
                    found.append(x.float())
        x = x.float()
        for number, block in enumerate(self.blocks[FROZEN:], FROZEN):
            x = block(x)
            if number in _TAPS:
                found.append(x)
        seen = functional.avg_pool2d(rays, 4)
        inner = []
        for features, lateral, of_rays in zip(found, self.lateral, self.rays):
            inner.append(lateral(features) + of_rays(seen))
            seen = functional.avg_pool2d(seen, 2)
        y = inner[3] + self.context(inner[3].mean((2, 3), keepdim=True))
        y = self.wide(y)
        for features, mixed in zip(inner[2::-1], self.mixed):
            y = self.narrow(y) if features.shape[1] < y.shape[1] else y
            y = mixed(features + functional.interpolate(y, scale_factor=2.0, mode="bilinear", align_corners=False))
        return self.floor(y), self.normals(y)

    def learning(self) -> tuple[dict[str, nn.Parameter], dict[str, nn.Parameter]]:
        """By their names the parameters of the trunk that learn, and those of the rest."""
        both = {name: p for name, p in self.named_parameters() if p.requires_grad}
        trunk = {name: p for name, p in both.items() if name.startswith(("stem.", "blocks."))}
        return trunk, {name: p for name, p in both.items() if name not in trunk}


def loss(
    found: tuple[Tensor, Tensor], floor: Tensor, normals: Tensor, known: Tensor
) -> tuple[Tensor, dict[str, float]]:
    """What is wrong with an answer, and its parts: cross entropy and Dice of the floor, and of the normals the angle
    (radians), which a surface that is wholly wrong does not rule as it would its cosine.

    floor    (N, H, W) float, 1 floor
    normals  (N, 3, H, W), zero where unknown
    known    (N, H, W) float, 1 where the floor label counts
    """
    floor, normals, known = floor[:, 1::2, 1::2], normals[:, :, 1::2, 1::2], known[:, 1::2, 1::2]  # fine enough
    logits, directions = (functional.interpolate(f, scale_factor=2.0, mode="bilinear") for f in found)
    logits = logits[:, 0]
    entropy = functional.binary_cross_entropy_with_logits(logits, floor, reduction="none")
    entropy = (entropy * known).sum() / known.sum().clamp(min=1)
    chance = torch.sigmoid(logits) * known
    dice = 1 - (2 * (chance * floor).sum() + 1) / (chance.sum() + (floor * known).sum() + 1)
    there = normals.square().sum(1) > 0.25
    cosine = (functional.normalize(directions, dim=1) * normals).sum(1)
    count = there.sum().clamp(min=1)
    angle = (torch.acos(cosine.clamp(-0.9999, 0.9999)) * there).sum() / count
    total = entropy + 0.5 * dice + angle
    parts = {"floor": entropy, "dice": dice, "degrees": torch.rad2deg(angle)}
    return total, {name: float(part.detach()) for name, part in parts.items()}
