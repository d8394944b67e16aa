"""Pairs with the signatures of the exports of SAM, whose answer is known: at each point a disc in the network's image,
whose radius is 20 plus 100 times the red at the point, 0 to 1, without the discs of points that must not be in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from onnx_samples import I32, I64, F, save, value

SIDE, FINE = 1024, 256
LEAST, MORE = 20.0, 100.0  # pixels of the network's image
MEAN, STD = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
FORMS = (
    "sam2-samexporter", "sam2-osam", "sam2-by-shape", "sam2-huggingface", "efficient-sam", "mobile-sam",
    "mobile-sam-samexporter",
)  # fmt: skip
_FEATURES = {
    "sam2-samexporter": ("high_res_feats_0", "high_res_feats_1", "image_embed"),
    "sam2-osam": ("high_res_features1", "high_res_features2", "image_embeddings"),
    "sam2-by-shape": ("t1", "t2", "t3"),
    "sam2-huggingface": ("image_embeddings.0", "image_embeddings.1", "image_embeddings.2"),
}


def pair(folder: Path, form: str) -> tuple[Path, Path]:
    """The encoder and the decoder of a form of resources/nvsim_resources/models, without their description."""
    folder.mkdir(exist_ok=True)
    return encoder(folder / "encoder.onnx", form), decoder(folder / "decoder.onnx", form)


def encoder(path: Path, form: str = "sam2-samexporter") -> Path:
    """Red, 0 to 1, is the first channel of the first feature."""
    if form == "mobile-sam-samexporter":
        image = value("input_image", "height", "width", 3)
        start = [
            ("Transpose", ["input_image"], ["chw"], {"perm": [2, 0, 1]}),
            ("Unsqueeze", ["chw", "zero"], ["nchw"]),
            # It pads to 1024 to the right and below, as samexporter's own graph does.
            ("Shape", ["nchw"], ["shape"]), ("Sub", ["full", "shape"], ["lack"]),
            ("Concat", ["zeros", "lack"], ["pads"], {"axis": 0}), ("Pad", ["nchw", "pads"], ["square"]),
            ("Div", ["square", "white"], ["colour"]),
        ]  # fmt: skip
    elif form == "efficient-sam":
        image = value("batched_images", "b", 3, "h", "w")
        start = [("Resize", ["batched_images", "", "", "full"], ["colour"], {"mode": "linear"})]
    else:
        names = {"sam2-osam": "input", "sam2-by-shape": "t0", "sam2-huggingface": "pixel_values"}
        image = value(names.get(form, "image"), 1, 3, SIDE, SIDE)
        start = [("Mul", [image.name, "std"], ["scaled"]), ("Add", ["scaled", "mean"], ["colour"])]
    one = form in ("efficient-sam", "mobile-sam", "mobile-sam-samexporter")
    features = {"image_embeddings": (256, 16)} if one else dict(
        zip(_FEATURES[form], ((32, 4), (64, 8), (256, 16)), strict=True)
    )  # fmt: skip
    # A feature of 64 x 64 is too coarse for the red at a point: where there is only that, it is the whole image's.
    scale = 1 if form != "mobile-sam" else 255
    constants = {
        "std": (STD if form != "mobile-sam" else np.float32([58.395, 57.12, 57.375])).astype(np.float32)[:, None, None],
        "mean": (MEAN if form != "mobile-sam" else np.float32([123.675, 116.28, 103.53])).astype(np.float32)[
            :, None, None
        ],
        "zero": np.array([0]), "zeros": np.zeros(4, np.int64), "full": np.array([1, 3, SIDE, SIDE]),
        "white": np.float32(255),
    }  # fmt: skip
    nodes, outputs = list(start), []
    for name, (channels, step) in features.items():
        weights = np.zeros((channels, 3, 1, 1), np.float32)
        weights[:3, :, 0, 0] = np.eye(3) / scale
        constants[f"w{channels}"] = weights
        pool = {"kernel_shape": [step] * 2, "strides": [step] * 2}
        nodes += [
            ("AveragePool", ["colour"], [f"p{channels}"], pool),
            ("Conv", [f"p{channels}", f"w{channels}"], [name]),
        ]
        outputs.append(value(name, 1, channels, SIDE // step, SIDE // step))
    if form == "sam2-osam":
        outputs = [outputs[2], outputs[0], outputs[1]]  # the embedding first
    used = {name for node in nodes for name in node[1]}
    return save(path, nodes, [image], outputs, {n: v for n, v in constants.items() if n in used})


def decoder(path: Path, form: str = "sam2-samexporter") -> Path:
    hf, efficient, mobile = form == "sam2-huggingface", form == "efficient-sam", form.startswith("mobile-sam")
    names = {"point_coords": "point_coords", "point_labels": "point_labels"}
    if hf:
        names = {"point_coords": "input_points", "point_labels": "input_labels"}
    elif efficient:
        names = {"point_coords": "batched_point_coords", "point_labels": "batched_point_labels"}
    elif form == "sam2-by-shape":
        names = {"point_coords": "t4", "point_labels": "t5"}
    lead = [1] if hf or efficient else []
    points = value(names["point_coords"], 1, *lead, "n", 2)
    labels = value(names["point_labels"], 1, *lead, "n", kind=I64 if hf else F)
    if efficient or mobile:
        inputs, fine = [value("image_embeddings", 1, 256, 64, 64)], "image_embeddings"
    else:
        sides = ((32, 256), (64, 128), (256, 64))
        inputs = [value(n, 1, c, s, s) for n, (c, s) in zip(_FEATURES[form], sides, strict=True)]
        fine = _FEATURES[form][0]
    inputs += [points, labels]
    mask, has = ("t6", "t7") if form == "sam2-by-shape" else ("mask_input", "has_mask_input")
    if not hf and not efficient:
        inputs += [value(mask, "labels" if not mobile else 1, 1, 256, 256), value(has, 1)]
    size = {"sam2-by-shape": ("t8", I32), "sam2-osam": ("orig_im_size", I64), "efficient-sam": ("orig_im_size", I64),
            "mobile-sam": ("orig_im_size", F), "mobile-sam-samexporter": ("orig_im_size", F)}.get(form)  # fmt: skip
    if size:
        inputs.append(value(size[0], 2, kind=size[1]))
    if hf:
        inputs.append(value("input_boxes", 1, "boxes", 4))
    nodes, constants = _discs(points.name, labels.name, fine, form, size[0] if size else "")
    if not hf and not efficient:  # a mask that is said to be there, or is not empty, spoils the answer
        nodes += [
            ("ReduceSum", [mask], ["m1"], {"keepdims": 0}), ("ReduceSum", [has], ["m2"], {"keepdims": 0}),
            ("Abs", ["m1"], ["m3"]), ("Add", ["m3", "m2"], ["m4"]), ("Mul", ["m4", "never"], ["m5"]),
            ("Sub", ["right", "m5"], ["right_too"]),
        ]  # fmt: skip
    elif hf:  # a box that is none: its number of boxes is 0
        nodes += [("ReduceSum", ["input_boxes"], ["m1"], {"keepdims": 0}), ("Sub", ["right", "m1"], ["right_too"])]
    else:
        nodes += [("Identity", ["right"], ["right_too"])]
    out, scores_name = ("pred_masks", "iou_scores") if hf else ("masks", "iou_predictions")
    if efficient:
        out = "output_masks"
    elif form == "sam2-by-shape":
        out, scores_name = "t9", "t10"
    four, single = form in ("sam2-osam",) or mobile, form == "sam2-by-shape"
    order = ["right_too"] if single else [*(["wide"] if four else []), "narrow", "right_too", "wide"]
    scores = [0.9] if single else [*([0.99] if four else []), 0.2, 0.9, 0.3]
    nodes += [
        ("Sub", ["right_too", "never"], ["narrow"]), ("Add", ["right_too", "never"], ["wide"]),
        ("Concat", order, ["joined"], {"axis": 1}),
    ]  # fmt: skip
    last = "joined"
    if size:
        nodes += _resized(size[0], mobile, len(order))
        last = "large"
    constants["never"] = np.float32(1e6)
    shape = [1, *lead, len(scores)]
    if lead:
        nodes.append(("Unsqueeze", [last, "one_axis"], [out]))
        constants["one_axis"] = np.array([1])
    else:
        nodes.append(("Identity", [last], [out]))
    nodes.append(("Identity", ["s"], [scores_name]))
    constants["s"] = np.array(scores, np.float32).reshape(shape)
    sides = ("oh", "ow") if size else (FINE, FINE)
    outputs = [value(out, 1, *lead, len(scores), *sides), value(scores_name, *shape)]
    if mobile:
        nodes.append(("Identity", ["joined"], ["low_res_masks"]))
        outputs.append(value("low_res_masks", 1, len(scores), FINE, FINE))
    constants |= {"one": np.array([1]), "count": np.array([1, len(order)]), "n1024": np.float32(SIDE),
                  "half": np.float32(0.5), "zero1": np.array([0]), "one1": np.array([1]), "two1": np.array([2]),
                  "axes": np.array([2, 3]), "starts": np.array([0, 0]), "square": np.array([SIDE, SIDE])}  # fmt: skip
    used = {name for node in nodes for name in (node[1] if isinstance(node, tuple) else node.input)}
    return save(path, nodes, inputs, outputs, {n: v for n, v in constants.items() if n in used})


def _discs(points: str, labels: str, fine: str, form: str, size: str) -> tuple[list, dict[str, np.ndarray]]:
    """Logits "right" (1, 1, 256, 256)."""
    at = (np.arange(FINE, dtype=np.float32) + 0.5) * SIDE / FINE
    constants = {
        "flat": np.array([1, -1, 1, 2]), "flat_labels": np.array([1, -1, 1, 1]), "centre": np.float32([0.5]),
        "to_grid": np.float32([2 / SIDE]), "whole": np.float32([1]), "gx": at[None, None, None, :],
        "gy": at[None, None, :, None], "first": np.array([0]), "second": np.array([1]), "last": np.array([3]),
        "more": np.float32([MORE]), "least": np.float32([LEAST]), "yes": np.float32([1]), "no": np.float32([0]),
        "off": np.float32([-1]), "far": np.float32([1e6]), "minus_far": np.float32([-1e6]), "ch": np.array([1]),
        "to1024": np.float32([SIDE]),
    }  # fmt: skip
    nodes = [
        ("Reshape", [points, "flat"], ["p0"]), ("Cast", [labels], ["lf"], {"to": F}),
        ("Reshape", ["lf", "flat_labels"], ["l"]),
        ("Add", ["p0", "centre"], ["p1"]),  # SAM's prompt encoder adds half a pixel
    ]  # fmt: skip
    if form == "efficient-sam":  # points are of the original image
        constants["flip"] = np.array([1, 0])
        nodes += [
            ("Cast", [size], ["hw"], {"to": F}), ("Gather", ["hw", "flip"], ["wh"]), ("Div", ["to1024", "wh"], ["k"]),
            ("Mul", ["p1", "k"], ["p"]),
        ]  # fmt: skip
    else:
        nodes.append(("Identity", ["p1"], ["p"]))
    nodes += [
        ("Mul", ["p", "to_grid"], ["p2"]), ("Sub", ["p2", "whole"], ["grid"]),
        ("GridSample", [fine, "grid"], ["colours"], {"mode": "bilinear", "align_corners": 0, "padding_mode": "border"}),
        ("Gather", ["colours", "first"], ["red0"], {"axis": 1}),  # (1, 1, n, 1)
        ("Transpose", ["red0"], ["red"], {"perm": [0, 2, 1, 3]}),
        ("Mul", ["red", "more"], ["r0"]), ("Add", ["r0", "least"], ["r"]),
        ("Gather", ["p", "first"], ["px"], {"axis": 3}), ("Gather", ["p", "second"], ["py"], {"axis": 3}),
        ("Sub", ["gx", "px"], ["dx"]), ("Sub", ["gy", "py"], ["dy"]), ("Mul", ["dx", "dx"], ["dx2"]),
        ("Mul", ["dy", "dy"], ["dy2"]), ("Add", ["dx2", "dy2"], ["d2"]), ("Sqrt", ["d2"], ["d"]),
        ("Sub", ["r", "d"], ["inside"]), ("Sub", ["d", "r"], ["outside"]),
        ("Equal", ["l", "yes"], ["is_in"]), ("Equal", ["l", "no"], ["is_out"]),
        ("Where", ["is_in", "inside", "minus_far"], ["in_logits"]),
        ("Where", ["is_out", "outside", "far"], ["out_logits"]),
        ("ReduceMax", ["in_logits", "ch"], ["in_any"], {"keepdims": 1}),
        ("ReduceMin", ["out_logits", "ch"], ["out_all"], {"keepdims": 1}),
        ("Min", ["in_any", "out_all"], ["found"]),
        # SAM 1 needs a point that is none, the others add it by themselves.
        ("ReduceMin", ["l"], ["lowest"], {"keepdims": 0}),
    ]  # fmt: skip
    if form.startswith("mobile-sam"):
        nodes += [("Equal", ["lowest", "off"], ["padded"]), ("Where", ["padded", "found", "minus_far"], ["right"])]
    else:
        nodes += [("Equal", ["lowest", "off"], ["padded"]), ("Where", ["padded", "minus_far", "found"], ["right"])]
    return nodes, constants


def _resized(size: str, crops: bool, count: int) -> list:
    """ "large" of "joined", at the size that is asked for; SAM 1 cuts its border off before."""
    nodes: list = [("Cast", [size], ["to"], {"to": I64})]
    if crops:
        nodes += [
            ("Cast", [size], ["f"], {"to": F}), ("ReduceMax", ["f"], ["longest"], {"keepdims": 0}),
            ("Div", ["n1024", "longest"], ["scale"]), ("Mul", ["f", "scale"], ["scaled"]),
            ("Add", ["scaled", "half"], ["up"]), ("Floor", ["up"], ["cut"]), ("Cast", ["cut"], ["ends"], {"to": I64}),
            ("Concat", ["count", "square"], ["all"], {"axis": 0}),
            ("Resize", ["joined", "", "", "all"], ["full"], {"mode": "linear"}),
            ("Slice", ["full", "starts", "ends", "axes"], ["content"]),
        ]  # fmt: skip
    else:
        nodes += [("Identity", ["joined"], ["content"])]
    return [
        *nodes,
        ("Concat", ["count", "to"], ["sizes"], {"axis": 0}),
        ("Resize", ["content", "", "", "sizes"], ["large"], {"mode": "linear"}),
    ]
