"""Three graphs with the signatures of EVF-SAM's parts whose answer is known: floor is where the red of the large image
exceeds half of the mean red of the small one, if the token ids are those of the prompt."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from onnx_samples import I64, save, value
from prompted_networks import encoder

IDS = (0, 77, 5, 2)


def evf_sam(folder: Path, form: str) -> tuple[Path, Path, Path]:
    folder.mkdir(exist_ok=True)
    embed = np.zeros((1, 1, 256), np.float32)
    embed[0, 0, 0] = 1
    nodes = [
        ("Mul", ["visual_tokens", "half"], ["scaled"]), ("Add", ["scaled", "half"], ["colour"]),
        ("Slice", ["colour", "zero", "one", "one"], ["red"]), ("ReduceMean", ["red"], ["mean"], {"keepdims": 0}),
        ("Sub", ["textual_tokens", "ids"], ["off"]), ("Abs", ["off"], ["away"]),
        ("ReduceSum", ["away"], ["wrong0"], {"keepdims": 0}), ("Cast", ["wrong0"], ["wrong1"], {"to": 1}),
        ("Mul", ["wrong1", "much"], ["wrong"]), ("Add", ["mean", "wrong"], ["number"]),
        ("Mul", ["number", "embed"], ["text_embeds"]),
    ]  # fmt: skip
    constants = {
        "half": np.float32([0.5]), "zero": np.array([0]), "one": np.array([1]), "ids": np.array([IDS]),
        "much": np.float32(1000), "embed": embed,
    }  # fmt: skip
    inputs = [value("visual_tokens", 1, 3, 224, 224), value("textual_tokens", 1, "length", kind=I64)]
    beit3 = save(folder / "beit3.onnx", nodes, inputs, [value("text_embeds", 1, 1, 256)], constants)
    sam = "sam2-samexporter" if form == "evf-sam2" else "mobile-sam"
    looked = encoder(folder / "encoder.onnx", sam)
    name, channels, side = ("high_res_feats_0", 32, 256) if form == "evf-sam2" else ("image_embeddings", 256, 64)
    inputs = [value(name, 1, channels, side, side), value("text_embeds", 1, 1, 256)]
    if form == "evf-sam2":
        inputs += [value("high_res_feats_1", 1, 64, 128, 128), value("image_embed", 1, 256, 64, 64)]
    nodes = [
        ("Slice", [name, "zero", "one", "one"], ["red"]), ("Slice", ["text_embeds", "zero", "one", "two"], ["mean0"]),
        ("Reshape", ["mean0", "four"], ["mean"]), ("Mul", ["mean", "half"], ["least"]),
        ("Sub", ["red", "least"], ["over"]),
        ("Mul", ["over", "steep"], ["right"]), ("Sub", ["right", "steep"], ["narrow"]),
        ("Concat", ["narrow", "right", "narrow"], ["masks"], {"axis": 1}), ("Identity", ["s"], ["iou_predictions"]),
    ]  # fmt: skip
    constants = {
        "zero": np.array([0]), "one": np.array([1]), "two": np.array([2]), "four": np.array([1, 1, 1, 1]),
        "half": np.float32([0.5]), "steep": np.float32([40]), "s": np.float32([[0.2, 0.8, 0.3]]),
    }  # fmt: skip
    outputs = [value("masks", 1, 3, side, side), value("iou_predictions", 1, 3)]
    return beit3, looked, save(folder / "decoder.onnx", nodes, inputs, outputs, constants)
