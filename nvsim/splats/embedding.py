"""The appearance embedding: a short vector that describes lighting and exposure at a camera position. The background
and the colors of Gaussians depend on it.

There are two kinds. The position embedding (paper, section III-C, camera pose embedding) is a network of the camera
position, defined everywhere. The index embedding (Splatfacto-W, Xu et al. 2024) has one vector per training image. At
other positions it is the mean of all vectors, or the vector of the nearest training camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]


@dataclass(eq=False)
class Embedding:
    """An appearance embedding of one of the two kinds.

    weights   named float32 arrays. Position: layer i as "embed.i.weight" (out, in) and "embed.i.bias" (out,), with ReLU
              between the layers and none after the last. Index: "index.vectors" (V, E) and "index.positions" (V, 3),
              the training cameras in meters, world. Other names are ignored
    octaves   position: number of octaves of sines and cosines of position / `period` in the network's input. The input
              is, per axis, position / `period`, then the sine of each octave, then the cosine of each octave
    period    meters
    nearest   index: whether to use the vector of the nearest training camera instead of the mean
    """

    weights: dict[str, Float32]
    octaves: int = 4
    period: float = 5.0
    nearest: bool = False

    def at(self, position: NDArray[np.floating]) -> Float32:
        """(E,) float32: the embedding of a camera at `position` (3,), meters, world."""
        vectors = self.weights.get("index.vectors")
        if vectors is not None:
            if not self.nearest:
                return np.asarray(vectors.mean(axis=0), np.float32)
            distance = np.linalg.norm(self.weights["index.positions"] - np.asarray(position, np.float32), axis=1)
            return vectors[int(distance.argmin())]
        x = np.asarray(position, np.float32) / np.float32(self.period)
        phases = x[:, None] * (2.0 ** np.arange(self.octaves, dtype=np.float32))
        h = np.concatenate([x[:, None], np.sin(phases), np.cos(phases)], axis=1).reshape(-1)
        last = layer_count(self.weights, "embed") - 1
        for i in range(last + 1):
            h = self.weights[f"embed.{i}.weight"] @ h + self.weights[f"embed.{i}.bias"]
            if i < last:
                h = np.maximum(h, 0)
        return np.asarray(h, np.float32)


def layer_count(weights: dict[str, Float32], part: str) -> int:
    """The number of layers "part.0.weight", "part.1.weight", ... in `weights`."""
    count = 0
    while f"{part}.{count}.weight" in weights:
        count += 1
    return count
