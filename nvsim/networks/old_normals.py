"""Read `normals.onnx` without a model description: one of two known exports, or with a `normals.toml` of six keys.

The tensors of the network are found in the ONNX file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.files.regular import read_text
from nvsim.networks.binding import words
from nvsim.networks.onnx_session import Node
from nvsim.networks.toml_table import LARGEST, Table, parsed

_FLOATS = ("tensor(float)", "tensor(float16)")
_GREY = (0.485, 0.456, 0.406)
_AXES = (("left", "right"), ("up", "down"), ("backward", "forward"))
KEYS = ("white", "mean", "std", "axes", "halved", "multiple")


def description_from_legacy_toml(
    path: Path, network: Path, inputs: Sequence[Node], outputs: Sequence[Node]
) -> dict[str, Any]:
    """The description of the `network`, as parsed TOML, from the six keys in the file at `path`.

    `inputs` and `outputs` are those of the network. Raises InputError if the file or the network does not fit."""
    values = parsed(read_text(path, "a description of a network", "save it as UTF-8", LARGEST), path)
    for key in values:
        if key not in KEYS:
            raise InputError(f"{path} has the unknown key {key!r:.40}; the known keys are {', '.join(KEYS)}.")
    table = Table(values, path)
    white = table.number("white", 1.0)
    axes = table.three("axes", (1.0, 1.0, 1.0))
    if 0 in axes:
        raise InputError(f"{path}: axes is {list(axes)}; no axis may be 0.")
    image = [i for i in inputs if len(i.shape) == 4 and i.type in _FLOATS]
    if len(image) != 1 or len(inputs) != 1:
        raise InputError(
            f"{network} takes {words(inputs)}; a network for normals takes one image of shape (1, 3, H, W)."
        )
    output, last = _output(outputs, network)
    return {
        "role": "normals",
        "title": path.stem,
        "files": {"network": {"file": network.name}},
        "images": {
            "photo": {
                "resize": "centre", "interpolation": "linear", "brightest": white,
                "mean": list(table.three("mean", (0.0, 0.0, 0.0))),
                "std": list(table.three("std", (1.0, 1.0, 1.0), positive=True)),
                "pad": [255 * part for part in _GREY], "multiple": table.whole("multiple", 1024, 1),
            }
        },
        "steps": [
            {
                "file": "network", "inputs": [{"value": "photo", "name": image[0].name}],
                "outputs": [{"value": "normals", "name": output.name}],
            }
        ],
        "result": {
            "value": "normals", "image": "photo", "layout": "NHWC" if last else "NCHW",
            "halved": table.flag("halved", False), "axes": [pair[a > 0] for pair, a in zip(_AXES, axes, strict=True)],
        },
    }  # fmt: skip


def _output(outputs: Sequence[Node], network: Path) -> tuple[Node, bool]:
    """The output with normals, and whether its channels are last."""
    named = [o for o in outputs if "normal" in o.name and "conf" not in o.name] or list(outputs)
    for node in named:
        shape = list(node.shape)
        if len(shape) == 4 and (shape[1] in (3, 4) or shape[3] in (3, 4)):
            return node, shape[1] not in (3, 4)
    raise InputError(f"{network} gives no normals, three or four values for each pixel; export those too.")
