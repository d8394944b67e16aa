"""Networks of normals whose answer is known, with the signatures of common exports: n = 2 c - 1 of the color c."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from onnx_samples import F16, I64, F, save, value

MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
AXES = (-1.0, -1.0, -1.0)


def metric3d(path: Path, matrix: np.ndarray | None = None, offset: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Path:
    """`pixel_values` 0 to 255, three outputs, sides of multiples of 28; the normal is `matrix` (2 c - 1) + `offset`."""
    turn = np.eye(3) if matrix is None else matrix
    nodes = [
        # Sides that are no multiples of 28 are refused, as by the patches of a vision transformer.
        ("SpaceToDepth", ["pixel_values"], ["patches"], {"blocksize": 28}),
        ("DepthToSpace", ["patches"], ["whole"], {"blocksize": 28}),
        ("Conv", ["whole", "weights", "bias"], ["xyz"]),
        ("ReduceMean", ["xyz", "channel"], ["predicted_depth"], {"keepdims": 0}),
        ("Identity", ["xyz"], ["kept"]),
        ("ReduceMean", ["xyz", "channel"], ["kappa"], {"keepdims": 1}),
        ("Concat", ["kept", "kappa"], ["predicted_normal"], {"axis": 1}),
        ("Identity", ["predicted_depth"], ["normal_confidence"]),
    ]
    constants = {
        "weights": (2 / 255 * turn)[:, :, None, None].astype(np.float32),
        "bias": (np.array(offset) - turn.sum(axis=1)).astype(np.float32),
        "channel": np.array([1]),
    }
    outputs = [value("predicted_depth", 1, "h", "w"), value("predicted_normal", 1, 4, "h", "w"),
               value("normal_confidence", 1, "h", "w")]  # fmt: skip
    return save(path, nodes, [value("pixel_values", 1, 3, "h", "w")], outputs, constants)


def moge(path: Path) -> Path:
    """`image` 0 to 1 and a scalar `num_tokens`; channels last, and a mask that is 0 on black."""
    nodes = [
        ("Conv", ["image", "weights", "bias"], ["planes"]),
        ("Transpose", ["planes"], ["normal"], {"perm": [0, 2, 3, 1]}),
        ("Cast", ["num_tokens"], ["tokens"], {"to": 1}),
        ("Mul", ["tokens", "nothing"], ["zero"]),
        ("ReduceMax", ["image", "channel"], ["most"], {"keepdims": 0}),
        ("Mul", ["most", "much"], ["raised"]),
        ("Add", ["raised", "zero"], ["shifted"]),
        ("Clip", ["shifted", "nothing", "whole"], ["mask"]),
    ]
    constants = {
        "weights": (2 * np.eye(3, dtype=np.float32))[:, :, None, None],
        "bias": np.full(3, -1, np.float32),
        "nothing": np.float32(0), "whole": np.float32(1), "much": np.float32(1000), "channel": np.array([1]),
    }  # fmt: skip
    inputs = [value("image", 1, 3, "h", "w"), value("num_tokens", kind=I64)]
    return save(path, nodes, inputs, [value("normal", 1, "h", "w", 3), value("mask", 1, "h", "w")], constants)


def own(
    path: Path, size: tuple[int | str, int | str] = ("h", "w"), half: bool = False, toml: str | None = None
) -> Path:
    """An export of nobody's: ImageNet's range, the opposite signs, (n + 1) / 2; described in a file beside it."""
    kind, number = (F16, np.float16) if half else (F, np.float32)
    nodes = [("Mul", ["input", "std"], ["scaled"]), ("Add", ["scaled", "mean"], ["c"]), ("Sub", ["one", "c"], ["out"])]
    constants = {"std": np.array(STD, number)[None, :, None, None], "mean": np.array(MEAN, number)[None, :, None, None],
                 "one": np.array(1, number)}  # fmt: skip
    save(path, nodes, [value("input", 1, 3, *size, kind=kind)], [value("out", 1, 3, *size, kind=kind)], constants)
    said = f"mean = {list(MEAN)}\nstd = {list(STD)}\naxes = {list(AXES)}\nhalved = true\n" if toml is None else toml
    path.with_suffix(".toml").write_text(said)
    return path


def metric3d_official(path: Path, channels: int = 4) -> Path:
    """`image` (1, 3, 616, 1064), 0 to 255, with the normals added to the outputs of the official script."""
    nodes = [
        ("Conv", ["image", "weights", "bias"], ["xyz"]),
        ("ReduceMean", ["xyz", "channel"], ["pred_depth"], {"keepdims": 1}),
        ("Concat", ["xyz", *["pred_depth"] * (channels - 3)], ["out_normal"], {"axis": 1}),
    ]
    constants = {
        "weights": (2 / 255 * np.eye(3, dtype=np.float32))[:, :, None, None],
        "bias": np.full(3, -1, np.float32),
        "channel": np.array([1]),
    }
    size = 616, 1064
    outputs = [value("pred_depth", 1, 1, *size), value("out_normal", 1, channels, *size)]
    return save(path, nodes, [value("image", 1, 3, *size)], outputs, constants)
