"""Networks that a user brings, in the folder where they are looked for."""

from __future__ import annotations

import os
from pathlib import Path

from fuzzing.places import workshop
from fuzzing.reader import Reader, Seed, each, files_in


def readers() -> list[Reader]:
    return [
        Reader("prompted network", _pair, _prompted),
        Reader("lpips network", _distance, _lpips),
        Reader("description of a model", _descriptions, _described),
    ]


def _pair() -> list[Seed]:
    from test_perception_prompted import decoder, encoder

    with workshop() as folder:
        encoder(folder / "prompted.encoder.onnx")
        decoder(folder / "prompted.decoder.onnx")
        files = files_in(folder)
    return each(files, "", {name: "binary" for name in files})


def _prompted(path: Path) -> object:
    from nvsim.networks.folder import VARIABLE
    from nvsim.networks.installed import find_model
    from nvsim.perception.prompted_network import PromptedNetwork

    os.environ[VARIABLE] = str(path)
    model = find_model("prompted")
    return model and PromptedNetwork(model.open("cpu"))


def _distance() -> list[Seed]:
    import onnx
    from onnx import TensorProto, helper

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
    from nvsim.evaluation.lpips import Lpips

    return Lpips(path).values


def _descriptions() -> list[Seed]:
    from nvsim.networks.ready import FOLDER

    files = files_in(FOLDER)
    return each(files, "", {name: "text" for name in files})


def _described(path: Path) -> object:
    from nvsim.networks.ready import read_description

    return [read_description(file) for file in sorted(path.glob("*.toml"))]
