"""Networks of the semantic role whose answer is known, with the signatures of common exports of ADE20K: the logit of
class 3 is 4 times the red, that of class 28 twice the green, that of class 0 the blue, the others are 0. Colors are 0
to 1."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from normal_networks import MEAN, STD
from onnx_samples import I64, save, value

FLOOR, RUG = 4.0, 2.0


def segformer(
    path: Path, classes: int = 150, size: tuple[int | str, int | str] = ("h", "w"), red: int | None = None
) -> Path:
    """`pixel_values`, ImageNet's range; `logits` a quarter as fine. With 151 classes the first is the background. With
    `red`, the logit of that class is 40 times the red minus the green and the blue."""
    sides = tuple(n // 4 if isinstance(n, int) else f"{n}4" for n in size)
    nodes = [
        *_logits("pixel_values", classes),
        ("AveragePool", ["fine"], ["logits"], {"kernel_shape": [4, 4], "strides": [4, 4]}),
    ]
    outputs = [value("logits", 1, classes, *sides)]
    weights = _weights(classes, 1.0)
    if red is not None:
        weights["weights"][red, :, 0, 0] = 40, -80, -80
    return save(path, nodes, [value("pixel_values", 1, 3, *size)], outputs, weights)


def mmseg(path: Path, size: int = 512) -> Path:
    """`input`, ImageNet's range in gray levels; `output` the label of each pixel."""
    nodes = [*_logits("input", 150), ("ArgMax", ["fine"], ["output"], {"axis": 1, "keepdims": 1})]
    outputs = [value("output", 1, 1, size, size, kind=I64)]
    return save(path, nodes, [value("input", 1, 3, size, size)], outputs, _weights(150, 255.0))


def _logits(image: str, classes: int) -> list:
    return [("Mul", [image, "std"], ["scaled"]), ("Add", ["scaled", "mean"], ["colour"]),
            ("Conv", ["colour", "weights"], ["fine"])]  # fmt: skip


def _weights(classes: int, white: float) -> dict[str, np.ndarray]:
    weights = np.zeros((classes, 3, 1, 1), np.float32)
    first = classes - 150
    weights[first + 3, 0], weights[first + 28, 1], weights[first, 2] = FLOOR, RUG, 1.0
    if first:
        weights[3, 2] = 9.0  # what is floor where nobody minds the background
    # With a mean and a deviation of its own: (c - mean) / std * std + mean is c, whatever the range.
    std, mean = np.float32(STD), np.float32(MEAN)
    if white == 255:
        std, mean = np.float32([58.395, 57.12, 57.375]) / 255, np.float32([123.675, 116.28, 103.53]) / 255
    return {"weights": weights, "std": std[None, :, None, None], "mean": mean[None, :, None, None]}
