"""Small real ONNX networks, whose answers can be computed by hand: linear functions of an image's mean colors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

SIZE = 48


def weights(width: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((3, width)).astype(np.float32)


def mean_network(
    path: Path,
    width: int,
    *,
    batch: int | str = "n",
    nhwc: bool = False,
    half: bool = False,
    classes: bool = False,
    tokens: int = 0,
    description: str = "",
) -> Path:
    """A file at `path` and its description: mean colors (N, 3) times `weights(width)`; as outputs also `whole`, which
    is not pooled, with `classes` the `logits`, 1000, and with `tokens` in their place (N, tokens, width) of
    `weights(tokens * width, 2)`."""
    kind, number = (TensorProto.FLOAT16, np.float16) if half else (TensorProto.FLOAT, np.float32)
    shape = [batch, SIZE, SIZE, 3] if nhwc else [batch, 3, SIZE, SIZE]
    nodes = [
        helper.make_node(
            "Transpose" if nhwc else "Identity", ["image"], ["x"], **({"perm": [0, 3, 1, 2]} if nhwc else {})
        ),
        helper.make_node("GlobalAveragePool", ["x"], ["pooled"]),
        helper.make_node("Flatten", ["pooled"], ["mean"]),
        helper.make_node("MatMul", ["mean", "w"], ["features"]),
        helper.make_node("Identity", ["x"], ["whole"]),
    ]
    outputs = [("features", [batch, width]), ("whole", [batch, 3, SIZE, SIZE])]
    constants = {"w": weights(width)}
    if tokens:
        nodes[3:4] = [
            helper.make_node("MatMul", ["mean", "t"], ["row"]),
            helper.make_node("Reshape", ["row", "shape"], ["features"]),
        ]
        outputs[0] = ("features", [batch, tokens, width])
        constants = {"t": weights(tokens * width, 2)}
    if classes:
        nodes.append(helper.make_node("MatMul", ["mean", "c"], ["logits"]))
        outputs.append(("logits", [batch, 1000]))
        constants["c"] = weights(1000, 1)
    graph = helper.make_graph(
        nodes,
        "mean",
        [helper.make_tensor_value_info("image", kind, shape)],
        [helper.make_tensor_value_info(name, kind, list(size)) for name, size in outputs],
        [numpy_helper.from_array(v.astype(number), n) for n, v in constants.items()]
        + ([numpy_helper.from_array(np.array([-1, tokens, width], np.int64), "shape")] if tokens else []),
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    onnx.checker.check_model(model)
    onnx.save(model, path)
    said = f'output = "features"\nwidth = {width}\nsize = {SIZE}\n' + ('classes = "logits"\n' if classes else "")
    said += f"tokens = {tokens}\n" if tokens else ""
    path.with_suffix(".toml").write_text(said + description)
    return path
