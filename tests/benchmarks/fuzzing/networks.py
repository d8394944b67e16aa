"""Networks that a user installs, in the folder where NVSim searches for them."""

from __future__ import annotations

import os
from pathlib import Path

import onnx
from floor_networks import segformer
from normal_networks import own
from onnx import TensorProto, helper
from test_perception_prompted import decoder, encoder

from fuzzing.places import workshop
from fuzzing.reader import Reader, Seed, each, files_in
from nvsim.evaluation.scores import Lpips
from nvsim.networks.folder import VARIABLE
from nvsim.networks.installation import add
from nvsim.networks.installed import find_model, installed_models
from nvsim.networks.known_forms import FOLDER, read_description
from nvsim.networks.onnx_session import Session
from nvsim.perception.prompted_network import PromptedNetwork


def readers() -> list[Reader]:
    return [
        Reader("prompted network", _pair, _prompted),
        Reader("lpips network", _distance, _lpips),
        Reader("description of a model", _descriptions, _described),
        Reader("onnx network", _distance, _signature, share=2),
        Reader("model added", _added, _add, disposable=True, share=2),
        Reader("folder of models", _installed, _listed),
        Reader("normals of before", _old_normals, _old),
    ]


def _pair() -> list[Seed]:
    with workshop() as folder:
        encoder(folder / "prompted.encoder.onnx")
        decoder(folder / "prompted.decoder.onnx")
        files = files_in(folder)
    return each(files, "", {name: "binary" for name in files})


def _prompted(path: Path) -> object:
    os.environ[VARIABLE] = str(path)
    model = find_model("prompted")
    return model and PromptedNetwork(model.open("cpu"))


def _distance() -> list[Seed]:
    images = [helper.make_tensor_value_info(n, TensorProto.FLOAT, (1, 3, "h", "w")) for n in ("a", "b")]
    distance = helper.make_tensor_value_info("d", TensorProto.FLOAT, (1, 1, 1, 1))
    nodes = [
        helper.make_node("Sub", ["a", "b"], ["off"]),
        helper.make_node("Abs", ["off"], ["away"]),
        helper.make_node("ReduceMean", ["away"], ["d"], keepdims=1),
    ]
    graph = helper.make_graph(nodes, "toy", images, [distance])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    with workshop() as folder:
        onnx.save(model, folder / "lpips.onnx")
        return each(files_in(folder), "lpips.onnx", {"lpips.onnx": "binary"})


def _lpips(path: Path) -> object:
    return Lpips(path).values


def _descriptions() -> list[Seed]:
    files = files_in(FOLDER)
    return each(files, "", {name: "text" for name in files})


def _described(path: Path) -> object:
    return [read_description(file) for file in sorted(path.glob("*.toml"))]


def _signature(path: Path) -> object:
    return Session(path).signature


def _added() -> list[Seed]:
    """A network whose form NVSim recognizes, in a folder of new networks."""
    with workshop() as folder:
        segformer(folder / "segformer-b0.onnx")
        files = {f"new/{name}": data for name, data in files_in(folder).items()}
    return each(files, "", {"new/segformer-b0.onnx": "binary"})


def _add(path: Path) -> object:
    """Adds a model as `nvsim models add` and `nvsim models check` do."""
    os.environ[VARIABLE] = str(path / "models")
    return add([path / "new"]).digest()


def _installed() -> list[Seed]:
    """A folder of models: one that was added, and files that belong to no model."""
    with workshop() as folder:
        for name, data in _added()[0].files.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(data)
        _add(folder)
        os.environ.pop(VARIABLE)
        files = files_in(folder / "models")
    description = next(name for name in files if name.endswith(".toml"))
    return each({**files, "notes.toml": b"x = 1\n", "other.txt": b"x"}, "", {description: "text", "notes.toml": "text"})


def _listed(path: Path) -> object:
    os.environ[VARIABLE] = str(path)
    models, problems = installed_models()
    return [(model.stamp, model.digest()) for model in models], problems


def _old_normals() -> list[Seed]:
    with workshop() as folder:
        own(folder / "normals.onnx", toml="")
        files = files_in(folder)
    files["normals.toml"] = b"white = 255.0\nmean = [0.5, 0.5, 0.5]\naxes = [1, -1, 1]\nhalved = true\nmultiple = 4\n"
    return each(files, "", {"normals.toml": "text", "normals.onnx": "binary"})


def _old(path: Path) -> object:
    os.environ[VARIABLE] = str(path)
    model = find_model("normals", "normals")
    return model and model.open("cpu")
