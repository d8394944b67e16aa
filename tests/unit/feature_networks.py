"""Real networks that find and match keypoints, with the signatures of published exports of ALIKED and LightGlue.

Keypoints are the strongest corners of the blurred gray image, as a difference of Gaussians sees them. Descriptors are
the answers of fixed random filters. The matchers select nearest descriptors, or nearest keypoints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from onnx_samples import I64, save, value

DIM, _SIDE, _AT_MOST = 64, 17, 700


def extractor(path: Path, of_colmap: bool = True, seed: int = 1, dim: int = DIM) -> Path:
    """`image` of any size; `keypoints` (1, N, 2) from -1 to 1 with `of_colmap`, which also takes `max_keypoints` and
    `min_score`; else pixels. `seed` < 0 gives descriptors that tell nothing: those of a white image."""
    rng = np.random.default_rng(abs(seed))
    at = np.arange(_SIDE) - _SIDE // 2

    def gauss(sigma: float) -> np.ndarray:
        one = np.exp(-(at**2) / (2 * sigma**2))
        both = np.outer(one, one)
        return both / both.sum()

    filters = rng.normal(size=(dim, _SIDE, _SIDE)) * gauss(4.0)
    filters -= gauss(4.0) * filters.sum(axis=(1, 2), keepdims=True)
    constants = {
        "third": np.full((1, 3, 1, 1), 1 / 3, np.float32),
        "contrast": (gauss(1.5) - gauss(2.5)).astype(np.float32)[None, None],
        "filters": (filters * (0 if seed < 0 else 1)).astype(np.float32)[:, None],
        "flat": np.array([-1], np.int64),
        "rows": np.array([1, dim, -1], np.int64),
        "most": np.array([_AT_MOST], np.int64),
        "zero": np.array(0, np.int64),
        "two": np.array([2], np.int64), "three": np.array([3], np.int64), "four": np.array([4], np.int64),
        "first": np.array([0], np.int64), "last": np.array([2], np.int64),
        "one": np.array(1.0, np.float32), "twice": np.array(2.0, np.float32),
        "tiny": np.array(1e-6, np.float32), "scale": np.array(50.0, np.float32),
    }  # fmt: skip
    pad = [_SIDE // 2] * 4
    nodes = [
        ("Conv", ["image", "third"], ["gray"]),
        ("Conv", ["gray", "contrast"], ["response"], {"pads": pad}),
        ("Abs", ["response"], ["strength"]),
        ("MaxPool", ["strength"], ["peaks"], {"kernel_shape": [7, 7], "pads": [3] * 4}),
        ("Equal", ["strength", "peaks"], ["is_peak"]),
        ("Sub", ["strength", "strength"], ["nothing"]),
        ("Where", ["is_peak", "strength", "nothing"], ["corners"]),
        ("Reshape", ["corners", "flat"], ["all"]),
        ("TopK", ["all", "most"], ["best", "which"]),
        ("Mul", ["best", "scale"], ["strong"]),
        ("Greater", ["strong", "min_score"] if of_colmap else ["strong", "tiny"], ["good"]),
        ("Compress", ["which", "good"], ["kept"], {"axis": 0}),
        ("Compress", ["strong", "good"], ["flat_scores"], {"axis": 0}),
        ("Unsqueeze", ["flat_scores", "first"], ["scores"]),
        ("Shape", ["image"], ["shape"]),
        ("Slice", ["shape", "three", "four"], ["width"]),
        ("Slice", ["shape", "two", "three"], ["height"]),
        ("Div", ["kept", "width"], ["y"]),
        ("Mod", ["kept", "width"], ["x"]),
        ("Unsqueeze", ["x", "first"], ["x1"]), ("Unsqueeze", ["x1", "last"], ["x2"]),
        ("Unsqueeze", ["y", "first"], ["y1"]), ("Unsqueeze", ["y1", "last"], ["y2"]),
        ("Concat", ["x2", "y2"], ["xy"], {"axis": 2}),
        ("Cast", ["xy"], ["pixels" if of_colmap else "keypoints"], {"to": 1}),
        ("Conv", ["gray", "filters"], ["dense"], {"pads": pad}),
        ("Reshape", ["dense", "rows"], ["by_pixel"]),
        ("Gather", ["by_pixel", "kept"], ["looks"], {"axis": 2}),
        ("Transpose", ["looks"], ["raw"], {"perm": [0, 2, 1]}),
        ("Add", ["raw", "tiny"], ["descriptors"]),
    ]  # fmt: skip
    inputs = [value("image", 1, 3, "h", "w")]
    if of_colmap:
        nodes += [
            ("Concat", ["width", "height"], ["sides"], {"axis": 0}),
            ("Cast", ["sides"], ["sizes"], {"to": 1}),
            ("Sub", ["sizes", "one"], ["spans"]),
            ("Mul", ["pixels", "twice"], ["doubled"]),
            ("Div", ["doubled", "spans"], ["shares"]),
            ("Sub", ["shares", "one"], ["keypoints"]),
        ]
        inputs += [value("max_keypoints", kind=I64), value("min_score")]
    outputs = [value("keypoints", 1, "n", 2), value("scores", 1, "n"), value("descriptors", 1, "n", dim)]
    return save(path, nodes, inputs, outputs, constants)


def matcher(path: Path, of_colmap: bool = True, by_keypoints: bool = False) -> Path:
    """COLMAP's: takes `image_size0` and `image_size1`; `matches0` is the match of each keypoint or -1. Else `matches0`
    are pairs. Mutual nearest descriptors match, or mutual nearest keypoints if `by_keypoints`."""
    constants = {
        "none": np.array(-1, np.int64), "second": np.array([2], np.int64), "minus": np.array(-2.0, np.float32),
        "first": np.array([0], np.int64), "column": np.array([1], np.int64),
        "axis": np.array([2], np.int64),
    }  # fmt: skip
    if by_keypoints:  # - |a - b|^2 = 2 a b - a^2 - b^2
        nodes = [
            ("Transpose", ["kpts1"], ["turned"], {"perm": [0, 2, 1]}),
            ("MatMul", ["kpts0", "turned"], ["product"]), ("Mul", ["product", "minus"], ["negative"]),
            ("ReduceSumSquare", ["kpts0", "axis"], ["a"]), ("ReduceSumSquare", ["kpts1", "axis"], ["b"]),
            ("Transpose", ["b"], ["bt"], {"perm": [0, 2, 1]}),
            ("Add", ["a", "bt"], ["sum"]), ("Add", ["sum", "negative"], ["off"]), ("Neg", ["off"], ["nearness"]),
            ("Exp", ["nearness"], ["likeness"]),
        ]  # fmt: skip
    else:
        nodes = [
            ("LpNormalization", ["desc0"], ["unit0"], {"axis": 2}),
            ("LpNormalization", ["desc1"], ["unit1"], {"axis": 2}),
            ("Transpose", ["unit1"], ["turned"], {"perm": [0, 2, 1]}), ("MatMul", ["unit0", "turned"], ["likeness"]),
        ]  # fmt: skip
    nodes += [
        ("ArgMax", ["likeness"], ["best"], {"axis": 2, "keepdims": 1}),
        ("ArgMax", ["likeness"], ["back"], {"axis": 1, "keepdims": 0}),
        ("Squeeze", ["best", "second"], ["to"]),
        ("GatherElements", ["back", "to"], ["home"], {"axis": 1}),
        ("Shape", ["to"], ["shape"]),
        ("ConstantOfShape", ["shape"], ["ones"], {"value": _one()}),
        ("CumSum", ["ones", "last"], ["own"], {"exclusive": 1}),
        ("Equal", ["home", "own"], ["mutual"]),
        ("ReduceMax", ["likeness", "axis"], ["top"], {"keepdims": 0}),
    ]
    constants["last"] = np.array(1, np.int64)
    sizes = [value("image_size0", 1, 2), value("image_size1", 1, 2)] if of_colmap else []
    if of_colmap:
        nodes += [
            ("Where", ["mutual", "to", "none"], ["matched"]),
            ("Squeeze", ["matched", "first"], ["matches0"]),
            ("Squeeze", ["top", "first"], ["mscores0"]),
        ]
        outputs = [value("matches0", "n", kind=I64), value("mscores0", "n")]
    else:
        nodes += [
            ("Squeeze", ["mutual", "first"], ["good"]),
            ("Squeeze", ["own", "first"], ["a"] if not by_keypoints else ["own1"]),
            ("Squeeze", ["to", "first"], ["to1"]),
            ("Unsqueeze", ["own1" if by_keypoints else "a", "column"], ["left"]),
            ("Unsqueeze", ["to1", "column"], ["right"]),
            ("Concat", ["left", "right"], ["pairs"], {"axis": 1}),
            ("Compress", ["pairs", "good"], ["matches0"], {"axis": 0}),
            ("Squeeze", ["top", "first"], ["top1"]),
            ("Compress", ["top1", "good"], ["mscores0"], {"axis": 0}),
        ]
        outputs = [value("matches0", "m", 2, kind=I64), value("mscores0", "m")]
    inputs = [
        value("kpts0", 1, "n", 2), value("kpts1", 1, "k", 2), value("desc0", 1, "n", "d"), value("desc1", 1, "k", "d"),
        *sizes,
    ]  # fmt: skip
    return save(path, nodes, inputs, outputs, constants)


def _one():  # type: ignore[no-untyped-def]
    from onnx import numpy_helper

    return numpy_helper.from_array(np.array([1], np.int64))
