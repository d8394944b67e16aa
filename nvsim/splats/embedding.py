"""The appearance embedding: a short vector that says how things look from a place, for the background and the colours.

Two kinds. Of the position (paper, section III-C, camera pose embedding): a network of the camera position, defined
everywhere. Of the index (Splatfacto-W, Xu et al. 2024): one vector per training image; elsewhere the mean of all, or
the vector of the nearest training camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]


@dataclass(eq=False)
class Embedding:
    """weights   named float32 arrays. Of the position: layer i as "embed.i.weight" (out, in) and "embed.i.bias" (out,),
              ReLU between the layers, none after the last. Of the index: "index.vectors" (V, E) and "index.positions"
              (V, 3), the training cameras in metres, world. Other names are not looked at
    octaves   of the position: number of octaves of sines and cosines of position / `period` that the network takes,
              after the position / `period` itself; per axis: value, sin of each octave, cos of each octave
    period    metres
    nearest   of the index: whether the vector of the nearest training camera is taken instead of the mean
    """

    weights: dict[str, Float32]
    octaves: int = 4
    period: float = 5.0
    nearest: bool = False

    def at(self, position: NDArray[np.floating]) -> Float32:
        """(E,) the embedding of a camera at `position` (3,), metres, world."""
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
    """How many layers "part.0.weight", "part.1.weight", ... there are."""
    count = 0
    while f"{part}.{count}.weight" in weights:
        count += 1
    return count
