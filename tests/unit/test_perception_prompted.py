"""A prompted pair as it was installed before there were descriptions, by a toy whose answer is known: the regions of
the colors at the points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from onnx import helper
from onnx_samples import I64, F, save, value

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.networks.installed import InstalledModel, find_model
from nvsim.perception.prompted_network import PromptedNetwork

SIDE = 64


def encoder(path: Path, form: str = "samexporter") -> Path:
    """Each feature is the image, averaged, its colors in the first three channels."""
    names = ("high_res_feats_0", "high_res_feats_1", "image_embed")
    image = {"huggingface": "pixel_values", "osam": "input"}.get(form, "image")
    nodes, constants, outputs = [], {}, []
    for name, channels, step in zip(names, (32, 64, 256), (2, 4, 8), strict=True):
        weights = np.zeros((channels, 3, 1, 1), np.float32)
        weights[:3, :, 0, 0] = np.eye(3)
        constants[f"w{channels}"] = weights
        nodes.append(
            helper.make_node("AveragePool", [image], [f"a{channels}"], kernel_shape=[step] * 2, strides=[step] * 2)
        )
        nodes.append(helper.make_node("Conv", [f"a{channels}", f"w{channels}"], [name]))
        outputs.append(value(name, 1, channels, SIDE // step, SIDE // step))
    return save(path, nodes, [value(image, 1, 3, SIDE, SIDE)], outputs, constants)


def decoder(path: Path, form: str = "samexporter") -> Path:
    """Logits above zero where the fine feature is like its mean at the points labeled 1, unlike that of the others."""
    huggingface, four = form == "huggingface", form == "osam"
    lead = [1] if huggingface else []
    points = value("input_points" if huggingface else "point_coords", 1, *lead, "n", 2)
    labels = value("input_labels" if huggingface else "point_labels", 1, *lead, "n", kind=I64 if huggingface else F)
    names = ["high_res_feats_0", "high_res_feats_1", "image_embed"]
    if huggingface:
        names = [f"image_embeddings.{k}" for k in range(3)]
    elif four:
        names = ["high_res_features1", "high_res_features2", "image_embeddings"]
    inputs = [value(n, 1, c, SIDE // s, SIDE // s) for n, c, s in zip(names, (32, 64, 256), (2, 4, 8), strict=True)]
    inputs += [points, labels]
    if huggingface:
        inputs.append(value("input_boxes", 1, "k", 4))
    else:
        inputs += [value("mask_input", 1, 1, 32, 32), value("has_mask_input", 1)]
    if four:
        inputs.append(value("orig_im_size", 2, kind=I64))
    nodes = [
        helper.make_node("Cast", [labels.name], ["l"], to=F),
        helper.make_node("Reshape", [points.name, "s4"], ["p"]),
        helper.make_node("Mul", ["p", "scale"], ["p2"]),
        helper.make_node("Sub", ["p2", "one"], ["grid"]),
        helper.make_node("GridSample", [names[0], "grid"], ["c"], mode="bilinear", align_corners=0),  # (1, 32, n, 1)
        helper.make_node("Reshape", ["l", "sl"], ["l4"]),  # (1, 1, n, 1)
        helper.make_node("Mul", ["c", "l4"], ["cl"]),
        helper.make_node("ReduceSum", ["cl", "two"], ["sum"], keepdims=1),
        helper.make_node("ReduceSum", ["l4", "two"], ["count"], keepdims=1),
        helper.make_node("Div", ["sum", "count"], ["color"]),
        helper.make_node("Sub", [names[0], "color"], ["off"]),
        helper.make_node("Abs", ["off"], ["away"]),
        helper.make_node("ReduceSum", ["away", "channel"], ["distance"], keepdims=1),
        helper.make_node("Sub", ["near", "distance"], ["logits"]),
        helper.make_node("Sub", ["logits", "much"], ["never"]),
        helper.make_node("Add", ["logits", "much"], ["always"]),
        helper.make_node("Concat", [*(["always"] if four else []), "never", "logits", "always"], ["m"], axis=1),
        helper.make_node("Identity", ["scores"], ["iou_scores" if huggingface else "iou_predictions"]),
    ]
    count = 4 if four else 3
    shape = (1, 1, count, SIDE // 2, SIDE // 2) if huggingface else (1, count, SIDE // 2, SIDE // 2)
    nodes.append(helper.make_node("Reshape", ["m", "out"], ["pred_masks" if huggingface else "masks"]))
    constants = {
        "s4": np.array([1, -1, 1, 2]), "sl": np.array([1, 1, -1, 1]), "out": np.array(shape),
        "scale": np.float32([2 / SIDE]), "one": np.float32([1]), "two": np.array([2]), "channel": np.array([1]),
        "near": np.float32([0.6]), "much": np.float32([99]),
        "scores": np.float32([0.99, 0.2, 0.9, 0.3] if four else [0.2, 0.9, 0.3]).reshape(1, *lead, count),
    }  # fmt: skip
    scores = "iou_scores" if huggingface else "iou_predictions"
    outputs = [value("pred_masks" if huggingface else "masks", *shape), value(scores, 1, *lead, count)]
    return save(path, nodes, inputs, outputs, constants)


def opened(*paths: Path) -> PromptedNetwork:
    """The form of a pair is found in it."""
    return PromptedNetwork(InstalledModel("prompted", "prompted", paths[0].parent, None, None, paths).open("cpu"))


def picture() -> tuple[np.ndarray, np.ndarray]:
    """(90, 150, 3), and where its lower right is of another color."""
    image = np.full((90, 150, 3), (200, 60, 60), np.uint8)
    floor = np.zeros((90, 150), bool)
    floor[45:, 60:] = True
    image[floor] = (40, 80, 160)
    return image, floor


@pytest.mark.parametrize("form", ["samexporter", "osam", "huggingface"])
def test_the_region_at_a_point_is_found_whatever_form_the_export_has(tmp_path: Path, form: str) -> None:
    network = opened(encoder(tmp_path / "e.onnx", form), decoder(tmp_path / "d.onnx", form))
    image, floor = picture()
    found = network.region(image, np.array([[120.0, 70.0]]), np.ones(1, bool))
    assert (found ^ floor).mean() < 0.03  # the border is as coarse as the features
    other = network.region(image, np.array([[10.0, 10.0], [120.0, 70.0]]), np.array([True, False]))
    assert (other ^ ~floor).mean() < 0.03


def test_it_fills_the_prompted_role_and_looks_once_at_an_image(tmp_path: Path, monkeypatch) -> None:
    network = opened(encoder(tmp_path / "e.onnx"), decoder(tmp_path / "d.onnx"))
    image, floor = picture()
    camera = Camera(Intrinsics.from_fov(150, 90, 1.2), camera_pose(np.zeros(3), 0.0))
    assert (network.mask(image, np.array([[120.0, 70.0], [80.0, 60.0]]), camera) ^ floor).mean() < 0.03
    monkeypatch.setattr(network._chain, "show", None)
    network.mask(image, np.array([[10.0, 10.0]]), camera)


def test_files_that_are_no_pair_are_refused_by_name(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("NVSIM_MODELS", str(tmp_path))
    assert find_model("prompted") is None
    good = encoder(tmp_path / "prompted.encoder.onnx")
    with pytest.raises(InputError, match=r"prompted\.decoder\.onnx is missing"):
        find_model("prompted")
    with pytest.raises(InputError, match="fit none of the known forms .*sam2-osam"):
        opened(good, encoder(tmp_path / "again.onnx"))
    (tmp_path / "prompted.decoder.onnx").write_bytes(b"no network")
    model = find_model("prompted")
    assert model is not None and model.files == (good, tmp_path / "prompted.decoder.onnx")
    with pytest.raises(InputError, match="cannot be loaded"):
        model.open()
