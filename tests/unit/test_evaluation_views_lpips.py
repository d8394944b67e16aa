"""The LPIPS door with small real networks whose distance is known in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from nvsim.errors import InputError
from nvsim.evaluation.scores import Lpips, open_lpips
from nvsim.networks.folder import VARIABLE, models_folder

WEIGHTS = np.array([0.5, -1.0, 2.0], np.float32)
SIZE = (1, 3, "height", "width")


def network(
    path: Path, *, inputs: int = 2, size=SIZE, kind=TensorProto.FLOAT, says: str = "", bias: float = 0.0
) -> Path:
    """Mean of the squared difference of one weighted sum of the channels: a fixed 1x1 convolution of each image."""
    names = ["inA", "inB", "inC"][:inputs]
    values = [helper.make_tensor_value_info(n, kind, size) for n in names]
    dtype = helper.tensor_dtype_to_np_dtype(kind)
    tensors = [
        numpy_helper.from_array(WEIGHTS.reshape(1, 3, 1, 1).astype(dtype), "weights"),
        numpy_helper.from_array(np.array(bias, dtype), "bias"),
    ]
    nodes = [
        helper.make_node("Conv", [names[0], "weights"], ["fa"]),
        helper.make_node("Conv", [names[-1], "weights"], ["fb"]),
        helper.make_node("Sub", ["fa", "fb"], ["difference"]),
        helper.make_node("Mul", ["difference", "difference"], ["square"]),
        helper.make_node("ReduceMean", ["square"], ["mean"], axes=[1, 2, 3], keepdims=1),
        helper.make_node("Add", ["mean", "bias"], ["lpips_out"]),
    ]
    out = helper.make_tensor_value_info("lpips_out", kind, (1, 1, 1, 1))
    graph = helper.make_graph(nodes, "distance", values, [out], tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    if says:
        helper.set_model_props(model, {"input_range": says})
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
    return path


def images() -> np.ndarray:
    return np.random.default_rng(0).random((2, 40, 70, 3), np.float32)


def expected(a: np.ndarray, b: np.ndarray, width: float) -> float:
    """`width` of the range that the network takes: 2 of -1..1, 1 of 0..1."""
    return float(((width * (a - b) @ WEIGHTS) ** 2).mean())


def test_the_distance_is_the_network_s_own_in_minus_one_to_one(tmp_path: Path) -> None:
    a, b = images()
    lpips = Lpips(network(tmp_path / "lpips.onnx"))
    assert lpips(a, b) == pytest.approx(expected(a, b, 2.0), rel=1e-4)
    assert lpips(a, a) == 0.0
    assert lpips(a, b) == pytest.approx(lpips(b, a))


@pytest.mark.parametrize(
    ("values", "says", "width"), [("auto", "0..1", 1.0), ("0..1", "", 1.0), ("-1..1", "0..1", 2.0)]
)
def test_the_range_is_what_the_flag_says_else_what_the_file_says(
    tmp_path: Path, values: str, says: str, width: float
) -> None:
    a, b = images()
    lpips = Lpips(network(tmp_path / "lpips.onnx", says=says), values)
    assert lpips(a, b) == pytest.approx(expected(a, b, width), rel=1e-4)


def test_half_precision_and_fixed_sizes_are_taken(tmp_path: Path) -> None:
    a, b = images()
    half = Lpips(network(tmp_path / "half.onnx", kind=TensorProto.FLOAT16))
    assert half(a, b) == pytest.approx(expected(a, b, 2.0), rel=2e-2)
    fixed = Lpips(network(tmp_path / "fixed.onnx", size=(1, 3, 40, 70)))
    assert fixed(a, b) == pytest.approx(expected(a, b, 2.0), rel=1e-4)
    with pytest.raises(InputError, match="60x40 pixels.*dynamic"):
        fixed(a[:, :60], b[:, :60])


def test_what_is_no_lpips_is_refused_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="two float images"):
        Lpips(network(tmp_path / "one.onnx", inputs=1))
    with pytest.raises(InputError, match="not an image distance"):
        Lpips(network(tmp_path / "biased.onnx", bias=0.5))
    with pytest.raises(InputError, match="input_range"):
        Lpips(network(tmp_path / "range.onnx", says="0..255"))
    (tmp_path / "text.onnx").write_text("not a network")
    with pytest.raises(InputError, match="cannot be loaded"):
        Lpips(tmp_path / "text.onnx")
    with pytest.raises(InputError, match="no LPIPS model"):
        Lpips(tmp_path / "missing.onnx")


def test_the_user_s_models_folder_is_looked_into_and_named_when_empty(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    found, why = open_lpips(None)
    assert found is None and "give --lpips FILE.onnx" in why and str(models_folder()) in why
    network(tmp_path / "lpips.onnx")
    found, why = open_lpips(None)
    assert found is not None and why == ""
