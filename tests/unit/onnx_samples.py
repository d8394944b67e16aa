"""Small real networks, built node by node."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

F, F16, I64, I32 = TensorProto.FLOAT, TensorProto.FLOAT16, TensorProto.INT64, TensorProto.INT32


def save(path: Path, nodes: list, inputs: list, outputs: list, constants: dict[str, np.ndarray]) -> Path:
    """`nodes` are made, or operator, inputs, outputs and attributes."""
    made = [n if isinstance(n, onnx.NodeProto) else _node(*n) for n in nodes]
    graph = helper.make_graph(
        made, "toy", inputs, outputs, [numpy_helper.from_array(v, n) for n, v in constants.items()]
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    onnx.checker.check_model(model)
    onnx.save(model, path)
    return path


def value(name: str, *shape: int | str, kind: int = F) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, kind, list(shape))


def _node(operator: str, inputs: list[str], outputs: list[str], attributes: dict[str, Any] | None = None) -> Any:
    return helper.make_node(operator, inputs, outputs, **(attributes or {}))
