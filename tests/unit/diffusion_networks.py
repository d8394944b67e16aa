"""Four graphs with the signatures of GeoWizard's parts whose answer is known: a perfect denoiser, which says of every
noisy latent what leads to those of the photo, where the switch says normals, and to nothing where it says depth. The
decoder gives back what was encoded, so that the normal is written in the color, n = 2 c - 1."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from onnx_samples import I64, save, value

SCALE = 0.18215


def alphas(trained: int = 1000, first: float = 0.00085, last: float = 0.012) -> np.ndarray:
    """(trained,) by hand: the product of 1 - beta up to each step."""
    found, product = [], 1.0
    for k in range(trained):
        beta = (first**0.5 + (last**0.5 - first**0.5) * k / (trained - 1)) ** 2
        product *= 1 - beta
        found.append(product)
    return np.array(found)


def geowizard(folder: Path) -> tuple[Path, Path, Path, Path]:
    folder.mkdir(exist_ok=True)
    clip = save(
        folder / "image_encoder.onnx",
        [("ReduceMean", ["pixel_values", "axes"], ["mean"], {"keepdims": 0}), ("Mul", ["mean", "none"], ["zero"]),
         ("Add", ["zero", "one"], ["image_embeds"])],
        [value("pixel_values", 1, 3, 224, 224)], [value("image_embeds", 1, 768)],
        {"axes": np.array([1, 2, 3]), "none": np.zeros((1, 768), np.float32), "one": np.ones((1, 768), np.float32)},
    )  # fmt: skip
    weights = np.zeros((4, 3, 1, 1), np.float32)
    weights[:3, :, 0, 0] = np.eye(3)
    encoder = save(
        folder / "vae_encoder.onnx",
        [("AveragePool", ["sample"], ["small"], {"kernel_shape": [8, 8], "strides": [8, 8]}),
         ("Conv", ["small", "weights"], ["latent_sample"])],
        [value("sample", 1, 3, "h", "w")], [value("latent_sample", 1, 4, "h8", "w8")], {"weights": weights},
    )  # fmt: skip
    nodes = [
        # (x - sqrt(a) x0) / sqrt(1 - a) is the noise, and sqrt(a) noise - sqrt(1 - a) x0 the velocity.
        ("Gather", ["alphas", "timestep"], ["a"]), ("Sqrt", ["a"], ["kept0"]), ("Sub", ["one", "a"], ["rest"]),
        ("Sqrt", ["rest"], ["noisy0"]), ("Reshape", ["kept0", "four"], ["kept"]),
        ("Reshape", ["noisy0", "four"], ["noisy"]),
        ("Split", ["sample"], ["photo", "state"], {"axis": 1, "num_outputs": 2}),
        ("Slice", ["class_labels", "zero", "first", "axis"], ["label"]), ("Reshape", ["label", "wide"], ["switch"]),
        ("Div", ["switch", "sine"], ["share"]), ("Mul", ["photo", "share"], ["clean0"]),
        ("ReduceMean", ["encoder_hidden_states", "last"], ["hidden"], {"keepdims": 1}),
        ("Reshape", ["hidden", "wide"], ["hidden4"]), ("Mul", ["clean0", "hidden4"], ["clean"]),
        ("Mul", ["kept", "clean"], ["k0"]), ("Sub", ["state", "k0"], ["n0"]), ("Div", ["n0", "noisy"], ["noise"]),
        ("Mul", ["kept", "noise"], ["v0"]), ("Mul", ["noisy", "clean"], ["v1"]), ("Sub", ["v0", "v1"], ["out_sample"]),
    ]  # fmt: skip
    constants = {
        "alphas": alphas().astype(np.float32), "one": np.float32([1]), "four": np.array([-1, 1, 1, 1]),
        "wide": np.array([2, 1, 1, 1]), "zero": np.array([0]), "first": np.array([1]), "axis": np.array([1]),
        "sine": np.float32([np.sin(1.0)]), "last": np.array([2]),
    }  # fmt: skip
    inputs = [value("sample", 2, 8, "h", "w"), value("timestep", 2, kind=I64),
              value("encoder_hidden_states", 2, 1, 768), value("class_labels", 2, 10)]  # fmt: skip
    unet = save(folder / "unet.onnx", nodes, inputs, [value("out_sample", 2, 4, "h", "w")], constants)
    back = np.zeros((3, 4, 1, 1), np.float32)
    back[:, :3, 0, 0] = np.eye(3)
    decoder = save(
        folder / "vae_decoder.onnx",
        [("Conv", ["latent_sample", "weights"], ["small"]),
         ("Resize", ["small", "", "scales"], ["sample"], {"mode": "nearest"})],
        [value("latent_sample", 1, 4, "h", "w")], [value("sample", 1, 3, "h8", "w8")],
        {"weights": back, "scales": np.float32([1, 1, 8, 8])},
    )  # fmt: skip
    return clip, encoder, unet, decoder
