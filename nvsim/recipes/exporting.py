"""Exports the trained network as an ONNX file with descriptions. Weights are stored in 16 bits and used in 32 bits."""

from __future__ import annotations

import hashlib
import tempfile
import warnings
from pathlib import Path
from typing import Any

import torch

from nvsim.errors import InputError
from nvsim.files.atomic import make_folder, write_bytes, write_text
from nvsim.files.reading import reading
from nvsim.recipes.batches import MEAN, STD
from nvsim.recipes.network import MULTIPLE, InteriorNetwork

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
        data = _halved(onnx.load(Path(scratch) / NAME), onnx).SerializeToString()
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


def _halved(model: Any, onnx: Any) -> Any:
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
