"""ONNX files from other people: endless, too large, crashing, or with weights in the user's files."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import onnx
import pytest
from normal_networks import metric3d
from onnx import TensorProto, helper, numpy_helper

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.evaluation.scores import Lpips
from nvsim.networks import onnx_session
from nvsim.networks.external_data import check_external_data
from nvsim.networks.onnx_server import reason
from nvsim.networks.onnx_session import Session

SECONDS = 3.0  # in place of ten


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(onnx_session, "_SECONDS", SECONDS)


def saved(path: Path, nodes: list, tensors=(), ins=("a", "b"), out=None) -> Path:
    """A network of images in and `d` out."""
    images = [helper.make_tensor_value_info(n, TensorProto.FLOAT, (1, 3, "h", "w")) for n in ins]
    outs = [helper.make_tensor_value_info("d", TensorProto.FLOAT, out)]
    graph = helper.make_graph(nodes, "g", images, outs, initializer=list(tensors))
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(model.SerializeToString())
    return path


DISTANCE = [
    helper.make_node("Sub", ["a", "b"], ["off"]),
    helper.make_node("Abs", ["off"], ["away"]),
    helper.make_node("ReduceMean", ["away"], ["d0"], keepdims=1),
]


def loop(start: str, end: str) -> tuple[list, list]:
    """Nodes and tensors of a loop of 2^62 runs from a value to another."""

    def value(name: str, kind: int, shape) -> onnx.ValueInfoProto:
        return helper.make_tensor_value_info(name, kind, shape)

    truth, number = TensorProto.BOOL, TensorProto.FLOAT
    body = helper.make_graph(
        [helper.make_node("Identity", ["c"], ["c2"]), helper.make_node("Identity", ["v"], ["v2"])], "body",
        [value("i", TensorProto.INT64, ()), value("c", truth, ()), value("v", number, None)],
        [value("c2", truth, ()), value("v2", number, None)],
    )  # fmt: skip
    tensors = [numpy_helper.from_array(np.array(1 << 62, np.int64), "M"), numpy_helper.from_array(np.array(True), "t")]
    return [helper.make_node("Loop", ["M", "t", start], [end], body=body)], tensors


def bomb(kind: str) -> tuple[list, list]:
    """Nodes and tensors of a tensor of 32 GB whose mean is added to the distance."""
    shape = numpy_helper.from_array(np.array([1 << 31, 4], np.int64), "s")
    numbers = [numpy_helper.from_array(np.float32(n), name) for n, name in ((0, "z"), (3e9, "n"), (1, "o"))]
    big = {
        "ConstantOfShape": helper.make_node("ConstantOfShape", ["s"], ["big"]),
        "Expand": helper.make_node("Expand", ["o", "s"], ["big"]),
        "Range": helper.make_node("Range", ["z", "n", "o"], ["big"]),
    }[kind]
    mean = helper.make_node("ReduceMean", ["big"], ["m"], keepdims=0)
    return [*DISTANCE, big, mean, helper.make_node("Add", ["d0", "m"], ["d"])], [shape, *numbers]


def test_a_network_that_never_ends_is_refused_in_seconds(tmp_path: Path) -> None:
    nodes, tensors = loop("d0", "d")
    path = saved(tmp_path / "lpips.onnx", [*DISTANCE, *nodes], tensors)
    with pytest.raises(InputError, match=r"lpips.onnx gives no answer within 3 s; export it again"):
        Lpips(path)
    nodes, tensors = loop("v0", "m")
    tensors.append(numpy_helper.from_array(np.ones(1, np.float32), "v0"))
    path = saved(path, [*DISTANCE, *nodes, helper.make_node("Add", ["d0", "m"], ["d"])], tensors)
    with pytest.raises(InputError, match=r"lpips.onnx gives no answer within 3 s; export it again"):
        Lpips(path)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps to a limit of memory")
@pytest.mark.parametrize("kind", ["ConstantOfShape", "Expand", "Range"])
def test_a_network_that_takes_all_memory_is_refused(tmp_path: Path, kind: str) -> None:
    nodes, tensors = bomb(kind)
    path = saved(tmp_path / "lpips.onnx", nodes, tensors)
    with pytest.raises(InputError, match="lpips.onnx (needs more than .* GB of memory|gives no answer)"):
        Lpips(path)


def semantic(folder: Path, name: str) -> None:
    """Installs a network of floor that never ends."""
    nodes, tensors = loop("a", "d")
    saved(folder / name / "network.onnx", nodes, tensors, ins=("a",), out=(1, 3, "h", "w"))
    (folder / name / "model.toml").write_text(
        'role = "semantic"\n[files]\nnetwork = { file = "network.onnx" }\n[images.photo]\nsize = 32\n[[steps]]\n'
        'file = "network"\ninputs = [{ value = "photo", name = "a" }]\noutputs = [{ value = "floor", name = "d" }]\n'
        '[result]\nvalue = "floor"\nimage = "photo"\nmeaning = "logits"\nclasses = 3\nfloor = [0]\n'
    )


def test_models_check_says_a_sentence_for_each_endless_model_and_tries_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setenv("NVSIM_MODELS", str(tmp_path / "models"))
    good = metric3d(tmp_path / "good.onnx", np.zeros((3, 3)), (0.0, -0.7, -0.7))
    assert main(["models", "add", str(good), "--name", "good"]) == 0
    for name in ("endless", "other"):
        semantic(tmp_path / "models", name)
    capsys.readouterr()
    assert main(["models", "check", "endless", "good", "other"]) == 1
    said = capsys.readouterr().out
    for name in ("endless", "other"):
        assert f"{name}/network.onnx gives no answer within 3 s; export it again, or use another network." in said
    assert "good: " in said and "ms per image" in said


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_stops_an_endless_network_at_once(tmp_path: Path, number: int) -> None:
    semantic(tmp_path, "endless")
    code = (
        "import sys; from nvsim.networks import onnx_session; onnx_session._SECONDS = 300.0\n"
        "from nvsim.networks.onnx_session import Session; run = Session.run\n"
        "def told(*a): print('runs', flush=True); return run(*a)\n"
        "Session.run = told\n"
        "from nvsim.cli.main import main; sys.exit(main(['models', 'check', 'endless']))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], env={**os.environ, "NVSIM_MODELS": str(tmp_path)}, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None and process.stdout.readline() == "runs\n"
    time.sleep(0.3)
    began = time.monotonic()
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130 and "stopped" in said and time.monotonic() - began < 20


# Weights in other files ----------------------------------------------------------------------------------------------


def external(location: str, count: int = 16, **said: str) -> TensorProto:
    tensor = TensorProto(name="x", data_type=TensorProto.UINT8, data_location=TensorProto.EXTERNAL)
    tensor.dims.append(count)
    for key, value in {"location": location, "offset": "0", "length": str(count), **said}.items():
        entry = tensor.external_data.add()
        entry.key, entry.value = key, value
    return tensor


TAIL = [
    helper.make_node("Cast", ["x"], ["xf"], to=TensorProto.FLOAT),
    helper.make_node("ReduceMean", ["xf"], ["m"], keepdims=1),
    helper.make_node("Add", ["d0", "m"], ["d"]),
]


@pytest.mark.parametrize(
    ("tensor", "sentence"),
    [
        (external("../secret"), "'../secret'; only a file in the folder of the network"),
        (external("sub/../../secret"), "only a file in the folder of the network"),
        (external("/etc/passwd"), "'/etc/passwd'; only a file in the folder"),
        (external("/dev/zero", 1 << 33), "only a file in the folder"),
        (external("C:\\secret"), "only a file in the folder"),
        (external("..\\secret"), "only a file in the folder"),
        (external("*/_ORT_MEM_ADDR_/*"), "only a file in the folder"),  # onnxruntime reads its own memory there
        (external("link"), "a link to a file in another folder; put the file itself beside lpips.onnx"),
        (external("folder/inside"), "a link to a file in another folder"),
        (external("pipe"), "not a regular file; copy"),
        (external("folder"), "a link to a file in another folder"),
        (external("missing"), "needs the file missing beside it, which is missing; copy it there"),
        (external("w" * 300), "cannot be read; copy it there"),
        (external("weights", 17), "end at byte 17 of weights, which has 16; copy it again"),
        (external("weights", offset="8"), "end at byte 24 of weights, which has 16"),
        (external("weights", offset="-8"), "not a number of bytes"),
        (external("weights", length="many"), "not a number of bytes"),
        (external(""), "do not name exactly one file"),
    ],
)
def test_weights_are_only_read_from_files_beside_the_network(tmp_path: Path, tensor, sentence: str) -> None:
    (tmp_path / "secret").write_bytes(bytes(1000))
    folder = tmp_path / "models"
    path = saved(folder / "lpips.onnx", [*DISTANCE, *TAIL], [tensor])
    (folder / "weights").write_bytes(bytes(16))
    (folder / "link").symlink_to("../secret")
    (folder / "folder").symlink_to(tmp_path)
    (tmp_path / "inside").write_bytes(bytes(1000))
    os.mkfifo(folder / "pipe")
    with pytest.raises(InputError, match=sentence.replace("*", r"\*")) as error:
        Lpips(path)
    assert str(error.value).startswith(str(path)) and "\n" not in str(error.value)


@pytest.mark.parametrize("place", ["attribute", "subgraph", "sparse", "function", "second graph"])
def test_weights_are_found_wherever_a_tensor_may_be(tmp_path: Path, place: str) -> None:
    tensor = external("../secret")
    path = saved(tmp_path / "x.onnx", DISTANCE)
    model = onnx.load(path)
    constant = helper.make_node("Constant", [], ["x"], value=tensor)
    if place == "attribute":
        model.graph.node.append(constant)
    elif place == "subgraph":
        inner = helper.make_graph([], "inner", [], [], initializer=[tensor])
        model.graph.node.append(helper.make_node("If", ["t"], ["y"], then_branch=inner, else_branch=inner))
    elif place == "sparse":
        model.graph.sparse_initializer.append(onnx.SparseTensorProto(values=tensor, dims=[16]))
    elif place == "function":
        model.functions.append(helper.make_function("own", "F", [], ["x"], [constant], []))
    data = model.SerializeToString()
    if place == "second graph":  # a message that is given twice is one, with the tensors of both
        other = onnx.ModelProto(graph=onnx.GraphProto(initializer=[tensor]))
        data += other.SerializeToString()
    path.write_bytes(data)
    with pytest.raises(InputError, match="'../secret'; only a file in the folder"):
        check_external_data(path)


def test_honest_weights_are_read_and_counted(tmp_path: Path) -> None:
    path = saved(tmp_path / "x.onnx", [*DISTANCE, *TAIL], [external("data/w.bin")])
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "w.bin").write_bytes(bytes(16))
    assert check_external_data(path) == path.stat().st_size + 16
    assert len(Session(path).inputs) == 2


def test_a_download_cache_of_links_is_read_where_its_files_lie_beside_each_other(tmp_path: Path) -> None:
    blobs, snapshot = tmp_path / "blobs", tmp_path / "snapshots" / "1"
    snapshot.mkdir(parents=True)
    saved(blobs / "hash1", [*DISTANCE, *TAIL], [external("x.onnx_data")])
    (blobs / "hash2").write_bytes(bytes(16))
    (snapshot / "x.onnx").symlink_to(blobs / "hash1")
    (snapshot / "x.onnx_data").symlink_to(blobs / "hash2")
    assert check_external_data(snapshot / "x.onnx") == (blobs / "hash1").stat().st_size + 16


@pytest.mark.parametrize("cut", [1, 7, 40, 100])
def test_a_file_that_is_cut_off_is_a_sentence(tmp_path: Path, cut: int) -> None:
    path = saved(tmp_path / "x.onnx", DISTANCE)
    path.write_bytes(path.read_bytes()[:-cut])
    with pytest.raises(InputError, match="x.onnx cannot be loaded as an ONNX network"):
        Session(path)
    path.write_bytes(b"")
    with pytest.raises(InputError, match="x.onnx is empty"):
        Session(path)


# Reasons ------------------------------------------------------------------------------------------------------------


def test_a_newer_version_of_the_format_is_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "ir99.onnx").write_bytes(bytes.fromhex("08633a04120261624204" + "0a00100d"))
    assert main(["models", "add", str(tmp_path / "ir99.onnx")]) == 2
    said = capsys.readouterr().err
    assert "(Unsupported model IR version: 99, max supported IR version: " in said and "::" not in said


SIGNATURE = (
    "[ONNXRuntimeError] : 1 : FAIL : Load model from /a b/x.onnx failed:/onnxruntime_src/onnxruntime/core/graph/"
    "model.cc:256 onnxruntime::Model::Model(onnx::ModelProto&&, const onnxruntime::PathString&, "
    "std::function<void(int)>, const onnxruntime::ModelOptions&) "
)


@pytest.mark.parametrize(
    ("said", "kept"),
    [
        (SIGNATURE + "Unsupported model IR version: 99", "Unsupported model IR version: 99"),
        (SIGNATURE + "opset 22 is *not* supported", "opset 22 is *not* supported"),
        (
            "[ONNXRuntimeError] : 7 : INVALID_PROTOBUF : Load model from x.onnx failed:Protobuf parsing failed.",
            "Protobuf parsing failed",
        ),
        (
            "[ONNXRuntimeError] : 6 : RUNTIME_EXCEPTION : Non-zero status code returned while running Expand node. "
            "Name:'' Status Message: /src/bfc_arena.cc:376 void* onnxruntime::BFCArena::AllocateRawInternal(size_t, "
            "bool, onnxruntime::Stream*) const [with T = int] the shape is wrong: 3",
            "the shape is wrong: 3",
        ),
        (
            "[ONNXRuntimeError] : 1 : FAIL : Deserialize tensor x failed.tensorprotoutils.cc:1876 "
            "GetExtDataFromTensorProto External initializer: x are out of bounds.",
            "External initializer: x are out of bounds",
        ),
        (
            "[ONNXRuntimeError] : 2 : INVALID_ARGUMENT : Got invalid dimensions for input: a for these indices\n"
            " index: 2 Got: 32 Expected: 64\n Please fix either the inputs/outputs or the model.",
            "index: 2 Got: 32 Expected: 64 Please fix either the inputs/outputs or the model",
        ),
        ("x" * 500 + " the end", "the end"),
    ],
)
def test_the_reason_of_onnxruntime_keeps_its_end_without_the_signature(said: str, kept: str) -> None:
    found = reason(RuntimeError(said))
    assert kept in found and found.endswith(kept)
    assert "onnxruntime::" not in found and "[ONNX" not in found and len(found) <= 250


# Names --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "toml",
    [
        'form = "' + "segformer-ade" + "9" * 4000 + '"\n[files]\nnetwork = { file = "x.onnx" }\n',
        'form = "../bundled/floor"\n',
        'form = ["moge-2"]\n',
        'form = "moge-2"\n[files]\nnetwork = { file = "' + "雪" * 100 + '" }\n',
        'form = "moge-2"\n[files]\nnetwork = { file = "x.onnx", beside = ["' + "雪" * 100 + '"] }\n',
    ],
)
def test_a_name_that_no_file_can_have_is_a_problem_of_one_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, toml: str
) -> None:
    monkeypatch.setenv("NVSIM_MODELS", str(tmp_path / "models"))
    good = metric3d(tmp_path / "good.onnx", np.zeros((3, 3)), (0.0, -0.7, -0.7))
    assert main(["models", "add", str(good), "--name", "good"]) == 0
    (tmp_path / "models" / "bad").mkdir()
    (tmp_path / "models" / "bad" / "model.toml").write_text(toml)
    capsys.readouterr()
    assert main(["models"]) == 0
    said = capsys.readouterr().out
    assert "warning: " in said and "bad/model.toml: " in said and "good: " in said
    assert main(["models", "check", "good"]) == 0


def test_onnxruntime_reports_nothing_to_its_vendor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for name in ("ORT_DISABLE_TELEMETRY", "CI"):  # each of them disables the telemetry by itself
        monkeypatch.delenv(name, raising=False)
    Session(saved(tmp_path / "distance.onnx", [*DISTANCE, helper.make_node("Identity", ["d0"], ["d"])]))
    assert [path.name for path in tmp_path.rglob("*")] == ["distance.onnx"], "a device identifier was stored"
