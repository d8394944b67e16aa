"""The network: EfficientNet-Lite0 without its last stage, and a feature pyramid that predicts floor and normals; its
export as ONNX.

The input is an image and, for each pixel, its ray in the frame of the leveled camera. The network therefore knows the
horizon and the field of view. Its normals are in the level frame, in which the normal of every floor is equal. The
sides of the image must be multiples of 32.

In the ONNX file, weights are stored in 16 bits and used in 32 bits.
"""

from __future__ import annotations

import hashlib
import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from nvsim.errors import InputError
from nvsim.files.atomic import make_folder, write_bytes, write_text
from nvsim.files.reading import reading
from nvsim.r2r.features.trunk import Layer, fold_batch_norms, need_weights, padding, read_weights
from nvsim.recipes.examples import MEAN, STD

MULTIPLE = 32
_HAS_FAST_HALVES = "AVX512" in torch.backends.cpu.get_cpu_capability()
"""Whether the processor multiplies 16-bit numbers at full speed. On others, the whole forward pass of a training step
took eight times as long with them."""
FROZEN = 5
"""Number of trunk blocks with frozen ImageNet weights: edges, colors and textures, and most of the cost of a step."""
_TAPS = {2: 24, 4: 40, 10: 112, 14: 192}
"""Trunk block -> channels of the features taken after it, at strides 4, 8, 16, 32."""
_WIDTHS = 32, 64, 64, 64
"""Channels of the pyramid at strides 4, 8, 16, 32."""


class _Convolution(nn.Module):
    """A convolution of the trunk, with its batch norm folded into the weights."""

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
    """A 3 x 3 depthwise convolution, a pointwise convolution, and a residual connection."""

    def __init__(self, width: int, dilation: int = 1) -> None:
        super().__init__(
            nn.Conv2d(width, width, 3, padding=dilation, dilation=dilation, groups=width, bias=False),
            nn.Conv2d(width, width, 1), nn.ReLU(),
        )  # fmt: skip

    def forward(self, x: Tensor) -> Tensor:
        y: Tensor = super().forward(x)
        return x + y


class _Rays(nn.Sequential):
    """Features of a pixel computed from its ray."""

    def __init__(self, width: int) -> None:
        super().__init__(nn.Conv2d(3, 24, 1), nn.ReLU(), nn.Conv2d(24, width, 1))


class InteriorNetwork(nn.Module):
    """Predicts floor and normals.

    Inputs are images (N, 3, H, W), normalized as the trunk requires, and rays (N, 3, H, W). Outputs are logits of floor
    (N, 1, H/4, W/4) and normals (N, 3, H/4, W/4) in the frame of the rays. The normals do not have unit length.

    Raises InputError if the package of the trunk is not installed.
    """

    def __init__(self) -> None:
        super().__init__()
        stem, blocks, _ = fold_batch_norms(read_weights(need_weights()))
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
        """Floor logits (N, 1, H/4, W/4) and normals (N, 3, H/4, W/4) for `image` and `rays`, both (N, 3, H, W)
        float32."""
        found = []
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, enabled=self.training and _HAS_FAST_HALVES):
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
        """Trainable parameters by name: those of the trunk, and all others."""
        both = {name: p for name, p in self.named_parameters() if p.requires_grad}
        trunk = {name: p for name, p in both.items() if name.startswith(("stem.", "blocks."))}
        return trunk, {name: p for name, p in both.items() if name not in trunk}


def prediction_loss(
    found: tuple[Tensor, Tensor], floor: Tensor, normals: Tensor, known: Tensor
) -> tuple[Tensor, dict[str, float]]:
    """The loss of a prediction, and its parts: cross entropy, Dice loss of the floor, and the angle of normals.

    The loss uses the angle (radians), because with the cosine, surfaces that are completely wrong would dominate. The
    part "degrees" is the angle in degrees.

    found    floor logits (N, 1, H/4, W/4) and normals (N, 3, H/4, W/4)
    floor    (N, H, W) float, 1 floor
    normals  (N, 3, H, W), zero if unknown
    known    (N, H, W) float, 1 if the floor label is known
    """
    floor, normals, known = floor[:, 1::2, 1::2], normals[:, :, 1::2, 1::2], known[:, 1::2, 1::2]  # half resolution
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


NAME = "interior.onnx"
LONGEST = 384
"""Longer side in pixels of the network's input image."""
_OPSET, _SMALL = 17, 256  # smaller tensors, by number of elements, keep 32 bits
_HEAD = """title = "NVSim's own: {what} of indoor images"
role = "{role}"
made_by = "NVSim"
licence = "MIT; its trunk, EfficientNet-Lite0 trained with ImageNet, Apache-2.0"
source = "https://github.com/tensorflow/tpu (trunk); nvsim models train"

[files]
network = {{ file = "{name}", sha256 = "{sha256}" }}

[images.photo]
resize = "stretch"
interpolation = "area"
multiple = {multiple}
longest = {longest}
brightest = 255
mean = [{mean}, {mean}, {mean}]
std = [{std}, {std}, {std}]

[[steps]]
file = "network"
inputs = [
  {{ value = "photo", name = "image", shape = [1, 3, 0, 0] }},
  {{ value = "rays", name = "rays", shape = [1, 3, 0, 0] }},
]
outputs = [{{ value = "{output}", name = "{output}" }}]

[result]
value = "{output}"
image = "photo"
"""
_RESULTS = {
    "semantic": ("floor", "floor", 'meaning = "logits"\n'),
    "normals": ("surface normals", "normals", 'axes = ["right", "down", "forward"]\nframe = "level"\n'),
}


def export(network: InteriorNetwork, folder: Path) -> Path:
    """Writes the ONNX file, semantic.toml and normals.toml into `folder`, and returns the path of the ONNX file. Raises
    InputError if the package onnx is not installed or the disk reports an error."""
    onnx = _onnx()
    network = network.eval().cpu()
    sides = {2: "height", 3: "width"}
    with torch.no_grad(), warnings.catch_warnings(), tempfile.TemporaryDirectory() as scratch:
        warnings.simplefilter("ignore")  # this exporter needs no additional packages, but warns that it is deprecated
        examples = torch.zeros(1, 3, 4 * MULTIPLE, 6 * MULTIPLE), torch.zeros(1, 3, 4 * MULTIPLE, 6 * MULTIPLE)
        torch.onnx.export(
            network, examples, Path(scratch) / NAME, dynamo=False, opset_version=_OPSET, input_names=["image", "rays"],
            output_names=["floor", "normals"],
            dynamic_axes={"image": sides, "rays": sides, "floor": {2: "h", 3: "w"}, "normals": {2: "h", 3: "w"}},
        )  # fmt: skip
        data = _to_half_precision(onnx.load(Path(scratch) / NAME), onnx).SerializeToString()
    make_folder(folder)
    path = folder / NAME
    write_bytes(path, data)
    digest = hashlib.sha256(data).hexdigest()
    for role, (what, output, rest) in _RESULTS.items():
        said = _HEAD.format(
            what=what, role=role, name=NAME, sha256=digest, multiple=MULTIPLE, longest=LONGEST, mean=MEAN, std=STD,
            output=output,
        )  # fmt: skip
        write_text(folder / f"{role}.toml", said + rest)
    return path


def exported_weights(path: Path) -> dict[str, torch.Tensor]:
    """Weights of an ONNX file of `export`: name in the network -> float32 tensor in its original shape. Raises
    InputError if the package onnx is not installed or the file cannot be read."""
    onnx = _onnx()
    with reading(path, "an ONNX file of `nvsim models train`", "name one, or the folder of a training"):
        tensors = {t.name.removesuffix("_16"): onnx.numpy_helper.to_array(t) for t in onnx.load(path).graph.initializer}
    return {name: torch.from_numpy(values.astype("float32")) for name, values in tensors.items()}


def _onnx() -> Any:
    """The package onnx. Raises InputError if it is not installed."""
    try:
        import onnx
    except ImportError as error:
        raise InputError("The package onnx is needed to write and read networks; run pip install onnx.") from error
    return onnx


def _to_half_precision(model: Any, onnx: Any) -> Any:
    """The ONNX `model` with its large tensors stored in 16 bits. A cast node follows each; onnxruntime runs it once
    when it loads the model."""
    graph, casts = model.graph, []
    for tensor in graph.initializer:
        values = onnx.numpy_helper.to_array(tensor)
        if values.dtype != "float32" or values.size < _SMALL:
            continue
        name = tensor.name
        tensor.CopyFrom(onnx.numpy_helper.from_array(values.astype("float16"), f"{name}_16"))
        casts.append(onnx.helper.make_node("Cast", [f"{name}_16"], [name], to=onnx.TensorProto.FLOAT))
    for at, node in enumerate(casts):
        graph.node.insert(at, node)
    onnx.checker.check_model(model)
    return model
